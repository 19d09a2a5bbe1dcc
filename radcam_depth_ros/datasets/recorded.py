"""A drive as the readings of nuScenes' sensors: which topic is which channel, when each was read, and its file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from radcam_depth_ros.bags import BagReader, factory, find_topics, read_scenario, read_static_transforms
from radcam_depth_ros.bags.topics import IMAGE_TYPES, TopicChooser
from radcam_depth_ros.datasets.errors import DatasetError
from radcam_depth_ros.datasets.layout import NUSCENES, NUSCENES_RADAR
from radcam_depth_ros.datasets.pcd_file import lidar_file, radar_file
from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import Calibration, decode_image, decode_odometry, encode_compressed_image, stamp_ns
from radcam_depth_ros.motion.poses import Poses

_PLACES = ("front_left", "front_right", "back_left", "back_right", "back", "front")
_JPEG = b"\xff\xd8"
_US_NS = 1_000


@dataclass
class Sensor:
    """A sensor of a drive.

    Attributes:
        channel: In nuScenes, such as CAM_FRONT.
        modality: camera, radar or lidar.
        ego_from_sensor: Its place.
        camera: Of a camera.
        time_us: When it was read.
    """

    channel: str
    modality: str
    ego_from_sensor: RigidTransform
    camera: CameraModel | None = None
    time_us: list[int] = field(default_factory=list)


class RecordedDrive:
    """The sensors of a bag that nuScenes has as well.

    A topic is the channel that its name tells (`/radar/back_left/points`), else the one ahead. Of radars those count
    whose fields are nuScenes' own.

    Args:
        path: A rosbag2 folder or .mcap file.

    Attributes:
        sensors: By their topics.
        poses: `global_from_ego`, by stamps in nanoseconds.
        scenario: What the bag says of the whole drive.

    Raises:
        DatasetError: for a bag without camera, radar, LiDAR, odometry or the place of a sensor above `base_footprint`.
        BagError: for one that cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.poses = path, Poses()
        self.sensors: dict[str, Sensor] = {}
        with BagReader(path) as reader:
            self.scenario: Mapping[str, str] = read_scenario(reader)
            topics = find_topics(reader.topics, of=str(path))
            if topics.lidar is None or topics.odometry is None:
                raise DatasetError(
                    f"expected a LiDAR (sensor_msgs/PointCloud2) and odometry (nav_msgs/Odometry) in {path}, got "
                    f"{', '.join(topics.names)}; record both"
                )
            tree = read_static_transforms(reader)
            for message in reader.messages([topics.odometry]):
                reading = decode_odometry(message.message)
                self.poses.add(reading.stamp_ns, reading.pose @ tree.lookup(reading.child_frame_id, NUSCENES.ego_frame))
            chooser = TopicChooser(reader.topics, str(path))
            channels = self._channels(chooser, topics.lidar)
            infos = {name: chooser.find_camera_info(name) for name, channel in channels.items() if channel[:3] == "CAM"}
            span = self.poses.span_ns or (0, 0)
            for topic, channel in channels.items():
                for message in reader.messages([topic]):
                    time_ns = stamp_ns(message.message.header)
                    if topic not in self.sensors:
                        pose = tree.lookup(NUSCENES.ego_frame, str(message.message.header.frame_id))
                        camera = self._camera(reader, infos[topic]) if topic in infos else None
                        kind = "camera" if camera else "radar" if channel.startswith("RADAR") else "lidar"
                        if kind == "radar" and _fields(message.message) != NUSCENES_RADAR:
                            break
                        self.sensors[topic] = Sensor(channel, kind, pose, camera)
                    if span[0] <= time_ns // _US_NS * _US_NS <= span[1]:
                        self.sensors[topic].time_us.append(time_ns // _US_NS)
        for channel in ("CAM_FRONT", "RADAR_FRONT", "LIDAR_TOP"):
            if not any(sensor.channel == channel and sensor.time_us for sensor in self.sensors.values()):
                raise DatasetError(
                    f"expected readings for {channel} while {topics.odometry} tells the motion in {path}, got none; "
                    f"a radar's fields must be {' '.join(NUSCENES_RADAR)}"
                )

    def files(self) -> Iterator[tuple[Sensor, int, bytes]]:
        """Each reading's sensor, time in microseconds and file, one at a time."""
        with BagReader(self.path) as reader:
            for item in reader.messages(list(self.sensors)):
                sensor, time_us = self.sensors[item.topic], stamp_ns(item.message.header) // _US_NS
                if sensor.time_us and sensor.time_us[0] <= time_us <= sensor.time_us[-1]:
                    yield sensor, time_us, _file(sensor, item.message)

    @staticmethod
    def _channels(chooser: TopicChooser, lidar: str) -> dict[str, str]:
        """The channels of topics; of several for one channel the first."""
        found: dict[str, str] = {}
        images = sorted(chooser.of_type(IMAGE_TYPES), key=lambda name: (name != chooser.find_image(), name))
        images = [name for name in images if "camera" in name]
        for prefix, names in (("CAM", images), ("RADAR", chooser.find_radars())):
            for name in names:
                place = next((place for place in _PLACES if place in name), "front")
                found.setdefault(f"{prefix}_{place.upper()}", name)
        return {**{topic: channel for channel, topic in found.items()}, lidar: "LIDAR_TOP"}

    @staticmethod
    def _camera(reader: BagReader, info: str) -> CameraModel:
        calibration = Calibration(next(reader.messages([info])).message)
        if calibration.lens is not None:
            raise DatasetError(
                f"expected images without distortion, as nuScenes has them, got the distortion of {info}; rectify the "
                "images first (image_proc)"
            )
        return calibration.camera


def _fields(message: Any) -> tuple[str, ...]:
    return tuple(str(field.name) for field in message.fields)


def _file(sensor: Sensor, message: Any) -> bytes:
    if sensor.modality == "radar":
        return radar_file(message)
    if sensor.modality == "lidar":
        return lidar_file(message)
    content = bytes(message.data)
    if content.startswith(_JPEG):
        return content
    return bytes(encode_compressed_image(factory, decode_image(message).image, 0, "").data)
