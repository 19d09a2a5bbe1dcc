"""`radcam-depth view`: a drive as a video."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from radcam_depth_ros.cli.options import (
    Bag,
    DeviceOption,
    ImageOption,
    ModelOption,
    PrecisionOption,
    RadarOption,
    load_estimator,
    progress_bar,
)

if TYPE_CHECKING:
    from radcam_depth_ros.frame import DepthResult, Frame

_DEFAULT_NETWORK = "baff"


def view(
    bag: Bag,
    save: Annotated[
        Path, typer.Option(help="Video (.mp4), strip of evenly spread frames (.png), or folder for single pictures.")
    ],
    network: Annotated[
        str | None,
        typer.Option(help=f"Network to run; by default the bag's own depth, or {_DEFAULT_NETWORK} where it has none."),
    ] = None,
    model: ModelOption = None,
    depth: Annotated[
        Path | None, typer.Option(help="Bag with the depth of this drive, of replay or recorded, to show instead.")
    ] = None,
    device: DeviceOption = "cpu",
    precision: PrecisionOption = "auto",
    image: ImageOption = None,
    radar: RadarOption = None,
    every: Annotated[int, typer.Option(help="Show only every so many-th image.")] = 1,
    frames: Annotated[int | None, typer.Option(help="At most so many; a strip has 5 by default.")] = None,
    width: Annotated[int, typer.Option(help="Width of the pictures in pixels.")] = 1920,
) -> None:
    """Shows a drive: the camera beside its dense and semi-dense depth, radar returns drawn in.

    Example: radcam-depth simulate out/shown --seed 7 --frames 20 && radcam-depth view out/shown --save out/shown.mp4
    """
    from radcam_depth_ros import viewing
    from radcam_depth_ros.bags import BagReader
    from radcam_depth_ros.drive import DriveSettings

    settings = DriveSettings(image=image, radars=tuple(radar) if radar else None)
    options = viewing.ViewOptions(every, frames, width)
    if depth is not None and (network is not None or model is not None):
        raise viewing.ViewError("--depth shows the depth of a bag, --network and --model compute it; give one of them")
    with ExitStack() as stack:
        recorded = stack.enter_context(BagReader(depth or bag))
        namespace = viewing.find_recorded_depth(recorded)
        if depth is not None and namespace is None:
            raise viewing.ViewError(
                f"{depth} has no depth of the node (depth/image_rect and depth/camera_info); write it with "
                "`radcam-depth replay`, or leave --depth out"
            )
        estimate: Callable[[Frame], DepthResult | None]
        if namespace is not None and network is None and model is None:
            estimate = viewing.RecordedDepth(recorded, namespace).predict
        else:
            estimate = load_estimator(network or _DEFAULT_NETWORK, model, device, precision).estimate
        bar = stack.enter_context(progress_bar())
        task = bar.add_task("drawing", total=None)
        shown = viewing.view(
            bag, save, estimate, settings, options, lambda done, total: bar.update(task, completed=done, total=total)
        )
    Console(stderr=True).print(f"{save}: {shown} pictures", markup=False, soft_wrap=True)
