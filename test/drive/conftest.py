from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from lidar_drive import LidarDrive, write_lidar_drive

Write = Callable[..., Path]


@pytest.fixture
def write_drive_with(tmp_path: Path) -> Write:
    """Writes a drive with a LiDAR; the arguments are `LidarDrive`'s."""

    def write(**settings: Any) -> Path:
        return write_lidar_drive(tmp_path / "drive.mcap", LidarDrive(**settings))

    return write
