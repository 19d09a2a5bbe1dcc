from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from radcam_depth_ros import messages, simulation
from radcam_depth_ros.geometry import TransformTree, ground_coefficients, ground_plane, project, unproject
from radcam_depth_ros.simulation.materials.surfaces import Label

TOPICS = {
    "/camera/image_raw/compressed",
    "/camera/camera_info",
    "/ground_truth/depth",
    "/ground_truth/classes",
    "/radar/points",
    "/radar_4d/points",
    "/lidar/points",
    "/odom",
    "/tf",
    "/tf_static",
    "/scenario",
}
NUSCENES_FIELDS = [
    *("x", "y", "z", "dyn_prop", "id", "rcs", "vx", "vy", "vx_comp", "vy_comp", "is_quality_valid", "ambig_state"),
    *("x_rms", "y_rms", "invalid_state", "pdh0", "vx_rms", "vy_rms"),
]


def transforms(drive: Any) -> TransformTree:
    tree = TransformTree()
    for link in messages.decode_transforms(drive.messages["/tf_static"][0]):
        tree.set(link.parent_frame, link.child_frame, link.parent_from_child)
    return tree


def depth_and_classes(drive: Any) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    depth = messages.decode_depth(drive.messages["/ground_truth/depth"][0]).depth_m
    classes = messages.decode_classes(drive.messages["/ground_truth/classes"][0]).classes
    return depth, classes


def errors_in_image(drive: Any, xyz: npt.NDArray[np.float32], frame: str) -> npt.NDArray[np.float32]:
    """Of points that fall into the image: their depth less the exact depth, relative to it, where that is finite."""
    camera = messages.Calibration(drive.messages["/camera/camera_info"][0]).camera
    depth, _ = depth_and_classes(drive)
    uv, z = project(transforms(drive).lookup("camera_optical", frame).apply(xyz), camera)
    column, row = np.round(np.nan_to_num(uv, nan=-1.0)).astype(int).T
    inside = (z > 0) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    exact = depth[row[inside], column[inside]]
    found: npt.NDArray[np.float32] = (z[inside] - exact)[np.isfinite(exact)] / exact[np.isfinite(exact)]
    return found


def test_all_topics_are_there(still_drive: Any) -> None:
    assert set(still_drive.messages) == TOPICS


def test_stamps_follow_the_sensors_rates(still_drive: Any) -> None:
    stamps = {
        topic: [messages.stamp_ns(message.header) for message in found]
        for topic, found in still_drive.messages.items()
        if topic not in ("/tf", "/tf_static", "/scenario")
    }
    assert stamps["/camera/image_raw/compressed"] == [1_700_000_000_000_000_000, 1_700_000_000_100_000_000]
    assert stamps["/ground_truth/depth"] == stamps["/camera/camera_info"] == stamps["/camera/image_raw/compressed"]
    for topic, rate_hz in (("/radar/points", 13), ("/radar_4d/points", 15), ("/lidar/points", 10), ("/odom", 50)):
        assert np.allclose(np.diff(stamps[topic]), 1e9 / rate_hz, atol=2)
        assert stamps[topic][0] <= stamps["/camera/image_raw/compressed"][0]
        assert stamps[topic][-1] >= stamps["/camera/image_raw/compressed"][-1]


def test_the_scenario_says_what_was_drawn(still_drive: Any) -> None:
    (message,) = still_drive.messages["/scenario"]
    scenario = json.loads(message.data)
    assert scenario["street"] == "town"
    assert simulation.Weather(scenario["weather"]) is not simulation.Weather.ANY
    assert simulation.TimeOfDay(scenario["time_of_day"]) is not simulation.TimeOfDay.ANY
    assert simulation.Season(scenario["season"]) is not simulation.Season.ANY
    assert scenario["focal_length_px"] == 126.0


