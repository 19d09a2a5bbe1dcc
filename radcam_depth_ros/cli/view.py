"""`radcam-depth view`: shows a recorded or live drive as a video, pictures, or in Rerun."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radcam_depth_ros.cli.terminal.node_parameters import NodeParameters, ParamsOption, node_parameters
from radcam_depth_ros.cli.terminal.options import (
    NETWORK,
    DeviceOption,
    ImageOption,
    ModelOption,
    PrecisionOption,
    RadarOption,
    RuntimeOption,
    ThreadsOption,
    estimator_parameters,
    keep_apart,
    load_estimator,
    needs_ros,
    progress_bar,
)
from radcam_depth_ros.reporting.terminal import PlainConsole

if TYPE_CHECKING:
    from radcam_depth_ros.drive import DriveSettings
    from radcam_depth_ros.frame import DepthResult, Frame
    from radcam_depth_ros.viewing import ViewOptions

_LIVE = "topics"


def view(
    bag: Annotated[
        Path, typer.Argument(help=f"A rosbag2 folder or .mcap file, or `{_LIVE}`: what a node publishes now.")
    ],
    save: Annotated[
        Path | None,
        typer.Option(
            help="Video (.mp4), strip of evenly spread frames (.png), recording for Rerun (.rrd), or folder for single "
            "pictures."
        ),
    ] = None,
    rerun: Annotated[
        bool,
        typer.Option(
            "--rerun",
            help="Show camera, returns, depth, points and confidence on one timeline in Rerun, or --save them as .rrd.",
        ),
    ] = False,
    network: Annotated[
        str | None,
        typer.Option(help=f"Network to run; by default the bag's own depth, or {NETWORK} where it has none."),
    ] = None,
    model: ModelOption = None,
    params: ParamsOption = None,
    depth: Annotated[
        Path | None,
        typer.Option(
            help="Bag with the depth of this drive, from replay or recorded, to show instead; for topics: the node's "
            "namespace."
        ),
    ] = None,
    device: DeviceOption = None,
    precision: PrecisionOption = None,
    runtime: RuntimeOption = None,
    threads: ThreadsOption = None,
    image: ImageOption = None,
    radar: RadarOption = None,
    every: Annotated[int, typer.Option(help="Show only every n-th image.")] = 1,
    frames: Annotated[int | None, typer.Option(help="Maximum number of pictures; a strip has 5 by default.")] = None,
    seconds: Annotated[
        float | None, typer.Option(help="For topics: stop after this many seconds; Ctrl-C stops it too.")
    ] = None,
    width: Annotated[int, typer.Option(help="Width of the pictures in pixels.")] = 1920,
) -> None:
    """Shows a drive: the camera beside its dense and semi-dense depth, radar returns drawn in.

    For live topics, each image is shown with the depth that a node publishes for it, until 10 s pass without one.

    With a running node: radcam-depth view topics --save out/live.mp4 --seconds 10

    In Rerun: radcam-depth view out/shown --rerun

    Example: radcam-depth simulate out/shown --seed 7 --frames 20 && radcam-depth view out/shown --save out/shown.mp4
    """
    from radcam_depth_ros import viewing

    _require_target(save, rerun)
    keep_apart((save,), (bag, depth, params, model))
    estimation = estimator_parameters(network, model, device, precision, runtime, threads)
    given = {"image_topic": image, "radar_topics": radar or None, **estimation}
    node = node_parameters(params, given, unused=("output.",))
    options = viewing.ViewOptions(every, frames, width)
    if network is not None or model is not None:
        if depth is not None:
            raise viewing.ViewError(
                "--depth shows the depth of a bag, --network and --model compute it; give one of them"
            )
        if _is_live(bag):
            raise viewing.ViewError(f"{_LIVE} shows the depth that a node publishes; leave --network and --model out")
    if _is_live(bag):
        shown = _view_live(save, node.drive_settings(), options, None if depth is None else str(depth), seconds)
    elif seconds is not None:
        raise viewing.ViewError(f"--seconds is for {_LIVE}, {bag} is a bag; give --frames")
    else:
        is_estimated = network is not None or model is not None
        shown = _view_bag(bag, save, depth, node, options, is_estimated=is_estimated)
    PlainConsole(stderr=True).print(f"{save or 'Rerun'}: {shown} pictures", soft_wrap=True)


def _require_target(save: Path | None, is_rerun: bool) -> None:
    """Refuses options that name no place to show the drive, or two."""
    from radcam_depth_ros import viewing

    if save is None and not is_rerun:
        raise viewing.ViewError("expected a place for the pictures; give --save FILE.mp4, or --rerun for the viewer")
    if save is not None and is_rerun and save.suffix != ".rrd":
        raise viewing.ViewError(f"--rerun saves recordings (.rrd), not {save.name}; leave --rerun out, or give an .rrd")


def _is_live(bag: Path) -> bool:
    return str(bag) == _LIVE and not bag.exists()


def _view_bag(
    bag: Path,
    save: Path | None,
    depth: Path | None,
    node: NodeParameters,
    options: ViewOptions,
    *,
    is_estimated: bool,
) -> int:
    from radcam_depth_ros import viewing
    from radcam_depth_ros.bags import BagReader

    with ExitStack() as stack:
        recorded = stack.enter_context(BagReader(depth or bag))
        namespace = viewing.find_recorded_depth(recorded)
        if depth is not None and namespace is None:
            raise viewing.ViewError(
                f"{depth} has no depth of the node (depth/image_rect and depth/camera_info); write it with "
                "`radcam-depth replay`, or leave --depth out"
            )
        estimate: Callable[[Frame], DepthResult | None]
        if namespace is not None and not is_estimated:
            estimate = viewing.RecordedDepth(recorded, namespace).predict
        else:
            estimate = _estimate(node)
        bar = stack.enter_context(progress_bar())
        task = bar.add_task("drawing", total=None)
        return viewing.view(
            bag,
            save,
            estimate,
            node.drive_settings(),
            options,
            lambda done, total: bar.update(task, completed=done, total=total),
        )


def _estimate(node: NodeParameters) -> Callable[[Frame], DepthResult | None]:
    """The network's depth; none of a frame whose depth the node would suppress."""
    estimator, without_radar = load_estimator(node.config.estimator), node.config.frame_builder.without_radar

    def estimate(frame: Frame) -> DepthResult | None:
        result = estimator.estimate(frame)
        return None if without_radar == "suppress" and not result.radar_in_view else result

    return estimate


def _view_live(
    save: Path | None, settings: DriveSettings, options: ViewOptions, namespace: str | None, seconds: float | None
) -> int:
    from radcam_depth_ros import viewing

    with needs_ros(f"view {_LIVE}"):
        from radcam_depth_ros import live_topics as listening
    with listening.listener(listening.ListenOptions(seconds)) as source, progress_bar() as bar:
        # Ctrl-C ends the listening, not the writing of what came.
        before = signal.signal(signal.SIGINT, lambda *_: source.stop())
        try:
            task = bar.add_task("drawing", total=options.frames)
            return viewing.view_live(
                source,
                save,
                settings,
                options,
                namespace,
                lambda shown: bar.update(task, completed=shown),
                lambda sentence: bar.console.print(sentence, soft_wrap=True),
            )
        finally:
            signal.signal(signal.SIGINT, before)
