"""Frame times of the engine and the live node beside other work on the computer: processes that only compute.

    .venv/bin/python -m benchmarks.contention --busy 0 1 2 4 --frames 200 --seconds 15 --json out/contention.json

The engine runs in a process of its own, frame after frame, as in the node; the live node is fed as by
`benchmarks.node_rate`, with two images under way. Ratios are to the first load, within one run.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import cache, partial
from typing import Any

import numpy as np
from rich.console import Console

from demo.process import keep_to_this_machine
from radcam_depth_ros import openmp
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.geometry import NETWORK_MULTIPLE
from radcam_depth_ros.reporting.terminal import print_table

BUSY_LOOP = "while True: pass"
WARM_UP_FRAMES = 10
POINTS = 60
SETTLE_S = 0.5
"""Busy processes have started by then."""

Figures = dict[str, Any]


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that only compute, as long as this lasts."""
    processes: list[subprocess.Popen[bytes]] = []
    try:
        # One after the other, so that those that have started end where another cannot start.
        processes.extend(subprocess.Popen([sys.executable, "-c", BUSY_LOOP]) for _ in range(count))
        time.sleep(SETTLE_S if count else 0)
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


@cache
def ready_engine(height: int, width: int, threads: int) -> Callable[[], object]:
    """One frame of an engine as the node has it; it is made ready once in each process."""
    from radcam_depth_ros.benchmarking.subject import Running, Size, Subject

    return Running.start(Subject(threads=threads)).prepare(Size(height, width, POINTS))[1]


def make_ready(height: int, width: int, threads: int) -> None:
    """Loads the engine in this process, before others are busy."""
    ready_engine(height, width, threads)


def engine_times_ms(height: int, width: int, frames: int, threads: int) -> list[float]:
    """Milliseconds of each frame of an engine as the node has it; for a process of its own."""
    call = ready_engine(height, width, threads)
    times_ms = []
    for _ in range(WARM_UP_FRAMES + frames):
        began_s = time.perf_counter()
        call()
        times_ms.append(1e3 * (time.perf_counter() - began_s))
    return times_ms[WARM_UP_FRAMES:]


def measure_engine(size: tuple[int, int], load: int, frames: int, threads: int) -> Figures:
    """Median and p99 of the engine beside so many busy processes."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        pool.submit(make_ready, *size, threads).result()
        with busy(load):
            times_ms = pool.submit(engine_times_ms, *size, frames, threads).result()
    median, p99 = np.percentile(times_ms, (50, 99)).round(1).tolist()
    return {"busy": load, "frames": frames, "median_ms": median, "p99_ms": p99}


def measure_node(size: tuple[int, int], load: int, seconds: float, threads: int) -> Figures:
    """Rate and latency of the live node beside so many busy processes; DemoError when it gives no depth."""
    from benchmarks import node_rate

    arguments = ["--size", f"{size[0]}x{size[1]}", "--seconds", str(seconds), "--parameter", f"threads:={threads}"]
    options = node_rate.parse(arguments)
    with busy(load):
        rate = node_rate.measure(options.size[0], options).as_json()
    latency = rate["latency_ms"]
    return {
        "busy": load,
        "frames_per_s": rate["frames_per_s"],
        "median_ms": latency["median"],
        "p99_ms": latency["p99"],
        "node_cpu": rate["node_cpu"],
    }


def with_ratios(rows: Sequence[Figures]) -> list[Figures]:
    """The same with each time as a multiple of the first row's."""
    return [
        {**row, **{f"{name}_ratio": _ratio(row[f"{name}_ms"], rows[0][f"{name}_ms"]) for name in ("median", "p99")}}
        for row in rows
    ]


def _ratio(value: float | None, first: float | None) -> float | None:
    return round(value / first, 2) if value and first else None


def report(engine: Sequence[Figures], node: Sequence[Figures]) -> None:
    """Prints a table of each."""
    for title, rows in (("engine", engine), ("live node", node)):
        if rows:
            names = tuple(rows[0])
            cells = tuple(tuple("" if row[name] is None else str(row[name]) for name in names) for row in rows)
            print_table(Console(), f"{title} beside busy processes", names, cells, "Ratios: to the first row.")


def _size(text: str) -> tuple[int, int]:
    try:
        height, width = (int(side) for side in text.split("x"))
    except ValueError:
        height = width = 0
    if min(height, width) < NETWORK_MULTIPLE or height % NETWORK_MULTIPLE or width % NETWORK_MULTIPLE:
        expected = f"expected HEIGHTxWIDTH in multiples of {NETWORK_MULTIPLE}, such as 448x800, got {text!r}"
        raise argparse.ArgumentTypeError(expected)
    return height, width


def _at_least(least: int) -> Callable[[str], int]:
    def count(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"expected a whole number of at least {least}, got {text!r}")
        return int(text)

    return count


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--size", type=_size, default="448x800", help="HEIGHTxWIDTH of the image [448x800]")
    parser.add_argument("--busy", type=_at_least(0), nargs="+", default=[0, 1, 2, 4], help="busy processes [0 1 2 4]")
    parser.add_argument("--frames", type=_at_least(1), default=200, help="frames of the engine for each [200]")
    parser.add_argument("--seconds", type=float, default=15.0, help="of the live node for each; 0: leave it out [15]")
    parser.add_argument("--threads", type=_at_least(0), default=0, help="of the network, as the node's parameter [0]")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Measures each load and prints tables."""
    options = parse(arguments)
    openmp.prepare()
    keep_to_this_machine()
    engine = partial(measure_engine, options.size, frames=options.frames, threads=options.threads)
    node = partial(measure_node, options.size, seconds=options.seconds, threads=options.threads)
    try:
        engines = with_ratios([engine(load=load) for load in options.busy])
        nodes = with_ratios([node(load=load) for load in options.busy]) if options.seconds else []
    except RadcamDepthError as error:
        print(f"contention: {error}", file=sys.stderr)
        return 1
    if options.json:
        settings = {name: os.environ.get(name, "") for name in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")}
        size, cores = "x".join(map(str, options.size)), len(os.sched_getaffinity(0))
        values = {"size": size, "cores": cores, "threads": options.threads, **settings}
        write_json({**values, "engine": engines, "node": nodes}, options.json)
    if options.json != "-":
        report(engines, nodes)
    return 0


if __name__ == "__main__":
    sys.exit(main())
