from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.evaluation.given import GivenAccumulator, returns_in_view
from radcam_depth_ros.frame import CameraModel, Frame, GroundPlane, RadarReturns
from radcam_depth_ros.geometry import depth_image

CAMERA = CameraModel(80, 60, 60.0, 60.0, 39.5, 29.5)


def frame_with(points=(), ground=None, rcs=math.nan):
    radar = RadarReturns.from_points(points)
    radar = RadarReturns(radar.xyz_m, np.full(len(radar), rcs, np.float32), radar.radial_speed_mps, radar.age_s)
    return Frame(0, "camera", np.zeros((60, 80, 3), np.uint8), CAMERA, radar, ground or GroundPlane())


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(0, 15))
def test_returns_in_view_are_those_that_are_drawn(seed, count):
    points = np.random.default_rng(seed).uniform((-30, -20, -5), (30, 20, 40), (count, 3))
    frame = frame_with(points)
    drawn = np.isfinite(np.concatenate([depth_image(point[None], CAMERA).ravel() for point in points] or [[np.nan]]))
    assert returns_in_view(frame) == drawn.sum()


def test_what_was_given_is_summed_up():
    accumulator = GivenAccumulator(None)
    assert accumulator.add(frame_with([(0, 0, 10), (0, 0, -1)], GroundPlane(1.6), 3.0)) == 1
    assert accumulator.add(frame_with([(0, 0, 10), (1, 0, 20)])) == 2
    given = accumulator.result()
    assert given.image_sizes == ("80 x 60",)
    assert given.returns_in_view == (1, 1.5, 2)
    assert (given.rcs_share, given.speed_share, given.road_share) == (0.5, 0.0, 0.5)
    assert given.camera_height_m == pytest.approx((1.6 + 1.4) / 2)
    assert given.camera_height_source == "assumed+frame"
    assert given.as_json()["returns_in_view"] == {"min": 1, "median": 1.5, "max": 2}


def test_nothing_given_has_no_numbers():
    plain = GivenAccumulator(None).result().as_json()
    assert plain["returns_in_view"] == {"min": None, "median": None, "max": None}
    assert plain["road_share"] is None
