"""`radcam-depth import` and `export-dataset`: bags of public data sets, and drives in the schema of one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from radcam_depth_ros.cli.terminal.fleet_runs import SOME_FAILED
from radcam_depth_ros.cli.terminal.options import keep_apart, progress_bar


def import_(
    dataset: Annotated[str, typer.Argument(help="nuscenes or truckscenes.")],
    dataroot: Annotated[Path, typer.Argument(help="The data set's folder, which has samples/, sweeps/ and VERSION/.")],
    out: Annotated[Path, typer.Argument(help="Folder of the bags: one .mcap file a scene; those there are kept.")],
    version: Annotated[str, typer.Option(help="Folder of the tables.")] = "v1.0-trainval",
    scenes: Annotated[
        str | None, typer.Option(help="Names of scenes, by commas.", show_default="all of the version or split")
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(help="Scenes of a split: train, val, test, or singh-train, singh-val, singh-test as published."),
    ] = None,
    images: Annotated[str, typer.Option(help="keyframes (2 Hz) or all (12 Hz).")] = "all",
    radars: Annotated[str, typer.Option(help="front, the one of published evaluations, or all.")] = "front",
    cameras: Annotated[
        str | None, typer.Option(help="Channels of cameras, by commas.", show_default="the one ahead")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Scenes at once, each in a process of its own.")] = 1,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Make bags anew that are there.")] = False,
) -> None:
    """Imports a public data set: a bag for each scene, which the node and all verbs read.

    A scene that fails is told, and the others go on; then the exit code is 3.

    Example: radcam-depth simulate out/town --seed 7 --frames 20 &&
    radcam-depth export-dataset nuscenes out/town out/nuscenes &&
    radcam-depth import nuscenes out/nuscenes out/scenes --version v1.0-mini
    """
    from radcam_depth_ros.datasets import (
        LAYOUTS,
        DatasetError,
        ImportedScene,
        ImportOptions,
        import_scenes,
        plan_import,
        some_names,
    )

    if dataset not in LAYOUTS:
        raise DatasetError(f"expected a data set among {', '.join(LAYOUTS)}, got {dataset!r}; see docs/datasets.md")
    keep_apart((out,), (dataroot,))
    plan = plan_import(
        LAYOUTS[dataset],
        dataroot,
        out,
        ImportOptions(images, radars, _listed(cameras)),
        version=version,
        names=_listed(scenes),
        split=split,
    )
    with progress_bar() as progress:
        reading = progress.add_task("reading rows of tables", total=None)
        task = progress.add_task("importing scenes", total=len(plan.scenes))

        def done(scene: ImportedScene) -> None:
            progress.advance(task)
            if scene.problem:
                progress.console.print(f"{scene.name}: {scene.problem}", markup=False, soft_wrap=True)

        results = import_scenes(
            plan, jobs, overwrite=overwrite, tick=lambda rows: progress.advance(reading, rows), done=done
        )
    failed = [scene.name for scene in results if scene.problem]
    if failed:
        typer.echo(
            f"radcam-depth: {len(failed)} of {len(results)} scenes were not imported: {some_names(failed)}; see above, "
            "and import again, which keeps the others",
            err=True,
        )
        raise typer.Exit(SOME_FAILED)
    typer.echo(f"{out}: {len(results)} scenes, {sum(scene.was_there for scene in results)} of them were there before")


def export_dataset(
    dataset: Annotated[str, typer.Argument(help="nuscenes.")],
    paths: Annotated[list[Path], typer.Argument(help="BAG... OUT: drives, or folders of some, and the new folder.")],
    version: Annotated[str, typer.Option(help="Folder of the tables.")] = "v1.0-mini",
) -> None:
    """Writes drives as scenes in the schema of nuScenes, for tools that read that: no annotations.

    Example: radcam-depth simulate out/city --seed 7 --frames 20 &&
    radcam-depth export-dataset nuscenes out/city out/city_as_nuscenes
    """
    from radcam_depth_ros.bags import find_bags
    from radcam_depth_ros.datasets import DatasetError, export_nuscenes

    if dataset != "nuscenes":
        raise DatasetError(f"expected the schema nuscenes, got {dataset!r}; other sets can only be imported")
    *places, out = paths
    if not places:
        raise DatasetError(f"expected drives and a new folder, got {out} alone; name the folder last")
    keep_apart((out,), places)
    bags = find_bags(places)
    with progress_bar() as progress:
        task = progress.add_task("exporting scenes", total=len(bags))
        export_nuscenes(bags, out, version=version, progress=lambda: progress.advance(task))


def _listed(text: str | None) -> tuple[str, ...]:
    return tuple(part.strip() for part in (text or "").split(",") if part.strip())
