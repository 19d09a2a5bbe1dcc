"""Facts and tables of an evaluation, for the terminal and for the report."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from radcam_depth_ros.evaluation.given import Given
from radcam_depth_ros.evaluation.groups import BAG, MARGIN, RETURNS, SCENARIO, Group, Grouping
from radcam_depth_ros.evaluation.measures.edges import EDGE_RATIO, NEAR_PX
from radcam_depth_ros.evaluation.measures.metrics import DepthMetrics
from radcam_depth_ros.evaluation.measures.reliability import LEAST_SHARE, TOLERANCE
from radcam_depth_ros.evaluation.summary import Evaluation
from radcam_depth_ros.reporting.table import Fact, Table, number

DENSE, SEMI_DENSE = "dense", "semi-dense"
NEAR_EDGES, AWAY_FROM_EDGES = "dense, near edges", "dense, away from edges"
BASELINE_TITLES = {
    "ground_nearest": "geometry alone",
    "camera_only": "camera alone",
    "radar_interpolation": "radar alone",
}
_BASELINE_NOTES = {
    "ground_nearest": "the flat road, or the radar return nearest in the image where that is closer.",
    "camera_only": "the same network without any radar return.",
    "radar_interpolation": "interpolated between the returns.",
}
_TITLES = {
    "mae": "MAE m",
    "rmse": "RMSE m",
    "absrel": "AbsRel",
    "log10": "log10",
    "rmselog": "RMSElog",
    "d1": "d1",
    "d2": "d2",
    "d3": "d3",
}
_HEIGHT_SOURCES = {
    "frame": "from the drive's transforms or the configuration",
    "given": "as given",
    "assumed": "assumed: the drive does not say",
}


def summary_table(evaluation: Evaluation) -> Table:
    """Mean absolute and root mean squared errors within each range."""
    kinds = _kinds(evaluation)
    ranges = [entry.name for entry in evaluation.dense.ranges]
    columns = ("", *(f"{title} {name}" for title in ("MAE", "RMSE") for name in ranges))
    rows = tuple(
        (name, *(number(entry.mae) for entry in entries), *(number(entry.rmse) for entry in entries))
        for name, entries in kinds
    )
    notes = (
        "Averaged over the pixels with ground truth in range, then over frames. Semi-dense: where it has values.",
        *_edge_notes(evaluation),
        *(f"{BASELINE_TITLES[name].capitalize()}: {_BASELINE_NOTES[name]}" for name in evaluation.baselines),
    )
    return Table("Error in metres, of all within 50, 70 and 80 m", columns, rows, " ".join(notes))


def _edge_notes(evaluation: Evaluation) -> Iterator[str]:
    """Defines the pixels near edges and has their share; nothing without exact depth."""
    if evaluation.edges.frames:
        within = (
            f"{number(100 * evaluation.edges.share, 1)} % of the pixels within {evaluation.dense.ranges[-1].name} m"
        )
        yield (
            f"Near edges: within {NEAR_PX} px of a step of the exact depth by more than {100 * (EDGE_RATIO - 1):.0f} % "
            f"or to the sky; {within}."
        )


def detail_table(evaluation: Evaluation) -> Table:
    """All measures within each range."""
    ranges = evaluation.dense.ranges
    coverage = {
        DENSE: evaluation.dense.coverage,
        SEMI_DENSE: (*(math.nan for _ in ranges[:-1]), evaluation.semi_dense.coverage),
        **{BASELINE_TITLES[name]: depth.coverage for name, depth in evaluation.baselines.items()},
    }
    rows = tuple(
        (f"{name}, {entry.name} m", *_measures(entry), number(100 * share, 1))
        for name, entries in _kinds(evaluation)
        for entry, share in zip(entries, coverage.get(name, (math.nan,) * len(ranges)), strict=True)
    )
    note = (
        "d1 to d3: share of pixels whose ratio to the truth is below 1.25, 1.25² and 1.25³. Coverage: share of the "
        "pixels with ground truth in range that have a finite depth; depth of +inf counts as the end of the range."
    )
    return Table("All measures", ("", *_TITLES.values(), "frames", "coverage %"), rows, note)


def distance_table(evaluation: Evaluation) -> Table:
    """Mean absolute error by distance."""
    names = [entry.name for entry in evaluation.dense.bins]
    rows = tuple(
        (name, *(number(entry.mae) for entry in entries))
        for name, entries in (
            (DENSE, evaluation.dense.bins),
            *((BASELINE_TITLES[name], depth.bins) for name, depth in evaluation.baselines.items()),
        )
    )
    return Table("MAE by distance of the ground truth, metres", ("", *(f"{name} m" for name in names)), rows)


def reliability_tables(evaluation: Evaluation) -> Iterator[Table]:
    """Calibration of the confidence by its bins, and by parts of the pixels; none where no pixel has a confidence."""
    reliability = evaluation.reliability
    if not reliability.overall.pixels:
        return
    bins = tuple(
        (
            f"{entry.lower:.1f}-{entry.upper:.1f}",
            *(number(value, 3) for value in (entry.predicted, entry.observed)),
            number(100 * entry.share, 1),
        )
        for entry in reliability.overall.bins
    )
    note = (
        "Predicted: mean confidence of the pixels. Observed: share of them whose dense depth is within "
        f"{100 * TOLERANCE:g} % of the truth."
    )
    within = f"within {reliability.within_m:g} m"
    yield Table(f"Reliability of the confidence, {within}", ("", "predicted", "observed", "pixels %"), bins, note)
    thresholds = tuple(
        (f"{entry.min_confidence:.1f}", number(100 * entry.left, 1), number(100 * entry.right, 1))
        for entry in reliability.overall.thresholds
    )
    note = (
        "What the node's min_confidence leaves of the pixels with ground truth, and the share of these whose dense "
        f"depth is within {100 * TOLERANCE:g} % of the truth."
    )
    yield Table(f"Minimum confidence, {within}", ("min_confidence", "left %", "right %"), thresholds, note)
    parts = {
        "all": reliability.overall,
        **reliability.by_time_of_day,
        **{f"{name} m": part for name, part in reliability.by_distance.items()},
        **reliability.by_surface,
    }
    rows = tuple(
        (
            name,
            *(number(value, 3) for value in (part.ece, part.largest_fall)),
            number(100 * part.pixels / reliability.overall.pixels, 1),
        )
        for name, part in parts.items()
    )
    note = (
        "ECE: mean distance of predicted and observed over ten bins, weighted by their pixels. Largest fall: of the "
        f"observed share from one bin to the next; without bins of less than {100 * LEAST_SHARE:g} % of the pixels."
    )
    yield Table(f"Calibration of the confidence, {within}", ("", "ECE", "largest fall", "pixels %"), rows, note)


def sky_tables(evaluation: Evaluation) -> Iterator[Table]:
    """Shares of the sky and of surfaces that have a depth; none where no sky is known."""
    sky = evaluation.sky
    if not sky.pixels:
        return
    rows = (
        ("sky", number(100 * sky.finite, 1)),
        (f"surfaces within {sky.within_m:g} m", number(100 * sky.kept, 1)),
        *((name, number(100 * value, 1)) for name, value in sky.thin.items()),
    )
    note = "Depth as it is published, with the sky as +Inf: none of the sky should be finite, and all of the others."
    yield Table("Pixels with a finite depth", ("", "%"), rows, note)


def class_tables(evaluation: Evaluation) -> Iterator[Table]:
    """The dense depth by class; none where the drives have no classes."""
    within = f"within {evaluation.dense.ranges[-1].name} m"
    for title, entries in (
        (f"By class, {within}", evaluation.by_class),
        (f"By group of classes, {within}", evaluation.by_class_group),
    ):
        if entries:
            rows = tuple((entry.name, *_measures(entry)) for entry in entries)
            yield Table(title, ("", *_TITLES.values(), "frames"), rows)


def thing_tables(evaluation: Evaluation) -> Iterator[Table]:
    """Errors of small things by distance; none where the drives do not show them."""
    things = evaluation.things
    if not things:
        return
    distances = tuple(next(iter(things.values())))
    rows = tuple(
        (f"{name}, {title}", *cells)
        for name, by_distance in things.items()
        for title, cells in (
            ("MAE", (number(entry.mae_m) for entry in by_distance.values())),
            ("median", (number(entry.median_m) for entry in by_distance.values())),
            ("pixels", (str(entry.pixels) for entry in by_distance.values())),
        )
    )
    note = "Mean and median of the absolute error over the pixels of all frames."
    columns = ("", *(f"{name} m" for name in distances))
    yield Table("Error of small things by distance of the ground truth, metres", columns, rows, note)


def group_table(evaluation: Evaluation, grouping: Grouping) -> Table:
    """The dense depth by group of frames, beside the baselines; marks groups that are worse than geometry alone."""
    property_ = "number of radar returns in view" if grouping.name == RETURNS else grouping.name.replace("_", " ")
    title = f"By {property_}, within {evaluation.dense.ranges[-1].name} m"
    baselines = tuple(f"MAE m, {BASELINE_TITLES[name]}" for name in evaluation.baselines)
    compared = ("worse than geometry alone", *(f"% of frames, {name} m" for name in evaluation.geometry))
    rows = tuple(
        (
            group.name,
            *_measures(group.dense),
            *(number(group.baselines[name].mae) for name in evaluation.baselines),
            *(_compared(evaluation, group) if evaluation.geometry else ()),
        )
        for group in grouping.groups
    )
    columns = ("", *_TITLES.values(), "frames", *baselines)
    if not evaluation.geometry:
        return Table(title, columns, rows)
    note = (
        "Worse than geometry alone: the ranges in which the MAE is larger, and the share of the frames whose MAE is "
        f"more than {100 * MARGIN:g} % larger."
    )
    return Table(title, (*columns, *compared), rows, note)


def _compared(evaluation: Evaluation, group: Group) -> tuple[str, ...]:
    shares = (group.comparisons[name].frames_share for name in evaluation.geometry)
    return (_within(group.worse_within) or "-", *(number(100 * share, 0) for share in shares))


def _within(ranges: Sequence[str]) -> str:
    return f"{' and '.join(ranges)} m" if ranges else ""


def tables_of(evaluation: Evaluation) -> tuple[Table, ...]:
    """All tables of the evaluation that have rows."""
    return (
        summary_table(evaluation),
        distance_table(evaluation),
        detail_table(evaluation),
        *reliability_tables(evaluation),
        *sky_tables(evaluation),
        *class_tables(evaluation),
        *thing_tables(evaluation),
        *(group_table(evaluation, grouping) for grouping in evaluation.groupings if len(grouping.groups) > 1),
    )


def facts_of(evaluation: Evaluation) -> tuple[Fact, ...]:
    """Inputs and settings of the evaluation."""
    facts = [Fact("network", evaluation.network), Fact("frames", str(evaluation.frames))]
    if evaluation.frames_missing:
        facts.append(Fact("frames without depth", str(evaluation.frames_missing)))
    facts.append(Fact("ground truth", evaluation.ground_truth))
    if evaluation.scans.scans:
        facts.append(Fact("LiDAR scans", "; ".join(evaluation.scans.sentences)))
    facts.append(Fact("the network was given", _given(evaluation.given)))
    # A property that all frames share has no table.
    alike = {entry.name: entry.groups[0].name for entry in evaluation.groupings if len(entry.groups) == 1}
    scenario = [alike[name] for name in SCENARIO if name in alike]
    if scenario:
        facts.append(Fact("scenario", ", ".join(scenario)))
    within = f"pixels within {evaluation.dense.ranges[-1].name} m"
    facts.append(Fact("dense coverage", f"{number(100 * evaluation.dense.coverage[-1], 1)} % of the {within}"))
    facts.append(Fact("semi-dense coverage", f"{number(100 * evaluation.semi_dense.coverage, 1)} % of the {within}"))
    if evaluation.sparsification.frames:
        curve = evaluation.sparsification.mae
        rises = "never raises it" if curve.falls else f"raises it by {number(curve.rise_m, 3)} m at most"
        value = f"AUSE {number(curve.ause_m)} m of MAE; leaving out another 5 % of the least confident pixels {rises}"
        facts.append(Fact("confidence", value))
    calibration = evaluation.reliability.overall
    if calibration.pixels:
        falls = f"falls by {number(calibration.largest_fall, 3)} at most" if calibration.largest_fall else "never falls"
        fall = f"the observed share {falls} from one bin to the next"
        facts.append(Fact("calibration of the confidence", f"ECE {number(calibration.ece, 3)}; {fall}"))
    if "ground_nearest" in evaluation.baselines:
        sources = " or ".join(_HEIGHT_SOURCES[name] for name in evaluation.given.camera_height_source.split("+"))
        height = f"{number(evaluation.given.camera_height_m)} m ({sources})"
        facts.append(Fact("camera above the road, for geometry alone", height))
    if evaluation.geometry:
        facts.append(Fact("worse than geometry alone", _worse(evaluation)))
    if evaluation.clip_m is not None:
        facts.append(Fact("predictions clipped to", f"{evaluation.clip_m:g} m in every range"))
    latency = evaluation.latency
    facts.append(
        Fact("time for an estimate", f"p50 {number(latency.p50_ms, 0)} ms, p99 {number(latency.p99_ms, 0)} ms")
    )
    return tuple(facts)


def _worse(evaluation: Evaluation) -> str:
    """The share of the frames that are worse than geometry alone, and the drives that are."""
    shares = " and ".join(
        f"{number(100 * entry.frames_share, 1)} % of the frames within {name} m"
        for name, entry in evaluation.geometry.items()
    )
    drives = [group for entry in evaluation.groupings if entry.name == BAG for group in entry.groups]
    widest = tuple(evaluation.geometry)[-1]
    worse = [
        f"{drive.name} (within {_within(drive.worse_within)}; "
        f"{number(100 * drive.comparisons[widest].frames_share, 0)} % of the frames within {widest} m)"
        for drive in drives
        if drive.worse_within
    ]
    by_drive = f"; MAE larger in {len(worse)} of {len(drives)} drives" if drives else ""
    named = f": {', '.join(worse)}" if worse else ""
    return f"MAE more than {100 * MARGIN:g} % larger in {shares}{by_drive}{named}"


def _given(given: Given) -> str:
    least, middle, most = given.returns_in_view
    columns = f"{number(100 * given.rcs_share, 0)} % with RCS, {number(100 * given.speed_share, 0)} % with speed"
    if given.road_share == 0:
        road = "not the road: the camera's height above it is unknown"
    elif given.road_share == 1:
        road = "the road, from the camera's height above it"
    else:
        road = f"the road in {number(100 * given.road_share, 0)} % of the frames: else the camera's height is unknown"
    sizes = ", ".join(given.image_sizes)
    return (
        f"images of {sizes} px; {least:.0f} to {most:.0f} radar returns in view, {middle:.0f} in the middle "
        f"({columns}); {road}"
    )


def _kinds(evaluation: Evaluation) -> tuple[tuple[str, Sequence[DepthMetrics]], ...]:
    edges = evaluation.edges
    return (
        (DENSE, evaluation.dense.ranges),
        *(((NEAR_EDGES, edges.near), (AWAY_FROM_EDGES, edges.away)) if edges.frames else ()),
        (SEMI_DENSE, evaluation.semi_dense.metrics),
        *((BASELINE_TITLES[name], depth.ranges) for name, depth in evaluation.baselines.items()),
    )


def _measures(entry: DepthMetrics) -> tuple[str, ...]:
    return (*(number(getattr(entry, name), 2 if name in ("mae", "rmse") else 3) for name in _TITLES), str(entry.frames))


def without_truth(evaluation: Evaluation) -> Iterator[Fact]:
    """Names bags that were read and say nothing: one among many would else go unnoticed."""
    groups = [group for entry in evaluation.groupings if entry.name == BAG for group in entry.groups]
    idle = [group.name for group in groups if not group.dense.frames]
    if idle:
        yield Fact("bags without ground truth within 80 m", ", ".join(idle))
