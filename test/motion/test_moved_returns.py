from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.bags import factory
from radcam_depth_ros.frame import RadarReturns
from radcam_depth_ros.geometry import RigidTransform, TransformTree
from radcam_depth_ros.messages import OdometryReading, encode_odometry
from radcam_depth_ros.motion import Displacement, Motion, MotionError, displacement, move

SECOND = 1_000_000_000
BASE_FROM_CAMERA = RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([1.5, 0.0, 1.4]))
BASE_FROM_RADAR = RigidTransform.from_quaternion((3.5, 0.6, 0.5), (0, 0, math.sin(0.2), math.cos(0.2)))
CAMERA_FROM_RADAR = BASE_FROM_CAMERA.inverse() @ BASE_FROM_RADAR
RADAR_M = CAMERA_FROM_RADAR.translation


class Ride:
    """A vehicle that drives and turns evenly, far from the world's origin."""

    def __init__(self, speed_mps: float, yaw_rate: float) -> None:
        self.speed_mps, self.yaw_rate = speed_mps, yaw_rate
        self.motion = Motion("/odom", is_odometry=True, transforms=TransformTree(), anchor="camera")
        for index in range(151):
            time_s = 1 + index / 100
            reading = OdometryReading(round(time_s * SECOND), "odom", "base", self.at(time_s), np.zeros(3), np.zeros(3))
            self.motion.add(encode_odometry(factory, reading))

    def at(self, time_s: float) -> RigidTransform:
        yaw = self.yaw_rate * time_s
        if self.yaw_rate:
            radius = self.speed_mps / self.yaw_rate
            x, y = radius * math.sin(yaw), radius * (1 - math.cos(yaw))
        else:
            x, y = self.speed_mps * time_s, 0.0
        return RigidTransform.from_quaternion((4e5 + x, 5e6 + y, 30.0), (0, 0, math.sin(yaw / 2), math.cos(yaw / 2)))

    def seen(self, world_m: np.ndarray, velocity: np.ndarray, time_s: float, image_s: float) -> RadarReturns:
        """What the radar sees of points in the world that are at `world_m` at a time, in the camera's axes."""
        radar = self.at(time_s) @ BASE_FROM_RADAR
        step = 1e-4
        own = ((self.at(time_s + step) @ BASE_FROM_RADAR).translation - radar.translation) / step
        sight = world_m - radar.translation
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        speed = ((velocity - own) * sight).sum(axis=1)
        in_camera = (self.at(time_s) @ BASE_FROM_CAMERA).inverse().apply(world_m)
        age = np.full(len(world_m), image_s - time_s, np.float32)
        return RadarReturns(in_camera, np.full(len(world_m), 3, np.float32), speed.astype(np.float32), age)

    def moved(self, returns: RadarReturns, time_s: float, image_s: float) -> RadarReturns:
        how = displacement(self.motion, BASE_FROM_CAMERA, RADAR_M, round(time_s * SECOND), round(image_s * SECOND))
        return move(returns, how)


@settings(deadline=None, max_examples=10)
@given(speed=st.floats(0, 15), yaw_rate=st.sampled_from([0.0, 0.3, -0.3]), image_s=st.floats(2.2, 2.4))
def test_what_stands_still_is_at_one_place_in_all_sweeps(speed: float, yaw_rate: float, image_s: float) -> None:
    ride = Ride(speed, yaw_rate)
    rng = np.random.default_rng(1)
    camera_m = rng.uniform((-20, -2, 5), (20, 2, 60), (30, 3))
    pose = ride.at(image_s) @ BASE_FROM_CAMERA
    world_m = camera_m @ pose.rotation.T + pose.translation
    for time_s in image_s + np.array([0.04, -0.03, -0.11, -0.35, -0.8]):
        returns = ride.seen(world_m, np.zeros(3), time_s, image_s)
        moved = ride.moved(returns, time_s, image_s)
        np.testing.assert_allclose(moved.xyz_m, camera_m, atol=1e-3)
        np.testing.assert_array_equal(moved.age_s, returns.age_s)
        np.testing.assert_array_equal(moved.radial_speed_mps, returns.radial_speed_mps)


@pytest.mark.parametrize("speed", [20.0, -8.0, 1.5])
@pytest.mark.parametrize("time_s", [1.6, 1.9, 2.03])
def test_a_car_ahead_moves_by_its_doppler(speed: float, time_s: float) -> None:
    ride, image_s = Ride(12.0, 0.0), 2.0
    radar = ride.at(image_s) @ BASE_FROM_RADAR
    ahead = np.array([1.0, 0.0, 0.0])  # straight ahead of the radar, so that it moves along the line of sight
    car_m = radar.translation + 40 * ahead
    returns = ride.seen((car_m + speed * (time_s - image_s) * ahead)[None], speed * ahead, time_s, image_s)
    expected = (ride.at(image_s) @ BASE_FROM_CAMERA).inverse().apply(car_m[None])
    np.testing.assert_allclose(ride.moved(returns, time_s, image_s).xyz_m, expected, atol=1e-3)


def test_a_speed_over_ground_is_taken_as_it_is_and_one_that_is_missing_moves_nothing() -> None:
    how = Displacement(RigidTransform.identity(), np.zeros(3), np.array([0.0, 0.0, 10.0]), 0.5)
    xyz = np.array([[0, 0, 20.0]] * 5, np.float32)
    speed = np.array([-10.0, np.nan, 4.0, -10.5, 3e38], np.float32)
    returns = RadarReturns(xyz, speed, speed, np.full(5, 0.5, np.float32))
    np.testing.assert_allclose(move(returns, how).xyz_m[:, 2], [20, 20, 27, 20, 20])
    np.testing.assert_allclose(move(returns, how, is_over_ground=True).xyz_m[:, 2], [15, 20, 22, 14.75, 20])
    unknown = Displacement(how.image_from_sweep, how.radar_m, None, 0.5)
    np.testing.assert_allclose(move(returns, unknown).xyz_m[:, 2], 20)
    np.testing.assert_allclose(move(returns, unknown, is_over_ground=True).xyz_m[0, 2], 15)


def test_a_place_that_was_set_anew_moves_nothing() -> None:
    ride = Ride(10.0, 0.0)
    far = RigidTransform(np.eye(3), np.array([0.0, 0, 0]))
    reading = OdometryReading(round(2.505 * SECOND), "odom", "base", far, np.zeros(3), np.zeros(3))
    ride.motion.add(encode_odometry(factory, reading))
    for image_s, sentence in ((2.505, "/odom has the vehicle jump"), (2.6, "'base' on /odom are 0.10 s away")):
        with pytest.raises(MotionError, match=sentence):
            displacement(ride.motion, BASE_FROM_CAMERA, RADAR_M, 2 * SECOND, round(image_s * SECOND))
