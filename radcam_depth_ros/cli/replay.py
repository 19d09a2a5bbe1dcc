"""`radcam-depth replay`: writes the depth of a bag's images to another bag."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radcam_depth_ros.cli.terminal.fleet_runs import OnOption, ShardOption, finish, found_bags, is_bag, run_fleet
from radcam_depth_ros.cli.terminal.node_parameters import ParamsOption, node_parameters
from radcam_depth_ros.cli.terminal.options import (
    ColormapOption,
    DeviceOption,
    EncodingOption,
    ImageOption,
    ModelOption,
    NetworkOption,
    OutputSizeOption,
    PointsRangeOption,
    PointsStrideOption,
    PrecisionOption,
    PreviewRangeOption,
    RadarOption,
    RadarSweepsOption,
    RuntimeOption,
    ThreadsOption,
    WithoutRadarOption,
    estimator_parameters,
    keep_apart,
    load_estimator,
    progress_bar,
)
from radcam_depth_ros.reporting.terminal import PlainConsole, print_table

if TYPE_CHECKING:
    from radcam_depth_ros.drive import DriveSettings
    from radcam_depth_ros.estimator import Estimator
    from radcam_depth_ros.replay import ReplayOptions


def replay(
    bags: Annotated[list[Path], typer.Argument(help="A rosbag2 folder or .mcap file; or several, or folders of some.")],
    out: Annotated[
        Path, typer.Argument(help="Bag to write: a folder, or a file that ends in .mcap; of several bags their folder.")
    ],
    params: ParamsOption = None,
    network: NetworkOption = None,
    model: ModelOption = None,
    device: DeviceOption = None,
    precision: PrecisionOption = None,
    runtime: RuntimeOption = None,
    threads: ThreadsOption = None,
    image: ImageOption = None,
    radar: RadarOption = None,
    radar_sweeps: RadarSweepsOption = None,
    without_radar: WithoutRadarOption = None,
    encoding: EncodingOption = None,
    output_size: OutputSizeOption = None,
    passthrough: Annotated[bool, typer.Option("--passthrough", help="Copy the input's messages as well.")] = False,
    preview: Annotated[bool, typer.Option("--preview", help="Write depth in colours as well.")] = False,
    colormap: ColormapOption = None,
    preview_range: PreviewRangeOption = None,
    points: Annotated[bool, typer.Option("--points", help="Write point clouds as well.")] = False,
    points_stride: PointsStrideOption = None,
    points_range: PointsRangeOption = None,
    compressed_depth: Annotated[
        bool, typer.Option("--compressed-depth", help="Write depth as image_transport's compressedDepth as well.")
    ] = False,
    compress: Annotated[bool, typer.Option("--compress", help="Write a smaller bag, which takes longer.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it exists.")] = False,
    shard: ShardOption = None,
    on: OnOption = None,
) -> None:
    """Writes the depth of every image of a bag to another bag, as the live node would, without dropping a frame.

    Of several bags each gets a bag in the folder OUT; those that are there are kept, and a bag that fails is named in
    OUT/failed.jsonl.

    Example: radcam-depth simulate out/ride --seed 7 --frames 20 && radcam-depth replay out/ride out/depth.mcap
    """
    from radcam_depth_ros import replay as replaying
    from radcam_depth_ros.fleet.work.replaying import Replaying
    from radcam_depth_ros.fleet.work.weights import Weights

    keep_apart((out,), (*bags, params, model))
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
            **estimator_parameters(network, model, device, precision, runtime, threads),
        },
    )
    wanted = {"preview": preview, "points": points, "compressed_depth": compressed_depth}
    options = replaying.ReplayOptions(
        output=node.config.output,
        passthrough=passthrough,
        also=tuple(name for name, is_wanted in wanted.items() if is_wanted),
        overwrite=overwrite,
        compress=compress,
    )
    estimator, settings = load_estimator(node.config.estimator), node.drive_settings()
    if shard or on or len(bags) > 1 or not is_bag(bags[0]):
        finish(run_fleet(Replaying(Weights.of(estimator), settings, options), found_bags(bags), out, shard, on))
    else:
        _replay_one(bags[0], out, estimator, settings, options)


def _replay_one(bag: Path, out: Path, estimator: Estimator, settings: DriveSettings, options: ReplayOptions) -> None:
    from radcam_depth_ros import replay as replaying

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
    print_table(PlainConsole(stderr=True), str(out), columns, (counts,))
