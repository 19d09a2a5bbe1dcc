"""LiDAR ground truth against exact depth: a scan as it lies, one moved to its image's time, and many accumulated.

Run it from the repository's root: `python -m experiments.lidar_truth`; `--json FILE` writes the figures, - to stdout. A
drive of each seed is simulated, with odometry and /tf; as it lies a scan is taken from a copy without them.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from radcam_depth_ros.bags import BagReader, BagWriter
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.drive import DriveSettings, Sample, ScanSummary, read_samples
from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.simulation import SimulationConfig, simulate

SEEDS = (1_000_000, 1_000_001, 1_000_003)
"""The first drives kept for measuring that go faster than 10 m/s, but 1000002, whose scans are 4 ms off."""
WITHIN_M = 80.0
_MOTION = ("/odom", "/tf")


@dataclass(frozen=True)
class TruthErrors:
    """Mean absolute error of LiDAR truth against exact depth within 80 m, averaged over the frames, metres.

    Attributes:
        seed: The drive's.
        frames: How many have a scan near.
        speed_mps: The vehicle's, by odometry, over the time between scan and image.
        offset_ms: Mean time between scan and image.
        as_it_lies_m: The nearest scan, unmoved.
        moved_m: The same, moved to the image's time.
        accumulated_m: Many scans.
        ratio: `moved_m` over `as_it_lies_m`.
    """

    seed: int
    frames: int
    speed_mps: float
    offset_ms: float
    as_it_lies_m: float
    moved_m: float
    accumulated_m: float
    ratio: float


def measure(seed: int, frames: int, folder: Path, config: SimulationConfig) -> TruthErrors:
    """The errors on one drive, which is simulated first."""
    drive, still = folder / f"{seed}.mcap", folder / f"{seed}-still.mcap"
    simulate(config, seed, frames, drive)
    without_motion(drive, still)
    exact = {
        sample.frame.stamp_ns: sample.depth_m for sample in read_samples(drive, DriveSettings(ground_truth="exact"))
    }
    lidar = DriveSettings(ground_truth="lidar")
    moved = tuple(read_samples(drive, lidar))
    errors = [
        _errors(samples, exact)
        for samples in (
            tuple(read_samples(still, lidar)),
            moved,
            tuple(read_samples(drive, DriveSettings(ground_truth="lidar", accumulate="always"))),
        )
    ]
    # Of the same frames in all three.
    known = np.all([np.isfinite(values) for values in errors], axis=0)
    lies, one, many = (float(values[known].mean()) for values in errors)
    scans = ScanSummary.of(sample.scan for sample in moved if sample.scan is not None).moved
    speed = scans.shift_m / scans.offset_s
    return TruthErrors(seed, int(known.sum()), speed, 1e3 * scans.offset_s, lies, one, many, one / lies)


def without_motion(drive: Path, copy: Path) -> None:
    """Copies a bag without what tells how the vehicle moves."""
    with BagReader(drive) as reader, BagWriter(copy, overwrite=True) as writer:
        for message in reader.messages([topic.name for topic in reader.topics if topic.name not in _MOTION]):
            writer.copy(message)


def _errors(samples: Sequence[Sample], exact: dict[int, FloatArray]) -> FloatArray:
    """(frames,) metres; NaN of a frame without LiDAR truth."""
    found = []
    for sample in samples:
        truth_m = exact[sample.frame.stamp_ns]
        known = np.isfinite(sample.depth_m) & (truth_m <= WITHIN_M)
        found.append(np.abs(sample.depth_m[known] - truth_m[known]).mean() if known.any() else np.nan)
    return np.array(found, np.float32)


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS, help="of the drives")
    parser.add_argument("--frames", type=int, default=20, help="of each drive, at 10 Hz")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        seeds = track(options.seeds, "measuring", console=Console(stderr=True))
        rows = [measure(seed, options.frames, Path(folder), SimulationConfig()) for seed in seeds]
    if options.json:
        write_json({"within_m": WITHIN_M, "drives": [asdict(row) for row in rows]}, options.json)
    if options.json == "-":
        return
    table = Table(
        "seed", "frames", "m/s", "offset ms", "as it lies", "moved", "accumulated", "ratio", title="metres off"
    )
    for row in rows:
        numbers = (row.as_it_lies_m, row.moved_m, row.accumulated_m, row.ratio)
        place = (str(row.seed), str(row.frames), f"{row.speed_mps:.1f}", f"{row.offset_ms:.0f}")
        table.add_row(*place, *(f"{number:.2f}" for number in numbers))
    Console().print(table)


if __name__ == "__main__":
    main()
