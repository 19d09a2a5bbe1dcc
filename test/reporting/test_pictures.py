from __future__ import annotations

import numpy as np

from radcam_depth_ros.messages import colorise
from radcam_depth_ros.reporting.pictures import ERROR_M, colour_error, draw_depth, draw_error, draw_radar


def test_depth_has_the_colours_of_the_scale():
    depth = np.linspace(2, 80, 48 * 64, dtype=np.float32).reshape(48, 64)
    depth[0, 0] = np.nan
    drawn = draw_depth(depth)
    np.testing.assert_array_equal(drawn[1:], colorise(depth, 2.0, 80.0)[1:])
    assert drawn[0, 0].tolist() == [34, 34, 34]
    beyond = draw_depth(np.full((4, 4), np.inf, np.float32))
    np.testing.assert_array_equal(beyond, colorise(np.full((4, 4), 80.0, np.float32), 2.0, 80.0))


def test_single_lidar_points_can_be_seen():
    truth = np.full((900, 1600), np.nan, np.float32)
    truth[450, 801] = 10.0
    drawn = draw_depth(truth)
    assert 4 <= (drawn != 34).any(axis=2).sum() <= 40
    error = draw_error(np.full((900, 1600), 15.0, np.float32), truth)
    assert 4 <= (error != 34).any(axis=2).sum() <= 40


def test_errors_are_red_where_too_near_and_blue_where_too_far():
    near, right, far, unknown = colour_error(np.array([[-ERROR_M * 2, 0.0, ERROR_M, np.nan]], np.float32))[0].tolist()
    assert near[0] > 150 > near[2]
    assert far[2] > 150 > far[0]
    assert min(right) > 240
    assert unknown == [34, 34, 34]


def test_errors_without_truth_are_unknown():
    truth = np.array([[10.0, np.nan, np.inf, 0.0]], np.float32)
    drawn = draw_error(np.full((1, 4), 10.0, np.float32), truth)
    assert (drawn[0] == 34).all(axis=1).tolist() == [False, True, True, True]


def test_radar_is_drawn_the_nearest_on_top():
    image = np.full((48, 64, 3), 90, np.uint8)
    image.setflags(write=False)
    uv = np.array([[20, 20], [20, 20], [-5, 400], [np.nan, np.nan], [1e20, 5]], np.float32)
    drawn = draw_radar(image, uv, np.array([5.0, 40.0, 10.0, -3.0, 10.0], np.float32))
    assert drawn[20, 20].tolist() == colorise(np.full((1, 1), 5.0, np.float32), 2.0, 80.0)[0, 0].tolist()
    assert (drawn[:, 40:] == 90).all()
    np.testing.assert_array_equal(draw_radar(image, uv[:0], np.zeros(0, np.float32)), image)