def test_radar_has_the_layout_of_nuscenes(still_drive: Any) -> None:
    for message in still_drive.messages["/radar/points"]:
        assert [field.name for field in message.fields] == NUSCENES_FIELDS
        assert message.point_step == 43
        xyz = messages.decode_radar(message).returns.xyz_m
        assert 5 <= len(xyz) <= 150
        assert not xyz[:, 2].any()


def test_sky_is_infinitely_far_and_nothing_else_is(still_drive: Any) -> None:
    depth, classes = depth_and_classes(still_drive)
    assert (np.isinf(depth) == (classes == Label.SKY)).all()
    assert np.isfinite(depth).mean() > 0.3
    assert depth.min() > 0.3


def test_the_road_lies_on_the_ground_plane(still_drive: Any) -> None:
    depth, classes = depth_and_classes(still_drive)
    camera = messages.Calibration(still_drive.messages["/camera/camera_info"][0]).camera
    ground = ground_plane(transforms(still_drive).lookup("camera_optical", "base_footprint"))
    a, b, c, _ = ground_coefficients(ground, camera)
    row, column = np.nonzero((classes == Label.ROAD) & (depth < 30))
    assert len(row) > 500
    predicted = 1 / (a * column + b * row + c)
    # Kerbs, side roads and the vehicle's own pitch bend the road a little.
    assert np.median(np.abs(predicted / depth[row, column] - 1)) < 0.02


def test_lidar_agrees_with_the_exact_depth(still_drive: Any) -> None:
    points = messages.decode_points(still_drive.messages["/lidar/points"][0]).xyz_m
    errors = errors_in_image(still_drive, points, "lidar")
    assert len(errors) > 1000
    assert np.median(np.abs(errors)) < 0.015


def test_imaging_radar_agrees_with_the_exact_depth(still_drive: Any) -> None:
    points = messages.decode_radar(still_drive.messages["/radar_4d/points"][0]).returns.xyz_m
    errors = errors_in_image(still_drive, points, "radar_4d")
    assert len(errors) > 100
    assert np.median(np.abs(errors)) < 0.06


def test_a_standing_vehicle_sees_nothing_move(still_drive: Any) -> None:
    for topic in ("/radar/points", "/radar_4d/points"):
        speeds = messages.decode_radar(still_drive.messages[topic][0]).returns.radial_speed_mps
        assert np.percentile(np.abs(speeds), 75) < 0.5
    odometry = messages.decode_odometry(still_drive.messages["/odom"][0])
    assert np.abs(odometry.linear).max() < 0.2


def test_the_image_has_content(still_drive: Any) -> None:
    image = messages.decode_image(still_drive.messages["/camera/image_raw/compressed"][0]).image
    assert image.shape == (96, 160, 3)
    assert image.std() > 10


def decoded(drive: Any) -> dict[str, list[npt.NDArray[np.generic]]]:
    """The bytes of all messages' data, and poses."""
    arrays: dict[str, list[npt.NDArray[np.generic]]] = {}
    for topic, found in drive.messages.items():
        if topic == "/odom":
            arrays[topic] = [messages.decode_odometry(message).linear for message in found]
        elif hasattr(found[0], "data"):
            arrays[topic] = [np.asarray(message.data) for message in found]
        elif topic.startswith("/tf"):
            arrays[topic] = [messages.decode_transforms(message)[0].parent_from_child.rotation for message in found]
    return arrays


def test_a_seed_decides_everything(record: Any, read: Any) -> None:
    world = simulation.WorldConfig(view_m=100.0, street=simulation.StreetKind.RESIDENTIAL)
    camera = dataclasses.replace(simulation.CameraConfig(), width=96, height=64)
    config = simulation.SimulationConfig(world=world, camera=camera)
    first, second = (decoded(read(record(config, seed=11))) for _ in range(2))
    assert first.keys() == second.keys()
    for topic, arrays in first.items():
        assert len(arrays) == len(second[topic])
        assert all(np.array_equal(a, b) for a, b in zip(arrays, second[topic], strict=True)), topic
    # Another image leaves what the other sensors see as it was.
    other = decoded(read(record(dataclasses.replace(config, camera=dataclasses.replace(camera, width=64)), seed=11)))
    for topic in ("/radar/points", "/radar_4d/points", "/lidar/points"):
        assert all(np.array_equal(a, b) for a, b in zip(first[topic], other[topic], strict=True)), topic
    assert not np.array_equal(decoded(read(record(config, seed=12)))["/radar/points"][0], first["/radar/points"][0])


