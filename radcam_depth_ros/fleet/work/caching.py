"""Prepares the samples of one drive for training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from radcam_depth_ros import configuration
from radcam_depth_ros.fleet.unit import Unit, Worker
from radcam_depth_ros.training.data.cache import CacheSettings, cached_drives


@dataclass(frozen=True)
class Caching:
    """The work of `radcam-depth train --cache-only`.

    Attributes:
        cache: Folder of the samples.
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
            (drive,) = cached_drives([bag], Path(self.cache), self.cached)
            return {"frames": len(drive)}

        return work
