"""Bags on a disk or at a URL: finding them, telling whether one changed, and fetching it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from radcam_depth_ros.bags import find_bags
from radcam_depth_ros.files import content_of
from radcam_depth_ros.storage.errors import StorageError
from radcam_depth_ros.storage.transfers import file_system, is_remote, require_room, tried

_SUFFIXES = (".mcap", ".db3")


def find_places(places: list[str]) -> list[str]:
    """Places of all bags in some places, sorted.

    Raises:
        BagError: for a place on a disk without any.
        StorageError: for a URL without any, or that cannot be reached.
    """
    found = {str(bag) for bag in find_bags([Path(place) for place in places if not is_remote(place)])}
    for place in filter(is_remote, places):
        system, path = file_system(place)
        files = tried(partial(system.find, path), f"look into {place}")
        folders = {file.rpartition("/")[0] for file in files if file.endswith("/metadata.yaml")}
        bags = {file for file in files if file.endswith(_SUFFIXES) and file.rpartition("/")[0] not in folders}
        if not bags | folders:
            raise StorageError(f"there is no bag at {place}; give .mcap files, rosbag2 folders, or a folder of some")
        found |= {str(system.unstrip_protocol(bag)) for bag in bags | folders}
    return sorted(found)


def remote_stamp(place: str) -> str:
    """Size and etag of a remote bag, of a folder of its files; empty where it is not there."""
    system, path = file_system(place)
    try:
        files = tried(lambda: system.find(path, detail=True), f"look at {place}")
    except StorageError:
        return ""
    return " ".join(f"{name.rpartition('/')[2]} {_etag(entry)}" for name, entry in sorted(files.items()))


def stamp_at(place: str) -> str:
    """Size and time of change of a bag, at a URL its etag, known without reading it; empty where there is none."""
    if is_remote(place):
        return remote_stamp(place)
    bag = Path(place)
    try:
        parts = [part.stat() for part in (sorted(bag.iterdir()) if bag.is_dir() else [bag])]
    except OSError:
        return ""
    return f"{sum(part.st_size for part in parts)} {max((part.st_mtime_ns for part in parts), default=0)}"


def content_at(place: str) -> str:
    """What stands for a bag's content: its SHA-256 on a disk, sizes and etags at a URL."""
    return remote_stamp(place) if is_remote(place) else content_of(Path(place))


def _etag(entry: dict[str, Any]) -> str:
    known = next((entry[name] for name in ("ETag", "etag", "md5Hash", "mtime", "LastModified") if name in entry), "")
    return f"{entry.get('size')} {known}"


@contextmanager
def staged(place: str) -> Iterator[Path]:
    """A bag on the local disk; one that is remote is read once, and goes again at the end.

    Raises:
        StorageError: when it cannot be read, or the disk has no room for it.
    """
    if not is_remote(place):
        yield Path(place)
        return
    system, path = file_system(place)
    files = tried(lambda: system.find(path, detail=True), f"read {place}")
    if not files:
        raise StorageError(f"there is no bag at {place} any more")
    with TemporaryDirectory(prefix="radcam_depth_bag_") as folder:
        require_room(place, files.values(), Path(folder), "set TMPDIR to a larger disk")
        bag = Path(folder) / place.rstrip("/").rpartition("/")[2]
        for name in files:
            target = bag if name == path else bag / name.rpartition("/")[2]
            target.parent.mkdir(exist_ok=True)
            tried(partial(system.get_file, name, str(target)), f"read {place}")
        yield bag
