"""A real browser that looks at pages: headless Chromium, by Playwright."""

from __future__ import annotations

import functools
import http.server
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

WIDE, NARROW = (1280, 800), (400, 800)
SIZES = (WIDE, NARROW)
_NAMES = ("chromium", "chromium-browser", "google-chrome", "chromium-headless-shell")
_SIDEWAYS = """() => {
  const width = document.documentElement.clientWidth;
  const isScrolled = (element) => {
    for (let at = element.parentElement; at; at = at.parentElement)
      if (getComputedStyle(at).overflowX !== 'visible') return true;
    return false;
  };
  const isWide = (element) => element.getBoundingClientRect().right > width + 1 && element.checkVisibility();
  const wide = [...document.querySelectorAll('body *')].filter((one) => isWide(one) && !isScrolled(one));
  return document.documentElement.scrollWidth > width + 1
    ? [document.documentElement.scrollWidth, ...wide.slice(0, 5).map((one) => one.outerHTML.slice(0, 160))] : [];
}"""


@contextmanager
def browser() -> Iterator[Any]:
    """Chromium; skips the test where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="the extra `docs` is not installed")
    program = next(filter(None, map(shutil.which, _NAMES)), None)
    if program is None:
        pytest.skip(f"there is no browser: none of {', '.join(_NAMES)} is installed")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        try:
            yield chromium
        finally:
            chromium.close()


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a folder's files, on this machine alone."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder))) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/"
        finally:
            server.shutdown()
            thread.join()


class Look:
    """One tab, which collects what goes wrong in it.

    Attributes:
        page: The tab.
        problems: Errors of the console and of scripts, requests that failed or left this machine.
    """

    def __init__(self, chromium: Any, size: tuple[int, int]) -> None:
        self.page = chromium.new_page(viewport={"width": size[0], "height": size[1]})
        self.problems: list[str] = []
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda error: self.problems.append(f"script: {error}"))
        self.page.on("requestfailed", self._miss)
        self.page.on("response", self._see)

    def _hear(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.problems.append(f"console: {message.text}")

    def _miss(self, request: Any) -> None:
        # Of a video a browser takes what it needs, and breaks off; so it does with the icon of a page that is left.
        breaks_off = request.resource_type == "media" or request.url.endswith("/favicon.png")
        if not (breaks_off and request.failure == "net::ERR_ABORTED"):
            self.problems.append(f"failed: {request.url}, {request.failure}")

    def _see(self, response: Any) -> None:
        is_here = response.url.startswith(("http://127.0.0.1:", "file:", "data:", "blob:"))
        if not is_here or response.status >= 400:
            self.problems.append(f"{response.status}: {response.url}")

    def check(self, address: str, screenshot: Path) -> None:
        """Opens a page, takes its picture, and fails on errors and on sideways scrolling."""
        self.page.goto(address, wait_until="load")
        self.page.screenshot(path=str(screenshot))
        assert self.page.evaluate(_SIDEWAYS) == [], f"{address} is too wide"
        assert self.problems == [], f"{address}: {self.problems}"
