"""`radcam-depth simulate`: writes a simulated drive as a bag."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from radcam_depth_ros.cli.terminal.options import keep_apart, progress_bar


def simulate(
    out: Annotated[Path, typer.Argument(help="Bag to write: a folder, or a file that ends in .mcap.")],
    seed: Annotated[int, typer.Option(help="Random seed of the street, the drive and all noise.")] = 0,
    frames: Annotated[int, typer.Option(help="Number of images.")] = 100,
    config: Annotated[
        Path | None, typer.Option(help="Settings; the defaults are those of config/simulation.yaml.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it exists.")] = False,
) -> None:
    """Simulates a drive with camera, radars, LiDAR and odometry, with exact depth and classes of every image.

    Example: radcam-depth simulate out/drive --seed 7 --frames 20
    """
    from radcam_depth_ros import configuration
    from radcam_depth_ros.frame import RadcamDepthError

    try:
        from radcam_depth_ros import simulation  # here, so that all other verbs run without the extra `sim`
    except ModuleNotFoundError as error:
        raise RadcamDepthError(
            f"the simulator needs the package {error.name}, which is not installed; install it with "
            f"`pip install {error.name}`"
        ) from error
    keep_apart((out,), (config,))
    settings = (
        simulation.SimulationConfig() if config is None else configuration.load(simulation.SimulationConfig, config)
    )
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
