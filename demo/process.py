"""The node as a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from types import TracebackType

from radcam_depth_ros.frame import RadcamDepthError

GRACE_S = 10.0
"""So long a node may take to end after a signal, before it gets a stronger one."""


class DemoError(RadcamDepthError):
    """The demo cannot go on."""


def keep_to_this_machine() -> None:
    """Has all that is started from now on speak with nobody else, in a domain of its own unless one is chosen."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(10 + os.getpid() % 50))
    # The default shared-memory segments are smaller than one image.
    profile = Path(__file__).parents[1] / "config" / "fastdds.xml"
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(profile))


class NodeProcess:
    """Runs `radcam_depth_node` inside a `with` block; what it logs goes to a file.

    Args:
        parameters: Its parameter file.
        log: Where its log goes.
        command: What to run in place of the node.
    """

    def __init__(self, parameters: Path, log: Path, command: tuple[str, ...] = ()) -> None:
        # As the installed executable does it, also where the package is on the path without being installed.
        start = "import sys; from radcam_depth_ros.node import main; sys.exit(main())"
        arguments = ["--ros-args", "--params-file", str(parameters)]
        self._command = command or (sys.executable, "-c", start, *arguments)
        self._log = log

    def __enter__(self) -> NodeProcess:
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                self._command, stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if self._process.poll() is not None:
                return
            self._process.send_signal(number)
            try:
                self._process.wait(GRACE_S)
            except subprocess.TimeoutExpired:
                continue

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def problem(self) -> str | None:
        """The first error that it logged."""
        return next((line for line in self._lines() if line.startswith(("[ERROR]", "[FATAL]"))), None)

    @property
    def last_lines(self) -> str:
        """The end of its log."""
        return "\n".join(self._lines()[-12:])

    def _lines(self) -> list[str]:
        return self._log.read_text(encoding="utf-8", errors="replace").splitlines()

    def check(self) -> None:
        """Raises DemoError when the process has ended."""
        exit_code = self._process.poll()
        if exit_code is not None:
            raise DemoError(f"the node ended with exit code {exit_code}; {self._log} ends with:\n{self.last_lines}")
