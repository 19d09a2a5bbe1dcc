"""Several sweeps of a radar in one frame, moved to the image's time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from small_drive import CAMERA, small_image

from radcam_depth_ros.bags import factory
from radcam_depth_ros.frame import Frame, RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilder, FrameBuilderConfig
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import (
    OdometryReading,
    StampedTransform,
    encode_camera_info,
    encode_image,
    encode_odometry,
    encode_points,
    encode_transforms,
)
from radcam_depth_ros.pairing import PairingConfig

SECOND = 1_000_000_000
BASE_FROM_CAMERA = RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([1.5, 0.0, 1.4]))
BASE_FROM_RADAR = RigidTransform(np.eye(3), np.array([3.5, 0.0, 0.5]))
WORLD_M = np.array([[30.0, 4.0, 1.0], [45.0, -6.0, 2.0], [60.0, 1.0, 0.5]])
CONFIG = FrameBuilderConfig(
    image="/image",
    camera_info="/camera_info",
    radars=("/radar",),
    odometry="/odom",
    pairing=PairingConfig(radar_sweeps=4),
)
TF_CONFIG = replace(CONFIG, odometry="", odom_frame="map")


def place(time_s: float) -> RigidTransform:
    """12 m/s, turning by 0.2 rad/s."""
    yaw = 0.2 * time_s
    return RigidTransform.from_quaternion(
        (60 * math.sin(yaw), 60 * (1 - math.cos(yaw)), 0), (0, 0, math.sin(yaw / 2), math.cos(yaw / 2))
    )


def drive(
    frame_builder: FrameBuilder, start_s: float = 0.0, seconds: float = 1.0, moves: bool = True, base: str = "base"
) -> list[Frame]:
    """Poses at 50 Hz, clouds of three standing points at 20 Hz and images at 10 Hz, 10 ms after a cloud."""
    link = StampedTransform
    fixed = [link("base", "camera", 0, BASE_FROM_CAMERA), link("base", "radar", 0, BASE_FROM_RADAR)]
    frame_builder.add("/tf_static", encode_transforms(factory, fixed), 0)
    frame_builder.add("/camera_info", encode_camera_info(factory, CAMERA, 0, "camera"), 0)
    frames: list[Frame] = []
    for tick in range(round(seconds * 100)):
        time_s = start_s + tick / 100
        now_ns, pose = round((time_s + 100) * SECOND), place(time_s)
        if moves and tick % 2 == 0:
            still = np.zeros(3)
            reading = OdometryReading(now_ns, "odom", base, pose, still, still)
            frame_builder.add("/odom", encode_odometry(factory, reading), now_ns)
            links = [link("map", "odom", now_ns, RigidTransform.identity()), link("odom", "base", now_ns, pose)]
            frame_builder.add("/tf", encode_transforms(factory, links), now_ns)
        if tick % 5 == 0:
            x, y, z = (pose @ BASE_FROM_RADAR).inverse().apply(WORLD_M).T
            frames += frame_builder.add(
                "/radar", encode_points(factory, {"x": x, "y": y, "z": z}, now_ns, "radar"), now_ns
            )
        if tick % 10 == 1:
            frames += frame_builder.add("/image", encode_image(factory, small_image(tick), now_ns, "camera"), now_ns)
    return frames + list(frame_builder.flush())


def expected(frame: Frame) -> np.ndarray:
    time_s = frame.stamp_ns / SECOND - 100
    return (place(time_s) @ BASE_FROM_CAMERA).inverse().apply(WORLD_M)


@pytest.mark.parametrize("config", [CONFIG, TF_CONFIG])
def test_what_stands_still_is_at_one_place_in_all_sweeps(config: FrameBuilderConfig) -> None:
    frame_builder = FrameBuilder(config)
    frames = drive(frame_builder)
    assert len(frames) == 10
    for frame in frames[3:]:
        assert frame.radar_counts == (12,)
        np.testing.assert_allclose(frame.radar.xyz_m, np.tile(expected(frame), (4, 1)), atol=1e-3)
        np.testing.assert_allclose(frame.radar.age_s, np.repeat([0.01, 0.06, 0.11, 0.16], 3), atol=1e-6)
    assert frame_builder.motion_problem == ""


def test_a_single_sweep_stays_as_it_was_unless_it_is_to_be_moved() -> None:
    single = replace(CONFIG, pairing=PairingConfig())
    plain, moved = drive(FrameBuilder(single)), drive(FrameBuilder(replace(single, radar_motion_compensation=True)))
    for before, after in zip(plain[2:], moved[2:], strict=True):
        assert before.radar_counts == after.radar_counts == (3,)
        seen = (place(before.stamp_ns / SECOND - 100.01) @ BASE_FROM_CAMERA).inverse().apply(WORLD_M)
        np.testing.assert_allclose(before.radar.xyz_m, seen, atol=1e-3)
        np.testing.assert_allclose(after.radar.xyz_m, expected(after), atol=1e-3)
        np.testing.assert_array_equal(before.radar.age_s, after.radar.age_s)


@pytest.mark.parametrize(
    ("config", "reason"),
    [
        (CONFIG, "no odometry came on /odom"),
        (TF_CONFIG, "no pose of 'camera' in 'map' came on /tf"),
        (replace(CONFIG, odometry="/odometry"), "no odometry came on /odometry"),
    ],
)
def test_without_the_vehicle_s_motion_the_nearest_sweep_is_left_as_it_was(
    config: FrameBuilderConfig, reason: str
) -> None:
    frame_builder = FrameBuilder(config)
    frames = drive(frame_builder, moves=False)
    plain = drive(FrameBuilder(replace(CONFIG, pairing=PairingConfig())), moves=False)
    for frame, same in zip(frames, plain, strict=True):
        np.testing.assert_array_equal(frame.radar.xyz_m, same.radar.xyz_m)
    assert reason in frame_builder.motion_problem
    assert frame_builder.unmoved_frames == len(frames)


def test_a_frame_that_nobody_can_place_is_named() -> None:
    frame_builder = FrameBuilder(CONFIG)
    frames = drive(frame_builder, base="trailer")
    assert all(len(frame.radar) == 3 for frame in frames)
    assert "'trailer'" in frame_builder.motion_problem


def test_nothing_from_before_a_backward_jump_comes_along() -> None:
    frame_builder = FrameBuilder(CONFIG)
    drive(frame_builder, start_s=5.0)
    # Elsewhere at the same time of day: what was before would be off by metres.
    frames = drive(frame_builder)
    assert frame_builder.counts.resets == 1
    assert [len(frame.radar) for frame in frames[-4:]] == [12] * 4
    for frame in frames:
        sweeps = len(frame.radar) // 3
        assert float(frame.radar.age_s.max()) < 0.2
        if sweeps > 1:
            np.testing.assert_allclose(frame.radar.xyz_m, np.tile(expected(frame), (sweeps, 1)), atol=1e-3)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"radars": ("/a", "/b"), "radar_frame": ("x", "y", "z")}, "radar_frame needs one value .* each of 2, got 3"),
        ({"radar_fields": "rcs"}, "quantity=field, got 'rcs'"),
        ({"odometry": "/radar"}, "different topics"),
        ({"pairing": PairingConfig(radar_time_offset_s=(0.0, 1.0))}, "radar_time_offset_s needs one value"),
    ],
)
def test_settings_that_do_not_fit(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(RadcamDepthError, match=sentence):
        replace(CONFIG, **values)  # type: ignore[arg-type]


def test_frames_that_are_set_come_before_those_of_the_messages() -> None:
    config = replace(CONFIG, radars=("/front", "/rear"), camera_frame="camera", radar_frame=("front", "rear"))
    frame_builder = FrameBuilder(config)
    places = {"front": [0.0, 0.0, 1.0], "rear": [0.0, 0.0, -1.0]}
    fixed = [
        StampedTransform("camera", name, 0, RigidTransform(np.eye(3), np.array(at))) for name, at in places.items()
    ]
    frame_builder.add("/tf_static", encode_transforms(factory, fixed), 0)
    frame_builder.add("/camera_info", encode_camera_info(factory, CAMERA, 0, "sensor"), 0)
    one = np.ones(1, np.float32)
    for topic in config.radars:
        frame_builder.add(topic, encode_points(factory, {"x": one, "y": one, "z": one}, SECOND, "radar"), 0)
    (frame,) = frame_builder.add("/image", encode_image(factory, small_image(0), SECOND, "sensor"), 0)
    assert frame.frame_id == "camera"
    np.testing.assert_allclose(frame.radar.xyz_m[:, 2], [2, 0])


@pytest.mark.parametrize("stamps", ["arrival", ("arrival", "header")])
def test_sweeps_of_a_radar_without_stamps_have_the_time_of_their_arrival(stamps: str | tuple[str, ...]) -> None:
    config = replace(
        CONFIG, radars=("/front", "/rear"), radar_stamps=stamps, camera_from_radar=(0, 0, 0, 0, 0, 0, 1) * 2
    )
    frame_builder = FrameBuilder(config)
    frame_builder.add("/camera_info", encode_camera_info(factory, CAMERA, 0, "camera"), 0)
    one = np.ones(1, np.float32)
    for index in range(3):
        now_ns = (10 + index) * SECOND
        for topic in config.radars:
            stamp_ns = 0 if config.is_stamped_by_arrival(topic) else now_ns
            cloud = encode_points(factory, {"x": one, "y": one, "z": one}, stamp_ns, "")
            assert not frame_builder.add(topic, cloud, index, now_ns)
        (frame,) = frame_builder.add("/image", encode_image(factory, small_image(0), now_ns, "camera"), index)
        assert frame.radar_counts == (1, 1)
    with pytest.raises(RadcamDepthError, match="radar_stamps must be one of header, arrival, got"):
        replace(CONFIG, radar_stamps="never")


def test_each_radar_has_its_own_frame_fields_and_offset() -> None:
    config = replace(
        CONFIG,
        radars=("/front", "/rear"),
        radar_frame=("", "radar"),
        radar_fields=("", "rcs=loudness"),
        pairing=PairingConfig(radar_time_offset_s=(0.0, -0.5)),
    )
    frame_builder = FrameBuilder(config)
    fixed = [StampedTransform("camera", name, 0, RigidTransform.identity()) for name in ("radar", "other")]
    frame_builder.add("/tf_static", encode_transforms(factory, fixed), 0)
    frame_builder.add("/camera_info", encode_camera_info(factory, CAMERA, 0, "camera"), 0)
    one = np.ones(1, np.float32)
    front = {"x": one, "y": one, "z": one, "rcs": 2 * one}
    rear = {"x": one, "y": one, "z": one, "loudness": 3 * one}
    frame_builder.add("/front", encode_points(factory, front, SECOND, "other"), 0)
    frame_builder.add("/rear", encode_points(factory, rear, SECOND + SECOND // 2, ""), 0)
    (frame,) = frame_builder.add("/image", encode_image(factory, small_image(0), SECOND, "camera"), 0)
    np.testing.assert_array_equal(frame.radar.rcs_dbsm, [2, 3])
    np.testing.assert_array_equal(frame.radar.age_s, [0, 0])
    with pytest.raises(RadcamDepthError, match="loudness"):
        frame_builder.add("/rear", encode_points(factory, front, 2 * SECOND, ""), 0)
