from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from small_drive import CAMERA_FROM_RADAR

from demo.plan import plan_drive
from radcam_depth_ros.bags import BagError
from radcam_depth_ros.geometry import GeometryError, RigidTransform


def test_the_node_is_set_for_the_bag(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    plan = plan_drive(write_drive(tmp_path / "drive.mcap"))
    parameters: Any = plan.parameters
    assert parameters["image_topic"] == "/camera/image_raw"
    assert parameters["image_transport"] == "raw"
    assert parameters["camera_info_topic"] == "/camera/camera_info"
    assert parameters["radar_topics"] == ["/radar/points"]
    assert parameters["use_sim_time"] is True
    for topic in plan.played:
        assert parameters[f"qos_overrides.{topic}.subscription.reliability"] == "reliable"
    extrinsics = RigidTransform.from_quaternion(
        parameters["camera_from_radar"][:3], parameters["camera_from_radar"][3:]
    )
    np.testing.assert_allclose(extrinsics.rotation, CAMERA_FROM_RADAR.rotation, atol=1e-9)
    np.testing.assert_allclose(extrinsics.translation, CAMERA_FROM_RADAR.translation, atol=1e-9)
    assert set(plan.played) == {"/camera/image_raw", "/camera/camera_info", "/radar/points"}
    assert plan.images == 5


def test_the_parameter_file_is_for_the_node(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    plan = plan_drive(write_drive(tmp_path / "drive.mcap"), tmp_path / "mine.safetensors")
    plan.write_parameters(tmp_path / "node.yaml")
    content = yaml.safe_load((tmp_path / "node.yaml").read_text(encoding="utf-8"))
    assert content == {"radcam_depth": {"ros__parameters": plan.parameters}}
    assert content["radcam_depth"]["ros__parameters"]["model_file"] == str(tmp_path / "mine.safetensors")


def test_a_real_drive_is_compressed_and_without_a_road(astyx_val: Path) -> None:
    plan = plan_drive(astyx_val)
    assert plan.parameters["image_topic"] == "/camera_front/image_raw"
    assert plan.parameters["image_transport"] == "compressed"
    assert "camera_height_m" not in plan.parameters


def test_a_bag_without_a_sensor_is_refused(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(BagError, match="camera_info"):
        plan_drive(write_drive(tmp_path / "drive.mcap", without=("/camera/camera_info",)))


def test_a_bag_without_transforms_is_refused(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match="radar"):
        plan_drive(write_drive(tmp_path / "drive.mcap", without=("/tf_static",)))
