"""Options that several verbs share, and how they print."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

# What is heavy to import is imported where it is used, here and in the verbs: --help answers at once.
if TYPE_CHECKING:
    from radcam_depth_ros.estimator import Estimator, EstimatorConfig

_PRECISION_HELP = (
    "Number format of the network: float32, bfloat16, or auto: what RADCAM_DEPTH_PRECISION says, else what suits the "
    "processor."
)
Bag = Annotated[Path, typer.Argument(help="A rosbag2 folder or .mcap file.")]
NetworkOption = Annotated[str, typer.Option(help="A network whose weights come with the package.")]
ModelOption = Annotated[
    Path | None, typer.Option(help="A weight file (.safetensors or exported .pt), in place of --network.")
]
DeviceOption = Annotated[str, typer.Option(help="cpu, or cuda.")]
PrecisionOption = Annotated[
    str,
    typer.Option(help=_PRECISION_HELP),
]
# The same for verbs that take --params: None where they are not given.
NetworkChoice = Annotated[
    str | None, typer.Option("--network", help="A network whose weights come with the package.", show_default="baff")
]
DeviceChoice = Annotated[str | None, typer.Option("--device", help="cpu, or cuda.", show_default="cpu")]
PrecisionChoice = Annotated[
    str | None,
    typer.Option(
        "--precision",
        help=_PRECISION_HELP,
        show_default="auto",
    ),
]
ThreadsChoice = Annotated[
    int | None,
    typer.Option(
        "--threads", min=1, help="CPU threads of the network; the last digits depend on it.", show_default="2"
    ),
]
ImageOption = Annotated[str | None, typer.Option(help="Topic of the images; found by type and name if not given.")]
RadarOption = Annotated[list[str] | None, typer.Option(help="Topic of a radar; repeat it for several.")]
JsonOption = Annotated[
    str | None, typer.Option("--json", help="Write the figures as JSON to a file; - or nothing for stdout.")
]


class _RateColumn(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.1f}/s" if task.speed else "-/s", style="progress.data.speed")


def estimator_parameters(
    network: str | None, model: Path | None, device: str | None, precision: str | None, threads: int | None
) -> dict[str, object]:
    """The node's parameters that options of these names stand for; None for those not given."""
    model_file = None if model is None else str(model)
    values = {"network": network, "model_file": model_file, "device": device}
    return {**values, "precision": precision, "threads": threads}


def load_estimator(config: EstimatorConfig) -> Estimator:
    """The estimator that a parameter file and options ask for, with a fixed number of threads in any case."""
    from radcam_depth_ros.engine import offline_threads
    from radcam_depth_ros.estimator import Estimator

    return Estimator(replace(config, threads=config.threads or offline_threads()))


@contextmanager
def needs_ros(what: str) -> Iterator[None]:
    """Around the import of a room that needs ROS: where that is missing, says that `what` needs it."""
    try:
        yield
    except ModuleNotFoundError as error:
        from radcam_depth_ros.frame import RadcamDepthError

        raise RadcamDepthError(
            f"{what} needs ROS 2, and the package {error.name} is not installed; source ROS "
            "(source /opt/ros/jazzy/setup.bash), or install the extra `ros` of this package with pip"
        ) from error


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A bar on stderr with count, rate and time left."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _RateColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as progress:
        yield progress


def write_json(values: Any, target: str) -> None:
    """Writes JSON to stdout for `-`, else to a file, whole or not at all."""
    from radcam_depth_ros.files import write_text

    text = json.dumps(values, indent=2) + "\n"
    if target == "-":
        typer.echo(text, nl=False)
    else:
        write_text(target, text)
