"""The error of bags, and suggestions of similar names for its messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from radcam_depth_ros.frame import RadcamDepthError


class BagError(RadcamDepthError):
    """A bag that cannot be read, written or used; the message says which, why and what to do."""


def nearest(name: str, known: Iterable[str], how_many: int = 3) -> str:
    """The known names most like `name`, for the end of a sentence; all of them when none is like it."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=how_many, cutoff=0.5)
    return ", ".join(close or names) or "none"
