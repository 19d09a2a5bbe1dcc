"""`radcam-depth merge`: joins the results of shards to one evaluation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radcam_depth_ros.cli.terminal.evaluation_tables import print_facts_and_tables
from radcam_depth_ros.cli.terminal.fleet_runs import SOME_FAILED
from radcam_depth_ros.cli.terminal.options import JsonOption, write_json
from radcam_depth_ros.printable import printable

if TYPE_CHECKING:
    from radcam_depth_ros.fleet.merging import Merged


def merge(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="What evaluate --out wrote to.")],
    json_target: JsonOption = None,
    report: Annotated[
        Path | None,
        typer.Option(help="Write an HTML page: worst drives first, and which to look at next."),
    ] = None,
    partial: Annotated[bool, typer.Option("--partial", help="Leave drives out that are not done yet.")] = False,
) -> None:
    """Joins the results of evaluate --out to those of one process, to the last digit but for times.

    Drives that failed are left out and named; the exit code is 3 then.

    Example: radcam-depth simulate out/drives/1 --seed 1000001 --frames 4 &&
    radcam-depth evaluate out/drives --out out/results --shard 0/2 ;
    radcam-depth evaluate out/drives --out out/results --shard 1/2 ; radcam-depth merge out/results --json -
    """
    from radcam_depth_ros.fleet.merging import merge as merge_results
    from radcam_depth_ros.fleet.results import open_results
    from radcam_depth_ros.storage import place_of

    tell(merge_results(open_results(place_of(folder)), partial=partial), report, json_target)


def tell(merged: Merged, report: Path | None, json_target: str | None) -> None:
    """Writes what is asked for, prints tables unless stdout is for JSON, and ends with 3 where drives are left out."""
    from radcam_depth_ros.evaluation.published import PublishedEvaluation
    from radcam_depth_ros.evaluation.tables import distance_table, summary_table, thing_tables

    if report:
        _write_report(report, merged)
    if json_target:
        write_json(merged.as_json(), json_target)
    measures = merged.evaluation
    if json_target != "-":
        if isinstance(measures, PublishedEvaluation):
            print_facts_and_tables((), (measures.table(),))
        else:
            tables = (summary_table(measures), distance_table(measures), *thing_tables(measures))
            print_facts_and_tables(merged.told(), tables)
    for place in merged.missing:
        typer.echo(printable(f"not done yet and left out: {place}"), err=True)
    for place, reason in merged.failed.items():
        typer.echo(printable(f"failed and left out: {place}: {reason}"), err=True)
    if merged.failed:
        raise typer.Exit(SOME_FAILED)


def _write_report(path: Path, merged: Merged) -> None:
    from radcam_depth_ros.evaluation.plots import plots_of
    from radcam_depth_ros.evaluation.published import PublishedEvaluation
    from radcam_depth_ros.evaluation.tables import tables_of
    from radcam_depth_ros.fleet.report import fleet_tables
    from radcam_depth_ros.reporting.page import write_report

    evaluation = merged.evaluation
    title = f"{evaluation.network} on {len(merged.bags)} drives"
    if isinstance(evaluation, PublishedEvaluation):
        write_report(path, title, (), (evaluation.table(),))
        return
    tables = (*fleet_tables(merged.lines), *tables_of(evaluation))
    write_report(path, title, merged.told(), tables, (), plots_of(evaluation))
