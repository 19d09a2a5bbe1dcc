"""The tables of `radcam-depth bench`."""

from __future__ import annotations

import math

from rich.console import Console

from radcam_depth_ros.benchmarking.figures import AgainstFigures, PairFigures, Report, SectionFigures, SizeFigures
from radcam_depth_ros.benchmarking.machine import CONVOLUTION, MATRIX_PRODUCT
from radcam_depth_ros.benchmarking.sections import GFLOP_COUNTING
from radcam_depth_ros.benchmarking.subject import Size
from radcam_depth_ros.reporting.terminal import PlainConsole, print_table

COLUMNS = ("median ms", "p99 ms", "GFLOP", "of best", "MiB")


def print_report(report: Report) -> None:
    """Prints everything to the terminal."""
    console = PlainConsole()
    described, machine = report.described, report.machine
    console.print(f"{machine.gpu or machine.cpu}, {machine.threads} threads, {' '.join(machine.flags)}")
    for precision, kinds in report.best_gflops.items():
        console.print(
            f"best rates in {precision}: convolution {kinds[CONVOLUTION]:.0f} GFLOP/s, matrix product "
            f"{kinds[MATRIX_PRODUCT]:.0f} GFLOP/s"
        )
    if report.advice:
        console.print(report.advice)
    console.print(f"{described.network}, weights: {described.weights}, {described.mode}; engine: {described.engine}")
    for entry in report.sizes:
        _print_sections(console, entry)
    _print_whole(console, report)
    if report.against:
        _print_against(console, report.against)


def _print_sections(console: Console, entry: SizeFigures) -> None:
    print_table(
        console,
        f"sections at {entry.size}, {entry.rounds} rounds",
        ("section", *COLUMNS),
        tuple((section.name, *_cells(section)) for section in entry.sections),
        "resample and resample back: for a camera whose image has twice the rows and columns; they are not in the "
        "whole",
    )


def _print_whole(console: Console, report: Report) -> None:
    rows = tuple(
        (*_size(entry.size), *_cells(entry.whole), f"{1e3 / entry.whole.median_ms:.1f}") for entry in report.sizes
    )
    note = f"GFLOP: {GFLOP_COUNTING}; MiB: the peak of a process that does nothing else"
    print_table(console, "whole network", ("image", "points", *COLUMNS, "frames/s"), rows, note)


def _print_against(console: Console, against: AgainstFigures) -> None:
    other, rows = against.other, []
    for pair in against.pairs:
        mine, others = pair.subject, pair.other
        rows.append(
            (
                *_size(mine.size),
                *_size(others.size),
                *(_number(value) for value in (mine.median_ms, others.median_ms)),
                *(_number(pair.quantile(share)) for share in (0.5, 0.1, 0.9)),
                *(_number(value) for value in (mine.peak_memory_mb, others.peak_memory_mb)),
            )
        )
    print_table(
        console,
        f"against {against.spec}",
        (
            *("image", "points", "other image", "other points", "median ms", "other median ms"),
            *("ratio", "ratio p10", "ratio p90", "MiB", "other MiB"),
        ),
        rows,
        f"other: {other.network}, weights: {other.weights}, {other.mode}; engine: {other.engine}",
    )
    for pair in against.pairs:
        console.print(_pair_line(pair))
    if against.drive:
        drive = against.drive
        console.print(
            f"over {drive.frames} frames of the bag: dense depth differs by {100 * drive.depth_difference:.3f} % "
            f"(median of frames); MAE within 80 m {drive.mae_m:.3f} m, other {drive.other_mae_m:.3f} m, "
            f"{100 * drive.mae_change:.2f} % apart"
        )


def _pair_line(pair: PairFigures) -> str:
    ratios = ", ".join(_number(ratio) for ratio in pair.ratios)
    line = f"ratios pair by pair at {pair.subject.size}: {ratios}; of the fastest: {_number(pair.ratio_of_fastest)}"
    if math.isfinite(pair.depth_difference):
        line += f"; dense depth differs by {100 * pair.depth_difference:.3f} % (median, made-up image)"
    return line


def _size(size: Size) -> tuple[str, str]:
    return f"{size.height} x {size.width}", str(size.points)


def _cells(figures: SectionFigures) -> tuple[str, ...]:
    share = f"{100 * figures.share_of_best:.0f} %" if math.isfinite(figures.share_of_best) else ""
    median, p99, gflop, memory = map(
        _number, (figures.median_ms, figures.p99_ms, figures.gflop, figures.peak_memory_mb)
    )
    return median, p99, gflop, share, memory


def _number(value: float) -> str:
    """Three digits, nothing where there is no number."""
    if not math.isfinite(value):
        return ""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
