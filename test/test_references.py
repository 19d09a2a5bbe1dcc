"""Citations: each key in code and docs is in docs/references.md, and each key of that page is cited somewhere."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import yaml

import radcam_depth_ros

ROOT = Path(__file__).parents[1]
REFERENCES = ROOT / "docs" / "references.md"
FOLDERS = ("radcam_depth_ros", "benchmarks", "experiments", "demo", "scripts", "config", "launch", "docs")
ENDINGS = {".py", ".md", ".yaml", ".rst"}
KEY = re.compile(r"\[([A-Z][A-Za-z]+(?:19|20)\d\d[a-z]?)\]")


def pages() -> Iterator[tuple[str, str]]:
    """Name and text of all code and docs but the page of references."""
    files = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")) if path.suffix in ENDINGS]
    for path in [*files, ROOT / "README.md", ROOT / "CHANGELOG.rst"]:
        if path != REFERENCES and "__pycache__" not in path.parts:
            yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")


TEXTS = dict(pages())
LISTED = re.findall(r"^- \*\*\[(\w+)\]\*\* ", REFERENCES.read_text(encoding="utf-8"), re.M)


def test_each_reference_is_listed_once_with_what_was_taken() -> None:
    text = REFERENCES.read_text(encoding="utf-8")
    entries = re.findall(r"^- \*\*\[\w+\]\*\* .*?(?=^- |^\n|\Z)", text, re.M | re.S)
    assert len(LISTED) == len(set(LISTED)) == len(entries)
    assert [entry for entry in entries if "Taken:" not in entry] == []
    assert [entry for entry in entries if not re.search(r"\b(DOI|arXiv)\b|not found", entry)] == []


def test_each_cited_key_is_listed() -> None:
    unknown = {name: sorted(set(KEY.findall(text)) - set(LISTED)) for name, text in TEXTS.items()}
    assert {name: keys for name, keys in unknown.items() if keys} == {}, "add them to docs/references.md"


def test_each_listed_key_is_cited() -> None:
    cited = {key for text in TEXTS.values() for key in KEY.findall(text)}
    assert set(LISTED) - cited == set()


def test_nothing_refers_to_pages_outside_of_the_project() -> None:
    outside = {
        name: re.findall(r"\bMETHODS\b|\b[A-Z]+\.md\b(?<!README\.md)(?<!CONTRIBUTING\.md)(?<!SECURITY\.md)", text)
        for name, text in TEXTS.items()
    }
    assert {name: found for name, found in outside.items() if found} == {}


def test_the_citation_file_has_what_the_format_requires() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert str(citation["cff-version"]) == "1.2.0"
    assert citation["authors"] == [{"name": "radcam_depth_ros developers"}]
    assert str(citation["version"]) == radcam_depth_ros.__version__
    assert f"version = {{{radcam_depth_ros.__version__}}}" in REFERENCES.read_text(encoding="utf-8")
