from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.drive import read_samples
from radcam_depth_ros.evaluation.baselines import (
    FARTHEST_M,
    flat_road,
    ground_nearest,
    known_or_assumed_ground,
    nearest_return,
    radar_interpolation,
    without_radar,
)
from radcam_depth_ros.evaluation.measures.metrics import DepthAccumulator, DepthRange
from radcam_depth_ros.frame import ASSUMED_HEIGHT_M, CameraModel, Frame, GroundPlane, RadarReturns
from radcam_depth_ros.geometry import unproject

CAMERA = CameraModel(80, 60, 60.0, 60.0, 39.5, 29.5)
GROUND = GroundPlane(1.5)


def frame_with(points=(), ground=GROUND, camera=CAMERA):
    image = np.zeros((camera.height, camera.width, 3), np.uint8)
    return Frame(0, "camera", image, camera, RadarReturns.from_points(np.reshape(points, (-1, 3))), ground)


def point_at(u, v, depth_m):
    return ((u - CAMERA.cx) / CAMERA.fx * depth_m, (v - CAMERA.cy) / CAMERA.fy * depth_m, depth_m)


@settings(max_examples=30, deadline=None)
@given(height=st.floats(0.5, 4), pitch=st.floats(-0.2, 0.2), roll=st.floats(-0.2, 0.2))
def test_points_of_the_flat_road_lie_on_it(height, pitch, roll):
    up = np.array([np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch), -np.sin(pitch)])
    road = flat_road(CAMERA, GroundPlane(height, tuple(up)))
    assert road.shape == (60, 80)
    assert road.dtype == np.float32
    assert ((road > 0) & (road <= FARTHEST_M * 1.001)).all()
    points = unproject(road, CAMERA)[road < FARTHEST_M * 0.999]
    np.testing.assert_allclose(points @ up, -height, atol=2e-3 * height)


def test_the_flat_road_of_a_level_camera():
    road = flat_road(CAMERA, GROUND)
    np.testing.assert_allclose(road[45], 60.0 * 1.5 / (45 - 29.5), rtol=1e-5)
    np.testing.assert_allclose(road[:29], FARTHEST_M, rtol=1e-5)


def test_without_returns_the_flat_road_is_left():
    np.testing.assert_array_equal(ground_nearest(frame_with()), flat_road(CAMERA, GROUND))


def test_a_return_in_front_of_the_road_wins_around_itself():
    depth = ground_nearest(frame_with([point_at(40, 40, 4.0)]))
    road = flat_road(CAMERA, GROUND)
    assert road[40, 40] > 8
    assert depth[40, 40] == pytest.approx(4.0)
    # The only return is the nearest everywhere; where the road is closer still, the road is taken.
    np.testing.assert_allclose(depth, np.minimum(road, 4.0), rtol=1e-6)
    assert depth[59, 0] == road[59, 0] < 4.0


def test_above_the_horizon_the_return_counts_alone():
    depth = ground_nearest(frame_with([point_at(10, 5, 70.0), point_at(70, 5, 20.0)]))
    assert depth[0, 0] == pytest.approx(70.0)
    assert depth[0, 79] == pytest.approx(20.0)
    assert depth[50, 0] == flat_road(CAMERA, GROUND)[50, 0]


def test_of_two_returns_the_nearer_in_the_image_counts():
    nearest = nearest_return(frame_with([point_at(20, 30, 9.0), point_at(60, 30, 5.0)]))
    assert (nearest[:, :39] == np.float32(9.0)).all()
    assert (nearest[:, 42:] == np.float32(5.0)).all()


def test_returns_out_of_view_do_not_count():
    behind, beside = (1.0, 0.0, -5.0), (50.0, 0.0, 5.0)
    assert np.isnan(nearest_return(frame_with([behind, beside]))).all()
    np.testing.assert_array_equal(ground_nearest(frame_with([behind, beside])), flat_road(CAMERA, GROUND))


