"""Pictures of what a node publishes, over DDS."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rclpy
from generated_messages import require_tf2_msgs
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from small_drive import CAMERA, CAMERA_FROM_RADAR, PERIOD_NS, START_NS, small_image, small_returns

from radcam_depth_ros import cli
from radcam_depth_ros.bags import BagError, find_topics
from radcam_depth_ros.drive import DriveSettings, TopicChoice
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.geometry import project
from radcam_depth_ros.live_topics import ListenOptions, listener
from radcam_depth_ros.messages import (
    StampedTransform,
    encode_camera_info,
    encode_confidence,
    encode_depth,
    encode_image,
    encode_points,
    encode_transforms,
)
from radcam_depth_ros.node.topics.factory import build_message, message_class
from radcam_depth_ros.viewing import ViewError, ViewOptions, view_live

IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
TOPICS = {
    "/camera/image_raw": IMAGE,
    "/camera/camera_info": INFO,
    "/front/depth/image_rect": IMAGE,
    "/front/depth/camera_info": INFO,
    "/front/semi_dense/image_rect": IMAGE,
    "/front/depth/confidence": IMAGE,
}
RADAR_TOPICS = {"/radar/points": "sensor_msgs/msg/PointCloud2", "/tf_static": "tf2_msgs/msg/TFMessage"}
QUICK = ListenOptions(patience_s=0.6, settle_s=0.1)
PATIENT = ListenOptions(settle_s=0.1)
"""For tests that end by the number of frames: a busy machine stops for more than half a second."""
NARROW = ViewOptions(width=480)


class Vehicle:
    """A camera, perhaps a radar, and a node that gives depth of every other image, 20 a second, until it is closed."""

    def __init__(self, without: tuple[str, ...] = (), has_radar: bool = False) -> None:
        self._context = Context()
        rclpy.init(args=[], context=self._context)
        self._node = Node("vehicle", context=self._context, start_parameter_services=False, enable_rosout=False)
        topics = TOPICS | (RADAR_TOPICS if has_radar else {})
        qos = {
            topic: QoSProfile(
                depth=10,
                reliability=ReliabilityPolicy.BEST_EFFORT if "camera/" in topic else ReliabilityPolicy.RELIABLE,
                durability=DurabilityPolicy.TRANSIENT_LOCAL if topic == "/tf_static" else DurabilityPolicy.VOLATILE,
            )
            for topic in topics
        }
        self._publishers = {
            topic: self._node.create_publisher(message_class(type_name), topic, qos[topic])
            for topic, type_name in topics.items()
        }
        if has_radar:
            mount = StampedTransform("camera", "radar", 0, CAMERA_FROM_RADAR)
            self._publishers["/tf_static"].publish(encode_transforms(build_message, [mount]))
        self._without, self._has_radar, self._closed = without, has_radar, threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def heard(self, images: int = 10) -> bool:
        """Waits until somebody has had so many images; False when closed before."""
        count = 0
        while count < images and not self._closed.wait(0.05):
            count += all(publisher.get_subscription_count() for publisher in self._publishers.values())
        return not self._closed.is_set()

    def close(self) -> None:
        self._closed.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def _run(self) -> None:
        index = 0
        while not self._closed.wait(0.05):
            where = (START_NS + index * PERIOD_NS, "camera")
            values = np.full((CAMERA.height, CAMERA.width), 0.5, np.float32)
            depth = encode_depth(build_message, values + 10, *where)
            messages = {
                "/camera/camera_info": encode_camera_info(build_message, CAMERA, *where),
                "/camera/image_raw": encode_image(build_message, small_image(index), *where),
                "/front/depth/image_rect": depth,
                "/front/depth/camera_info": encode_camera_info(build_message, CAMERA, *where),
                "/front/semi_dense/image_rect": depth,
                "/front/depth/confidence": encode_confidence(build_message, values, *where),
            }
            if self._has_radar:
                points = dict(zip("xyz", small_returns(0).T, strict=True))
                messages["/radar/points"] = encode_points(build_message, points, where[0], "radar")
            for topic, message in messages.items():
                if topic not in self._without and (index % 2 == 0 or "camera/" in topic):
                    self._publishers[topic].publish(message)
            index += 1


@pytest.fixture
def vehicle() -> Iterator[Callable[..., Vehicle]]:
    running: list[Vehicle] = []

    def start(*without: str, has_radar: bool = False) -> Vehicle:
        running.append(Vehicle(without, has_radar))
        return running[-1]

    yield start
    for one in running:
        one.close()


def view(*arguments: Any, **options: Any) -> int:
    with listener(options.pop("listen", QUICK)) as source:
        return view_live(source, *arguments, **options)


def test_images_are_shown_with_the_depth_of_their_stamp(vehicle: Callable[..., Vehicle], tmp_path: Path) -> None:
    vehicle()
    told: list[str] = []
    target = tmp_path / "out" / "live.mp4"
    assert view(target, options=ViewOptions(frames=6, width=480), warn=told.append, listen=PATIENT) == 6
    video = cv2.VideoCapture(str(target))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 6
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(5, abs=2.6), "every other image has depth"
    assert [path.name for path in target.parent.iterdir()] == ["live.mp4"]
    assert told == ["radar returns are not drawn: radars with /tf_static were not found"]


@pytest.mark.parametrize("has_radar", [True, False])
def test_returns_are_drawn_where_the_latched_transform_puts_them(
    vehicle: Callable[..., Vehicle], tmp_path: Path, has_radar: bool
) -> None:
    require_tf2_msgs()
    vehicle(has_radar=has_radar)
    told: list[str] = []
    assert view(tmp_path / "pictures", options=ViewOptions(frames=3, width=480), warn=told.append, listen=PATIENT) == 3
    picture = cv2.imread(str(max((tmp_path / "pictures").iterdir())))
    assert picture is not None
    left, top, width = 480 // 3, 26, 480 // 3 - 4  # of the dense depth, all of one value
    dense = picture[top : top + round(width * CAMERA.height / CAMERA.width), left : left + width]
    drawn = np.argwhere((dense != dense[0, 0]).any(axis=2))[:, ::-1]
    uv, _ = project(CAMERA_FROM_RADAR.apply(small_returns(0)), CAMERA)
    away_px = np.linalg.norm(drawn[:, None] - (uv + 0.5) * width / CAMERA.width, axis=2)
    if has_radar:
        assert (away_px.min(axis=0) < 12).all(), "each return has its mark"
        assert (away_px.min(axis=1) < 12).all(), "nothing else is drawn"
    else:
        assert not drawn.size
    assert bool(told) != has_radar


def test_the_verb_ends_by_ctrl_c_with_what_it_has(
    vehicle: Callable[..., Vehicle], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = vehicle()
    target = tmp_path / "pictures"
    interrupt = threading.Thread(target=lambda: running.heard() and signal.raise_signal(signal.SIGINT))
    interrupt.start()
    monkeypatch.setattr(sys, "argv", ["radcam-depth", "view", "topics", "--save", str(target), "--width", "480"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    interrupt.join()
    assert not ended.value.code
    assert len(list(target.iterdir())) > 1
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize(
    ("silent", "words"),
    [
        ("/front/depth/image_rect", r"/front/depth/image_rect \(publishers: 1, messages: 0\).* node is active"),
        ("/camera/camera_info", "no usable camera_info on '/camera/camera_info'"),
    ],
)
def test_what_does_not_come_is_named(vehicle: Callable[..., Vehicle], tmp_path: Path, silent: str, words: str) -> None:
    vehicle(silent)
    with pytest.raises(ViewError, match=words):
        view(tmp_path / "live.mp4", options=NARROW, listen=ListenOptions(seconds=0.8, settle_s=0.1))
    assert not list(tmp_path.iterdir())


def test_topics_that_are_not_there_are_named_with_those_that_are(
    vehicle: Callable[..., Vehicle], tmp_path: Path
) -> None:
    target = tmp_path / "live.mp4"
    with pytest.raises(ViewError, match=r"no node publishes depth/image_rect .* in any namespace; .* There is nothing"):
        view(target, listen=ListenOptions(discovery_s=0.1, settle_s=0.1))
    vehicle()
    with listener(QUICK) as source:
        source.find(lambda: find_topics(source.topics, radars=()))
        source.stop()
        with pytest.raises(ViewError, match=r"in /rear/; .* There is .*/front/depth/image_rect"):
            view_live(source, target, namespace="rear")
        missing = DriveSettings(topics=TopicChoice(image="/camera/image"))
        with pytest.raises(BagError, match=r"the ROS domain has no image topic /camera/image .* has .*/image_raw"):
            view_live(source, target, missing)


def test_times_that_make_no_sense_are_refused() -> None:
    with pytest.raises(RadcamDepthError, match="must be positive"):
        ListenOptions(seconds=0.0)


def test_without_ros_it_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.startswith("radcam_depth_ros.live_topics")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr("radcam_depth_ros.live_topics", raising=False)
    monkeypatch.setitem(sys.modules, "rclpy", None)
    for name in [name for name in sys.modules if name.startswith("rclpy.")]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(sys, "argv", ["radcam-depth", "view", "topics", "--save", str(tmp_path / "live.mp4")])
    with pytest.raises(SystemExit, match="2"):
        cli.main()
    assert "view topics needs ROS 2, and the package rclpy" in capsys.readouterr().err
