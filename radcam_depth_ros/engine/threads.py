"""Keeps few threads computing: `apart` computes in a thread that ends, `offline_threads` is the number for commands."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

OFFLINE_THREADS = 2
"""Threads of commands that work through bags, whatever runs beside: figures depend on them in their last digits."""

T = TypeVar("T")


def apart(call: Callable[[], T]) -> T:
    """Does something that computes, such as loading a network, in a thread of its own that ends with it.

    Each thread that computes gets a team of OpenMP threads and keeps it until it ends. When all teams together have
    more threads than there are processors, GNU's OpenMP lets none of them spin while it waits for the others, and each
    step of a network begins with waking one: with a team left over from loading, a frame takes twice as long.

    Args:
        call: What to do.

    Returns:
        What it returns; what it raises is raised.
    """
    with ThreadPoolExecutor(1, "apart") as thread:
        return thread.submit(call).result()


def offline_threads() -> int:
    """`OFFLINE_THREADS`, or torch's number where that is less: a single core, or OMP_NUM_THREADS."""
    return min(OFFLINE_THREADS, torch.get_num_threads())
