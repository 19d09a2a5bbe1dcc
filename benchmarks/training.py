"""Training: pixels an hour, GFLOP/s, and where an iteration's time goes, by number format and layout of processes.

Run it from the repository's root: `python -m benchmarks.training`; `--json FILE` writes the figures, - to stdout. Each
layout, some processes of some threads, trains by the package's own loop on key frames of a simulated drive, one layout
after another. Each part of an iteration is timed inside of it, in the first process.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess  # nosec B404  # this module again, as the processes that train
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from rich.table import Table
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.clocks import clocks
from radcam_depth_ros import configuration, networks
from radcam_depth_ros.benchmarking.machine import CONVOLUTION, Machine, best_gflops, probes
from radcam_depth_ros.benchmarking.rotation import Schedule, in_rotation
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.simulation import SimulationConfig, simulate
from radcam_depth_ros.training import checkpoint, fit
from radcam_depth_ros.training.data.batches import BatchMaker
from radcam_depth_ros.training.data.cache import CacheSettings, cached_drives
from radcam_depth_ros.training.data.sample_sets import SampleSet, TrainingData
from radcam_depth_ros.training.distributed.ranks import joined
from radcam_depth_ros.training.losses.registry import Criterion
from radcam_depth_ros.training.observer import StepReport, ValidationReport
from radcam_depth_ros.training.recipe import PhaseConfig, TrainingConfig, recipe_of

DRIVE = {"key_frames": True, "camera": {"rate_hz": 1.0}, "lidar": {"enabled": False}}
FRAMES = 8
WARM_UP = 3

_PARTS = {
    "losses": (Criterion, "__call__"),
    "backward": (torch.Tensor, "backward"),
    "exchange": (fit, "share_gradients"),
    "clipping": (fit, "clip_grad_norm_"),
    "optimiser": (torch.optim.AdamW, "step"),
    "averaging": (checkpoint.AveragedWeights, "update"),
}
"""What an iteration calls; what is left is the forward pass."""


class _Silent:
    def on_step(self, report: StepReport) -> None:
        """Nothing."""

    def on_validation(self, report: ValidationReport) -> None:
        """Nothing."""

    def on_note(self, text: str) -> None:
        """Nothing."""


def samples_of(folder: Path, network: str) -> SampleSet:
    """Key frames of a simulated drive, made in `folder` or found there."""
    bag = folder / "drive"
    if not bag.exists():
        simulate(configuration.build(SimulationConfig, DRIVE), 1_000_000, FRAMES, bag)
    config = networks.create(network).config
    settings = CacheSettings(config.focal_length_px, config.max_depth_m)
    return SampleSet.of(cached_drives([bag], folder / "cache", settings))


def work(
    folder: Path, network: str, precision: str, threads: int, crop: tuple[int, int], count: int, rounds: int
) -> None:
    """One process of a layout: iterates, and prints the figures of the whole as JSON if it is the first."""
    torch.set_num_threads(threads)
    samples = samples_of(folder, network)
    recipe: TrainingConfig = recipe_of(network)
    with joined() as ranks:
        phase = PhaseConfig(1.0, (crop,), count * ranks.size)
        recipe = replace(recipe, precision=precision, threads=threads, phases=(phase,))
        maker = BatchMaker(samples, recipe.augmentation, recipe.seed)
        started = time.perf_counter()
        batch = maker.make(ranks.rank * count, count, crop)
        making_s = time.perf_counter() - started
        data = TrainingData(samples, samples, "a simulated drive")
        trainer = fit.Trainer(network, data, recipe, folder / str(ranks.rank), _Silent(), resume=False, ranks=ranks)
        # Counted by itself: the counter slows it down.
        counter = FlopCounterMode(display=False)
        with counter:
            trainer._iterate(batch, phase)
        for _ in range(WARM_UP):
            trainer._iterate(batch, phase)
        times, parts = [], []
        for _ in range(rounds):
            with clocks(_PARTS) as spent:
                started = time.perf_counter()
                trainer._iterate(batch, phase)
                times.append(time.perf_counter() - started)
            parts.append(spent)
        if not ranks.is_first:
            return
        median_s = float(np.median(times))
        split = {name: 1e3 * float(np.median([entry[name] for entry in parts])) for name in _PARTS}
        pixels = count * ranks.size * crop[0] * crop[1]
        figures = {
            "processes": ranks.size,
            "threads": threads,
            "precision": precision,
            "batch": count * ranks.size,
            "iteration_ms": 1e3 * median_s,
            "gpx_an_hour": 3.6e-6 * pixels / median_s,
            "gflops": 1e-9 * counter.get_total_flops() * ranks.size / median_s,
            "parts_ms": {
                "making a batch, beside": 1e3 * making_s,
                "forward": 1e3 * median_s - sum(split.values()),
                **split,
            },
        }
        print(json.dumps(figures))


def run_layout(options: list[str], processes: int, threads: int) -> dict[str, Any]:
    """Starts a layout's processes on loopback; the figures that the first one prints."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    shared = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "WORLD_SIZE": str(processes)}
    command = [sys.executable, "-m", "benchmarks.training", "--worker", "--threads", str(threads), *options]
    started = []
    for rank in range(processes):
        place = {**shared, "RANK": str(rank)} if processes > 1 else {}
        environment = {**os.environ, "OMP_NUM_THREADS": str(threads), **place}
        pipe = subprocess.PIPE if rank == 0 else subprocess.DEVNULL
        started.append(subprocess.Popen(command, env=environment, stdout=pipe, text=True))  # nosec B603
    told = started[0].communicate()[0]
    if any(process.wait() for process in started):
        raise SystemExit(f"a process of the layout {processes} x {threads} failed; what it said is above")
    found: dict[str, Any] = json.loads(told.splitlines()[-1])
    return found


