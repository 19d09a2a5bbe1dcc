"""`radcam-depth check-calibration`: checks the extrinsics and clocks of a bag."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from radcam_depth_ros.cli.terminal.node_parameters import OUTPUT, ParamsOption, node_parameters
from radcam_depth_ros.cli.terminal.options import (
    Bag,
    CameraHeightOption,
    ImageOption,
    JsonOption,
    LidarOption,
    RadarOption,
    progress_bar,
    write_json,
)
from radcam_depth_ros.reporting.terminal import print_table

if TYPE_CHECKING:
    from radcam_depth_ros.calibration import Report, SensorReport

_SUSPECT_EXIT = 1
_COLUMNS = ("score", "view", "road", "lidar", "doppler", "sweeps")
_ALTERNATIVES = 4
_STYLES = {"OK": "green", "SUSPECT": "bold red", "UNKNOWN": "yellow"}


def check_calibration(
    bag: Bag,
    out: Annotated[Path | None, typer.Option(help="Folder for pictures: radar and LiDAR over the images.")] = None,
    frames: Annotated[int, typer.Option(min=1, help="Number of images to check, evenly spread.")] = 12,
    json_target: JsonOption = None,
    params: ParamsOption = None,
    image: ImageOption = None,
    radar: RadarOption = None,
    lidar: LidarOption = None,
    odometry: Annotated[str | None, typer.Option(help="Topic of the vehicle's motion; found likewise.")] = None,
    camera_from_radar: Annotated[
        str | None,
        typer.Option(help="Try other extrinsics: x y z qx qy qz qw of each radar, as the node's parameter takes them."),
    ] = None,
    radar_time_offset_s: Annotated[
        float | None, typer.Option(help="Added to the radars' stamps, as the node's parameter is.", show_default="0.0")
    ] = None,
    camera_height: CameraHeightOption = None,
) -> None:
    """Checks the mounting and time stamps of radars and LiDAR: wrong signs, turns of 90 degrees, late stamps.

    Each radar's mounting is compared with flips, turns and the inverse. The exit code is 1 where something is SUSPECT.

    Example: radcam-depth simulate out/placed --seed 7 --frames 20 &&
    radcam-depth check-calibration out/placed --out out/overlays
    """
    from radcam_depth_ros import calibration

    node = node_parameters(
        params,
        {
            "image_topic": image,
            "radar_topics": radar or None,
            "odometry_topic": odometry,
            "camera_from_radar": _numbers(camera_from_radar) or None,
            "camera_height_m": camera_height,
            "radar_time_offset_s": radar_time_offset_s,
        },
        unused=(*OUTPUT, "estimator."),
        lidar=lidar,
    )
    with progress_bar() as bar:
        tasks = {}

        def show(step: str, done: int, total: int) -> None:
            if step not in tasks:
                tasks[step] = bar.add_task(step, total=total)
            bar.update(tasks[step], completed=done, total=total)

        report = calibration.check(bag, node.drive_settings(), frames=frames, out=out, progress=show)
    if json_target is not None:
        write_json(dataclasses.asdict(report), json_target)
    else:
        _print(report)
    if report.pictures:
        Console(stderr=True).print(f"{out}: {len(report.pictures)} pictures", markup=False, soft_wrap=True)
    if report.verdict == calibration.SUSPECT:
        raise typer.Exit(_SUSPECT_EXIT)


def _numbers(text: str | None) -> tuple[float, ...]:
    from radcam_depth_ros.frame import RadcamDepthError

    try:
        return tuple(float(word) for word in (text or "").replace(",", " ").split())
    except ValueError:
        raise RadcamDepthError(
            f"camera_from_radar needs 7 numbers a radar, x y z qx qy qz qw, got {text!r}; put them in quotes"
        ) from None


def _print(report: Report) -> None:
    console = Console()
    console.print(f"{report.bag}: ", end="", markup=False, soft_wrap=True)
    console.print(report.verdict, style=_STYLES[report.verdict])
    for sensor in report.sensors:
        _print_places(console, sensor)
    console.print(
        "score: 1 where no other place fits better in anything; view: share in the image; road: share not below it; "
        "lidar: near its points; doppler: as odometry has it; sweeps: at one place before and after",
        style="dim",
    )
    for sensor in report.sensors:
        _tell(console, sensor.verdict, f"{sensor.topic}, place: {sensor.sentence}")
    for time in report.times:
        _tell(console, time.verdict, f"{time.topic}, time: {time.sentence}")
    if not report.road_is_known:
        console.print("the road is assumed 1.4 m below a level camera; --camera-height tells it", markup=False)
    if report.seconds_read < report.seconds:
        console.print(f"only the first {report.seconds_read:.0f} of {report.seconds:.0f} s were read", markup=False)


def _print_places(console: Console, sensor: SensorReport) -> None:
    fits = (*((sensor.given,) if sensor.given else ()), *sensor.alternatives[:_ALTERNATIVES])
    rows = tuple(
        (fit.name, *("" if (value := getattr(fit, name)) is None else f"{value:.2f}" for name in _COLUMNS))
        for fit in fits
    )
    print_table(console, f"{sensor.topic}: {sensor.verdict}", ("placed", *_COLUMNS), rows)


def _tell(console: Console, verdict: str, sentence: str) -> None:
    console.print(f"{verdict}: ", style=_STYLES[verdict], end="")
    console.print(sentence, markup=False, highlight=False, soft_wrap=True)
