"""Checks the poses and clocks of a bag's radars and LiDAR."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from radcam_depth_ros.calibration.evidence import LIDAR_PARTS, Evidence, lidar_parts
from radcam_depth_ros.calibration.pictures import draw_view
from radcam_depth_ros.calibration.placements import alternatives
from radcam_depth_ros.calibration.recording import Recording, read_recording
from radcam_depth_ros.calibration.report import OK, SUSPECT, UNKNOWN, Report, SensorReport
from radcam_depth_ros.calibration.timing import check_times
from radcam_depth_ros.calibration.verdict import check_radar, check_sensor
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.files import whole
from radcam_depth_ros.pairing import for_each_radar
from radcam_depth_ros.reporting.pictures import encode

FRAMES = 12


def check(
    bag: Path | str,
    settings: DriveSettings | None = None,
    *,
    frames: int = FRAMES,
    out: Path | None = None,
    progress: Callable[[str, int, int], None] = lambda step, done, total: None,
) -> Report:
    """Checks the poses and clocks of a bag's radars and LiDAR.

    Args:
        bag: A rosbag2 folder or .mcap file.
        settings: Settings for reading it, such as other extrinsics.
        frames: Number of images that are used, evenly spread.
        out: A folder for pictures of them; None for none.
        progress: Called with (step, done, to do).

    Raises:
        RadcamDepthError: for a bag that cannot be used, or a folder that cannot be written.
    """
    settings = settings or DriveSettings()
    recording = read_recording(bag, settings, frames, lambda done, total: progress("reading", done, total))
    sensors: list[SensorReport] = []
    up = np.asarray(recording.views[0].frame.ground.or_assumed().up)
    steps = len(recording.radars) + 2
    for index, radar in enumerate(recording.radars):
        placements = alternatives(radar.camera_from_radar, up, "camera_from_radar")
        sensors.append(check_radar(recording, index, Evidence(recording, index), placements))
        progress("comparing", index + 1, steps)
    if recording.camera_from_lidar is not None:
        sensors.append(_judge_lidar(recording, sensors, up))
    progress("comparing", steps - 1, steps)
    offsets_s = for_each_radar(
        "radar_time_offset_s", settings.frame_builder.pairing.radar_time_offset_s, len(recording.topics.radars)
    )
    times = check_times(recording, offsets_s)
    progress("comparing", steps, steps)
    verdicts = [sensor.verdict for sensor in sensors[: len(recording.radars)]]
    verdict = UNKNOWN if UNKNOWN in verdicts else OK
    if SUSPECT in (*(sensor.verdict for sensor in sensors), *(time.verdict for time in times)):
        verdict = SUSPECT
    report = Report(
        str(bag),
        round(recording.seconds, 3),
        round(recording.seconds_read, 3),
        verdict,
        tuple(sensors),
        times,
        recording.views[0].frame.ground.is_known,
    )
    return report if out is None else dataclasses.replace(report, pictures=_write_pictures(recording, out, progress))


def _judge_lidar(recording: Recording, radars: list[SensorReport], up: np.typing.NDArray[np.float64]) -> SensorReport:
    topic = recording.topics.lidar or ""
    points = sum(len(view.lidar_m) for view in recording.views if view.lidar_m is not None)
    if recording.camera_from_lidar is None or not points:
        return SensorReport(topic, UNKNOWN, "no image has a scan near enough in time", 0, 0)
    believed = [index for index, report in enumerate(radars) if report.verdict != SUSPECT]
    placements = alternatives(recording.camera_from_lidar, up, "camera_from_lidar")
    parts = lidar_parts(recording, placements, believed)
    return check_sensor(topic, placements, parts, points, LIDAR_PARTS, ("a radar whose place is right",))


def _write_pictures(recording: Recording, out: Path, progress: Callable[[str, int, int], None]) -> tuple[str, ...]:
    written: list[str] = []
    for number, view in enumerate(recording.views):
        path = out / f"{number:03d}.png"
        with whole(path) as temporary:
            temporary.write_bytes(encode(draw_view(recording, view)))
        written.append(str(path))
        progress("drawing", number + 1, len(recording.views))
    return tuple(written)
