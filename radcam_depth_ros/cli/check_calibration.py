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
    keep_apart,
    progress_bar,
    write_json,
)
from radcam_depth_ros.reporting.terminal import PlainConsole, print_table

if TYPE_CHECKING:
    from radcam_depth_ros.calibration import Report, RoadReport, SensorReport

_SUSPECT_EXIT = 1
_COLUMNS = ("score", "view", "road", "lidar", "doppler", "sweeps")
_ALTERNATIVES = 4
_STYLES = {"OK": "green", "SUSPECT": "bold red", "UNKNOWN": "yellow"}


def check_calibration(
    bag: Bag,
    out: Annotated[Path | None, typer.Option(help="Folder for pictures: radar and LiDAR over the images.")] = None,
    frames: Annotated[
        int | None,
        typer.Option(min=1, help="Number of images to check, evenly spread.", show_default="12, with --road 40"),
    ] = None,
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
    road: Annotated[
        bool, typer.Option("--road", help="Estimate the camera's height above the road, pitch and roll instead.")
    ] = False,
    write_params: Annotated[
        Path | None, typer.Option(help="With --road: write them to this YAML file, as the node's parameters.")
    ] = None,
) -> None:
    """Checks the mounting and time stamps of radars and LiDAR: wrong signs, turns of 90 degrees, late stamps.

    Each radar's mounting is compared with flips, turns and the inverse. The exit code is 1 where something is SUSPECT.

    Example: radcam-depth simulate out/placed --seed 7 --frames 20 &&
    radcam-depth check-calibration out/placed --out out/overlays
    """
    from radcam_depth_ros import calibration
    from radcam_depth_ros.frame import RadcamDepthError

    if (road and out is not None) or (write_params is not None and not road):
        raise RadcamDepthError("--out makes no pictures with --road, and --write-params needs it; leave one out")
    keep_apart((out, json_target, write_params), (bag, params))
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

        settings = node.drive_settings()
        if road:
            found = calibration.check_road(bag, settings, frames=frames or calibration.ROAD_FRAMES, progress=show)
        else:
            report = calibration.check(bag, settings, frames=frames or calibration.FRAMES, out=out, progress=show)
    if road:
        _print_road(found, json_target, write_params)
        return
    if json_target is not None:
        write_json(dataclasses.asdict(report), json_target)
    else:
        _print(report)
    if report.pictures:
        PlainConsole(stderr=True).print(f"{out}: {len(report.pictures)} pictures", soft_wrap=True)
    if report.verdict == calibration.SUSPECT:
        raise typer.Exit(_SUSPECT_EXIT)


def _print_road(report: RoadReport, json_target: str | None, write_params: Path | None) -> None:
    """Prints the road, writes the parameter file, and ends with the exit code."""
    from radcam_depth_ros import calibration, inspection
    from radcam_depth_ros.frame import RadcamDepthError

    if json_target is not None:
        write_json(dataclasses.asdict(report), json_target)
    else:
        _print_road_table(report)
    if write_params is not None:
        height, *turns = report.values
        if height.value is None:
            raise RadcamDepthError(f"{write_params} is not written, since the road is unknown: {report.sentence}")
        settings = tuple(
            inspection.Setting(value.parameter, value.value, f"by {report.source}, +- {value.deviation:g}")
            for value in (height, *turns)
            if value.value is not None
        )
        inspection.write_parameters(write_params, inspection.Suggestion(settings), Path(report.bag).name)
        PlainConsole(stderr=True).print(f"parameters: {write_params}", soft_wrap=True)
    if report.verdict == calibration.SUSPECT:
        raise typer.Exit(_SUSPECT_EXIT)


def _print_road_table(report: RoadReport) -> None:
    console = PlainConsole()
    console.print(f"{report.bag}: ", end="", soft_wrap=True)
    console.print(report.verdict, style=_STYLES[report.verdict])

    def cell(number: float | None) -> str:
        return "" if number is None else f"{number:.2f}"

    rows = tuple(
        (value.parameter, cell(value.value), cell(value.deviation), cell(value.given), value.verdict)
        for value in report.values
    )
    source = f"{report.source or 'no source'}, {report.frames} of {report.looked_at} frames"
    print_table(console, source, ("parameter", "measured", "deviation", "given", "verdict"), rows)
    for value in report.values:
        _print_verdict(console, value.verdict, f"{value.parameter}: {value.sentence}")


def _numbers(text: str | None) -> tuple[float, ...]:
    from radcam_depth_ros.frame import RadcamDepthError

    try:
        return tuple(float(word) for word in (text or "").replace(",", " ").split())
    except ValueError:
        raise RadcamDepthError(
            f"camera_from_radar needs 7 numbers a radar, x y z qx qy qz qw, got {text!r}; put them in quotes"
        ) from None


def _print(report: Report) -> None:
    console = PlainConsole()
    console.print(f"{report.bag}: ", end="", soft_wrap=True)
    console.print(report.verdict, style=_STYLES[report.verdict])
    for sensor in report.sensors:
        _print_places(console, sensor)
    console.print(
        "score: 1 where no other place fits better in anything; view: share in the image; road: share not below it; "
        "lidar: near its points; doppler: as odometry has it; sweeps: at one place before and after",
        style="dim",
    )
    for sensor in report.sensors:
        _print_verdict(console, sensor.verdict, f"{sensor.topic}, place: {sensor.sentence}")
    for time in report.times:
        _print_verdict(console, time.verdict, f"{time.topic}, time: {time.sentence}")
    if not report.road_is_known:
        console.print("the road is assumed 1.4 m below a level camera; --camera-height tells it")
    if report.seconds_read < report.seconds:
        console.print(f"only the first {report.seconds_read:.0f} of {report.seconds:.0f} s were read")


def _print_places(console: Console, sensor: SensorReport) -> None:
    fits = (*((sensor.given,) if sensor.given else ()), *sensor.alternatives[:_ALTERNATIVES])
    rows = tuple(
        (fit.name, *("" if (value := getattr(fit, name)) is None else f"{value:.2f}" for name in _COLUMNS))
        for fit in fits
    )
    print_table(console, f"{sensor.topic}: {sensor.verdict}", ("placed", *_COLUMNS), rows)


def _print_verdict(console: Console, verdict: str, sentence: str) -> None:
    console.print(f"{verdict}: ", style=_STYLES[verdict], end="")
    console.print(sentence, highlight=False, soft_wrap=True)
