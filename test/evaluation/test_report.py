from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from radcam_depth_ros.drive import Sample
from radcam_depth_ros.evaluation.drive import Drive, FrameMeasures, Observation
from radcam_depth_ros.evaluation.metrics import EvaluationError
from radcam_depth_ros.evaluation.panels import (
    ERROR_M,
    TILE_WIDTH,
    Panel,
    PanelKeeper,
    colour_error,
    draw_depth,
    draw_error,
    draw_panel,
    draw_radar,
)
from radcam_depth_ros.evaluation.plots import Curve, Plot
from radcam_depth_ros.evaluation.report import write_report
from radcam_depth_ros.evaluation.tables import Fact, Table
from radcam_depth_ros.files import FileError
from radcam_depth_ros.frame import CameraModel, DepthResult, Frame, RadarReturns
from radcam_depth_ros.messages import colorise

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


def make_observation(index, mae_m=1.0, bag=""):
    camera = CameraModel(16, 12, 10.0, 10.0, 7.5, 5.5)
    depth = np.full((12, 16), 20.0, np.float32)
    frame = Frame(index, "camera", np.zeros((12, 16, 3), np.uint8), camera, RadarReturns.empty())
    result = DepthResult(index, "camera", camera, depth, depth, depth, 0)
    measures = FrameMeasures(np.full((3, 8), mae_m), {}, 1.0, mae_m, 0, 0.1)
    return Observation(
        Drive([], bag), index, Sample(frame, (), depth, "exact"), result, {"ground_nearest": depth}, measures
    )


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
    assert all(reference.startswith("data:image/") for reference in page.references)
    assert all(url.startswith("data:image/png") for url in re.findall(r"url\(([^)]*)\)", text))
    assert not re.search(r"https?://|<script|@import", text)
    assert [entry.name for entry in path.parent.iterdir()] == ["report.html"]


def test_a_report_may_be_bare(tmp_path):
    write_report(tmp_path / "report.html", "Nothing yet")
    assert "Nothing yet" in Page((tmp_path / "report.html").read_text(encoding="utf-8")).texts


def test_what_a_panel_lacks_is_left_out():
    tiles = draw_panel(make_panel(ground_truth=None, geometry=None))
    assert [tile.title for tile in tiles] == TITLES[:3]
    tiles = draw_panel(make_panel(dense=None, semi_dense=None, geometry=None))
    assert [tile.title for tile in tiles] == ["camera and radar", "ground truth"]


def test_a_panel_of_another_size_is_refused():
    with pytest.raises(EvaluationError, match=r"dense of a panel must be \(48, 64\)"):
        make_panel(dense=np.ones((24, 32), np.float32))


def test_depth_has_the_colours_of_the_scale():
    depth = np.linspace(2, 80, 48 * 64, dtype=np.float32).reshape(48, 64)
    depth[0, 0] = np.nan
    drawn = draw_depth(depth)
    np.testing.assert_array_equal(drawn[1:], colorise(depth, 2.0, 80.0)[1:])
    assert drawn[0, 0].tolist() == [34, 34, 34]
    beyond = draw_depth(np.full((4, 4), np.inf, np.float32))
    np.testing.assert_array_equal(beyond, colorise(np.full((4, 4), 80.0, np.float32), 2.0, 80.0))


def test_pictures_are_no_wider_than_a_tile():
    for tile in draw_panel(make_panel(width=2048, height=618)):
        assert tile.image.shape == (round(618 * TILE_WIDTH / 2048), TILE_WIDTH, 3)


def test_single_lidar_points_can_be_seen():
    truth = np.full((900, 1600), np.nan, np.float32)
    truth[450, 801] = 10.0
    drawn = draw_depth(truth)
    assert 4 <= (drawn != 34).any(axis=2).sum() <= 40
    error = draw_error(np.full((900, 1600), 15.0, np.float32), truth)
    assert 4 <= (error != 34).any(axis=2).sum() <= 40


def test_errors_are_red_where_too_near_and_blue_where_too_far():
    near, right, far, unknown = colour_error(np.array([[-ERROR_M * 2, 0.0, ERROR_M, np.nan]], np.float32))[0].tolist()
    assert near[0] > 150 > near[2]
    assert far[2] > 150 > far[0]
    assert min(right) > 240
    assert unknown == [34, 34, 34]


def test_errors_without_truth_are_unknown():
    truth = np.array([[10.0, np.nan, np.inf, 0.0]], np.float32)
    drawn = draw_error(np.full((1, 4), 10.0, np.float32), truth)
    assert (drawn[0] == 34).all(axis=1).tolist() == [False, True, True, True]


def test_radar_is_drawn_the_nearest_on_top():
    image = np.full((48, 64, 3), 90, np.uint8)
    image.setflags(write=False)
    uv = np.array([[20, 20], [20, 20], [-5, 400], [np.nan, np.nan], [1e20, 5]], np.float32)
    drawn = draw_radar(image, uv, np.array([5.0, 40.0, 10.0, -3.0, 10.0], np.float32))
    assert drawn[20, 20].tolist() == colorise(np.full((1, 1), 5.0, np.float32), 2.0, 80.0)[0, 0].tolist()
    assert (drawn[:, 40:] == 90).all()
    np.testing.assert_array_equal(draw_radar(image, uv[:0], np.zeros(0, np.float32)), image)


@pytest.mark.parametrize("frames", [0, 1, 3, 10, 11, 57, 1000])
def test_evenly_spaced_frames_are_kept(frames):
    keeper = PanelKeeper(5, worst=1)
    for index in range(frames):
        keeper.add(make_observation(index, mae_m=float(index == frames // 2)))
        assert len(keeper._kept) <= 10
    titles = [panel.title for panel in keeper.panels()]
    even = [int(re.match(r"frame (\d+),", title)[1]) for title in titles if "worst" not in title]
    assert len(even) == min(frames, 5)
    assert even == sorted(set(even))
    assert frames < 5 or max(np.diff(even)) <= 2 * min(np.diff(even))
    assert frames == 0 or even[-1] >= (frames - 1) / 2
    assert [title for title in titles if "worst" in title] == titles[5 if frames >= 5 else frames :]
    assert frames == 0 or titles[-1].startswith(f"frame {frames // 2},")


def test_the_worst_frames_are_kept_the_worst_first():
    keeper = PanelKeeper(0, worst=3)
    for index in range(20):
        keeper.add(make_observation(index, mae_m=float(index * 7 % 20), bag="night"))
    titles = [panel.title for panel in keeper.panels()]
    assert [re.search(r"MAE (\d+)", title)[1] for title in titles] == ["19", "18", "17"]
    assert titles[0].startswith("frame 17 of night,")
    assert titles[0].endswith("the worst")
    assert titles[2].endswith("number 3 of the worst")


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


def test_without_ground_truth_no_frame_is_the_worst():
    keeper = PanelKeeper(2)
    keeper.add(make_observation(0, float("nan")))
    assert [panel.title for panel in keeper.panels()] == ["frame 0, stamp 0.000 s"]


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path):
    (tmp_path / "taken").write_text("a file", encoding="utf-8")
    with pytest.raises(FileError, match=r"cannot write .*taken"):
        write_report(tmp_path / "taken" / "report.html", "A report")
    assert [entry.name for entry in tmp_path.iterdir()] == ["taken"]
