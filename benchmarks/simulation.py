"""Simulation: frames a minute, and where the time goes.

Run it from the repository's root: `python -m benchmarks.simulation`; `--json FILE` writes the figures, - to stdout.
Drives of different seeds are simulated as for training (`--key-frames`) or as they are recorded, and each part is timed
inside of the very drive, by the wall clock of one process.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from pathlib import Path

import yaml
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.clocks import clocks
from radcam_depth_ros import configuration
from radcam_depth_ros.bags import BagWriter
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.simulation import SimulationConfig, recording, simulate
from radcam_depth_ros.simulation.sensors.camera_unit import CameraUnit
from radcam_depth_ros.simulation.world.world import World

# What the recording calls, by the part that it belongs to; `surroundings` are built on the way, when the vehicle moves.
_PARTS = {
    "world": (World, "__init__"),
    "image": (recording, "render"),
    "development": (CameraUnit, "develop"),
    "radar": (recording, "sweep_radar"),
    "imaging_radar": (recording, "sweep_imaging_radar"),
    "lidar": (recording, "sweep_lidar"),
    "surroundings": (World, "scene_at"),
    "writing": (BagWriter, "write"),
}


def measure(config: SimulationConfig, seeds: range, frames: int) -> dict[str, float]:
    """Frames a minute, and milliseconds a frame of each part."""
    with tempfile.TemporaryDirectory() as folder, clocks(_PARTS) as spent:
        start = time.perf_counter()
        for seed in track(seeds, "simulating"):
            simulate(config, seed, frames, Path(folder) / f"{seed}.mcap")
        total = time.perf_counter() - start
    count = len(seeds) * frames
    parts = {f"{part}_ms": 1e3 * seconds / count for part, seconds in spent.items()}
    rest = 1e3 * total / count - sum(parts.values())
    return {"frames": count, "frames_a_minute": 60 * count / total, **parts, "rest_ms": rest}


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, help="settings; the defaults of config/simulation.yaml")
    parser.add_argument("--street", default="any", help="kind of street")
    parser.add_argument("--seeds", type=int, default=10, help="how many drives")
    parser.add_argument("--frames", type=int, default=4, help="of each drive")
    parser.add_argument("--key-frames", action="store_true", help="as for training: an image a second, sweeps near it")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    given = yaml.safe_load(options.config.read_text(encoding="utf-8")) if options.config else {}
    config = configuration.build(SimulationConfig, given, str(options.config))
    world = dataclasses.replace(config.world, street=type(config.world.street)(options.street))
    config = dataclasses.replace(config, world=world)
    if options.key_frames:
        camera = dataclasses.replace(config.camera, rate_hz=1.0)
        config = dataclasses.replace(config, camera=camera, key_frames=True)
    found = measure(config, range(1_000_000, 1_000_000 + options.seeds), options.frames)
    if options.json:
        write_json(found, options.json)
    if options.json == "-":
        return
    table = Table("part", "", title="simulation, one process")
    for name, value in found.items():
        table.add_row(name.replace("_", " "), f"{value:.3g}")
    Console().print(table)


if __name__ == "__main__":
    main()
