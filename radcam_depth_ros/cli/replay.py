"""`radcam-depth replay`: a bag in, a bag with depth out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from radcam_depth_ros.cli.options import (
    Bag,
    DeviceOption,
    ImageOption,
    ModelOption,
    NetworkOption,
    PrecisionOption,
    RadarOption,
    load_estimator,
    progress_bar,
)
from radcam_depth_ros.cli.tables import print_table


def replay(
    bag: Bag,
    out: Annotated[Path, typer.Argument(help="Bag to write: a folder, or a file that ends in .mcap.")],
    network: NetworkOption = "baff",
    model: ModelOption = None,
    device: DeviceOption = "cpu",
    precision: PrecisionOption = "auto",
    image: ImageOption = None,
    radar: RadarOption = None,
    radar_sweeps: Annotated[
        int, typer.Option(help="Sweeps of each radar for an image, moved by the bag's odometry where they are several.")
    ] = 1,
    without_radar: Annotated[
        str, typer.Option(help="Images without radar returns: camera_only, hold (the last sweep) or suppress.")
    ] = "camera_only",
    encoding: Annotated[str, typer.Option(help="32FC1 (metres) or 16UC1 (millimetres).")] = "32FC1",
    output_size: Annotated[
        str, typer.Option(help="native, or network: the size that the network works at.")
    ] = "native",
    passthrough: Annotated[bool, typer.Option("--passthrough", help="Copy the input's messages as well.")] = False,
    preview: Annotated[bool, typer.Option("--preview", help="Write depth in colours as well.")] = False,
    colormap: Annotated[str, typer.Option(help="Colours of the preview: turbo, viridis, grey ...")] = "turbo",
    preview_range: Annotated[
        tuple[float, float], typer.Option(help="Depths of the preview's first and last colour, metres.")
    ] = (2.0, 80.0),
    points: Annotated[bool, typer.Option("--points", help="Write point clouds as well.")] = False,
    points_stride: Annotated[int, typer.Option(help="A point for each square of so many pixels' width.")] = 1,
    points_range: Annotated[tuple[float, float], typer.Option(help="Depths of the first and last point, metres.")] = (
        0.0,
        1000.0,
    ),
    compress: Annotated[bool, typer.Option("--compress", help="Write a smaller bag, which takes longer.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it exists.")] = False,
) -> None:
    """Writes the depth of every image of a bag to another bag, as the live node would, without dropping a frame.

    Example: radcam-depth simulate out/ride --seed 7 --frames 20 && radcam-depth replay out/ride out/depth.mcap
    """
    from radcam_depth_ros import replay as replaying
    from radcam_depth_ros.drive import DriveSettings
    from radcam_depth_ros.pairing import PairingConfig
    from radcam_depth_ros.pipeline import OutputConfig

    settings = DriveSettings(
        image=image,
        radars=tuple(radar) if radar else None,
        without_radar=without_radar,
        pairing=PairingConfig(radar_sweeps=radar_sweeps),
    )
    options = replaying.ReplayOptions(
        output=OutputConfig(
            depth_encoding=encoding,
            preview_colormap=colormap,
            preview_near_m=preview_range[0],
            preview_far_m=preview_range[1],
            points_stride=points_stride,
            points_near_m=points_range[0],
            points_far_m=points_range[1],
        ),
        passthrough=passthrough,
        preview=preview,
        points=points,
        overwrite=overwrite,
        compress=compress,
    )
    estimator = load_estimator(network, model, device, precision, output_size)
    with progress_bar() as progress:
        task = progress.add_task("replaying", total=None)
        summary = replaying.replay(
            bag,
            out,
            estimator,
            settings,
            options,
            lambda done, total: progress.update(task, completed=done, total=total),
        )
    counts = (str(summary.images), str(summary.frames), str(summary.without_radar))
    columns = ("images", "depth images", "without radar in view")
    print_table(Console(stderr=True), str(out), columns, (counts,))
