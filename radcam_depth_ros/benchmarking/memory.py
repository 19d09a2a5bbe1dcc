"""Measures memory: of one call by its allocations, of a whole network in a process of its own."""

from __future__ import annotations

import json
import os
import re
import subprocess  # nosec B404  # starts this module in another process, nothing else
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch.profiler import ProfilerActivity, profile

from radcam_depth_ros.benchmarking.subject import BenchmarkError, Running, Size, Subject

PASSES = 2
MIB = 2**20


def peak_allocated_mb(call: Callable[[], object], device: str) -> float:
    """The most memory (MiB) that a call held at once of what it allocated itself: with its output, without inputs."""
    if device != "cpu":
        torch.cuda.synchronize(device)
        torch.cuda.reset_peak_memory_stats(device)
        before = torch.cuda.memory_allocated(device)
        call()
        torch.cuda.synchronize(device)
        return float(torch.cuda.max_memory_allocated(device) - before) / MIB
    with _quiet_profiler(), profile(activities=[ProfilerActivity.CPU], profile_memory=True) as profiler:
        call()
    held = peak = 0
    for event in sorted(_memory_events(profiler), key=lambda event: event["ts"]):
        held += event["args"]["Bytes"]
        peak = max(peak, held)
    return peak / MIB


def _memory_events(profiler: profile) -> Iterator[dict[str, Any]]:
    """Each time that memory was taken or given back."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trace.json"
        profiler.export_chrome_trace(str(path))
        events = json.loads(path.read_text(encoding="utf-8"))["traceEvents"]
    yield from (event for event in events if event["name"] == "[memory]")


@contextmanager
def _quiet_profiler() -> Iterator[None]:
    """Torch's profiler writes to stderr, into the progress bar, whenever it starts and stops."""
    name = "KINETO_LOG_LEVEL"
    before = os.environ.get(name)
    os.environ[name] = before or "99"
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]


def process_peak_mb(subject: Subject, size: Size) -> float:
    """The most memory (MiB) that a process ever had which only loads a network and runs it.

    Raises:
        BenchmarkError: when that process fails, since memory runs out for example.
    """
    asked = json.dumps({"subject": {**vars(subject), "architecture": dict(subject.architecture)}, "size": vars(size)})
    done = subprocess.run(  # nosec B603  # this interpreter, and arguments in a list: no shell sees them
        [sys.executable, "-m", "radcam_depth_ros.benchmarking.memory", asked],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise BenchmarkError(
            f"the process that measures memory at {size} failed: {last}; choose a smaller size if memory ran out"
        )
    return float(done.stdout.split()[-1])


def _run_alone(asked: str) -> float:
    """What the process does; returns its own peak in MiB."""
    values = json.loads(asked)
    _, call = Running.start(Subject(**values["subject"])).prepare(Size(**values["size"]))
    for _ in range(PASSES):
        call()
    # Not getrusage: its maximum is inherited from the process that started this one.
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text(encoding="utf-8"))
    return int(found.group(1)) / 1024 if found else float("nan")


if __name__ == "__main__":
    print(_run_alone(sys.argv[1]))
