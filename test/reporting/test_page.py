from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from radcam_depth_ros.files import FileError
from radcam_depth_ros.reporting.errors import ReportError
from radcam_depth_ros.reporting.page import write_report
from radcam_depth_ros.reporting.panel import Highlight, Panel, draw_panel
from radcam_depth_ros.reporting.pictures import TILE_WIDTH
from radcam_depth_ros.reporting.plot import Curve, Plot
from radcam_depth_ros.reporting.table import Fact, Table

TITLES = [
    "camera and radar",
    "semi-dense depth",
    "dense depth",
    "ground truth",
    "error of the dense depth",
    "error of geometry alone",
]


def make_panel(width=64, height=48, **changes):
    depth = np.full((height, width), 20.0, np.float32)
    semi_dense = np.where(np.arange(width) < width // 4, depth, np.float32(np.nan))
    values = {
        "title": "frame 0",
        "image": np.full((height, width, 3), 90, np.uint8),
        "radar_uv": np.array([[10.0, 20.0], [30.0, 20.0]], np.float32),
        "radar_depth_m": np.array([5.0, 40.0], np.float32),
        "semi_dense": semi_dense,
        "dense": depth,
        "ground_truth": depth + 1,
        "geometry": depth - 1,
    }
    return Panel(**{**values, **changes})


class Page(HTMLParser):
    """Collects what a page shows, and that it closes what it opens."""

    def __init__(self, text):
        super().__init__()
        self.pictures, self.texts, self.open, self.references = [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag == "img":
            self.pictures.append((values["alt"], values["src"]))
        self.references += [values[name] for name in ("src", "href") if name in values]
        if tag not in ("img", "meta"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if data.strip():
            self.texts.append(data.strip())


def decode(source):
    return cv2.imdecode(np.frombuffer(base64.b64decode(source.partition("base64,")[2]), np.uint8), cv2.IMREAD_COLOR)


def test_a_report_is_one_page_with_everything_in_it(tmp_path):
    path = tmp_path / "new" / "report.html"
    table = Table("Error", ("", "MAE <50 m>"), (("dense", "1.23"), ("geometry alone", "4.56")), "A note & more.")
    write_report(path, "A drive <1>", [Fact("network", "baff & co")], [table], [make_panel(), make_panel()])
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    assert [alt for alt, _ in page.pictures] == TITLES * 2
    for _, source in page.pictures:
        assert decode(source).shape == (48, 64, 3)
    for shown in ("A drive <1>", "baff & co", "MAE <50 m>", "4.56", "A note & more.", "frame 0", "2 m", "80 m"):
        assert shown in page.texts
    # Nothing is loaded from elsewhere: every reference is a data URI.
    assert all(reference.startswith(("data:image/", "#")) for reference in page.references)
    assert all(url.startswith("data:image/png") for url in re.findall(r"url\(([^)]*)\)", text))
    assert not re.search(r"https?://|<script|@import", text)
    assert [entry.name for entry in path.parent.iterdir()] == ["report.html"]


def test_pictures_come_before_tables(tmp_path):
    path = tmp_path / "report.html"
    table = Table("Error", ("", "MAE"), (("dense", "1.23"),))
    highlights = [Highlight("the best frame", make_panel()), Highlight("the worst frame", make_panel(title="frame 9"))]
    write_report(path, "A drive", tables=[table], panels=[make_panel()], highlights=highlights)
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    assert [alt for alt, _ in page.pictures[:6]] == [TITLES[0], TITLES[2], TITLES[4]] * 2
    assert page.texts.index("The best frame") < page.texts.index("frame 9") < page.texts.index("Error")
    targets = [reference[1:] for reference in page.references if reference.startswith("#")]
    assert targets == ["tables", "frames"]
    assert all(f'id="{target}"' in text for target in targets)
    assert 'role="region" tabindex="0" aria-label="Error"' in text


def test_a_report_may_be_bare(tmp_path):
    write_report(tmp_path / "report.html", "Nothing yet")
    assert "Nothing yet" in Page((tmp_path / "report.html").read_text(encoding="utf-8")).texts


def test_what_a_panel_lacks_is_left_out():
    tiles = draw_panel(make_panel(ground_truth=None, geometry=None))
    assert [tile.title for tile in tiles] == TITLES[:3]
    tiles = draw_panel(make_panel(dense=None, semi_dense=None, geometry=None))
    assert [tile.title for tile in tiles] == ["camera and radar", "ground truth"]


def test_a_panel_of_another_size_is_refused():
    with pytest.raises(ReportError, match=r"dense of a panel must be \(48, 64\)"):
        make_panel(dense=np.ones((24, 32), np.float32))


def test_pictures_are_no_wider_than_a_tile():
    for tile in draw_panel(make_panel(width=2048, height=618)):
        assert tile.image.shape == (round(618 * TILE_WIDTH / 2048), TILE_WIDTH, 3)


def test_curves_are_drawn_before_the_frames(tmp_path):
    path = tmp_path / "report.html"
    plots = [Plot("Error <over> distance", "m", "m", (Curve("dense", (0, 1), (1, 2)),), "A note.")]
    write_report(path, "A drive", panels=[make_panel()], plots=plots)
    page = Page(path.read_text(encoding="utf-8"))
    assert [alt for alt, _ in page.pictures] == ["Error <over> distance", *TITLES]
    kind, _, data = page.pictures[0][1].partition(";base64,")
    assert kind == "data:image/svg+xml"
    assert b"<svg" in base64.b64decode(data)
    assert "A note." in page.texts


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path):
    (tmp_path / "taken").write_text("a file", encoding="utf-8")
    with pytest.raises(FileError, match=r"cannot write .*taken"):
        write_report(tmp_path / "taken" / "report.html", "A report")
    assert [entry.name for entry in tmp_path.iterdir()] == ["taken"]
