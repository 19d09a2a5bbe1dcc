"""Camera height, pitch and roll by `check-calibration --road` against the truth of simulated drives.

Run it from the repository's root: `python -m benchmarks.road_calibration --json -`. Each drive is checked as it is,
without its LiDAR, and without LiDAR and odometry, so that Doppler alone tells the speed. The truth is the transform.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from radcam_depth_ros.bags import BagReader, BagWriter
from radcam_depth_ros.calibration import check_road
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.simulation import CameraConfig, SimulationConfig, simulate

FIRST_SEED = 1_000_000
WITHOUT = {"lidar": (), "texture+odometry": ("/lidar/points",), "texture+doppler": ("/lidar/points", "/odom", "/tf")}
"""What a drive has to lack so that a source is used."""
HEIGHT_SHARE, PITCH_DEG = 0.05, 0.3
"""The targets."""


def copy_without(bag: Path, topics: tuple[str, ...], target: Path) -> Path:
    """Copies a bag but for some topics."""
    with BagReader(bag) as reader, BagWriter(target) as writer:
        kept = {topic.name for topic in reader.topics} - set(topics)
        for message in reader.messages(kept):
            writer.copy(message)
    return target


def measure(bag: Path, source: str, frames: int, folder: Path) -> dict[str, Any]:
    """Errors of one drive with one source; None where it is unknown."""
    used = copy_without(bag, WITHOUT[source], folder / "used.mcap") if WITHOUT[source] else bag
    start = time.perf_counter()
    report = check_road(used, frames=frames)
    row: dict[str, Any] = {"source": source, "used": report.frames, "seconds": round(time.perf_counter() - start, 1)}
    for value, name in zip(report.values, ("height_m", "pitch_deg", "roll_deg"), strict=True):
        is_known = value.value is not None and value.given is not None
        row |= {
            name: value.given and round(value.given, 3),
            f"{name}_error": round((value.value or 0.0) - (value.given or 0.0), 3) if is_known else None,
            f"{name}_deviation": value.deviation and round(value.deviation, 3),
        }
    if used != bag:
        used.unlink()
    return {**row, "why_unknown": report.sentence}


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """How many drives were told, how many within the targets, and the largest errors."""
    told = [row for row in rows if row["height_m_error"] is not None and row["pitch_deg_error"] is not None]
    height = np.array([abs(row["height_m_error"]) / row["height_m"] for row in told])
    pitch, roll = (
        np.array([abs(row[name]) for row in told if row[name] is not None])
        for name in ("pitch_deg_error", "roll_deg_error")
    )
    return {
        "drives": len(rows),
        "told": len(told),
        "height_held": int((height <= HEIGHT_SHARE).sum()),
        "pitch_held": int((pitch <= PITCH_DEG).sum()),
        "largest_height_share": round(float(height.max(initial=0.0)), 4),
        "largest_pitch_deg": round(float(pitch.max(initial=0.0)), 3),
        "largest_roll_deg": round(float(roll.max(initial=0.0)), 3),
    }


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bags", type=Path, help="folder of the drives; those that are there are used again")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="of the first drive")
    parser.add_argument("--seeds", type=int, default=10, help="how many drives")
    parser.add_argument("--frames", type=int, default=30, help="images of each drive, and pairs that are looked at")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    rows: dict[int, list[dict[str, Any]]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        for seed in range(options.seed, options.seed + options.seeds):
            bag = (options.bags or Path(temporary)) / str(seed)
            if not bag.exists():
                simulate(SimulationConfig(camera=CameraConfig(depth=False, classes=False)), seed, options.frames, bag)
            rows[seed] = [measure(bag, source, options.frames, Path(temporary)) for source in WITHOUT]
    totals = {
        source: summary([row for some in rows.values() for row in some if row["source"] == source])
        for source in WITHOUT
    }
    if options.json:
        write_json({"summary": totals, "drives": rows}, options.json)
    if options.json == "-":
        return
    table = Table("source", *next(iter(totals.values())))
    for source, total in totals.items():
        table.add_row(source, *map(str, total.values()))
    Console().print(table)


if __name__ == "__main__":
    main()
