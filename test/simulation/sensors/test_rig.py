from __future__ import annotations

import numpy as np

from radcam_depth_ros.simulation import CameraConfig, ImagingRadarConfig, LidarConfig, RadarConfig
from radcam_depth_ros.simulation.sensors.rig import CAMERA, draw_rig

SENSORS = (RadarConfig(), ImagingRadarConfig(), LidarConfig())


def test_a_mounting_does_not_depend_on_the_image() -> None:
    small = draw_rig(4, CameraConfig(width=160, height=96), *SENSORS)
    large = draw_rig(4, CameraConfig(min_focal_length_px=900, max_focal_length_px=1800), *SENSORS)
    for frame, pose in small.base_from_sensor.items():
        assert np.allclose(pose.translation, large.base_from_sensor[frame].translation)
    assert 900 <= large.camera.fx <= 1800
    assert 1.2 <= small.footprint_from(CAMERA).translation[2] <= 2.0


def test_each_seed_draws_a_size_between_the_least_and_the_most() -> None:
    config = CameraConfig(width=1000, height=500, min_width=500, min_height=200)
    cameras = [draw_rig(seed, config, *SENSORS).camera for seed in range(60)]
    assert min(camera.width for camera in cameras) < 560
    assert max(camera.width for camera in cameras) > 940
    assert all(500 <= camera.width <= 1000 and 200 <= camera.height <= 500 for camera in cameras)
    assert {camera.fx for camera in cameras} == {630.0}
    assert {draw_rig(seed, CameraConfig(), *SENSORS).camera.width for seed in range(5)} == {800}


def test_cameras_around_a_usual_height_have_a_tail() -> None:
    config = CameraConfig(min_height_m=1.0, usual_height_m=1.4, max_height_m=3.0)
    heights = [draw_rig(seed, config, *SENSORS).footprint_from(CAMERA).translation[2] for seed in range(200)]
    low, middle, high = np.percentile(heights, [10, 50, 95])
    assert 1.2 < low < 1.4 < middle < 1.75 < high
    assert 2.3 < max(heights) <= 3.0
    assert min(heights) >= 1.0