def test_a_height_that_nobody_knows_is_given_or_assumed():
    tilted = GroundPlane(up=(0.0, -np.cos(0.1), -np.sin(0.1)))
    assert known_or_assumed_ground(frame_with(), 9.0) is GROUND
    assert known_or_assumed_ground(frame_with(ground=tilted)) == GroundPlane(ASSUMED_HEIGHT_M, tilted.up)
    assert known_or_assumed_ground(frame_with(ground=tilted), 2.0) == GroundPlane(2.0, tilted.up)
    np.testing.assert_array_equal(
        ground_nearest(frame_with(ground=GroundPlane()), 1.5), ground_nearest(frame_with(ground=GROUND))
    )


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 30), scale=st.sampled_from([1, 10]))
def test_interpolated_depth_lies_between_the_returns(seed, count, scale):
    generator = np.random.default_rng(seed)
    camera = CameraModel(80 * scale, 60 * scale, 60.0 * scale, 60.0 * scale, 40 * scale - 0.5, 30 * scale - 0.5)
    pixels = generator.integers((0, 0), (80, 60), (count, 2))
    points = [point_at(u, v, depth) for (u, v), depth in zip(pixels, generator.uniform(2, 90, count), strict=True)]
    frame = frame_with(points, camera=camera)
    depth = radar_interpolation(frame)
    assert depth.shape == (60 * scale, 80 * scale)
    assert depth.dtype == np.float32
    known = frame.radar.xyz_m[:, 2]
    assert known.min() * 0.999 <= depth.min()
    assert depth.max() <= known.max() * 1.001


def test_interpolated_depth_is_the_return_s_where_there_is_one():
    points = [point_at(10, 30, 8.0), point_at(70, 30, 40.0), point_at(70, 30, 60.0)]
    depth = radar_interpolation(frame_with(points))
    assert depth[30, 10] == pytest.approx(8.0, rel=0.01)
    assert depth[30, 70] == pytest.approx(40.0, rel=0.01)
    # Half-way, the inverse depths count alike.
    assert depth[30, 40] == pytest.approx(2 / (1 / 8 + 1 / 40), rel=0.01)
    assert (np.diff(depth[30, 10:71]) >= -1e-3).all()


def test_nothing_is_interpolated_from_nothing():
    assert (radar_interpolation(frame_with([(0.0, 0.0, -3.0)])) == FARTHEST_M).all()


def test_a_silent_radar_has_no_returns():
    frame = frame_with([point_at(10, 30, 8.0)])
    silent = without_radar(dataclasses.replace(frame, radar_counts=(1, 0)))
    assert len(silent.radar) == 0
    assert silent.radar_counts == (0, 0)
    assert silent.image is frame.image
    assert silent.ground == frame.ground


def test_it_is_quick():
    camera = CameraModel(800, 448, 630.0, 630.0, 399.5, 223.5)
    points = np.random.default_rng(0).uniform((-10, -1, 3), (10, 1, 80), (300, 3))
    frame = frame_with(points, camera=camera)
    durations = []
    for _ in range(5):
        start = time.thread_time()
        ground_nearest(frame)
        durations.append(time.thread_time() - start)
    # 8 ms of a slow core, whatever else the machine does; the margin is for a core that is shared.
    assert min(durations) < 0.03


@pytest.mark.parametrize(("clip_m", "mae_m", "rmse_m"), [(None, 3.12, 6.34), (80.0, 3.64, 8.20)])
def test_figures_on_the_real_drive(astyx_val, clip_m, mae_m, rmse_m):
    accumulator = DepthAccumulator([DepthRange.within(50.0, clip_m)])
    for sample in read_samples(astyx_val):
        accumulator.add(ground_nearest(sample.frame), sample.depth_m)
    (result,) = accumulator.result()
    assert result.frames == 16
    assert result.mae == pytest.approx(mae_m, abs=0.06)
    assert result.rmse == pytest.approx(rmse_m, abs=0.1)
