"""Replay of a simulated 900 x 1600 drive against the network's own time over the same frames, in one process.

Run it from the repository's root: `python -m benchmarks.replay`; `--bag` takes another drive, `--model` other weights,
`--json FILE` writes the figures. The two are timed alternately, and the ratio is the median of those of the rounds.
"""

from __future__ import annotations

import argparse
import dataclasses
import statistics
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.drive import DriveSettings, read_samples
from radcam_depth_ros.encoder import OutputConfig
from radcam_depth_ros.engine import apart
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.replay import ReplayOptions, replay
from radcam_depth_ros.simulation import SimulationConfig, simulate


def simulated(path: Path, frames: int) -> Path:
    """A drive with a camera of 900 x 1600 pixels."""
    config = SimulationConfig()
    camera = dataclasses.replace(config.camera, width=1600, height=900)
    simulate(dataclasses.replace(config, camera=camera), 7, frames, path)
    return path


def compare(bag: Path, folder: Path, estimator: Estimator, options: ReplayOptions, rounds: int) -> dict[str, float]:
    """Milliseconds a frame of both, and their ratio."""
    frames = [sample.frame for sample in read_samples(bag, DriveSettings(ground_truth="none"))]
    inputs = [estimator.prepare(frame) for frame in frames]
    network, whole = [], []

    def run() -> None:
        for given in inputs:
            estimator.run(given)

    for turn in track(range(rounds + 1), "timing"):
        start = time.perf_counter()
        apart(run)  # as a replay runs it: threads of this one would stand in its way
        between = time.perf_counter()
        replay(bag, folder / f"{turn}.mcap", estimator, options=options)
        end = time.perf_counter()
        (folder / f"{turn}.mcap").unlink()
        if turn:  # the first is for warming up
            network.append(1e3 * (between - start) / len(frames))
            whole.append(1e3 * (end - between) / len(frames))
    return {
        "frames": len(frames),
        "network_ms": statistics.median(network),
        "replay_ms": statistics.median(whole),
        "ratio": statistics.median(b / a for a, b in zip(network, whole, strict=True)),
    }


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bag", type=Path, help="a drive; a simulated one by default")
    parser.add_argument("--frames", type=int, default=40, help="of the simulated drive")
    parser.add_argument("--rounds", type=int, default=5, help="how often both are timed")
    parser.add_argument("--model", type=Path, help="weights; those of baff by default")
    parser.add_argument("--compress", action="store_true", help="write a compressed bag")
    parser.add_argument("--encoding", default="32FC1", help="of the depth images")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    estimator = Estimator(EstimatorConfig(model_file=str(options.model or ""), allow_exported=True))
    written = ReplayOptions(compress=options.compress, output=OutputConfig(options.encoding))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bag = options.bag or simulated(folder / "drive", options.frames)
        found = compare(bag, folder, estimator, written, options.rounds)
    if options.json:
        write_json(found, options.json)
    if options.json == "-":
        return
    table = Table(*found, title="replay against the network alone")
    table.add_row(*(f"{value:.3g}" for value in found.values()))
    Console().print(table)


if __name__ == "__main__":
    main()
