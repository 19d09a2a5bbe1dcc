"""`radcam-depth bench`: measures the speed and memory of a network on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radcam_depth_ros.cli.terminal.options import (
    NETWORK,
    DeviceOption,
    JsonOption,
    ModelOption,
    NetworkOption,
    PrecisionOption,
    RuntimeOption,
    progress_bar,
    write_json,
)

if TYPE_CHECKING:
    from radcam_depth_ros.benchmarking.rotation import Watch


def bench(
    network: NetworkOption = None,
    model: ModelOption = None,
    size: Annotated[
        list[str] | None,
        typer.Option(
            help="HEIGHTxWIDTH of the image that the network sees, 448x800 by default; repeat it for several."
        ),
    ] = None,
    points: Annotated[str, typer.Option(help="Number of radar points; several with commas between.")] = "60",
    repeats: Annotated[
        int, typer.Option(min=1, help="Maximum number of rounds; slow parts get fewer, at least two.")
    ] = 30,
    precision: PrecisionOption = None,
    runtime: RuntimeOption = None,
    threads: Annotated[
        int, typer.Option(min=0, help="CPU threads; 0 chooses as the node does: fewer beside other work.")
    ] = 0,
    against: Annotated[
        str | None,
        typer.Option(
            help="Run another configuration alternately: `paper`, or what differs, such as "
            "'precision=float32,mode=eager' or 'points=1000' or fields of the network's architecture."
        ),
    ] = None,
    bag: Annotated[
        Path | None, typer.Option(help="With --against precision=...: compare depth over this bag's frames as well.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Stop after this many frames of the bag.")] = None,
    json_target: JsonOption = None,
    device: DeviceOption = None,
) -> None:
    """Measures a network: each section and the whole, in time, memory and as a share of the machine's own best rate.

    Example: radcam-depth bench --size 256x448 --points 10,60 --repeats 5 --json out/bench.json
    """
    from radcam_depth_ros.benchmarking.measurement import measure
    from radcam_depth_ros.benchmarking.rotation import Schedule
    from radcam_depth_ros.benchmarking.subject import Size, Subject
    from radcam_depth_ros.cli.terminal.bench_request import parse_against, parse_count, parse_size, with_frames
    from radcam_depth_ros.cli.terminal.bench_tables import print_report

    subject = Subject(
        network=network or NETWORK,
        model_file=str(model or ""),
        precision=precision or "auto",
        device=device or "cpu",
        runtime=runtime or "auto",
        threads=threads,
    )
    counts = [parse_count(part) for part in points.split(",")]
    sizes = [Size.padded(*parse_size(text), count) for text in size or ["448x800"] for count in counts]
    other = None if against is None else parse_against(against, subject)
    if bag is not None:
        other = with_frames(other, bag, limit)
    with _watched() as watch:
        report = measure(subject, sizes, Schedule(repeats), watch, other)
    if json_target:
        write_json(report.as_json(), json_target)
    if json_target != "-":
        print_report(report)


@contextmanager
def _watched() -> Iterator[Watch]:
    """A progress bar that follows the measurement from one part of it to the next."""
    with progress_bar() as progress:
        task = progress.add_task("starting", total=None)
        described = ""

        def watch(what: str, done: int, total: int) -> None:
            nonlocal described
            if what != described:
                described = what
                # From the start: each part has its own speed.
                progress.reset(task, description=what, total=total)
            progress.update(task, completed=done, total=total)

        yield watch
