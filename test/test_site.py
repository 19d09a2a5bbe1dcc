"""The docs' site: every page is in it and is reached, and looks right in a real browser, wide and narrow."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urldefrag

import pytest
import yaml
from browser import SIZES, Look, browser, served

ROOT = Path(__file__).parents[1]


class _Loader(yaml.SafeLoader):
    """Takes mkdocs' tags for what they are beside: text."""


_Loader.add_multi_constructor("", lambda *_: None)


def in_navigation(entry: Any) -> Iterator[str]:
    if isinstance(entry, str):
        yield entry
    for inner in entry.values() if isinstance(entry, dict) else entry if isinstance(entry, list) else ():
        yield from in_navigation(inner)


def test_every_page_is_in_the_navigation() -> None:
    settings = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), _Loader)
    listed = [path for path in in_navigation(settings["nav"]) if path.endswith(".md")]
    pages = runpy.run_path(str(ROOT / "scripts" / "documented_commands.py"))["pages"]()
    made = {"changes.md", *(f"notebooks/{path.stem}.md" for path in (ROOT / "notebooks").glob("*.ipynb"))}
    assert sorted(listed) == sorted({*pages, "CONTRIBUTING.md", "SECURITY.md", "CODE_OF_CONDUCT.md", *made})


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs", reason="the extra `docs` is not installed")
    folder = tmp_path_factory.mktemp("site")
    # Not with --quiet: what is not told is not counted either, and a broken link passes.
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


def pages_of(site: Path) -> set[str]:
    found = {path.parent.relative_to(site).as_posix() for path in site.rglob("index.html")}
    return {"" if path == "." else f"{path}/" for path in found}


@pytest.mark.exhaustive
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("size", SIZES, ids=["wide", "narrow"])
def test_pages_look_right_in_a_browser(site: Path, tmp_path: Path, size: tuple[int, int]) -> None:
    """Each is reached from the first by links; nothing fails, nothing is loaded from elsewhere, nothing is too wide."""
    seen: set[str] = set()
    with served(site) as address, browser() as chromium:
        look = Look(chromium, size)
        waiting = [""]
        while waiting:
            place = waiting.pop()
            if place in seen:
                continue
            seen.add(place)
            look.check(address + place, tmp_path / f"{place.replace('/', '_') or 'home'}.png")
            links = look.page.evaluate("() => [...document.links].map((link) => link.href)")
            inside = {urldefrag(link)[0].removeprefix(address) for link in links if link.startswith(address)}
            waiting += sorted(link for link in inside if link == "" or link.endswith("/"))
        text = "() => [...document.querySelectorAll('article p')].map((part) => part.textContent)"
        assert not [part for part in look.page.evaluate(text) if part.lstrip().startswith(("- ", "| ", "```"))]
    assert seen == pages_of(site)


@pytest.mark.exhaustive
@pytest.mark.timeout(900)
def test_the_search_finds_and_the_video_plays(site: Path, tmp_path: Path) -> None:
    with served(site) as address, browser() as chromium:
        look = Look(chromium, SIZES[0])
        look.check(f"{address}docs/tutorials/first_run/", tmp_path / "first_run.png")
        video = look.page.locator("video")
        video.evaluate("(video) => video.play()")
        look.page.wait_for_function("() => document.querySelector('video').currentTime > 0.2", timeout=60_000)
        look.page.keyboard.press("/")
        look.page.keyboard.type("sparsification", delay=20)
        look.page.wait_for_selector(".md-search-result__item", timeout=60_000)
        assert look.problems == []
