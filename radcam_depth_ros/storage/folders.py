"""Folders on a disk or at a URL.

Files appear whole or not at all: on a disk by renaming, in an object store since an object is put as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from radcam_depth_ros.files import cannot_write, whole
from radcam_depth_ros.storage.transfers import file_system, is_remote, require_room, tried


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
        """Writes a file, whole or not at all; FileError or StorageError when it cannot be written."""
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
        self._at = _Reached(*file_system(place))

    def _full(self, name: str) -> str:
        return f"{self._at.path.rstrip('/')}/{name}".rstrip("/")

    def read(self, name: str) -> bytes | None:
        """As of `Folder`."""
        try:
            content: bytes = tried(lambda: self._at.system.cat_file(self._full(name)), f"read {self.place}/{name}")
        except FileNotFoundError:
            return None
        return content

    def write(self, name: str, content: bytes) -> None:
        """As of `Folder`."""
        tried(lambda: self._at.system.pipe_file(self._full(name), content), f"write {self.place}/{name}")

    def remove(self, name: str) -> None:
        """As of `Folder`."""
        with suppress(FileNotFoundError):
            tried(lambda: self._at.system.rm_file(self._full(name)), f"remove {self.place}/{name}")

    def names(self, within: str = "") -> set[str]:
        """As of `Folder`."""
        self._at.system.invalidate_cache()
        try:
            paths = tried(
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
                tried(lambda: self._at.system.put_file(str(local), self._full(name)), f"write {self.place}/{name}")

    def fetch(self, names: Sequence[str], folder: Path) -> bool:
        """Copies files to a folder on the disk, block by block; False where one of them is missing.

        Raises:
            StorageError: when one cannot be read, or the disk has no room for them.
        """
        system = self._at.system
        system.invalidate_cache()
        try:
            entries = [tried(partial(system.info, self._full(name)), f"look at {self.place}/{name}") for name in names]
            require_room(self.place, entries, folder, "choose another folder")
            for name in names:
                tried(partial(system.get_file, self._full(name), str(folder / name)), f"read {self.place}/{name}")
        except FileNotFoundError:
            return False
        return True

    def put(self, folder: Path, names: Sequence[str]) -> None:
        """Copies files of a folder on the disk here, one after the other.

        Raises:
            StorageError: when one cannot be written.
        """
        for name in names:
            tried(partial(self._at.system.put_file, str(folder / name), self._full(name)), f"write {self.place}/{name}")


def folder_at(place: str) -> Folder:
    """A folder on a disk or at a URL; StorageError for a URL of a kind that is not installed."""
    return RemoteFolder(place) if is_remote(place) else Folder(place)
