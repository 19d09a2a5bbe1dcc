"""A camera that pans and a radar that is lost: where returns lie in the images' frames."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from small_drive import CAMERA, small_image

from radcam_depth_ros.bags import factory
from radcam_depth_ros.frame import Frame
from radcam_depth_ros.frame_builder import FrameBuilder, FrameBuilderConfig, FrameBuilderError
from radcam_depth_ros.geometry import MAX_LINKS, RigidTransform
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
PAN_FROM_CAMERA = RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([0.2, 0.0, 0.1]))
BASE_FROM_RADAR = RigidTransform(np.eye(3), np.array([2.0, 0.3, 0.5]))
POINT_M = np.array([[40.0, 3.0, 1.0]])
"""What the radar sees, in the world; the vehicle starts at its origin."""
CONFIG = FrameBuilderConfig(
    image="/image", radars=("/radar",), footprint_frame="ground", pairing=PairingConfig(0.03, 0.01)
)
STILL = RigidTransform.identity()


def panned(time_s: float) -> RigidTransform:
    """The camera's mount on the vehicle, turning by 0.4 rad/s and nodding."""
    yaw = 0.4 * time_s
    return RigidTransform.from_quaternion((1.0, 0, 1.5 + 0.1 * time_s), (0, 0, math.sin(yaw / 2), math.cos(yaw / 2)))


def driven(time_s: float) -> RigidTransform:
    return RigidTransform(np.eye(3), np.array([10.0 * time_s, 0.0, 0.0]))


def link(parent: str, child: str, time_s: float, pose: RigidTransform) -> object:
    return encode_transforms(factory, [StampedTransform(parent, child, round(time_s * SECOND), pose)])


def ride(
    config: FrameBuilderConfig,
    *,
    speed: bool = False,
    silent_after_s: float = 9.0,
    until_s: float = 1.0,
    bogus: int = 0,
) -> list[Frame]:
    """Images at 10 Hz, 20 ms after a sweep, the mount told at 50 Hz, and what tells how the vehicle drives.

    A hundred times a second so many frames come on `/tf_static` and on `/tf` that never came before.
    """
    frame_builder = FrameBuilder(config)
    for child, parent, pose in (("pan", "camera", PAN_FROM_CAMERA), ("base", "radar", BASE_FROM_RADAR)):
        frame_builder.add("/tf_static", link(child, parent, 0, pose), 0)
    frame_builder.add("/tf_static", link("ground", "base", 0, STILL), 0)
    frame_builder.add("/camera_info", encode_camera_info(factory, CAMERA, 0, "camera"), 0)
    frames: list[Frame] = []
    for tick in range(round(until_s * 100)):
        time_s, now_ns = tick / 100, tick * SECOND // 100
        for topic in ("/tf_static", "/tf") if bogus else ():
            names = [f"{topic}/{tick}/{number}" for number in range(bogus)]
            links = [StampedTransform("base", name, now_ns, STILL) for name in names]
            frame_builder.add(topic, encode_transforms(factory, links), now_ns)
        place = driven(time_s) if speed else STILL
        if tick % 2 == 0:
            frame_builder.add("/tf", link("base", "pan", time_s, panned(time_s)), now_ns)
            frame_builder.add("/tf", link("odom", "ground", time_s, place), now_ns)
            reading = OdometryReading(now_ns, "odom", "base", place, np.zeros(3), np.zeros(3))
            frame_builder.add("/odom", encode_odometry(factory, reading), now_ns)
        if tick % 10 == 4 and time_s < silent_after_s:
            seen = (place @ BASE_FROM_RADAR).inverse().apply(POINT_M)
            cloud = encode_points(factory, dict(zip("xyz", seen.T, strict=True)), now_ns, "radar")
            frames += frame_builder.add("/radar", cloud, now_ns)
        if tick % 10 == 6:
            frames += frame_builder.add("/image", encode_image(factory, small_image(0), now_ns, "camera"), now_ns)
        frames += frame_builder.expire(now_ns)
    assert len(frames) == round(until_s * 10)
    assert len(frame_builder.transforms.frames) <= MAX_LINKS + 1
    assert bool(frame_builder.transform_problem.count("ever new names")) == bool(bogus)
    return frames


