"""Messages that the ROS 2 wheels lack: `make test` generates them, or leaves a sentence that says why not."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest


def require_tf2_msgs() -> Any:
    """The module tf2_msgs.msg; skips where there is none."""
    return _require("tf2_msgs")


def require_radar_msgs() -> Any:
    """The module radar_msgs.msg; skips where there is none."""
    return _require("radar_msgs")


def _require(package: str) -> Any:
    file = Path(sys.prefix, f"{package}.missing")
    why = file.read_text(encoding="utf-8").strip() if file.exists() else "scripts/make_messages generates it"
    return pytest.importorskip(f"{package}.msg", reason=f"{package} is not installed; {why}")
