"""Sets how OpenMP threads wait for each other; must run before torch loads OpenMP."""

from __future__ import annotations

import os

SPIN_COUNT = "10000"
"""Turns of its loop in which a thread of GNU's OpenMP waits for others before it lets go of its core.

Long enough for the steps of a network to follow each other without a system call, and short where a partner has no
core: the default of 300,000 takes some milliseconds, hundreds of times a frame (docs/decisions.md).
"""


def prepare() -> None:
    """Sets the environment of this process; what the user has set stays. Without effect once torch is loaded."""
    if not {"GOMP_SPINCOUNT", "OMP_WAIT_POLICY"} & os.environ.keys():
        os.environ["GOMP_SPINCOUNT"] = SPIN_COUNT
