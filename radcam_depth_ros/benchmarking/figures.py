"""Holds measured figures, as values and as JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.benchmarking.machine import CONVOLUTION, Machine
from radcam_depth_ros.benchmarking.sections import GFLOP_COUNTING
from radcam_depth_ros.benchmarking.subject import Running, Size


@dataclass(frozen=True)
class SectionFigures:
    """A section, or the whole network.

    Attributes:
        name: Of the section.
        median_ms: Milliseconds.
        p99_ms: Milliseconds.
        gflop: Operations in billions; NaN where they are not counted.
        share_of_best: Rate as a share of the machine's best convolution rate in the same precision; NaN likewise.
        peak_memory_mb: MiB; NaN where it was not measured.
    """

    name: str
    median_ms: float
    p99_ms: float
    gflop: float = math.nan
    share_of_best: float = math.nan
    peak_memory_mb: float = math.nan

    @classmethod
    def of(
        cls,
        name: str,
        ms: npt.NDArray[np.float64],
        best_gflops: float,
        gflop: float = math.nan,
        peak_memory_mb: float = math.nan,
    ) -> SectionFigures:
        """From the times of all rounds, (rounds,) milliseconds."""
        median_ms = float(np.median(ms))
        share = 1e3 * gflop / median_ms / best_gflops if median_ms > 0 else math.nan
        return cls(name, median_ms, float(np.percentile(ms, 99)), gflop, share, peak_memory_mb)

    def as_json(self) -> dict[str, Any]:
        """Plain values; null where there is no number."""
        return {
            "median_ms": plain(self.median_ms),
            "p99_ms": plain(self.p99_ms),
            "gflop": plain(self.gflop),
            "share_of_best": plain(self.share_of_best),
            "peak_memory_mb": plain(self.peak_memory_mb),
        }


@dataclass(frozen=True)
class SizeFigures:
    """A network at one size.

    Attributes:
        size: What it was given.
        rounds: How often everything was timed.
        whole: The network from uint8 image to depth; its memory is that of a process of its own.
        sections: In order of execution; what brings the image to the network first, what brings depth back and what of
            the network is in no section last.
    """

    size: Size
    rounds: int
    whole: SectionFigures
    sections: tuple[SectionFigures, ...]

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            **vars(self.size),
            "rounds": self.rounds,
            **self.whole.as_json(),
            "frames_per_s": plain(1e3 / self.whole.median_ms),
            "stages": [{"name": section.name, **section.as_json()} for section in self.sections],
        }


@dataclass(frozen=True)
class SideFigures:
    """One side of a comparison.

    Attributes:
        size: What it was given.
        median_ms: Milliseconds, of the alternating runs.
        gflop: Operations in billions.
        peak_memory_mb: Of a process of its own, MiB.
    """

    size: Size
    median_ms: float
    gflop: float
    peak_memory_mb: float

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            **vars(self.size),
            **{name: plain(getattr(self, name)) for name in ("median_ms", "gflop", "peak_memory_mb")},
        }


@dataclass(frozen=True)
class PairFigures:
    """Two configurations that were run alternately.

    Attributes:
        subject: The network that is measured.
        other: What it is held against.
        ratios: Time of `other` over time of `subject`, pair by pair: above 1, `subject` is faster.
        ratio_of_fastest: The same of the fastest turn of each.
        depth_difference: Median of |dense - other's| / other's on a synthetic image; NaN where weights or sizes differ.
    """

    subject: SideFigures
    other: SideFigures
    ratios: tuple[float, ...]
    ratio_of_fastest: float
    depth_difference: float = math.nan

    def quantile(self, share: float) -> float:
        """A quantile of the ratios."""
        return float(np.quantile(self.ratios, share))

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "subject": self.subject.as_json(),
            "other": self.other.as_json(),
            "ratio": {
                "median": plain(self.quantile(0.5)),
                "p10": plain(self.quantile(0.1)),
                "p90": plain(self.quantile(0.9)),
                "of_fastest": plain(self.ratio_of_fastest),
                "pairs": [plain(ratio) for ratio in self.ratios],
            },
            "memory_ratio": plain(self.other.peak_memory_mb / self.subject.peak_memory_mb),
            "depth_difference": plain(self.depth_difference),
        }


@dataclass(frozen=True)
class DriveFigures:
    """Two configurations over the same frames.

    Attributes:
        frames: How many.
        depth_difference: Median over all frames of each frame's median of |dense - other's| / other's.
        mae_m: Mean absolute error within 80 m of the network that is measured; NaN without ground truth.
        other_mae_m: The same of what it is held against.
    """

    frames: int
    depth_difference: float
    mae_m: float
    other_mae_m: float

    @property
    def mae_change(self) -> float:
        """By how much the error differs, as a share of the other's."""
        return abs(self.mae_m - self.other_mae_m) / self.other_mae_m

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        names = ("frames", "depth_difference", "mae_m", "other_mae_m", "mae_change")
        return {name: plain(getattr(self, name)) for name in names}


