"""The grouping rules of diagnostic_aggregator (Jazzy), which is in no package registry, for files of analyzers.

A GenericAnalyzer takes a status whose whole name matches a `regex`, is a `name` or `expected`, begins with one of
`startswith` or `find_and_remove_prefix`, or has one of `contains` in it. What it takes it shows below its path, with
spaces for slashes, and without the prefix. An AnalyzerGroup hands a status to all of its analyzers that take it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

MATCHERS = {"regex", "name", "expected", "startswith", "find_and_remove_prefix", "contains"}
OTHERS = {"type", "path", "remove_prefix", "num_items", "timeout", "discard_stale"}


def grouped(path: Path, names: Iterable[str]) -> dict[str, list[str]]:
    """What each GenericAnalyzer of a file shows of statuses of these names, by the analyzer's path."""
    parameters = yaml.safe_load(path.read_text(encoding="utf-8"))["analyzers"]["ros__parameters"]
    return _of_group(parameters, f"/{parameters['path']}", tuple(names))


def _of_group(entries: Mapping[str, Any], path: str, names: tuple[str, ...]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for analyzer in (entry for entry in entries.values() if isinstance(entry, dict)):
        kind, below = analyzer["type"].removeprefix("diagnostic_aggregator/"), f"{path}/{analyzer['path']}"
        if kind == "AnalyzerGroup":
            found |= _of_group(analyzer["analyzers"], below, names)
        else:
            assert kind == "GenericAnalyzer"
            assert analyzer.keys() <= MATCHERS | OTHERS
            assert all(isinstance(analyzer[key], list) for key in analyzer.keys() & MATCHERS), "as the aggregator wants"
            assert isinstance(analyzer.get("timeout", 5.0), float), "as the aggregator wants"
            found[below] = [_shown(analyzer, name) for name in names if _takes(analyzer, name)]
    return found


def _takes(analyzer: Mapping[str, Any], name: str) -> bool:
    starts = (*analyzer.get("startswith", ()), *analyzer.get("find_and_remove_prefix", ()))
    return (
        any(re.fullmatch(pattern, name) for pattern in analyzer.get("regex", ()))
        or name in (*analyzer.get("name", ()), *analyzer.get("expected", ()))
        or name.startswith(starts)
        or any(part in name for part in analyzer.get("contains", ()))
    )


def _shown(analyzer: Mapping[str, Any], name: str) -> str:
    shown = name.replace("/", " ")
    for prefix in analyzer.get("remove_prefix", analyzer.get("find_and_remove_prefix", ())):
        shown = shown.removeprefix(prefix.replace("/", " "))
    return shown.lstrip() if shown != name.replace("/", " ") else shown
