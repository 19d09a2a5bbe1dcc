"""Hooks of mkdocs: which files are pages of the site, under the paths that they have in the checkout.

So that all links are the same here and on a forge, a page's path is that from the checkout's root. Beside README, docs
and the pages of scripts there are: one page for each room's docstrings, the changelog, the notebook's cells, and each
file that a page links, as it is.
"""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PACKAGE = "radcam_depth_ros"
NOTEBOOKS = "notebooks"
_SINGLE = (
    *("README.md", "CONTRIBUTING.md", "SECURITY.md", "CODE_OF_CONDUCT.md"),
    *("benchmarks/README.md", "experiments/README.md"),
)
_LINK = re.compile(r"(?<=\]\()([^)#:]+)(?=[)#])")
_LOG = logging.getLogger("mkdocs.hooks.site_pages")
"""Warnings of mkdocs' loggers fail a strict build."""
_VIDEO = re.compile(r"\[([^\]]*)\]\(([^)]+\.mp4)\)")


def page_paths() -> tuple[str, ...]:
    """Markdown files that are pages, as paths from the checkout's root."""
    docs = (path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))
    return (*_SINGLE, *sorted(docs))


def rooms() -> tuple[str, ...]:
    """The rooms of the package, which have a page each."""
    found = (path.stem for path in (ROOT / PACKAGE).iterdir() if _is_room(path))
    return tuple(sorted(found))


def _is_room(path: Path) -> bool:
    is_module = path.suffix == ".py" if path.is_file() else (path / "__init__.py").is_file()
    return is_module and not path.stem.startswith("_")


def linked_files() -> tuple[str, ...]:
    """Files of the checkout that pages link and that are no pages."""
    found = set()
    for page in page_paths():
        folder = (ROOT / page).parent
        for target in _LINK.findall((ROOT / page).read_text(encoding="utf-8")):
            path = (folder / target).resolve()
            if path.is_file() and path.suffix not in (".md", ".ipynb") and path.is_relative_to(ROOT):
                found.add(path.relative_to(ROOT).as_posix())
    return tuple(sorted(found))


def generated() -> Iterator[tuple[str, str]]:
    """Paths and texts of pages that are no Markdown files."""
    for room in rooms():
        yield f"api/{room}.md", f"# {room}\n\n::: {PACKAGE}.{room}\n"
    names = "".join(f"- [{room}]({room}.md)\n" for room in rooms())
    yield (
        "api/index.md",
        "# API\n\nThe docstrings of each room; [design.md](../docs/design.md#rooms) says what the rooms are and which "
        f"may import which.\n\n{names}",
    )
    changes = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    yield "changes.md", "# Changes\n" + changes.partition("\n\n")[2].replace("``", "`")
    for path in sorted((ROOT / NOTEBOOKS).glob("*.ipynb")):
        yield f"{NOTEBOOKS}/{path.stem}.md", notebook_text(path)


def notebook_text(path: Path) -> str:
    """A notebook's cells as Markdown."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
    return "\n\n".join(parts) + "\n"


def on_config(config: Any) -> Any:
    """Puts the rooms' pages into the navigation."""
    for section in config.nav:
        if "API" in section:
            section["API"] = ["api/index.md", *(f"api/{room}.md" for room in rooms())]
    config.watch.append(str(ROOT / PACKAGE))
    return config


def on_files(files: Files, config: Any) -> Files:
    """Replaces what mkdocs found by the pages under their paths from the checkout's root; the theme's files stay."""
    kept = [file for file in files if not str(file.abs_src_path or "").startswith(str(ROOT / "docs"))]
    own = [
        File(path, str(ROOT), config.site_dir, config.use_directory_urls) for path in (*page_paths(), *linked_files())
    ]
    texts = [File.generated(config, path, content=text) for path, text in generated()]
    notebooks = [
        File(path.relative_to(ROOT).as_posix(), str(ROOT), config.site_dir, config.use_directory_urls)
        for path in sorted((ROOT / NOTEBOOKS).glob("*.ipynb"))
    ]
    return Files([*kept, *own, *texts, *notebooks])


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Shows linked videos in the page, and the changelog as a page."""
    depth = "../" * page.url.count("/") if page.file.use_directory_urls else ""
    folder = Path(page.file.src_uri).parent

    def video(found: re.Match[str]) -> str:
        place = (ROOT / folder / found[2]).resolve().relative_to(ROOT).as_posix()
        if not (ROOT / place).is_file():
            _LOG.warning("%s links %s, which is not there", page.file.src_uri, place)
        attributes = f'aria-label="{found[1]}" src="{depth}{place}" style="max-width: 100%"'
        return f'<video controls muted playsinline preload="metadata" {attributes}></video>'

    return _VIDEO.sub(video, markdown).replace("(CHANGELOG.rst)", "(changes.md)").replace(".ipynb)", ".md)")
