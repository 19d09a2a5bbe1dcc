"""`radcam-depth simulate`: writes a simulated drive as a bag."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radcam_depth_ros.cli.terminal.fleet_runs import OnOption, ShardOption, finish, run_fleet
from radcam_depth_ros.cli.terminal.options import keep_apart, progress_bar
from radcam_depth_ros.extras import install_extra

if TYPE_CHECKING:
    from radcam_depth_ros.simulation import SimulationConfig


def simulate(
    out: Annotated[Path, typer.Argument(help="Bag to write: a folder, or a file that ends in .mcap.")],
    seed: Annotated[int, typer.Option(help="Random seed of the street, the drive and all noise.")] = 0,
    frames: Annotated[int, typer.Option(help="Number of images of a drive.")] = 100,
    drives: Annotated[
        int | None,
        typer.Option(help="Write so many drives, of SEED and the seeds after it, to OUT/SEED; those there are kept."),
    ] = None,
    jobs: Annotated[int | None, typer.Option(help="Drives at once.", show_default="one for each core")] = None,
    config: Annotated[
        Path | None, typer.Option(help="Settings; the defaults are those of config/simulation.yaml.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it exists.")] = False,
    seeds: Annotated[
        str | None,
        typer.Option(help="Write the drives of the seeds A to B - 1, given as A:B, to OUT/SEED.mcap; for shards."),
    ] = None,
    shard: ShardOption = None,
    on: OnOption = None,
) -> None:
    """Simulates a drive with camera, radars, LiDAR and odometry, with exact depth and classes of every image.

    For drives to train on: radcam-depth simulate drives/ --drives 500 --frames 8 --config config/training_drives.yaml

    Example: radcam-depth simulate out/drive --seed 7 --frames 20
    """
    from radcam_depth_ros import configuration
    from radcam_depth_ros.frame import RadcamDepthError

    try:
        from radcam_depth_ros import simulation  # here, so that all other verbs run without the extra `sim`
    except ModuleNotFoundError as error:
        raise RadcamDepthError(
            f"the simulator needs the package {error.name}, which is not installed; {install_extra('sim')}"
        ) from error
    keep_apart((out,), (config,))
    settings = (
        simulation.SimulationConfig() if config is None else configuration.load(simulation.SimulationConfig, config)
    )
    if seeds or shard or on:
        _fleet(settings, _range(seeds), frames, out, shard, on)
        return
    if drives is not None or jobs is not None:
        _many(settings, seed, frames, out, drives, jobs, overwrite)
        return
    with progress_bar() as progress:
        task = progress.add_task("simulating", total=frames)
        simulation.simulate(
            settings,
            seed,
            frames,
            out,
            overwrite=overwrite,
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )


def _range(seeds: str | None) -> range:
    """The seeds of A:B."""
    from radcam_depth_ros.simulation import SimulationError

    found = re.fullmatch(r"(\d{1,18}):(\d{1,18})", seeds or "")
    if found is None or int(found[1]) >= int(found[2]):
        raise SimulationError(f"expected seeds as A:B with A below B, such as --seeds 0:1000, got {seeds or 'none'}")
    return range(int(found[1]), int(found[2]))


def _fleet(settings: SimulationConfig, seeds: range, frames: int, out: Path, shard: str | None, on: str | None) -> None:
    """Simulates the drives of a shard."""
    from radcam_depth_ros.fleet.work.simulating import Simulating

    finish(run_fleet(Simulating(settings, frames), [str(seed) for seed in seeds], out, shard, on))


def _many(
    settings: SimulationConfig, seed: int, frames: int, out: Path, drives: int | None, jobs: int | None, overwrite: bool
) -> None:
    """Simulates several drives into a folder."""
    from radcam_depth_ros import simulation

    if drives is None:
        raise simulation.SimulationError("--jobs is for several drives; say how many by --drives")
    if out.suffix == ".mcap":
        raise simulation.SimulationError(f"expected a folder for the bags of {drives} drives, got the file {out}")
    jobs = len(os.sched_getaffinity(0)) if jobs is None else jobs
    with progress_bar() as progress:
        task = progress.add_task("simulating drives", total=drives)
        simulation.simulate_drives(
            settings,
            range(seed, seed + drives),
            frames,
            out,
            jobs,
            overwrite=overwrite,
            progress=lambda _: progress.advance(task),
        )
