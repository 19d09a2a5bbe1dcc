"""The message of /tf, which the ROS 2 wheels lack: `make test` generates it, or leaves a sentence that says why not."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

_WHY = Path(sys.prefix, "tf2_msgs.missing")


def require_tf2_msgs() -> Any:
    """The module tf2_msgs.msg; skips where there is none."""
    why = _WHY.read_text(encoding="utf-8").strip() if _WHY.exists() else "scripts/make_tf2_msgs generates it"
    return pytest.importorskip("tf2_msgs.msg", reason=f"tf2_msgs is not installed; {why}")