@dataclass(frozen=True)
class Description:
    """How a network was run.

    Attributes:
        network: Its name.
        weights: Where its weights are from.
        precision: `float32` or `bfloat16`.
        mode: `frozen` or `eager`.
        engine: The engine's own words.
        threads: CPU threads, where nothing else runs on the computer.
        weights_sha256: SHA-256 of the weight file; empty for random weights.
    """

    network: str
    weights: str
    precision: str
    mode: str
    engine: str
    threads: int
    weights_sha256: str

    @classmethod
    def of(cls, running: Running) -> Description:
        """Of a network that is running."""
        engine, loaded = running.engine, running.loaded
        return cls(
            loaded.archive.card.network,
            loaded.weights,
            engine.precision,
            running.subject.mode,
            engine.describe(),
            engine.threads,
            loaded.archive.file_sha256,
        )


@dataclass(frozen=True)
class AgainstFigures:
    """All that was measured of two configurations.

    Attributes:
        spec: What was asked for.
        other: How the other one was run.
        pairs: For each size.
        drive: Over a bag, where one was given.
    """

    spec: str
    other: Description
    pairs: tuple[PairFigures, ...]
    drive: DriveFigures | None = None

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "spec": self.spec,
            **vars(self.other),
            "sizes": [pair.as_json() for pair in self.pairs],
            "drive": self.drive.as_json() if self.drive else None,
        }


@dataclass(frozen=True)
class Report:
    """All that was measured.

    Attributes:
        machine: Where.
        best_gflops: The machine's best rates, GFLOP/s, by precision and kind.
        described: How the network was run.
        sizes: For each size and number of points.
        against: The comparison, where one was asked for.
        advice: What the table of processors says of this one and should say, in a sentence; empty on a GPU.
    """

    machine: Machine
    best_gflops: dict[str, dict[str, float]]
    described: Description
    sizes: tuple[SizeFigures, ...]
    against: AgainstFigures | None = None
    advice: str = ""

    @property
    def best_convolution_gflops(self) -> float:
        """The rate that shares are of, GFLOP/s."""
        return self.best_gflops[self.described.precision][CONVOLUTION]

    def as_json(self) -> dict[str, Any]:
        """Plain values, in the schema of docs/benchmark.md."""
        best = {
            precision: {kind: plain(rate) for kind, rate in kinds.items()}
            for precision, kinds in self.best_gflops.items()
        }
        return {
            "machine": {**vars(self.machine), "flags": list(self.machine.flags), "best_gflops": best},
            **vars(self.described),
            "advice": self.advice,
            "gflop_counting": GFLOP_COUNTING,
            "sizes": [size.as_json() for size in self.sizes],
            "against": self.against.as_json() if self.against else None,
        }


def plain(value: float) -> float | int | None:
    """A number as JSON has it: five digits, null for what is not finite."""
    if isinstance(value, int):
        return value
    return float(f"{value:.5g}") if math.isfinite(value) else None
