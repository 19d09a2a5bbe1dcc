"""`radcam-depth bench`: how fast a network is on this machine."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from radcam_depth_ros.cli.options import DeviceOption, JsonOption, ModelOption, NetworkOption, progress_bar, write_json
from radcam_depth_ros.frame import RadcamDepthError

if TYPE_CHECKING:
    from radcam_depth_ros.benchmarking.comparison import Against
    from radcam_depth_ros.benchmarking.rotation import Watch
    from radcam_depth_ros.benchmarking.subject import Subject

PAPER = "paper"
PAPER_IMAGE_FACTOR = 2
"""A paper's network works on the image as it is; at the usual focal length ours sees half of its rows and columns."""


def bench(
    network: NetworkOption = "baff",
    model: ModelOption = None,
    size: Annotated[
        list[str] | None,
        typer.Option(
            help="HEIGHTxWIDTH of the image that the network sees, 448x800 by default; repeat it for several."
        ),
    ] = None,
    points: Annotated[str, typer.Option(help="Number of radar points; several with commas between.")] = "60",
    repeats: Annotated[int, typer.Option(min=1, help="Rounds at most; what is slow gets fewer, two at least.")] = 30,
    precision: Annotated[str, typer.Option(help="auto, float32 or bfloat16.")] = "auto",
    threads: Annotated[int, typer.Option(min=0, help="CPU threads; 0 leaves it to torch.")] = 0,
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
    device: DeviceOption = "cpu",
) -> None:
    """Measures a network: each stage and the whole, in time, memory and as a share of the machine's own best rate.

    Example: radcam-depth bench --size 256x448 --points 10,60 --repeats 5 --json out/bench.json
    """
    from radcam_depth_ros.benchmarking.measurement import measure
    from radcam_depth_ros.benchmarking.rotation import Schedule
    from radcam_depth_ros.benchmarking.subject import Size, Subject
    from radcam_depth_ros.cli.bench_tables import print_report

    subject = Subject(network=network, model_file=str(model or ""), precision=precision, device=device, threads=threads)
    counts = [_count(part) for part in points.split(",")]
    sizes = [Size.padded(*_height_width(text), count) for text in size or ["448x800"] for count in counts]
    other = None if against is None else _parse_against(against, subject)
    if bag is not None:
        other = _with_frames(other, bag, limit)
    with _watched() as watch:
        report = measure(subject, sizes, Schedule(repeats), watch, other)
    if json_target:
        write_json(report.as_json(), json_target)
    if json_target != "-":
        print_report(report)


def _height_width(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([1-9]\d*)x([1-9]\d*)", text)
    if not found:
        raise RadcamDepthError(f"a size is HEIGHTxWIDTH in pixels, for example 448x800, got {text!r}")
    return int(found.group(1)), int(found.group(2))


def _count(text: str) -> int:
    if not text.strip().isdigit():
        raise RadcamDepthError(f"a number of radar points is a whole number such as 60, got {text!r}")
    return int(text)


def _parse_against(spec: str, subject: Subject) -> Against:
    """The other configuration: what `spec` says, and for the rest as `subject`."""
    import yaml

    from radcam_depth_ros.benchmarking.comparison import Against
    from radcam_depth_ros.networks import registry

    try:
        # Names and values as in a card: YAML knows its numbers, words and lists.
        text = spec.replace("=", ": ").replace("(", "[").replace(")", "]")
        values: Any = yaml.safe_load(f"{{{text}}}")
    except yaml.YAMLError:
        values = None
    if not values or any(value is None and key != PAPER for key, value in values.items()):
        raise RadcamDepthError(
            f"--against takes `paper` or key=value pairs with commas between, such as 'precision=float32,mode=eager', "
            f"got {spec!r}"
        )
    is_paper = PAPER in values and values.pop(PAPER) is None
    architecture: dict[str, Any] = dict(subject.architecture)
    if is_paper:
        paper = registry.find(_network_name(subject)).paper
        if not paper:
            raise RadcamDepthError(f"the network {subject.network} has no paper's form; say what should differ")
        architecture.update(paper)
        values = {"mode": "eager", "precision": "float32", **values}
    height_width = _height_width(str(values.pop("size"))) if "size" in values else None
    points = _count(str(values.pop("points"))) if "points" in values else None
    precision, mode = str(values.pop("precision", subject.precision)), str(values.pop("mode", subject.mode))
    other = replace(subject, architecture={**architecture, **values}, precision=precision, mode=mode)
    return Against(spec, other, PAPER_IMAGE_FACTOR if is_paper else 1, height_width, points)


def _network_name(subject: Subject) -> str:
    from radcam_depth_ros.networks import archive

    return archive.load(subject.model_file).card.network if subject.model_file else subject.network


def _with_frames(against: Against | None, bag: Path, limit: int | None) -> Against:
    """A comparison that takes a bag's frames as well."""
    from itertools import islice

    from radcam_depth_ros.drive import read_samples

    if against is None:
        raise RadcamDepthError(
            "--bag is for comparing two precisions, got no --against; give --against precision=float32, for example"
        )
    return replace(against, samples=islice(read_samples(bag), limit))


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
