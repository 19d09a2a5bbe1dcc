"""Sets how glibc keeps freed memory, and when it returns it to the system."""

from __future__ import annotations

import ctypes
import gc

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_KEPT_BYTES = 1 << 30


def keep_freed_memory() -> None:
    """Lets the C library keep what a frame frees for the next frame.

    It hands large blocks back to the system otherwise, which fills them with zeros again, page by page, for each
    frame's maps.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, _KEPT_BYTES)
        mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)


def give_back_memory() -> None:
    """Gives the system what is free now: after a network was loaded, which takes several copies of it, or dropped.

    Script modules refer to themselves, so that Python has to collect them first.
    """
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
