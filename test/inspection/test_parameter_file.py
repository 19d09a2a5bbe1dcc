from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.frame_builder import level_ground
from radcam_depth_ros.inspection import (
    Suggestion,
    check_parameters,
    ground_parameters,
    topic_parameters,
    write_parameters,
)
from radcam_depth_ros.inspection.suggestion import Setting

TOPICS = topic_parameters("/front/image_raw", "sensor_msgs/msg/Image", "/front/camera_info", ("/r1", "/r2"))


def suggestion(*more: Setting) -> Suggestion:
    return Suggestion((*(Setting(name, value, "why") for name, value in TOPICS.items()), *more))


def read(text: str) -> dict[str, Any]:
    parameters: dict[str, Any] = yaml.safe_load(text)["/**"]["ros__parameters"]
    return parameters


def test_the_file_has_what_is_needed_and_the_rest_as_comments(tmp_path: Path) -> None:
    pose = [0.0, 0.5, 0.0, 0.5, -0.5, 0.5, 0.5] * 2
    given_ = suggestion(
        Setting("max_wait_s", 0.25, "slow"), Setting("camera_from_radar", pose, "instead", is_needed=False)
    )
    write_parameters(tmp_path / "node.yaml", given_, "drive.mcap")
    text = (tmp_path / "node.yaml").read_text(encoding="utf-8")
    assert read(text) == {**TOPICS, "max_wait_s": 0.25}
    assert f"# camera_from_radar: {pose}" in text
    assert "drive.mcap" in text.splitlines()[0]
    assert [path.name for path in tmp_path.iterdir()] == ["node.yaml"]


@pytest.mark.parametrize(
    "setting",
    [
        Setting("camera_from_radar", [1.0, 2.0], "too few numbers"),
        Setting("max_wait_s", -1.0, "negative"),
        Setting("camera_info_topic", "/front/image_raw", "the same topic twice"),
    ],
)
def test_what_the_node_would_refuse_is_not_written(tmp_path: Path, setting: Setting) -> None:
    with pytest.raises(RadcamDepthError):
        write_parameters(tmp_path / "node.yaml", suggestion(setting), "drive")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "value"), [("radar_time_offset_s", 11.0), ("no_such_parameter", 1), ("image_transport", "ffmpeg")]
)
def test_the_nodes_own_table_is_asked(name: str, value: object) -> None:
    check_parameters(TOPICS)
    with pytest.raises(RadcamDepthError, match=name):
        check_parameters({**TOPICS, name: value})


def test_no_radar_at_all_is_a_list_that_rclpy_takes() -> None:
    values = topic_parameters("/a", "sensor_msgs/msg/Image", "/b", ())
    assert values["radar_topics"] == [""]
    check_parameters(values)


@settings(max_examples=50, deadline=None)
@given(st.floats(0.2, 5.0), st.floats(-60, 60), st.floats(-170, 170))
def test_the_road_is_the_one_of_the_parameters(height_m: float, pitch_deg: float, roll_deg: float) -> None:
    parameters: Any = ground_parameters(level_ground(height_m, pitch_deg, roll_deg))
    assert parameters["camera_height_m"] == pytest.approx(height_m)
    assert parameters["camera_pitch_deg"] == pytest.approx(pitch_deg, abs=1e-4)
    assert parameters["camera_roll_deg"] == pytest.approx(roll_deg, abs=1e-4)
