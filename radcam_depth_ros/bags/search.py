"""Finds the bags below folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from radcam_depth_ros.bags.errors import BagError

_SUFFIXES = (".mcap", ".db3")


def find_bags(paths: Sequence[Path]) -> tuple[Path, ...]:
    """All bags in some places, sorted by path, each once.

    Args:
        paths: Bag files, bag folders, or folders with any of these below.

    Raises:
        BagError: for a path without a bag.
    """
    found: dict[Path, Path] = {}
    for path in paths:
        bags = _bags_below(path)
        if not bags:
            raise BagError(f"there is no bag at {path}; give .mcap files, rosbag2 folders, or a folder that holds some")
        found.update((bag.resolve(), bag) for bag in bags)
    return tuple(sorted(found.values()))


def _bags_below(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix in _SUFFIXES else []
    if (path / "metadata.yaml").is_file():
        return [path]
    bags: list[Path] = []
    for child in sorted(path.iterdir()) if path.is_dir() else []:
        # What is hidden is somebody's unfinished work.
        if child.name.startswith("."):
            continue
        bags += _bags_below(child)
    return bags
