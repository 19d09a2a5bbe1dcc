"""Chooses a network's number format: as asked, as the environment says, or as suits the hardware."""

from __future__ import annotations

import os
from dataclasses import dataclass

import torch

from radcam_depth_ros.engine.processors import Processor, precision_of
from radcam_depth_ros.frame import RadcamDepthError

PRECISIONS = ("auto", "float32", "bfloat16")

VARIABLE = "RADCAM_DEPTH_PRECISION"
"""Environment variable that says what `auto` is: the same figures on every vehicle, whatever its processor."""


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
    """EngineError for a precision that is none of `PRECISIONS`, or an environment that names another one."""
    if precision not in PRECISIONS:
        raise EngineError(f"precision must be one of {', '.join(PRECISIONS)}, got {precision!r}")
    of_environment()


def of_environment() -> str:
    """What the environment says `auto` is: `float32`, `bfloat16`, or `auto` where it says nothing.

    Raises:
        EngineError: for a value that is no precision.
    """
    value = os.environ.get(VARIABLE, "") or "auto"
    if value not in PRECISIONS:
        raise EngineError(f"{VARIABLE} must be one of {', '.join(PRECISIONS)}, got {value!r}; correct it or unset it")
    return value


def choose(precision: str, device: torch.device) -> NumberFormat:
    """The number format for a device.

    Args:
        precision: `float32`, `bfloat16`, or `auto`: what `RADCAM_DEPTH_PRECISION` says; else on a GPU bfloat16 where it
            computes in it, and on a CPU what the table of processors says.
        device: Where the network is to run.

    Raises:
        EngineError: for another precision, of the argument or the environment.
    """
    check_precision(precision)
    if precision != "auto":
        return NumberFormat(getattr(torch, precision), "as asked")
    told = of_environment()
    if told != "auto":
        return NumberFormat(getattr(torch, told), f"as {VARIABLE} says")
    if device.type == "cuda":
        if torch.cuda.is_bf16_supported(including_emulation=False):
            return NumberFormat(torch.bfloat16, "the GPU computes in it")
        return NumberFormat(torch.float32, "the GPU does not compute in bfloat16")
    if device.type != "cpu":
        return NumberFormat(torch.float32, f"the {device.type.upper()} does not compute in bfloat16")
    name, reason = precision_of(Processor.here())
    return NumberFormat(getattr(torch, name), reason)
