"""A folder of files that appear whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from radcam_depth_ros.files import cannot_write, whole


@dataclass(frozen=True)
class Folder:
    """A folder on a disk.

    Attributes:
        place: Its path.
    """

    place: str

    @property
    def _path(self) -> Path:
        return Path(self.place)

    def read(self, name: str) -> bytes | None:
        """A file's content; None where there is no such file."""
        try:
            return (self._path / name).read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None

    def write(self, name: str, content: bytes) -> None:
        """Writes a file, whole or not at all; FileError when it cannot be written."""
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
