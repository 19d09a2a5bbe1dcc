"""Which number format a network runs in: what the hardware has, and which of them a short measurement finds faster."""

from __future__ import annotations

import functools
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.frame import RadcamDepthError

PRECISIONS = ("auto", "float32", "bfloat16")

WORTH = 1.1
"""bfloat16 must be so many times as fast as float32 to be chosen: what it gains must outweigh what it rounds."""

BUDGET_S = 0.2
"""The measurement ends after this time, if it has taken `MIN_ROUNDS`."""

MIN_ROUNDS = 3

LAYERS = ((32, 112, 200), (128, 28, 50))
"""Channels, rows and columns of the convolutions that are timed: a fine and a coarse level of an encoder."""


class EngineError(RadcamDepthError):
    """A device, number format or mode that a network cannot be run with."""


@dataclass(frozen=True)
class NumberFormat:
    """What a network's weights and maps are held in, and why.

    Attributes:
        dtype: torch.float32 or torch.bfloat16.
        reason: In a few words.
    """

    dtype: torch.dtype
    reason: str

    def __post_init__(self) -> None:
        if self.dtype not in (torch.float32, torch.bfloat16):
            raise EngineError(f"a network runs in float32 or bfloat16, got {self.dtype}; choose one of them")

    @property
    def name(self) -> str:
        """`float32` or `bfloat16`."""
        return str(self.dtype).removeprefix("torch.")


def check_precision(precision: str) -> None:
    """EngineError for a precision that is none of `PRECISIONS`."""
    if precision not in PRECISIONS:
        raise EngineError(f"precision must be one of {', '.join(PRECISIONS)}, got {precision!r}")


def choose(precision: str, device: torch.device) -> NumberFormat:
    """The number format for a device.

    Args:
        precision: `float32`, `bfloat16`, or `auto`: on a GPU bfloat16 where it computes in it; on a CPU bfloat16 where
            the processor computes in it and a measurement finds it at least `WORTH` times as fast as float32.
        device: Where the network is to run.

    Raises:
        EngineError: for another precision.
    """
    check_precision(precision)
    if precision != "auto":
        return NumberFormat(torch.bfloat16 if precision == "bfloat16" else torch.float32, "as asked")
    if device.type == "cuda":
        if torch.cuda.is_bf16_supported(including_emulation=False):
            return NumberFormat(torch.bfloat16, "the GPU computes in it")
        return NumberFormat(torch.float32, "the GPU does not compute in bfloat16")
    if device.type != "cpu" or not processor_has_bfloat16():
        return NumberFormat(torch.float32, f"the {device.type.upper()} does not compute in bfloat16")
    gain = speedup_of_bfloat16()
    if gain >= WORTH:
        return NumberFormat(torch.bfloat16, f"measured: {gain:.1f} times as fast as float32")
    return NumberFormat(torch.float32, f"measured: bfloat16 {gain:.1f} times as fast")


def processor_has_bfloat16() -> bool:
    """Whether the processor computes in bfloat16 itself (avx512_bf16 or amx); elsewhere it is emulated, slower."""
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return False
    return "avx512_bf16" in flags or "amx_bf16" in flags


@functools.cache
def speedup_of_bfloat16() -> float:
    """How many times as fast as in float32 this processor convolves in bfloat16, measured once a process.

    Measured on one thread, by the time that it had on a processor: the wall clock of several threads says little while
    other processes are busy, as they are when a vehicle starts.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.inference_mode():
            return _measure({dtype: _layers(dtype) for dtype in (torch.float32, torch.bfloat16)})
    finally:
        torch.set_num_threads(threads)


def _measure(steps: dict[torch.dtype, Callable[[], None]]) -> float:
    times: dict[torch.dtype, list[float]] = {dtype: [] for dtype in steps}
    # The first calls build their kernels.
    for step in steps.values():
        step()
    end_s = time.thread_time() + BUDGET_S
    while len(times[torch.float32]) < MIN_ROUNDS or time.thread_time() < end_s:
        for dtype, step in steps.items():
            start_s = time.thread_time()
            step()
            times[dtype].append(time.thread_time() - start_s)
    return statistics.median(times[torch.float32]) / statistics.median(times[torch.bfloat16])


def _layers(dtype: torch.dtype) -> Callable[[], None]:
    """Runs one convolution with its activation at each of the sizes in `LAYERS`."""

    def tensor(*shape: int) -> Tensor:
        return torch.full(shape, 0.01, dtype=dtype).contiguous(memory_format=torch.channels_last)

    layers = [(tensor(1, width, rows, columns), tensor(width, width, 3, 3)) for width, rows, columns in LAYERS]

    def step() -> None:
        for maps, weight in layers:
            functional.leaky_relu(functional.conv2d(maps, weight, padding=1), 0.2, inplace=True)

    return step
