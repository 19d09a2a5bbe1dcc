"""Writes files whole or not at all, so that no reader sees half of one."""

from __future__ import annotations

import errno
import fcntl
import glob
import hashlib
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from radcam_depth_ros.frame import RadcamDepthError

_BLOCK_BYTES = 1 << 20


class FileError(RadcamDepthError):
    """A file that cannot be written."""


@contextmanager
def whole(path: Path | str) -> Iterator[Path]:
    """A temporary sibling to write to: it takes the file's name when the block succeeds, and goes away when it fails.

    Makes the folder. The sibling is a new file, whatever links are there, and has the file's suffix, by which some
    writers tell the format. It is on the disk before it takes the name; a link of that name is replaced, not followed.

    Raises:
        FileError: when it cannot be written; what was there before is intact.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_NOFOLLOW, 0o666))
        yield temporary
        sync(temporary)
        temporary.replace(target)
        sync(target.parent)
    except OSError as error:
        raise cannot_write(target, error) from None
    finally:
        # Where the folder itself cannot be made or written there is nothing to remove.
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def partial_folder(target: Path) -> Iterator[Path]:
    """A new folder beside a target, for what shall take its name when it is whole; the folder goes after the block.

    It is locked while it is used, and the lock ends with the process: what a killed one left beside the same target is
    removed first.

    Args:
        target: A file or folder. Its parent is made.

    Raises:
        OSError: when the folder cannot be made.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    for leftover in target.parent.glob(f".{glob.escape(target.name)}.partial-*"):
        with suppress(OSError), _locked(leftover) as is_unused:
            if is_unused:
                shutil.rmtree(leftover, ignore_errors=True)
    # Its name is known before there is a folder, so that a signal in between leaves none behind.
    folder = target.with_name(f".{target.name}.partial-{secrets.token_hex(4)}")
    try:
        folder.mkdir(mode=0o700)
        with _locked(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Whether this process could lock a folder: False where another one has, and on file systems without locks."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        is_locked = True
    except OSError:
        is_locked = False
    try:
        yield is_locked
    finally:
        os.close(handle)


def cannot_write(target: Path, error: OSError) -> FileError:
    """The refusal to write a file, as a sentence."""
    return FileError(f"cannot write {target}: {error.strerror or error}; choose a place that can be written")


def sync(path: Path) -> None:
    """Has a file, or a folder's names, written to the disk; a file system that cannot is left alone."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EROFS):
            raise
    finally:
        os.close(descriptor)


def write_text(path: Path | str, text: str) -> None:
    """Writes a UTF-8 file, whole or not at all; FileError when it cannot be written."""
    with whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def require_apart(writes: Iterable[Path | str | None], reads: Iterable[Path | str | None]) -> None:
    """Refuses to write to what is read, by any name of it: a link, a relative path, a file within a bag.

    Args:
        writes: Files and folders that will be written or replaced; None for those not asked for.
        reads: Files and folders that are read, likewise.

    Raises:
        FileError: which names both.
    """
    origins = [Path(source) for source in reads if source is not None]
    for target in (Path(output) for output in writes if output is not None):
        for origin in origins:
            if _meet(target, origin):
                raise FileError(f"{target} would be written to, but {origin} is read; choose another place to write to")


def _meet(target: Path, origin: Path) -> bool:
    written, read = target.resolve(), origin.resolve()
    if written == read or written in read.parents:
        return True
    if read in written.parents:
        # A folder of bags may have other files beside them.
        return (read / "metadata.yaml").is_file()
    if not written.exists() or not read.exists():
        return False
    return any(written.samefile(file) for file in (read, *(read.iterdir() if read.is_dir() else ())))


def content_of(path: Path) -> str:
    """SHA-256 of a file's bytes; of a folder, such as a bag's, of the names and bytes of its files."""
    if path.is_file():
        return _sha256_of(path)
    parts = (f"{part.name} {_sha256_of(part)}\n" for part in sorted(path.iterdir()) if part.is_file())
    return hashlib.sha256("".join(parts).encode("utf-8", "surrogateescape")).hexdigest()


def _sha256_of(file: Path) -> str:
    digest = hashlib.sha256()
    with file.open("rb", buffering=0) as stream:
        while block := stream.read(_BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()
