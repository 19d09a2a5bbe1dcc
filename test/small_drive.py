"""A drive of 96 x 64 pixels, message by message, with a radar and exact depth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.frame import CameraModel, ImageArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import (
    MessageFactory,
    StampedTransform,
    encode_camera_info,
    encode_depth,
    encode_image,
    encode_points,
    encode_transforms,
)

Change = Callable[[str, Any, int], tuple[str, Any, int]]
"""Topic, message and time of recording, to others."""
CAMERA = CameraModel(96, 64, 630.0, 630.0, 47.5, 31.5)  # the network's focal length: nothing is scaled
CAMERA_FROM_RADAR = RigidTransform(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([0.1, 0.2, -1.0]))
PERIOD_NS = 100_000_000
START_NS = 1_000_000_000


def small_image(index: int) -> ImageArray:
    """An image that differs from frame to frame."""
    return np.random.default_rng(index).integers(0, 255, (CAMERA.height, CAMERA.width, 3), dtype=np.uint8)


def small_returns(index: int) -> np.ndarray:
    """Radar returns in the radar's frame (x forward), (4, 3) metres."""
    return np.array([[8.0 + index, 0.3, 0], [20, -0.8, 0.2], [35, 1.5, 0.1], [12, 0.5, 0]], np.float32)


def small_messages(make: MessageFactory, index: int) -> list[tuple[str, str, Any, int]]:
    """One frame's messages: topic, type, message, time; radar first, ground truth last."""
    stamp = START_NS + index * PERIOD_NS
    image, x, y, z = small_image(index), *small_returns(index).T
    depth = np.full(image.shape[:2], 10.0 + index, np.float32)
    depth[:8] = np.inf
    cloud = encode_points(make, {"x": x, "y": y, "z": z, "rcs": np.full(4, 5, np.float32)}, stamp - 20_000_000, "radar")
    return [
        ("/radar/points", "sensor_msgs/msg/PointCloud2", cloud, stamp - 20_000_000),
        ("/camera/image_raw", "sensor_msgs/msg/Image", encode_image(make, image, stamp, "camera"), stamp),
        ("/camera/camera_info", "sensor_msgs/msg/CameraInfo", encode_camera_info(make, CAMERA, stamp, "camera"), stamp),
        ("/ground_truth/depth", "sensor_msgs/msg/Image", encode_depth(make, depth, stamp, "camera"), stamp),
    ]


def write_changed(
    path: Path,
    change: Change = lambda topic, message, time_ns: (topic, message, time_ns),
    frames: int = 12,
    links: Sequence[StampedTransform] | None = None,
) -> Path:
    """The small drive with each message changed; none is written in place of None."""
    if links is None:
        links = [StampedTransform("camera", "radar", START_NS, CAMERA_FROM_RADAR)]
    with BagWriter(path) as writer:
        if links:
            writer.write("/tf_static", encode_transforms(factory, links), START_NS, "tf2_msgs/msg/TFMessage")
        for index in range(frames):
            for topic, _, message, time_ns in small_messages(factory, index):
                name, changed, recorded_ns = change(topic, message, time_ns)
                if changed is not None:
                    writer.write(name, changed, recorded_ns)
    return path


def without_radar_stamps(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
    """A change: the radar sets no stamps."""
    if topic == "/radar/points":
        message.header.stamp.sec = message.header.stamp.nanosec = 0
    return topic, message, time_ns


def doppler_as_intensity() -> Change:
    """A change: the radar's only further field is an intensity, which is the Doppler speed in truth."""
    rng = np.random.default_rng(3)

    def change(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        if topic != "/radar/points":
            return topic, message, time_ns
        angle, distance = rng.uniform(-0.9, 0.9, 40), rng.uniform(5, 80, 40)
        columns = {"x": distance * np.cos(angle), "y": distance * np.sin(angle), "z": np.zeros(40)}
        columns["intensity"] = -rng.uniform(5, 15) * np.cos(angle)
        cloud = {name: values.astype(np.float32) for name, values in columns.items()}
        return topic, encode_points(factory, cloud, time_ns, "radar"), time_ns

    return change
