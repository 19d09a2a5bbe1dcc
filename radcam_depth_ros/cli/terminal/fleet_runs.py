"""Options of verbs that work on many drives, and what these verbs do with them: run, show progress, tell failures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radcam_depth_ros.cli.terminal.options import progress_bar
from radcam_depth_ros.printable import printable

if TYPE_CHECKING:
    from radcam_depth_ros.fleet.running import RunSummary
    from radcam_depth_ros.fleet.unit import Work

SOME_FAILED = 3
"""Exit code when some drives or scenes failed and the others are done."""

OutOption = Annotated[
    Path | None,
    typer.Option(help="Folder of results, one file a drive: drives that are done are kept, the rest goes on."),
]
ShardOption = Annotated[
    str | None,
    typer.Option(
        help="Work on every n-th drive alone: i/n, counted from 0 or from 1. Jobs that run apart share the drives so."
    ),
]
OnOption = Annotated[
    str | None,
    typer.Option(
        "--on",
        help="Where to work: local (this process), ray (the cluster of RAY_ADDRESS or of this computer, else one of "
        "its own), or ray://HOST:PORT. Needs the extra fleet.",
        show_default="local",
    ),
]


def is_url(place: Path) -> bool:
    """Whether a place is at a URL, of which `Path` has left one slash."""
    return re.match(r"[a-z][a-z0-9+.-]+:/", str(place)) is not None


def is_bag(place: Path) -> bool:
    """Whether a place is one bag on a disk, or nothing; else it is a folder that may hold some, or a URL."""
    return (not is_url(place) and not place.is_dir()) or (place / "metadata.yaml").is_file()


def found_bags(places: Sequence[Path]) -> list[str]:
    """Places of the bags of a run, sorted; BagError for a place without any."""
    from radcam_depth_ros.storage import find_places, place_of

    return find_places([place_of(place) for place in places])


def run_fleet(work: Work, places: Sequence[str], out: Path, shard: str | None, on: str | None) -> RunSummary:
    """Does the work on all drives of a shard, with progress on stderr, and names those that fail.

    Args:
        work: What is done with each drive.
        places: Places of all drives, or seeds.
        out: Folder of the results.
        shard: As of `ShardOption`.
        on: As of `OnOption`.

    Raises:
        RadcamDepthError: before any work, for options that cannot be, and a folder with results of something else.
    """
    from radcam_depth_ros.fleet.engines import engine_of
    from radcam_depth_ros.fleet.running import run
    from radcam_depth_ros.fleet.shard import Shard
    from radcam_depth_ros.fleet.unit import units_of
    from radcam_depth_ros.storage import place_of

    units = units_of(places)
    share = Shard() if shard is None else Shard.parse(shard)
    engine = engine_of(on)
    with progress_bar() as progress:
        task = progress.add_task(f"{work.verb}: drives", total=len(share.take(units)))
        summary = run(work, units, place_of(out), share, engine, lambda: progress.advance(task))
    if summary.failed:
        listed = f"{summary.results.folder.place}/failed.jsonl"
        typer.echo(printable(f"{summary.failed} of {len(summary.units)} drives failed; {listed} says why"), err=True)
    return summary


def finish(summary: RunSummary) -> None:
    """Ends with exit code 3 where drives failed."""
    if summary.failed:
        raise typer.Exit(SOME_FAILED)