def in_camera(place: RigidTransform, time_s: float) -> np.ndarray:
    return (place @ panned(time_s) @ PAN_FROM_CAMERA).inverse().apply(POINT_M)


def test_returns_and_road_are_where_the_camera_looks_at_the_images_time() -> None:
    for frame in ride(CONFIG):
        time_s = frame.stamp_ns / SECOND
        np.testing.assert_allclose(frame.radar.xyz_m, in_camera(STILL, time_s), atol=2e-3)
        assert frame.ground.height_m == pytest.approx(1.6 + 0.1 * time_s, abs=1e-4)


@pytest.mark.parametrize("config", [CONFIG, replace(CONFIG, odom_frame="odom", radar_motion_compensation=True)])
def test_ever_new_frames_change_nothing(config: FrameBuilderConfig) -> None:
    for with_bogus, without in zip(ride(config, bogus=25), ride(config), strict=True):
        assert len(without.radar) == len(with_bogus.radar) > 0
        np.testing.assert_array_equal(with_bogus.radar.xyz_m, without.radar.xyz_m)
        assert with_bogus.ground == without.ground


@pytest.mark.parametrize("source", [{"odometry": "/odom"}, {"odom_frame": "odom"}])
def test_where_returns_are_moved_the_mount_and_the_drive_count_once_each(source: dict[str, str]) -> None:
    frames = ride(replace(CONFIG, radar_motion_compensation=True, **source), speed=True)
    for frame in frames[2:]:
        time_s = frame.stamp_ns / SECOND
        np.testing.assert_allclose(frame.radar.xyz_m, in_camera(driven(time_s), time_s), atol=5e-3)


def test_a_radar_that_falls_silent_is_held_for_so_long() -> None:
    config = replace(CONFIG, without_radar="hold", max_hold_s=0.25)
    frames = ride(config, silent_after_s=0.5)
    assert [len(frame.radar) for frame in frames] == [1] * 7 + [0] * 3
    ages = [float(frame.radar.age_s[0]) for frame in frames[:7]]
    np.testing.assert_allclose(ages, [0.02] * 5 + [0.12, 0.22], atol=1e-6)
    # Held in the world, where the camera looks now.
    np.testing.assert_allclose(frames[6].radar.xyz_m, in_camera(STILL, 0.66), atol=2e-3)
    assert [len(frame.radar) for frame in ride(CONFIG, silent_after_s=0.5)] == [1] * 5 + [0] * 5


def test_limits_can_change_while_messages_come() -> None:
    frame_builder = FrameBuilder(CONFIG)
    changed = replace(
        CONFIG, without_radar="hold", camera_height_m=1.2, pairing=replace(CONFIG.pairing, max_time_offset_s=0.2)
    )
    frame_builder.adjust(changed)
    assert frame_builder.config == changed
    for config in (
        replace(changed, image="/other"),
        replace(changed, pairing=replace(changed.pairing, radar_sweeps=3)),
    ):
        with pytest.raises(Exception, match="can change"):
            frame_builder.adjust(config)
    assert frame_builder.config == changed


@pytest.mark.parametrize(
    ("image", "camera_info"),
    [
        ("image", "camera_info"),
        ("/color", "/camera_info"),
        ("/front/image_raw", "/front/camera_info"),
        ("front/left/rgb", "front/left/camera_info"),
        ("/front/image_raw/compressed", "/front/camera_info"),
    ],
)
def test_without_a_name_camera_info_is_beside_the_images(image: str, camera_info: str) -> None:
    assert FrameBuilderConfig(image=image).calibration_topic == camera_info
    assert FrameBuilderConfig(image=image, camera_info="/mine").calibration_topic == "/mine"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"without_radar": "panic"}, "without_radar must be one of camera_only, hold, suppress, got 'panic'"),
        ({"without_radar": "suppress", "radars": ()}, "no depth would ever come out"),
        ({"max_hold_s": -1.0}, "max_hold_s must be 0 or a positive"),
        ({"image": "/front/image", "radars": ("/front/camera_info",)}, "different topics"),
    ],
)
def test_settings_that_do_not_fit(values: dict[str, object], message: str) -> None:
    with pytest.raises(FrameBuilderError, match=message):
        FrameBuilderConfig(**values)
