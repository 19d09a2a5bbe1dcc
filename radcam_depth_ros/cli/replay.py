"""`radcam-depth replay`: a bag in, a bag with depth out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from radcam_depth_ros.cli.terminal.node_parameters import ParamsOption, node_parameters
from radcam_depth_ros.cli.terminal.options import (
    Bag,
    DeviceChoice,
    ImageOption,
    ModelOption,
    NetworkChoice,
    PrecisionChoice,
    RadarOption,
    ThreadsChoice,
    estimator_parameters,
    load_estimator,
    progress_bar,
)
from radcam_depth_ros.reporting.terminal import print_table


def replay(
    bag: Bag,
    out: Annotated[Path, typer.Argument(help="Bag to write: a folder, or a file that ends in .mcap.")],
    params: ParamsOption = None,
    network: NetworkChoice = None,
    model: ModelOption = None,
    device: DeviceChoice = None,
    precision: PrecisionChoice = None,
    threads: ThreadsChoice = None,
    image: ImageOption = None,
    radar: RadarOption = None,
    radar_sweeps: Annotated[
        int | None,
        typer.Option(
            help="Sweeps of each radar for an image, moved by the bag's odometry where they are several.",
            show_default="1",
        ),
    ] = None,
    without_radar: Annotated[
        str | None,
        typer.Option(
            help="Images without radar returns: camera_only, hold (the last sweep) or suppress.",
            show_default="camera_only",
        ),
    ] = None,
    encoding: Annotated[
        str | None, typer.Option(help="32FC1 (metres) or 16UC1 (millimetres).", show_default="32FC1")
    ] = None,
    output_size: Annotated[
        str | None, typer.Option(help="native, or network: the size that the network works at.", show_default="native")
    ] = None,
    passthrough: Annotated[bool, typer.Option("--passthrough", help="Copy the input's messages as well.")] = False,
    preview: Annotated[bool, typer.Option("--preview", help="Write depth in colours as well.")] = False,
    colormap: Annotated[
        str | None, typer.Option(help="Colours of the preview: turbo, viridis, grey ...", show_default="turbo")
    ] = None,
    preview_range: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Depths of the preview's first and last colour, metres.", show_default="2.0, 80.0"),
    ] = None,
    points: Annotated[bool, typer.Option("--points", help="Write point clouds as well.")] = False,
    points_stride: Annotated[
        int | None, typer.Option(help="A point for each square of so many pixels' width.", show_default="1")
    ] = None,
    points_range: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Depths of the first and last point, metres.", show_default="0.0, 1000.0"),
    ] = None,
    compress: Annotated[bool, typer.Option("--compress", help="Write a smaller bag, which takes longer.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it exists.")] = False,
) -> None:
    """Writes the depth of every image of a bag to another bag, as the live node would, without dropping a frame.

    Example: radcam-depth simulate out/ride --seed 7 --frames 20 && radcam-depth replay out/ride out/depth.mcap
    """
    from radcam_depth_ros import replay as replaying

    preview_near_m, preview_far_m = preview_range or (None, None)
    points_near_m, points_far_m = points_range or (None, None)
    node = node_parameters(
        params,
        {
            "image_topic": image,
            "radar_topics": radar or None,
            "radar_sweeps": radar_sweeps,
            "without_radar": without_radar,
            "depth_encoding": encoding,
            "preview_colormap": colormap,
            "preview_near_m": preview_near_m,
            "preview_far_m": preview_far_m,
            "points_stride": points_stride,
            "points_near_m": points_near_m,
            "points_far_m": points_far_m,
            "output_size": output_size,
            **estimator_parameters(network, model, device, precision, threads),
        },
    )
    options = replaying.ReplayOptions(
        output=node.config.output,
        passthrough=passthrough,
        also=tuple(name for name, is_wanted in (("preview", preview), ("points", points)) if is_wanted),
        overwrite=overwrite,
        compress=compress,
    )
    estimator = load_estimator(node.config.estimator)
    with progress_bar() as progress:
        task = progress.add_task("replaying", total=None)
        summary = replaying.replay(
            bag,
            out,
            estimator,
            node.drive_settings(),
            options,
            lambda done, total: progress.update(task, completed=done, total=total),
        )
    counts = (str(summary.images), str(summary.frames), str(summary.without_radar))
    columns = ("images", "depth images", "without radar in view")
    print_table(Console(stderr=True), str(out), columns, (counts,))
