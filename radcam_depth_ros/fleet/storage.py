"""Folders and bags on a disk, or anywhere that fsspec reaches: s3://, gs:// and so on.

Files appear whole or not at all: on a disk by renaming, in an object store since an object is put as a whole.
"""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from radcam_depth_ros.bags import find_bags
from radcam_depth_ros.extras import install_extra
from radcam_depth_ros.files import cannot_write, whole
from radcam_depth_ros.fleet.errors import FleetError

ValueT = TypeVar("ValueT")

TRIES = 4
"""How often a transfer is tried that fails or stalls."""
_S3 = ("s3", "s3a")
STALL_S = 20
"""A connection to S3 that gives nothing for so long has stalled, where fsspec's own settings do not say otherwise."""
_SPARE_BYTES = 256 << 20
"""Left free on the local disk beside a staged bag."""
_SUFFIXES = (".mcap", ".db3")


def place_of(path: Path | str) -> str:
    """A place as it was given; `Path` makes one slash of the two of a URL."""
    return re.sub(r"^([a-z][a-z0-9+.-]+):/(?!/)", r"\1://", str(path))


def is_remote(place: str) -> bool:
    """Whether a place is a URL."""
    return "://" in place


def find_places(places: list[str]) -> list[str]:
    """Places of all bags in some places, sorted.

    Raises:
        BagError: for a place on a disk without any.
        FleetError: for a URL without any, or that cannot be reached.
    """
    found = {str(bag) for bag in find_bags([Path(place) for place in places if not is_remote(place)])}
    for place in filter(is_remote, places):
        system, path = _system(place)
        files = _tried(partial(system.find, path), f"look into {place}")
        folders = {file.rpartition("/")[0] for file in files if file.endswith("/metadata.yaml")}
        bags = {file for file in files if file.endswith(_SUFFIXES) and file.rpartition("/")[0] not in folders}
        if not bags | folders:
            raise FleetError(f"there is no bag at {place}; give .mcap files, rosbag2 folders, or a folder of some")
        found |= {str(system.unstrip_protocol(bag)) for bag in bags | folders}
    return sorted(found)


def remote_stamp(place: str) -> str:
    """Size and etag of a remote bag, of a folder of its files; empty where it is not there."""
    system, path = _system(place)
    try:
        files = _tried(lambda: system.find(path, detail=True), f"look at {place}")
    except FleetError:
        return ""
    return " ".join(f"{name.rpartition('/')[2]} {_etag(entry)}" for name, entry in sorted(files.items()))


def _etag(entry: dict[str, Any]) -> str:
    known = next((entry[name] for name in ("ETag", "etag", "md5Hash", "mtime", "LastModified") if name in entry), "")
    return f"{entry.get('size')} {known}"


@contextmanager
def staged(place: str) -> Iterator[Path]:
    """A bag on the local disk; one that is remote is read once, and goes again at the end.

    Raises:
        FleetError: when it cannot be read, or the disk has no room for it.
    """
    if not is_remote(place):
        yield Path(place)
        return
    system, path = _system(place)
    files = _tried(lambda: system.find(path, detail=True), f"read {place}")
    if not files:
        raise FleetError(f"there is no bag at {place} any more")
    with TemporaryDirectory(prefix="radcam_depth_bag_") as folder:
        size, free = sum(int(entry["size"] or 0) for entry in files.values()), shutil.disk_usage(folder).free
        if size + _SPARE_BYTES > free:
            raise FleetError(
                f"{place} has {size >> 20} MB, and {folder} has room for {max(0, free - _SPARE_BYTES) >> 20} MB; free "
                "some, or set TMPDIR to a larger disk"
            )
        bag = Path(folder) / place.rstrip("/").rpartition("/")[2]
        for name in files:
            target = bag if name == path else bag / name.rpartition("/")[2]
            target.parent.mkdir(exist_ok=True)
            _tried(partial(system.get_file, name, str(target)), f"read {place}")
        yield bag


