"""Measures a network at some sizes: section by section, whole, and against another."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from radcam_depth_ros.benchmarking.comparison import Against, compare
from radcam_depth_ros.benchmarking.figures import Description, Report, SectionFigures, SizeFigures
from radcam_depth_ros.benchmarking.machine import (
    CONVOLUTION,
    Machine,
    Probe,
    best_gflops,
    precision_advice,
    probes,
)
from radcam_depth_ros.benchmarking.memory import process_peak_mb
from radcam_depth_ros.benchmarking.resampling_cost import RESAMPLE, RESAMPLE_BACK, estimator_tasks, resampling_ms
from radcam_depth_ros.benchmarking.rotation import Schedule, Task, Times, Watch, in_rotation
from radcam_depth_ros.benchmarking.sections import Anatomy, dissect
from radcam_depth_ros.benchmarking.subject import Running, Size, Subject

WHOLE, REST = "whole", "the rest"


def measure(
    subject: Subject, sizes: Sequence[Size], schedule: Schedule, watch: Watch, against: Against | None = None
) -> Report:
    """Measures everything.

    Args:
        subject: The network.
        sizes: One row of figures each.
        schedule: How long to measure.
        watch: Is told what is going on.
        against: What to hold the network against.

    Raises:
        RadcamDepthError: when a network cannot be loaded, or memory runs out where it is measured.
    """
    watch("loading the network", 0, 1)
    running = Running.start(subject)
    machine = Machine.here(subject.device)
    known = probes(dict.fromkeys((*machine.precisions, running.engine.precision)), subject.device)
    parts = [_time(running, size, known, schedule, watch) for size in sizes]
    best = best_gflops(known, [times for _, times in parts])
    figures: list[SizeFigures] = []
    for size, (anatomy, times) in zip(sizes, parts, strict=True):
        watch(f"memory at {size}", 0, 1)
        peak_mb = process_peak_mb(running.resolved, size)
        figures.append(_figures(size, anatomy, times, best[running.engine.precision][CONVOLUTION], peak_mb))
    compared = compare(running, figures, against, schedule, watch) if against else None
    said = "" if machine.gpu else precision_advice(best)
    return Report(machine, best, Description.of(running), tuple(figures), compared, said)


def _time(
    running: Running, size: Size, known: Sequence[Probe], schedule: Schedule, watch: Watch
) -> tuple[Anatomy, Times]:
    """All times at a size."""
    watch(f"preparing {size}", 0, 1)
    inputs, whole = running.prepare(size)
    anatomy = dissect(running, inputs)
    device = running.subject.device
    tasks = (
        Task(WHOLE, whole),
        *(section.task for section in anatomy.sections),
        *estimator_tasks(size, running.focal_length_px, device),
        *(probe.task for probe in known),
    )
    return anatomy, in_rotation(tasks, schedule, device, partial(watch, f"timing {size}"))


def _figures(size: Size, anatomy: Anatomy, times: Times, best: float, peak_mb: float) -> SizeFigures:
    """The figures of a size; `best` is the rate that shares are of."""
    around = {name: SectionFigures.of(name, ms, best) for name, ms in resampling_ms(times).items()}
    inside: list[SectionFigures] = []
    rest_ms = times.of(WHOLE)
    for name in dict.fromkeys(section.name for section in anatomy.sections):
        pieces = [section for section in anatomy.sections if section.name == name]
        gflop, memory_mb = sum(piece.gflop for piece in pieces), max(piece.peak_memory_mb for piece in pieces)
        inside.append(SectionFigures.of(name, times.of(name), best, gflop, memory_mb))
        rest_ms = rest_ms - times.of(name)
    return SizeFigures(
        size,
        len(times.ms),
        SectionFigures.of(WHOLE, times.of(WHOLE), best, anatomy.gflop, peak_mb),
        (around[RESAMPLE], *inside, SectionFigures.of(REST, rest_ms, best), around[RESAMPLE_BACK]),
    )
