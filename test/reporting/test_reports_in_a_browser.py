"""The reports of `evaluate` and of the demo in a real browser, wide and narrow, and by keyboard."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from browser import NARROW, SIZES, Look, browser

ROOT = Path(__file__).parents[2]
pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(1200)]


def run(*command: object) -> None:
    subprocess.run(
        [sys.executable, "-m", *map(str, command)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=True,
        timeout=900,
        stdin=subprocess.DEVNULL,
    )


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The page of each command that writes one, of one simulated drive."""
    with browser():  # skips before the drive is simulated
        pass
    folder = tmp_path_factory.mktemp("reports")
    run("demo", "--out", folder / "demo", "--frames", 5)
    evaluated = folder / "evaluation.html"
    run("radcam_depth_ros.cli", "evaluate", folder / "demo" / "drive.mcap", "--report", evaluated)
    return {"demo": folder / "demo" / "report.html", "evaluate": evaluated}


@pytest.mark.parametrize("size", SIZES, ids=["wide", "narrow"])
@pytest.mark.parametrize("name", ["demo", "evaluate"])
def test_a_report_shows_its_pictures_first(
    reports: dict[str, Path], tmp_path: Path, name: str, size: tuple[int, int]
) -> None:
    with browser() as chromium:
        look = Look(chromium, size)
        look.check(reports[name].as_uri(), tmp_path / f"{name}.png")
        page = look.page
        titles = page.locator(".first h2").all_inner_texts()
        assert titles == ["The best frame", "The middle frame", "The worst frame"]
        for article in page.locator(".first article").all():
            for picture in article.locator("img").all()[:2]:
                box = picture.bounding_box()
                assert box["width"] > 100
                assert box["y"] + box["height"] <= size[1], "not in the first screen"
        assert page.evaluate("() => [...document.images].every((image) => image.alt && image.naturalWidth > 0)")
        first_table = page.locator("table").first.bounding_box()
        assert first_table["y"] > size[1] / 2


def focused(page: Any) -> tuple[str, bool]:
    """What has the focus, and whether that can be seen."""
    tag, style = page.evaluate(
        "() => [document.activeElement.outerHTML.slice(0, 80), getComputedStyle(document.activeElement).outlineStyle]"
    )
    return str(tag), style != "none"


@pytest.mark.parametrize("name", ["demo", "evaluate"])
def test_a_report_can_be_used_by_keyboard(reports: dict[str, Path], tmp_path: Path, name: str) -> None:
    with browser() as chromium:
        look = Look(chromium, NARROW)
        look.check(reports[name].as_uri(), tmp_path / f"{name}.png")
        page = look.page
        count: Callable[[str], int] = lambda selector: page.locator(selector).count()  # noqa: E731
        stops = count("nav a") + count(".wide")
        assert count("nav a") >= 3
        scrolled = 0
        for stop in range(stops):
            page.keyboard.press("Tab")
            element, is_seen = focused(page)
            assert is_seen, element
            if stop == 1:
                page.keyboard.press("Enter")
                assert page.evaluate("() => location.hash") == "#tables"
                page.evaluate("() => document.querySelectorAll('nav a')[1].focus()")
            if 'role="region"' in element:
                page.keyboard.press("ArrowRight")
                page.wait_for_timeout(300)
                scrolled += page.evaluate("() => document.activeElement.scrollLeft > 0")
        assert scrolled, "no table that is too wide was moved by the arrow keys"
        assert look.problems == []
