"""Suggested parameters of the node for a bag, and their ROS parameter file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from radcam_depth_ros.files import write_text
from radcam_depth_ros.frame import GroundPlane
from radcam_depth_ros.frame_builder import COMPRESSED_SUFFIX
from radcam_depth_ros.geometry import TransformTree
from radcam_depth_ros.printable import printable

COMPRESSED_TYPE = "sensor_msgs/msg/CompressedImage"


@dataclass(frozen=True)
class Setting:
    """A parameter.

    Attributes:
        name: Its name in ROS.
        value: Its value.
        reason: Why.
        is_needed: Whether the node needs it for this bag; else it stands in the file as a comment.
    """

    name: str
    value: object
    reason: str
    is_needed: bool = True


@dataclass(frozen=True)
class Suggestion:
    """Parameters for the node.

    Attributes:
        settings: Its parameters.
    """

    settings: tuple[Setting, ...]

    @property
    def parameters(self) -> dict[str, object]:
        """Name to value of those that the node needs."""
        return {setting.name: setting.value for setting in self.settings if setting.is_needed}


def topic_parameters(image: str, image_type: str, camera_info: str, radars: Sequence[str]) -> dict[str, object]:
    """The parameters that name the topics of a bag."""
    is_compressed, base = image_type == COMPRESSED_TYPE, image.removesuffix(COMPRESSED_SUFFIX)
    return {
        "image_topic": base if is_compressed else image,
        "image_transport": "raw" if not is_compressed else "compressed_topic" if base == image else "compressed",
        "camera_info_topic": camera_info,
        # rclpy takes an empty list for nothing at all
        "radar_topics": list(radars) or [""],
    }


def extrinsic_parameters(
    transforms: TransformTree, camera_frame: str, radar_frames: Sequence[str]
) -> dict[str, object]:
    """Where the radars are, as a parameter.

    Raises:
        GeometryError: when a frame is not known.
    """
    numbers: list[float] = []
    for frame in radar_frames:
        camera_from_radar = transforms.lookup(camera_frame, frame)
        numbers += [float(value) for value in (*camera_from_radar.translation, *camera_from_radar.quaternion)]
    return {"camera_from_radar": numbers}


def ground_parameters(ground: GroundPlane) -> dict[str, object]:
    """The camera's height and attitude above the road, as parameters."""
    right, down, forward = (float(value) for value in ground.up)
    return {
        "camera_height_m": float(ground.height_m),
        "camera_pitch_deg": math.degrees(-math.asin(forward)),
        "camera_roll_deg": math.degrees(math.atan2(-right, -down)),
    }


def write_parameters(path: Path | str, suggestion: Suggestion, source: str) -> None:
    """Writes a ROS 2 parameter file, whole or not at all, with a comment for each parameter.

    Args:
        path: The file.
        suggestion: The parameters.
        source: The bag that they fit, for the file's first line.

    Raises:
        RadcamDepthError: for parameters that the node would refuse, or a file that cannot be written.
    """
    check_parameters(suggestion.parameters)
    lines = [f"# Parameters of the node radcam_depth for {printable(source)}; all others are in config/node_all.yaml."]
    lines += ["/**:", "  ros__parameters:"]
    for setting in suggestion.settings:
        lines += [f"    # {printable(setting.reason)}", f"    {'' if setting.is_needed else '# '}{_entry(setting)}"]
    write_text(path, "\n".join(lines) + "\n")


def check_parameters(parameters: Mapping[str, object]) -> None:
    """Refuses what the node would refuse.

    Raises:
        RadcamDepthError: for a value that cannot be used, or values that do not fit together.
    """
    from radcam_depth_ros.parameters import build_config  # here, since it brings torch

    build_config(parameters)


def _entry(setting: Setting) -> str:
    """A line of YAML, whatever the value: what is not plain is quoted, and spelled out where it cannot be printed."""
    if not "".join(map(str, setting.value if isinstance(setting.value, list) else [setting.value])).isprintable():
        return f"{setting.name}: {json.dumps(setting.value)}"
    # A list on one line, as ROS's own parameter files have it; safe_dump would put braces around a single value.
    style = None if isinstance(setting.value, list) else False
    text: str = yaml.safe_dump({setting.name: setting.value}, default_flow_style=style, width=10_000_000)
    return text.strip()
