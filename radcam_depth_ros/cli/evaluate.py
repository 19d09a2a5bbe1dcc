"""`radcam-depth evaluate`: measure a network over a bag with ground truth."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Generator, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as RichTable
from rich.text import Text

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.drive import DriveSettings, Sample, read_samples
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.evaluation.drive import EvaluationSettings, evaluate_drive
from radcam_depth_ros.evaluation.files import write_text
from radcam_depth_ros.evaluation.metrics import EvaluationError
from radcam_depth_ros.evaluation.panels import PanelKeeper
from radcam_depth_ros.evaluation.report import write_report
from radcam_depth_ros.evaluation.summary import Evaluation
from radcam_depth_ros.evaluation.tables import Fact, Table, distance_table, facts_of, summary_table, tables_of


def evaluate(
    bag: Annotated[Path, typer.Argument(help="A drive with ground truth: a rosbag2 folder or an .mcap file.")],
    network: Annotated[str, typer.Option(help="Name of a network whose weights come with the package.")] = "baff",
    model: Annotated[
        Path | None, typer.Option(help="Weight file in place of --network: .safetensors with its card, or an export.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE|-", help="Write the measures as JSON; - for standard output.")
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Write an HTML page with tables and pictures.")] = None,
    camera_height: Annotated[
        float | None, typer.Option(min=0.1, help="Metres above the road, in place of what the bag's transforms say.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Stop after this many frames.")] = None,
    clip: Annotated[
        float | None,
        typer.Option(min=1.0, help="Clip predictions to this many metres in every range; else to the range itself."),
    ] = None,
    lidar: Annotated[str | None, typer.Option(help="Topic of the LiDAR, where it is not found by itself.")] = None,
    depth: Annotated[str | None, typer.Option(help="Topic of true depth images, likewise.")] = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    threads: Annotated[int, typer.Option(min=0, help="CPU threads; 0 leaves the choice to torch.")] = 0,
) -> None:
    """Measures a network's depth against ground truth, beside what geometry alone gives.

    Ground truth is the exact depth of a simulated drive, or a LiDAR's points.

    Example: radcam-depth simulate out/drive --seed 1000000 --frames 40 &&
    radcam-depth evaluate out/drive --report out/evaluation.html
    """
    settings = DriveSettings(lidar=lidar, depth=depth, camera_height_m=camera_height or 0.0)
    frames = _count_frames(bag, settings)
    estimator = Estimator(EstimatorConfig(network, str(model) if model else "", device, threads))
    keeper = PanelKeeper() if report else None
    with _show_progress(read_samples(bag, settings), frames if limit is None else min(limit, frames)) as samples:
        evaluation = evaluate_drive(
            _warmed_up(islice(samples, limit), estimator),
            estimator.estimate,
            EvaluationSettings(estimator.card.network, camera_height, clip),
            keeper.add if keeper else None,
        )
    if not evaluation.has_ground_truth:
        raise EvaluationError(
            f"expected ground truth within 100 m of some frame of {bag}, got none; LiDAR scans must lie within "
            f"{settings.max_lidar_offset_s} s of an image, depth images must have an image's stamp"
        )
    facts = (Fact("drive", str(bag)), *facts_of(evaluation), Fact("weights", estimator.describe()))
    if report and keeper:
        write_report(
            report, f"{evaluation.network} on {bag.resolve().name}", facts, tables_of(evaluation), keeper.panels()
        )
    _print(evaluation, facts, {"bag": str(bag), "weights": estimator.describe()}, json_file)


def _count_frames(bag: Path, settings: DriveSettings) -> int:
    """The number of images in a bag that has ground truth."""
    with BagReader(bag) as reader:
        topics = settings.topics(reader)
        if topics.depth is None and topics.lidar is None:
            raise EvaluationError(
                f"expected ground truth in {bag}, got {', '.join(topics.names)}; what would serve is a LiDAR "
                "(sensor_msgs/PointCloud2, see --lidar) or true depth images (sensor_msgs/Image of 32FC1 or 16UC1, see "
                "--depth)"
            )
        return sum(topic.count for topic in reader.topics if topic.name == topics.image)


@contextlib.contextmanager
def _show_progress(samples: Iterator[Sample], total: int) -> Generator[Iterator[Sample], None, None]:
    """Passes samples on, and shows on standard error how far they are."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        yield iter(progress.track(samples, total=total, description="evaluating"))


def _warmed_up(samples: Iterable[Sample], estimator: Estimator) -> Iterator[Sample]:
    """Lets the estimator build what it builds once, so that times are those of a running node."""
    for index, sample in enumerate(samples):
        if index == 0:
            estimator.warm_up(sample.frame.camera)
        yield sample


def _print(evaluation: Evaluation, facts: tuple[Fact, ...], origin: dict[str, object], json_file: Path | None) -> None:
    text = json.dumps({**evaluation.as_json(), **origin}, indent=2, allow_nan=False)
    if json_file == Path("-"):
        # Plain: rich would wrap and colour it.
        print(text)
        return
    if json_file:
        write_text(json_file, text + "\n")
    console = Console()
    for fact in facts:
        # Not as markup: a path may hold brackets.
        console.print(Text.assemble((f"{fact.name}: ", "dim"), fact.value))
    for table in (summary_table(evaluation), distance_table(evaluation)):
        console.print(_rich(table))


def _rich(table: Table) -> RichTable:
    shown = RichTable(title=table.title, title_justify="left", caption=table.note or None, caption_justify="left")
    for index, column in enumerate(table.columns):
        shown.add_column(column, justify="right" if index else "left")
    for row in table.rows:
        shown.add_row(*row)
    return shown
