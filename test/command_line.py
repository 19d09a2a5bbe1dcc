"""The command `radcam-depth`, run within the process of the tests."""

from __future__ import annotations

import signal
import sys
from typing import Any

import pytest

from radcam_depth_ros import cli


def run_main(monkeypatch: pytest.MonkeyPatch, *arguments: Any) -> int:
    """The exit code of the command as a shell would see it."""
    monkeypatch.setattr(sys, "argv", ["radcam-depth", *(str(argument) for argument in arguments)])
    before = signal.getsignal(signal.SIGTERM)
    try:
        cli.main()
    except SystemExit as ended:
        return int(ended.code or 0)
    finally:
        signal.signal(signal.SIGTERM, before)
    return 0