class Folder:
    """A folder on a disk.

    Args:
        place: Its path.
    """

    def __init__(self, place: str) -> None:
        self.place, self._path = place, Path(place)

    def read(self, name: str) -> bytes | None:
        """A file's content; None where there is no such file."""
        try:
            return (self._path / name).read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None

    def write(self, name: str, content: bytes) -> None:
        """Writes a file, whole or not at all; FileError or FleetError when it cannot be written."""
        with whole(self._path / name) as temporary:
            temporary.write_bytes(content)

    def remove(self, name: str) -> None:
        """Removes a file, if it is there."""
        with suppress(FileNotFoundError):
            (self._path / name).unlink()

    def names(self, within: str = "") -> set[str]:
        """Names of the files and folders in a subfolder, without those that are being written."""
        try:
            return {entry.name for entry in (self._path / within).iterdir() if not entry.name.startswith(".")}
        except (FileNotFoundError, NotADirectoryError):
            return set()

    @contextmanager
    def written(self, name: str) -> Iterator[Path]:
        """Where a bag of this name is to be written: at its place itself, since bags appear whole."""
        try:
            self._path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(self._path, error) from None
        yield self._path / name


@dataclass(frozen=True)
class _Reached:
    """A file system of fsspec with a path on it."""

    system: Any
    path: str


class RemoteFolder(Folder):
    """A folder at a URL.

    Args:
        place: The URL.
    """

    def __init__(self, place: str) -> None:
        super().__init__(place)
        self._at = _Reached(*_system(place))

    def _full(self, name: str) -> str:
        return f"{self._at.path.rstrip('/')}/{name}".rstrip("/")

    def read(self, name: str) -> bytes | None:
        """As of `Folder`."""
        try:
            content: bytes = _tried(lambda: self._at.system.cat_file(self._full(name)), f"read {self.place}/{name}")
        except FileNotFoundError:
            return None
        return content

    def write(self, name: str, content: bytes) -> None:
        """As of `Folder`."""
        _tried(lambda: self._at.system.pipe_file(self._full(name), content), f"write {self.place}/{name}")

    def remove(self, name: str) -> None:
        """As of `Folder`."""
        with suppress(FileNotFoundError):
            _tried(lambda: self._at.system.rm_file(self._full(name)), f"remove {self.place}/{name}")

    def names(self, within: str = "") -> set[str]:
        """As of `Folder`."""
        self._at.system.invalidate_cache()
        try:
            paths = _tried(
                lambda: self._at.system.ls(self._full(within), detail=False), f"look into {self.place}/{within}"
            )
        except FileNotFoundError:
            return set()
        return {str(path).rstrip("/").rpartition("/")[2] for path in paths}

    @contextmanager
    def written(self, name: str) -> Iterator[Path]:
        """A place on the local disk; what is there at the end is put to its own place as a whole."""
        with TemporaryDirectory(prefix="radcam_depth_out_") as folder:
            local = Path(folder) / name
            yield local
            if local.is_file():
                _tried(lambda: self._at.system.put_file(str(local), self._full(name)), f"write {self.place}/{name}")


def folder_at(place: str) -> Folder:
    """A folder on a disk or at a URL; FleetError for a URL of a kind that is not installed."""
    return RemoteFolder(place) if is_remote(place) else Folder(place)


def _system(place: str) -> tuple[Any, str]:
    """The file system of a URL, and the path on it."""
    import fsspec

    protocol = place.partition("://")[0]
    options: dict[str, Any] = {}
    if protocol in _S3 and "config_kwargs" not in fsspec.config.conf.get("s3", {}):
        options["config_kwargs"] = {"read_timeout": STALL_S, "connect_timeout": STALL_S}
    try:
        system, path = fsspec.url_to_fs(place, **options)
    except (ImportError, ValueError) as error:
        advice = install_extra("fleet") if protocol in _S3 else "install the package that fsspec needs for it"
        raise FleetError(f"cannot reach {place}: {error}; {advice}") from None
    return system, str(path)


def _tried(do: Callable[[], ValueT], what: str, tries: int = TRIES) -> ValueT:
    """Tries a transfer some times; FileNotFoundError at once, FleetError for all else."""
    try:
        return do()
    except FileNotFoundError:
        raise
    except Exception as error:  # clients of object stores have errors of many kinds
        hopeless = isinstance(error, PermissionError) or type(error).__name__ == "NoCredentialsError"
        if hopeless or tries <= 1:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise FleetError(
                f"cannot {what}: {reason}; check the address, the credentials and what they allow"
            ) from None
    time.sleep(0.1 * 2 ** (TRIES - tries))
    return _tried(do, what, tries - 1)
