from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.drive.range_view import RangeView, Tolerance, Verdict
from radcam_depth_ros.frame import FloatArray

TOLERANCE = Tolerance(0.3, 0.02)


def rays(elevations_deg: FloatArray) -> FloatArray:
    azimuth, elevation = np.meshgrid(np.deg2rad(np.arange(-180, 180, 0.4)), np.deg2rad(elevations_deg))
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], -1).reshape(-1, 3)


BEAMS = rays(np.arange(-10, 10.1, 1.0, dtype=np.float32)).astype(np.float32)


@settings(deadline=None, max_examples=20)
@given(st.floats(5, 60), st.floats(-180, 180), st.floats(-9, 9))
def test_a_shell_around_the_sensor_parts_near_from_far(radius: float, azimuth_deg: float, elevation_deg: float) -> None:
    view = RangeView(np.float32(radius) * BEAMS)
    azimuth, elevation = np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg)
    ray = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    distances = radius * np.array([0.9, 1.0, 1.1]) + np.array([-0.5, 0, 0.5])
    points = np.asarray(distances[:, None] * ray, np.float32)
    assert view.check(points, TOLERANCE).tolist() == [Verdict.SEEN_THROUGH, Verdict.AGREES, Verdict.HIDDEN]


def test_a_road_agrees_with_itself_between_the_beams() -> None:
    beams = rays(np.arange(-10, 0, 0.6, dtype=np.float32)).astype(np.float32)
    down = beams[beams[:, 2] < -0.01]
    view = RangeView(down * np.float32(1.8) / -down[:, 2:])
    between = rays(np.arange(-9.5, -2, 0.25, dtype=np.float32)).astype(np.float32)
    verdict = view.check(between * np.float32(1.8) / -between[:, 2:], TOLERANCE)
    assert (verdict == Verdict.AGREES).all()


def test_upwards_nothing_is_the_sky_and_downwards_nobody_knows() -> None:
    view = RangeView(np.float32(20) * BEAMS[BEAMS[:, 0] > 0])
    behind = np.array([[-20, 0, 1], [-20, 0, -1], [-20, 0, 15], [-1, 0, 30]], np.float32)
    expected = [Verdict.OPEN, Verdict.UNKNOWN, Verdict.UNKNOWN, Verdict.UNKNOWN]
    assert view.check(behind, TOLERANCE).tolist() == expected


def test_a_scan_without_any_return_knows_nothing() -> None:
    view = RangeView(np.zeros((0, 3), np.float32))
    assert view.check(BEAMS, TOLERANCE).tolist() == [Verdict.UNKNOWN] * len(BEAMS)