def test_clock_and_mounting_errors_are_in_no_message(record: Any, read: Any) -> None:
    world = simulation.WorldConfig(view_m=100.0, street=simulation.StreetKind.RURAL)
    off = {"max_clock_offset_s": 0.0, "clock_jitter_s": 0.0, "max_mounting_error_deg": 0.0, "max_mounting_error_m": 0.0}

    def drive(**errors: float) -> Any:
        config = simulation.SimulationConfig(
            world=world,
            camera=simulation.CameraConfig(width=96, height=64, min_focal_length_px=80.0, max_focal_length_px=80.0),
            radar=dataclasses.replace(simulation.RadarConfig(), **errors),
            imaging_radar=simulation.ImagingRadarConfig(enabled=False),
            lidar=simulation.LidarConfig(enabled=False),
            key_frames=True,
        )
        return read(record(config, seed=11, frames=1))

    erring, exact = drive(), drive(**off)
    (sweep,), (exact_sweep,) = erring.messages["/radar/points"], exact.messages["/radar/points"]
    assert messages.stamp_ns(sweep.header) == messages.stamp_ns(exact_sweep.header)
    assert all(
        np.array_equal(a, b) for a, b in zip(decoded(erring)["/tf_static"], decoded(exact)["/tf_static"], strict=True)
    )
    assert not np.array_equal(sweep.data, exact_sweep.data)


def test_key_frames_keep_the_nearest_sweeps_only(record: Any, read: Any) -> None:
    camera = dataclasses.replace(simulation.CameraConfig(), width=64, height=32, rate_hz=1.0, jpeg=False)
    off = simulation.LidarConfig(enabled=False)
    world = simulation.WorldConfig(view_m=100.0, street=simulation.StreetKind.RURAL)
    config = simulation.SimulationConfig(world=world, camera=camera, lidar=off, key_frames=True)
    drive = read(record(config, seed=5, frames=3))
    images = [messages.decode_image(message).stamp_ns for message in drive.messages["/camera/image_raw"]]
    assert len(images) == 3
    assert "/lidar/points" not in drive.messages
    for topic, rate_hz in (("/radar/points", 13), ("/radar_4d/points", 15)):
        sweeps = [messages.stamp_ns(message.header) for message in drive.messages[topic]]
        assert np.abs(np.subtract(sweeps, images)).max() <= 0.5e9 / rate_hz + 2


def test_a_failure_leaves_nothing_behind(tmp_path: Path) -> None:
    camera = dataclasses.replace(simulation.CameraConfig(), width=32, height=32)
    config = simulation.SimulationConfig(world=simulation.WorldConfig(view_m=100.0), camera=camera)

    def interrupted(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulation.simulate(config, 0, 1, tmp_path / "drive", progress=interrupted)
    assert list(tmp_path.iterdir()) == []


def test_depth_is_along_the_optical_axis(still_drive: Any) -> None:
    depth, classes = depth_and_classes(still_drive)
    camera = messages.Calibration(still_drive.messages["/camera/camera_info"][0]).camera
    road = unproject(depth, camera)[(classes == Label.ROAD) & (depth < 20)]
    ground = ground_plane(transforms(still_drive).lookup("camera_optical", "base_footprint"))
    heights = road @ np.array(ground.up) + ground.height_m
    assert np.median(np.abs(heights)) < 0.03
