"""Places on a disk or at a URL, and transfers that are tried again where they fail or stall."""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from radcam_depth_ros.extras import install_extra
from radcam_depth_ros.storage.errors import StorageError

ValueT = TypeVar("ValueT")

TRIES = 4
"""How often a transfer is tried that fails or stalls."""
_S3 = ("s3", "s3a")
STALL_S = 20
"""A connection to S3 that gives nothing for so long has stalled, where fsspec's own settings do not say otherwise."""
_SPARE_BYTES = 256 << 20
"""Left free on the local disk beside what is fetched."""


def place_of(path: Path | str) -> str:
    """A place as it was given; `Path` makes one slash of the two of a URL."""
    return re.sub(r"^([a-z][a-z0-9+.-]+):/(?!/)", r"\1://", str(path))


def is_remote(place: str) -> bool:
    """Whether a place is a URL."""
    return "://" in place


def require_room(place: str, files: Iterable[Mapping[str, Any]], folder: Path, advice: str) -> None:
    """Raises StorageError, with some advice, where a folder's disk has no room for what is at a place."""
    size, free = sum(int(entry["size"] or 0) for entry in files), shutil.disk_usage(folder).free
    if size + _SPARE_BYTES > free:
        raise StorageError(
            f"{place} has {size >> 20} MB, and {folder} has room for {max(0, free - _SPARE_BYTES) >> 20} MB; free "
            f"some, or {advice}"
        )


def file_system(place: str) -> tuple[Any, str]:
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
        raise StorageError(f"cannot reach {place}: {error}; {advice}") from None
    return system, str(path)


def tried(do: Callable[[], ValueT], what: str, tries: int = TRIES) -> ValueT:
    """Tries a transfer some times; FileNotFoundError at once, StorageError for all else."""
    try:
        return do()
    except FileNotFoundError:
        raise
    except Exception as error:  # clients of object stores have errors of many kinds
        hopeless = isinstance(error, PermissionError) or type(error).__name__ == "NoCredentialsError"
        if hopeless or tries <= 1:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise StorageError(
                f"cannot {what}: {reason}; check the address, the credentials and what they allow"
            ) from None
    time.sleep(0.1 * 2 ** (TRIES - tries))
    return tried(do, what, tries - 1)
