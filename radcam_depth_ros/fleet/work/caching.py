"""Prepares the samples of one drive for training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

from radcam_depth_ros import configuration
from radcam_depth_ros.fleet.unit import Unit, Worker
from radcam_depth_ros.storage import is_remote
from radcam_depth_ros.training.data.cache import CacheSettings, build_drive, cache_name
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.data.shared_cache import SharedCache


@dataclass(frozen=True)
class Caching:
    """The work of `radcam-depth train --cache-only`.

    Attributes:
        cache: Folder of the samples, on a disk or at a URL.
        cached: How they are made.
    """

    cache: str
    cached: CacheSettings

    verb: ClassVar[str] = "train --cache-only"
    suffix: ClassVar[str] = ""
    reads_bags: ClassVar[bool] = True

    @property
    def threads(self) -> int:
        """One."""
        return 1

    def settings(self) -> dict[str, Any]:
        """How samples are made."""
        return {"cache": configuration.as_mapping(self.cached)}

    def facts(self) -> dict[str, Any]:
        """None."""
        return {}

    def open(self) -> Worker:
        """Loads nothing."""

        def work(unit: Unit, bag: Path, target: Path) -> Mapping[str, Any]:
            place = Path(unit.place)
            name = cache_name(place, self.cached)
            if not is_remote(self.cache):
                drive = Path(self.cache) / name
                build_drive(place, drive, self.cached, local=bag)
                return {"frames": len(CachedDrive(drive))}
            with TemporaryDirectory(prefix="radcam_depth_samples_") as folder:
                build_drive(place, Path(folder) / name, self.cached, SharedCache(self.cache), bag)
                return {"frames": len(CachedDrive(Path(folder) / name))}

        return work
