"""Describes the machine, and measures the best rates that it reaches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch.nn import functional

from radcam_depth_ros.benchmarking.rotation import Task, Times
from radcam_depth_ros.engine import Processor, advice

CONVOLUTIONS = ((64, 224, 400), (128, 112, 200), (256, 56, 100))
"""Channels, height and width of the 3 x 3 convolutions: 6.6 GFLOP each, as networks have them at 448 x 800."""
PRODUCT = 1472
"""Rows and columns of the matrix product: 6.4 GFLOP."""
GPU_BATCH = 32
"""A GPU is not busy with one of these."""

CONVOLUTION, MATRIX_PRODUCT = "convolution", "matrix_product"
_FLAGS = ("avx2", "avx512f", "avx512_vnni", "avx512_bf16", "avx512_fp16", "amx_tile", "amx_bf16", "amx_int8")


@dataclass(frozen=True)
class Machine:
    """What the network ran on.

    Attributes:
        cpu: Model name of the processor.
        gpu: Name of the GPU; empty on a CPU.
        threads: CPU threads of torch.
        flags: What the processor has, of the instruction sets that matter here.
    """

    cpu: str
    gpu: str
    threads: int
    flags: tuple[str, ...]

    @classmethod
    def here(cls, device: str) -> Machine:
        """This machine."""
        processor = Processor.here()
        return cls(
            cpu=processor.name,
            gpu="" if device == "cpu" else torch.cuda.get_device_name(device),
            threads=torch.get_num_threads(),
            flags=tuple(flag for flag in _FLAGS if flag in processor.flags),
        )

    @property
    def precisions(self) -> tuple[str, ...]:
        """The number formats that it computes in by itself."""
        return ("float32", "bfloat16") if self.gpu or Processor.here().has_bfloat16 else ("float32",)


@dataclass(frozen=True)
class Probe:
    """A piece of work whose rate is known to be good.

    Attributes:
        kind: `CONVOLUTION` or `MATRIX_PRODUCT`.
        precision: `float32` or `bfloat16`.
        gflop: Its multiply-adds, two operations each, in billions.
        task: Its work.
    """

    kind: str
    precision: str
    gflop: float
    task: Task


def probes(precisions: Iterable[str], device: str) -> tuple[Probe, ...]:
    """Large convolutions with channels last, and a matrix product, warmed up."""
    batch = 1 if device == "cpu" else GPU_BATCH
    found: list[Probe] = []
    for precision in precisions:
        dtype = torch.bfloat16 if precision == "bfloat16" else torch.float32
        for channels, height, width in CONVOLUTIONS:
            x = torch.randn(batch, channels, height, width).to(device, dtype, memory_format=torch.channels_last)
            weight = torch.randn(channels, channels, 3, 3).to(device, dtype, memory_format=torch.channels_last)
            gflop = 2e-9 * 9 * x.numel() * channels
            call = partial(functional.conv2d, x, weight, padding=1)
            found.append(_probe(CONVOLUTION, precision, gflop, call, f"{channels} channels"))
        matrix = torch.randn(batch, PRODUCT, PRODUCT).to(device, dtype)
        gflop = 2e-9 * matrix.numel() * PRODUCT
        found.append(_probe(MATRIX_PRODUCT, precision, gflop, partial(torch.matmul, matrix, matrix), "square"))
    return tuple(found)


def _probe(kind: str, precision: str, gflop: float, call: Callable[[], object], form: str) -> Probe:
    for _ in range(2):
        call()
    return Probe(kind, precision, gflop, Task(f"{precision} {kind}, {form}", call))


def best_gflops(known: Iterable[Probe], times: Iterable[Times]) -> dict[str, dict[str, float]]:
    """The best rate, GFLOP/s, by precision and kind: the best shape's median over all rounds."""
    measured = tuple(times)
    best: dict[str, dict[str, float]] = {}
    for probe in known:
        median_ms = float(np.median(np.concatenate([entry.of(probe.task.name) for entry in measured])))
        kinds = best.setdefault(probe.precision, {})
        kinds[probe.kind] = max(kinds.get(probe.kind, 0.0), 1e3 * probe.gflop / median_ms)
    return best


def precision_advice(best: Mapping[str, Mapping[str, float]]) -> str:
    """What the table of processors says of this one, and what it should say by these rates, in a sentence.

    Args:
        best: As `best_gflops` gives it.
    """
    rates = [best[precision][CONVOLUTION] if precision in best else math.nan for precision in ("float32", "bfloat16")]
    return advice(Processor.here(), rates[1] / rates[0])
