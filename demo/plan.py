"""Plan of a demo: the part of a bag that is played, and the node's parameters for it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml

from radcam_depth_ros.bags import BagReader, SensorTopics, find_topics, read_static_transforms
from radcam_depth_ros.geometry import TransformTree, ground_plane
from radcam_depth_ros.inspection import extrinsic_parameters, ground_parameters, topic_parameters
from radcam_depth_ros.parameters import NODE_NAME

FOOTPRINT_FRAME = "base_footprint"  # REP 105


@dataclass(frozen=True)
class Plan:
    """How to play a bag to the node.

    Attributes:
        bag: The bag.
        sensors: Its sensors.
        played: Topic to type of what is played.
        images: How many images there are.
        parameters: The node's parameters.
    """

    bag: Path
    sensors: SensorTopics
    played: dict[str, str]
    images: int
    parameters: dict[str, object]

    def write_parameters(self, path: Path) -> None:
        """Writes the parameters as a ROS parameter file."""
        content = {NODE_NAME: {"ros__parameters": self.parameters}}
        path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def plan_drive(bag: Path, model: Path | None = None) -> Plan:
    """Reads a bag's topics and static transforms.

    Args:
        bag: A rosbag2 folder or .mcap file.
        model: Weights in place of the package's own.

    The extrinsics become parameters since tf2_msgs, which `/tf_static` needs, does not come with the ROS wheels.

    Raises:
        RadcamDepthError: when the bag lacks a sensor, or the transform from a radar to the camera.
    """
    with BagReader(bag) as reader:
        sensors = find_topics(reader.topics)
        transforms = read_static_transforms(reader, sensors.tf_static or "/tf_static")
        played = {info.name: info.type_name for info in reader.topics if info.name in _played(sensors)}
        parameters: dict[str, object] = {"use_sim_time": True}
        if model is not None:
            parameters["model_file"] = str(model.resolve())
        image, image_type = sensors.image, played[sensors.image]
        parameters.update(topic_parameters(image, image_type, sensors.camera_info, sensors.radars))
        # A best-effort reader, the node's default, loses what comes before it knows the player, which knows it already.
        parameters.update({f"qos_overrides.{topic}.subscription.reliability": "reliable" for topic in played})
        parameters.update(_extrinsics(reader, sensors, transforms))
        images = reader.count([sensors.image])
    return Plan(bag, sensors, played, images, parameters)


def _played(sensors: SensorTopics) -> tuple[str, ...]:
    return (sensors.image, sensors.camera_info, *sensors.radars)


def _extrinsics(reader: BagReader, sensors: SensorTopics, transforms: TransformTree) -> dict[str, object]:
    camera_frame = _frame_id(reader, sensors.image)
    parameters = extrinsic_parameters(transforms, camera_frame, [_frame_id(reader, radar) for radar in sensors.radars])
    if transforms.can_transform(camera_frame, FOOTPRINT_FRAME):
        parameters.update(ground_parameters(ground_plane(transforms.lookup(camera_frame, FOOTPRINT_FRAME))))
    return parameters


def _frame_id(reader: BagReader, topic: str) -> str:
    return str(next(iter(reader.messages([topic]))).message.header.frame_id)
