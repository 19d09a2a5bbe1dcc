"""Time against error of forms of `baff`: each is trained for a short while, and all are timed in turns.

Run it from the repository's root, on simulated drives, of which some are kept for validation:

    python -m experiments.variants --bags out/drives --validation-bags out/held_out --out out/variants

A form that is trained already is not trained again: what was cut off goes on when the same command is given. Errors are
those of `radcam-depth train`'s last validation; with so short a training and one seed, differences below a tenth of a
metre say nothing. `--forms` takes some of them alone, `--json FILE` writes the figures.
"""

from __future__ import annotations

import argparse
import statistics
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from experiments.short_training import Budget, ShortTraining
from radcam_depth_ros.benchmarking.rotation import Schedule, Task, in_rotation
from radcam_depth_ros.benchmarking.sections import count_gflop
from radcam_depth_ros.benchmarking.subject import NetworkInputs, Running, Size, Subject
from radcam_depth_ros.cli.terminal.options import write_json

SHIPPED = "as shipped"
FORMS: dict[str, dict[str, Any]] = {
    SHIPPED: {},
    "no detail at half the size": {"full_size": False},
    "no features of ImageNet": {"context": "none"},
    "a depth for each 4 x 4 px": {"detail": 1, "full_size": False},
    "a depth for each pixel": {"detail": 4, "full_size": False},
    "position attention exact": {"position_pool": [1, 1]},
    "no position attention": {"position_attention": False},
    "no attention, no bottom-up branch": {
        "position_attention": False,
        "channel_attention": False,
        "bidirectional": False,
    },
    "16 returns a cell": {"returns_per_cell": 16},
    "narrower": {"channels": [32, 48, 96, 128]},
    "wider": {"channels": [48, 96, 160, 224]},
    "one block a level": {"blocks": [1, 1, 1, 1]},
}


def timed(names: list[str], size: Size, rounds: int) -> dict[str, dict[str, float]]:
    """Milliseconds and GFLOP of each form at a size, and how many times the shipped form's time it takes."""
    tasks: list[Task] = []
    found: dict[str, dict[str, float]] = {}
    for name in names:
        running = Running.start(Subject("baff", architecture=FORMS[name], precision="float32"))
        _, call = running.prepare(size)
        tasks.append(Task(name, call))
        inputs = NetworkInputs.synthetic(size, running.focal_length_px)
        found[name] = {"gflop": count_gflop(running, inputs)}
    with Progress() as progress:
        bar = progress.add_task("timing")
        times = in_rotation(
            tasks, Schedule(rounds, 600.0), "cpu", lambda done, total: progress.update(bar, completed=done, total=total)
        )
    for name in names:
        found[name]["ms"] = statistics.median(times.of(name))
        found[name]["times_shipped"] = statistics.median(times.of(name) / times.of(names[0]))
    return found


def main() -> None:
    """Trains, times, prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    Budget.add_options(parser, iterations=500)
    parser.add_argument("--rounds", type=int, default=30, help="turns of the timing")
    parser.add_argument("--forms", nargs="+", choices=FORMS, default=list(FORMS), metavar="NAME")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    names = [SHIPPED, *(name for name in options.forms if name != SHIPPED)]
    budget = Budget.of(options, {})
    folders = {name: options.out / name.replace(" ", "_") for name in names}
    errors = {name: ShortTraining(folders[name], budget, "baff", FORMS[name]).run() for name in names}
    figures = timed(names, Size(448, 800, 60), options.rounds)
    table = Table(title=f"{options.iterations} iterations; 448 x 800, 60 points")
    for column in ("form", "GFLOP", "ms", "times shipped", "MAE 80 m", "semi-dense share", "semi-dense MAE"):
        table.add_column(column, justify="left" if column == "form" else "right")
    for name in names:
        row, error = figures[name], errors[name]
        row.update(
            {key: error[key] for key in ("mae_80_m", "semi_dense_share", "semi_dense_mae_m")}, iterations=error["step"]
        )
        table.add_row(
            name,
            f"{row['gflop']:.1f}",
            f"{row['ms']:.1f}",
            f"{row['times_shipped']:.2f}",
            f"{row['mae_80_m']:.2f}",
            f"{100 * row['semi_dense_share']:.0f} %",
            f"{row['semi_dense_mae_m']:.2f}",
        )
    Console().print(table)
    if options.json:
        write_json(figures, options.json)


if __name__ == "__main__":
    main()
