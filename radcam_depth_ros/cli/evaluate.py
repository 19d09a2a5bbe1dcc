"""`radcam-depth evaluate`: measures a network over bags with ground truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from radcam_depth_ros.cli.terminal.node_parameters import OUTPUT, ParamsOption, node_parameters
from radcam_depth_ros.cli.terminal.options import (
    CameraHeightOption,
    DeviceOption,
    ImageOption,
    JsonOption,
    LidarOption,
    ModelOption,
    NetworkOption,
    PrecisionOption,
    RadarOption,
    ThreadsOption,
    estimator_parameters,
    keep_apart,
    load_estimator,
    progress_bar,
    write_json,
)
from radcam_depth_ros.printable import printable
from radcam_depth_ros.reporting.terminal import PlainConsole, print_table

if TYPE_CHECKING:
    from radcam_depth_ros.drive import DriveSettings, Sample
    from radcam_depth_ros.estimator import Estimator
    from radcam_depth_ros.evaluation.drive import Drive, EvaluationSettings, Observation
    from radcam_depth_ros.evaluation.frames import FrameLog
    from radcam_depth_ros.evaluation.panels import PanelKeeper
    from radcam_depth_ros.evaluation.summary import Evaluation
    from radcam_depth_ros.reporting.table import Fact, Table


def evaluate(
    bags: Annotated[list[Path], typer.Argument(help="Rosbag2 folders, .mcap files, or folders that hold some.")],
    params: ParamsOption = None,
    network: NetworkOption = None,
    model: ModelOption = None,
    json_target: JsonOption = None,
    report: Annotated[Path | None, typer.Option(help="Write an HTML page with tables, curves and pictures.")] = None,
    csv: Annotated[Path | None, typer.Option(help="Write the measures of each frame.")] = None,
    baselines: Annotated[
        str,
        typer.Option(help="What to measure as well, by commas; camera_only runs the network again, without radar."),
    ] = "ground_nearest,camera_only,radar_interpolation",
    no_baselines: Annotated[bool, typer.Option("--no-baselines", help="Measure the network alone: quicker.")] = False,
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Measure as papers on nuScenes do: singh2023, cafnet or justdepth; MAE and RMSE alone, by day, night "
            "and rain."
        ),
    ] = None,
    camera_height: CameraHeightOption = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Stop after this many frames of each bag.")] = None,
    clip: Annotated[
        float | None,
        typer.Option(
            min=1.0, help="Clip predictions to this many metres in every range; by default to the range itself."
        ),
    ] = None,
    image: ImageOption = None,
    radar: RadarOption = None,
    lidar: LidarOption = None,
    depth: Annotated[str | None, typer.Option(help="Topic of true depth images; found likewise.")] = None,
    device: DeviceOption = None,
    precision: PrecisionOption = None,
    threads: ThreadsOption = None,
) -> None:
    """Measures a network's depth against ground truth, beside simpler baselines.

    Ground truth is the exact depth of a simulated drive, or a LiDAR's points. Averages are over all frames of all bags.

    Example: radcam-depth simulate out/test --seed 1000000 --frames 40 &&
    radcam-depth evaluate out/test --report out/evaluation.html
    """
    from radcam_depth_ros.evaluation.drive import EvaluationSettings
    from radcam_depth_ros.evaluation.measures.errors import EvaluationError

    keep_apart((json_target, report, csv), (*bags, params, model))
    if protocol is not None and (report or csv or clip is not None or depth is not None):
        raise EvaluationError(
            f"the protocol {protocol} says itself how depth is measured; leave out --report, --csv, --clip and --depth"
        )
    wanted = () if no_baselines else tuple(name.strip() for name in baselines.split(",") if name.strip())
    node = node_parameters(
        params,
        {
            "image_topic": image,
            "radar_topics": radar or None,
            "camera_height_m": camera_height,
            **estimator_parameters(network, model, device, precision, threads),
        },
        unused=OUTPUT,
        lidar=lidar,
        depth=depth,
    )
    settings = node.drive_settings()
    if protocol is not None:
        estimator = load_estimator(replace(node.config.estimator, output_size="native"))
        _evaluate_published(bags, settings, estimator, protocol, limit, json_target)
        return
    sources = _find_sources(bags, settings, limit)
    # The evaluation measures depth at the network's size, however the node writes it.
    estimator = load_estimator(replace(node.config.estimator, output_size="native"))
    measuring = EvaluationSettings(estimator.card.network, camera_height, clip, wanted)
    _tell(_measure(sources, settings, estimator, measuring, with_panels=report is not None), report, csv, json_target)


def _tell(measured: _Measured, report: Path | None, csv: Path | None, json_target: str | None) -> None:
    """Writes what is asked for, and prints tables unless stdout is for JSON."""
    from radcam_depth_ros.evaluation.tables import distance_table, summary_table, thing_tables

    if report:
        _write_report(report, measured)
    if csv:
        measured.log.write_csv(csv)
    if json_target:
        write_json(measured.as_json(), json_target)
    if json_target != "-":
        measures = measured.evaluation
        _print(measured.facts(), (summary_table(measures), distance_table(measures), *thing_tables(measures)))


def _evaluate_published(
    places: Sequence[Path],
    settings: DriveSettings,
    estimator: Estimator,
    protocol: str,
    limit: int | None,
    json_target: str | None,
) -> None:
    """Measures by a published protocol; RadcamDepthError for a name that is none, and bags that do not serve."""
    from radcam_depth_ros.bags import find_bags
    from radcam_depth_ros.evaluation.measures.errors import EvaluationError
    from radcam_depth_ros.evaluation.measures.protocols import PROTOCOLS
    from radcam_depth_ros.evaluation.published import evaluate_published, published_drives

    if protocol not in PROTOCOLS:
        raise EvaluationError(f"expected a protocol among {', '.join(PROTOCOLS)}, got {protocol!r}")
    with progress_bar() as progress:
        drives, frames = published_drives(find_bags(places), settings, PROTOCOLS[protocol], limit)
        task = progress.add_task("evaluating", total=frames)
        result = evaluate_published(
            drives,
            estimator.estimate,
            PROTOCOLS[protocol],
            estimator.card.network,
            lambda: progress.advance(task),
        )
    if json_target:
        weights = {"weights": estimator.describe(), **vars(estimator.computation)}
        write_json({**result.as_json(), "bags": [str(place) for place in places], **weights}, json_target)
    if json_target != "-":
        _print((), (result.table(),))


@dataclass(frozen=True)
class _Source:
    """A bag to read.

    Attributes:
        bag: Where it is.
        name: What its frames are filed under.
        frames: How many of its images are read.
        limit: Where reading it stops; None for its end.
        scenario: As `bags.read_scenario` gives it.
    """

    bag: Path
    name: str
    frames: int
    limit: int | None
    scenario: Mapping[str, str]


@dataclass(frozen=True)
class _Measured:
    """An evaluation with what it was made of.

    Attributes:
        evaluation: The measures.
        sources: The bags.
        estimator: The estimator.
        log: The measures of each frame.
        panels: Pictures for the report; None where there is none.
    """

    evaluation: Evaluation
    sources: Sequence[_Source]
    estimator: Estimator
    log: FrameLog
    panels: PanelKeeper | None

    def facts(self) -> tuple[Fact, ...]:
        """What stands above the tables."""
        from radcam_depth_ros.evaluation.tables import facts_of
        from radcam_depth_ros.reporting.table import Fact

        return (
            Fact("drive" if len(self.sources) == 1 else "drives", _listed(self.sources)),
            *_without_truth(self.evaluation),
            *facts_of(self.evaluation),
            Fact("weights", f"{self.estimator.describe()}, {self.estimator.computation.threads} threads"),
        )

    def as_json(self) -> dict[str, Any]:
        """All figures, and what they were measured on and with."""
        bags = [str(source.bag) for source in self.sources]
        single = {"bag": bags[0]} if len(bags) == 1 else {}
        named = {"bags": bags, "weights": self.estimator.describe()}
        return {**self.evaluation.as_json(), **single, **named, **vars(self.estimator.computation)}


def _measure(
    sources: Sequence[_Source],
    settings: DriveSettings,
    estimator: Estimator,
    measuring: EvaluationSettings,
    *,
    with_panels: bool,
) -> _Measured:
    """Measures the depth of all bags; EvaluationError where no frame has ground truth."""
    from radcam_depth_ros.evaluation.drive import evaluate_drives
    from radcam_depth_ros.evaluation.frames import FrameLog
    from radcam_depth_ros.evaluation.measures.errors import EvaluationError
    from radcam_depth_ros.evaluation.panels import PanelKeeper

    log, keeper = FrameLog(), PanelKeeper() if with_panels else None

    def observe(observation: Observation) -> None:
        log.add(observation)
        if keeper:
            keeper.add(observation)

    with progress_bar() as progress:
        task = progress.add_task("evaluating", total=sum(source.frames for source in sources))
        drives = _drives(sources, settings, estimator, lambda: progress.advance(task))
        evaluation = evaluate_drives(drives, estimator.estimate, measuring, observe)
    if not evaluation.has_ground_truth:
        raise EvaluationError(
            f"expected ground truth within 100 m of some frame of {_listed(sources)}, got none; LiDAR scans must lie "
            f"within {settings.max_lidar_offset_s} s of an image, depth images must have an image's stamp"
            + "".join(f"; of the scans {sentence}" for sentence in evaluation.scans.sentences)
        )
    return _Measured(evaluation, sources, estimator, log, keeper)


def _find_sources(places: Sequence[Path], settings: DriveSettings, limit: int | None) -> tuple[_Source, ...]:
    """The bags of some places; all are looked at before anything is measured.

    Raises:
        RadcamDepthError: for a place without bags, or a bag that lacks a sensor or has no ground truth.
    """
    from radcam_depth_ros.bags import BagReader, find_bags, read_scenario
    from radcam_depth_ros.evaluation.measures.errors import EvaluationError

    bags = find_bags(places)
    names = [bag.stem if bag.is_file() else bag.name for bag in bags]
    taken = Counter(names)
    sources = []
    for bag, name in zip(bags, names, strict=True):
        with BagReader(bag) as reader:
            topics = settings.find_topics(reader)
            if topics.depth is None and topics.lidar is None:
                raise EvaluationError(
                    f"expected ground truth in {bag}, got {', '.join(topics.names)}; what would serve is a LiDAR "
                    "(sensor_msgs/PointCloud2, see --lidar) or true depth images (sensor_msgs/Image of 32FC1 or 16UC1, "
                    "see --depth)"
                )
            frames = reader.count([topics.image])
            scenario = read_scenario(reader)
        distinct = name if taken[name] == 1 else str(bag)
        sources.append(_Source(bag, distinct, min(frames, limit or frames), limit, scenario))
    return tuple(sources)


def _drives(
    sources: Iterable[_Source], settings: DriveSettings, estimator: Estimator, advance: Callable[[], None]
) -> Iterator[Drive]:
    from radcam_depth_ros.drive import read_samples
    from radcam_depth_ros.evaluation.drive import Drive

    for source in sources:
        samples = islice(read_samples(source.bag, settings), source.limit)
        yield Drive(_followed(samples, estimator, advance), source.name, source.scenario)


def _followed(samples: Iterable[Sample], estimator: Estimator, advance: Callable[[], None]) -> Iterator[Sample]:
    for sample in samples:
        # What is built once for a camera is built here, so that times are those of a running node.
        estimator.warm_up(sample.frame.camera)
        yield sample
        advance()


def _listed(sources: Sequence[_Source]) -> str:
    """The bags in a few words."""
    if len(sources) == 1:
        return str(sources[0].bag)
    names = [source.name for source in sources]
    some = ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:3])} ... {names[-1]}"
    return f"{len(sources)} bags: {some}"


def _without_truth(evaluation: Evaluation) -> Iterator[Fact]:
    """Names bags that were read and say nothing: one among many would else go unnoticed."""
    from radcam_depth_ros.evaluation.groups import BAG
    from radcam_depth_ros.reporting.table import Fact

    groups = [group for entry in evaluation.groupings if entry.name == BAG for group in entry.groups]
    idle = [group.name for group in groups if not group.dense.frames]
    if idle:
        yield Fact("bags without ground truth within 80 m", ", ".join(idle))


def _write_report(path: Path, measured: _Measured) -> None:
    from radcam_depth_ros.evaluation.plots import plots_of
    from radcam_depth_ros.evaluation.tables import tables_of
    from radcam_depth_ros.reporting.page import write_report

    evaluation, sources = measured.evaluation, measured.sources
    where = sources[0].bag.resolve().name if len(sources) == 1 else f"{len(sources)} bags"
    tables = (*tables_of(evaluation), measured.log.worst_table())
    panels = measured.panels.panels() if measured.panels else ()
    write_report(path, f"{evaluation.network} on {where}", measured.facts(), tables, panels, plots_of(evaluation))


def _print(facts: Iterable[Fact], tables: Iterable[Table]) -> None:
    console = PlainConsole()
    for fact in facts:
        # Not as markup: a path may hold brackets.
        console.print(Text.assemble((f"{fact.name}: ", "dim"), printable(fact.value)))
    for table in tables:
        print_table(console, table.title, table.columns, table.rows, table.note)
