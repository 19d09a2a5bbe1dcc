"""`radcam-depth evaluate`: measure a network over a bag with ground truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from radcam_depth_ros.cli.options import (
    Bag,
    DeviceOption,
    ImageOption,
    JsonOption,
    ModelOption,
    NetworkOption,
    PrecisionOption,
    RadarOption,
    load_estimator,
    progress_bar,
    write_json,
)

if TYPE_CHECKING:
    from radcam_depth_ros.drive import DriveSettings, Sample
    from radcam_depth_ros.estimator import Estimator
    from radcam_depth_ros.evaluation.tables import Fact, Table


def evaluate(
    bag: Bag,
    network: NetworkOption = "baff",
    model: ModelOption = None,
    json_target: JsonOption = None,
    report: Annotated[Path | None, typer.Option(help="Write an HTML page with tables and pictures.")] = None,
    camera_height: Annotated[
        float | None, typer.Option(min=0.1, help="Metres above the road, in place of what the bag's transforms say.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Stop after this many frames.")] = None,
    clip: Annotated[
        float | None,
        typer.Option(min=1.0, help="Clip predictions to this many metres in every range; else to the range itself."),
    ] = None,
    image: ImageOption = None,
    radar: RadarOption = None,
    lidar: Annotated[str | None, typer.Option(help="Topic of the LiDAR; found likewise.")] = None,
    depth: Annotated[str | None, typer.Option(help="Topic of true depth images; found likewise.")] = None,
    device: DeviceOption = "cpu",
    precision: PrecisionOption = "auto",
) -> None:
    """Measures a network's depth against ground truth, beside what geometry alone gives.

    Ground truth is the exact depth of a simulated drive, or a LiDAR's points.

    Example: radcam-depth simulate out/test --seed 1000000 --frames 40 &&
    radcam-depth evaluate out/test --report out/evaluation.html
    """
    from radcam_depth_ros.drive import DriveSettings, read_samples
    from radcam_depth_ros.evaluation.drive import EvaluationSettings, evaluate_drive
    from radcam_depth_ros.evaluation.metrics import EvaluationError
    from radcam_depth_ros.evaluation.panels import PanelKeeper
    from radcam_depth_ros.evaluation.report import write_report
    from radcam_depth_ros.evaluation.tables import Fact, distance_table, facts_of, summary_table, tables_of

    settings = DriveSettings(
        image=image,
        radars=tuple(radar) if radar else None,
        lidar=lidar,
        depth=depth,
        camera_height_m=camera_height or 0.0,
    )
    frames = _count_frames(bag, settings)
    estimator = load_estimator(network, model, device, precision)
    keeper = PanelKeeper() if report else None
    with progress_bar() as progress:
        samples = progress.track(
            islice(read_samples(bag, settings), limit), min(frames, limit or frames), description="evaluating"
        )
        evaluation = evaluate_drive(
            _warmed_up(samples, estimator),
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
        title = f"{evaluation.network} on {bag.resolve().name}"
        write_report(report, title, facts, tables_of(evaluation), keeper.panels())
    if json_target:
        write_json({**evaluation.as_json(), "bag": str(bag), "weights": estimator.describe()}, json_target)
    if json_target != "-":
        _print(facts, (summary_table(evaluation), distance_table(evaluation)))


def _count_frames(bag: Path, settings: DriveSettings) -> int:
    """The number of images in a bag that has ground truth."""
    from radcam_depth_ros.bags import BagReader
    from radcam_depth_ros.evaluation.metrics import EvaluationError

    with BagReader(bag) as reader:
        topics = settings.topics(reader)
        if topics.depth is None and topics.lidar is None:
            raise EvaluationError(
                f"expected ground truth in {bag}, got {', '.join(topics.names)}; what would serve is a LiDAR "
                "(sensor_msgs/PointCloud2, see --lidar) or true depth images (sensor_msgs/Image of 32FC1 or 16UC1, see "
                "--depth)"
            )
        return sum(topic.count for topic in reader.topics if topic.name == topics.image)


def _warmed_up(samples: Iterable[Sample], estimator: Estimator) -> Iterator[Sample]:
    """Lets the estimator build what it builds once, so that times are those of a running node."""
    for index, sample in enumerate(samples):
        if index == 0:
            estimator.warm_up(sample.frame.camera)
        yield sample


def _print(facts: Iterable[Fact], tables: Iterable[Table]) -> None:
    console = Console()
    for fact in facts:
        # Not as markup: a path may hold brackets.
        console.print(Text.assemble((f"{fact.name}: ", "dim"), fact.value))
    for table in tables:
        shown = RichTable(title=table.title, title_justify="left", caption=table.note or None, caption_justify="left")
        for index, column in enumerate(table.columns):
            shown.add_column(column, justify="right" if index else "left", no_wrap=True)
        for row in table.rows:
            shown.add_row(*row)
        console.print(shown)