def measure(options: argparse.Namespace, layouts: list[tuple[int, int]], precisions: list[str]) -> dict[str, Any]:
    """The figures of all layouts and number formats, and the best rates of the machine."""
    machine = Machine.here("cpu")
    torch.set_num_threads(max(processes * threads for processes, threads in layouts))
    known = probes(precisions, "cpu")
    times = in_rotation([probe.task for probe in known], Schedule(5), "cpu", lambda done, count: None)
    best = best_gflops(known, [times])
    found = []
    with tempfile.TemporaryDirectory() as folder:
        samples_of(Path(folder), options.network)
        for precision in precisions:
            for processes, threads in layouts:
                given = ["--folder", folder, "--network", options.network, "--precision", precision]
                given += ["--crop", options.crop, "--batch", str(options.batch), "--rounds", str(options.rounds)]
                figures = run_layout(given, processes, threads)
                figures["share_of_best"] = figures["gflops"] / best[precision][CONVOLUTION]
                found.append(figures)
    return {"machine": machine.cpu, "crop": options.crop, "best_gflops": best, "layouts": found}


def table_of(found: dict[str, Any]) -> Table:
    """The figures as a table, a column for each layout."""
    table = Table(title=f"training on {found['machine']}, crops of {found['crop']}")
    table.add_column("processes x threads", no_wrap=True)
    for one in found["layouts"]:
        table.add_column(f"{one['precision']}\n{one['processes']} x {one['threads']}", justify="right")
    rows = {
        "batch": ("batch", "{:.0f}"),
        "iteration, ms": ("iteration_ms", "{:.0f}"),
        "Gpx an hour": ("gpx_an_hour", "{:.2f}"),
        "GFLOP/s": ("gflops", "{:.0f}"),
        "share of the best convolution": ("share_of_best", "{:.0%}"),
    }
    for title, (name, form) in rows.items():
        table.add_row(title, *(form.format(one[name]) for one in found["layouts"]))
    table.add_section()
    for part in found["layouts"][0]["parts_ms"]:
        table.add_row(f"{part}, ms", *(f"{one['parts_ms'][part]:.0f}" for one in found["layouts"]))
    return table


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--network", default="baff")
    parser.add_argument("--crop", default="320x256", help="height and width of the images")
    parser.add_argument("--batch", type=int, default=4, help="images an iteration of one process")
    parser.add_argument("--rounds", type=int, default=10, help="iterations that are timed")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    for name, kind in (("--folder", Path), ("--precision", str), ("--threads", int)):
        parser.add_argument(name, type=kind, help=argparse.SUPPRESS)
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    height, width = (int(side) for side in options.crop.split("x"))
    if options.worker:
        crop = (height, width)
        work(options.folder, options.network, options.precision, options.threads, crop, options.batch, options.rounds)
        return
    cores = len(os.sched_getaffinity(0))
    layouts = [(1, 1)] if cores == 1 else [(1, 1), (1, cores), (cores, 1)]
    found = measure(options, layouts, list(Machine.here("cpu").precisions))
    if options.json:
        write_json(found, options.json)
    if options.json != "-":
        Console().print(table_of(found))


if __name__ == "__main__":
    main()
