"""`radcam-depth evaluate`: measures a network over bags with ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from radcam_depth_ros.cli.merge import tell
from radcam_depth_ros.cli.terminal.evaluation_tables import print_facts_and_tables
from radcam_depth_ros.cli.terminal.fleet_runs import (
    OnOption,
    OutOption,
    ShardOption,
    finish,
    found_bags,
    is_url,
    run_fleet,
)
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
    RuntimeOption,
    ThreadsOption,
    estimator_parameters,
    keep_apart,
    load_estimator,
    progress_bar,
    write_json,
)

if TYPE_CHECKING:
    from radcam_depth_ros.drive import DriveSettings
    from radcam_depth_ros.estimator import Estimator
    from radcam_depth_ros.evaluation.drive import EvaluationSettings, Observation
    from radcam_depth_ros.evaluation.frames import FrameLog
    from radcam_depth_ros.evaluation.panels import PanelKeeper
    from radcam_depth_ros.evaluation.sources import DriveSource
    from radcam_depth_ros.evaluation.summary import Evaluation
    from radcam_depth_ros.reporting.table import Fact


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
    runtime: RuntimeOption = None,
    threads: ThreadsOption = None,
    out: OutOption = None,
    shard: ShardOption = None,
    on: OnOption = None,
) -> None:
    """Measures a network's depth against ground truth, beside simpler baselines.

    Ground truth is the exact depth of a simulated drive, or a LiDAR's points. Averages are over all frames of all bags.

    Example: radcam-depth simulate out/test --seed 1000000 --frames 40 &&
    radcam-depth evaluate out/test --report out/evaluation.html
    """
    from radcam_depth_ros.evaluation.drive import EvaluationSettings

    keep_apart((json_target, report, csv, out), (*bags, params, model))
    _require_fitting(protocol, report or csv or clip or depth, csv, shard, out)
    wanted = () if no_baselines else tuple(name.strip() for name in baselines.split(",") if name.strip())
    node = node_parameters(
        params,
        {
            "image_topic": image,
            "radar_topics": radar or None,
            "camera_height_m": camera_height,
            **estimator_parameters(network, model, device, precision, runtime, threads),
        },
        unused=OUTPUT,
        lidar=lidar,
        depth=depth,
    )
    settings = node.drive_settings()
    # All are looked at before anything is measured; of many, one that does not serve must not stop the others.
    fleet = _Fleet(out, shard, on) if out or on or any(map(is_url, bags)) else None
    sources = () if fleet or protocol else _find_sources(bags, settings, limit)
    # The evaluation measures depth at the network's size, however the node writes it.
    estimator = load_estimator(replace(node.config.estimator, output_size="native"))
    measuring = EvaluationSettings(estimator.card.network, camera_height, clip, wanted)
    if fleet:
        _evaluate_fleet(bags, settings, estimator, measuring, protocol, limit, fleet, report, json_target)
    elif protocol:
        _evaluate_published(bags, settings, estimator, protocol, limit, json_target)
    else:
        measured = _measure(sources, settings, estimator, measuring, with_panels=report is not None)
        _tell(measured, report, csv, json_target)


def _find_sources(places: Sequence[Path], settings: DriveSettings, limit: int | None) -> tuple[DriveSource, ...]:
    """The bags of some places, looked at."""
    from radcam_depth_ros.bags import find_bags
    from radcam_depth_ros.evaluation.sources import DriveSource

    return tuple(DriveSource.find(bag, settings, limit) for bag in find_bags(places))


@dataclass(frozen=True)
class _Fleet:
    """Where a run over many drives works.

    Attributes:
        out: Folder of the results; None for a temporary one.
        shard: Which drives; None for all.
        on: The engine; None for this process.
    """

    out: Path | None
    shard: str | None
    on: str | None


def _require_fitting(protocol: str | None, own: object, csv: Path | None, shard: str | None, out: Path | None) -> None:
    """Refuses options that do not go together; `own` are those that a protocol decides itself."""
    from radcam_depth_ros.evaluation.measures.errors import EvaluationError
    from radcam_depth_ros.evaluation.measures.protocols import PROTOCOLS

    if protocol is not None and protocol not in PROTOCOLS:
        raise EvaluationError(f"expected a protocol among {', '.join(PROTOCOLS)}, got {protocol!r}")
    if protocol is not None and own:
        raise EvaluationError(
            f"the protocol {protocol} says itself how depth is measured; leave out --report, --csv, --clip and --depth"
        )
    if shard is not None and out is None:
        raise EvaluationError("--shard needs a folder that the results of all shards go to; give --out DIR")
    if csv is not None and out is not None:
        raise EvaluationError(
            "--out keeps sums of each drive, not its frames; leave out --csv, or evaluate without --out"
        )


def _evaluate_fleet(
    bags: Sequence[Path],
    settings: DriveSettings,
    estimator: Estimator,
    measuring: EvaluationSettings,
    protocol: str | None,
    limit: int | None,
    fleet: _Fleet,
    report: Path | None,
    target: str | None,
) -> None:
    """Measures each drive apart and keeps its result; then tells of all drives of this run together."""
    from radcam_depth_ros.fleet.merging import merge
    from radcam_depth_ros.fleet.work.evaluating import Evaluating
    from radcam_depth_ros.fleet.work.weights import Weights

    work = Evaluating(Weights.of(estimator), settings, measuring, protocol, limit)
    with TemporaryDirectory(prefix="radcam_depth_results_") as temporary:
        summary = run_fleet(work, found_bags(bags), fleet.out or Path(temporary), fleet.shard, fleet.on)
        # A shard alone is told of only where that is asked for.
        if summary.units and (fleet.shard is None or report or target):
            tell(merge(summary.results, summary.units), report, target)
    finish(summary)


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
        print_facts_and_tables(
            measured.facts(), (summary_table(measures), distance_table(measures), *thing_tables(measures))
        )


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
    from radcam_depth_ros.evaluation.measures.protocols import PROTOCOLS
    from radcam_depth_ros.evaluation.published import evaluate_published, published_drives

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
        print_facts_and_tables((), (result.table(),))


@dataclass(frozen=True)
class _Measured:
    """An evaluation with what it was made of.

    Attributes:
        evaluation: The measures.
        sources: The bags.
        names: What their frames are filed under.
        estimator: The estimator.
        log: The measures of each frame.
        panels: Pictures for the report; None where there is none.
    """

    evaluation: Evaluation
    sources: Sequence[DriveSource]
    names: Sequence[str]
    estimator: Estimator
    log: FrameLog
    panels: PanelKeeper | None

    @property
    def bags(self) -> list[str]:
        """Places of the bags."""
        return [str(source.bag) for source in self.sources]

    def facts(self) -> tuple[Fact, ...]:
        """What stands above the tables."""
        from radcam_depth_ros.evaluation.sources import listed
        from radcam_depth_ros.evaluation.tables import facts_of, without_truth
        from radcam_depth_ros.reporting.table import Fact

        return (
            Fact("drive" if len(self.sources) == 1 else "drives", listed(self.bags, self.names)),
            *without_truth(self.evaluation),
            *facts_of(self.evaluation),
            Fact("weights", f"{self.estimator.describe()}, {self.estimator.computation.threads} threads"),
        )

    def as_json(self) -> dict[str, Any]:
        """All figures, and what they were measured on and with."""
        from radcam_depth_ros.evaluation.sources import bags_json

        weights = {"weights": self.estimator.describe(), **vars(self.estimator.computation)}
        return {**self.evaluation.as_json(), **bags_json(self.bags), **weights}


def _measure(
    sources: Sequence[DriveSource],
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
    from radcam_depth_ros.evaluation.sources import distinct_names, listed

    bags = [str(source.bag) for source in sources]
    names = distinct_names([source.name for source in sources], bags)
    log, keeper = FrameLog(), PanelKeeper() if with_panels else None

    def observe(observation: Observation) -> None:
        log.add(observation)
        if keeper:
            keeper.add(observation)

    with progress_bar() as progress:
        task = progress.add_task("evaluating", total=sum(source.frames for source in sources))
        drives = (
            source.drive(name, settings, estimator.warm_up, lambda: progress.advance(task))
            for source, name in zip(sources, names, strict=True)
        )
        evaluation = evaluate_drives(drives, estimator.estimate, measuring, observe)
    if not evaluation.has_ground_truth:
        raise EvaluationError(
            f"expected ground truth within 100 m of some frame of {listed(bags, names)}, got none; LiDAR scans must "
            f"lie within {settings.max_lidar_offset_s} s of an image, depth images must have an image's stamp"
            + "".join(f"; of the scans {sentence}" for sentence in evaluation.scans.sentences)
        )
    return _Measured(evaluation, sources, names, estimator, log, keeper)


def _write_report(path: Path, measured: _Measured) -> None:
    from radcam_depth_ros.evaluation.plots import plots_of
    from radcam_depth_ros.evaluation.tables import tables_of
    from radcam_depth_ros.reporting.page import write_report

    evaluation, sources = measured.evaluation, measured.sources
    where = sources[0].bag.resolve().name if len(sources) == 1 else f"{len(sources)} bags"
    tables = (*tables_of(evaluation), measured.log.worst_table())
    panels, highlights = (measured.panels.panels(), measured.panels.highlights()) if measured.panels else ((), ())
    title = f"{evaluation.network} on {where}"
    write_report(path, title, measured.facts(), tables, panels, plots_of(evaluation), highlights)
