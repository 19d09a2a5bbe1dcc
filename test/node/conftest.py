"""A live node with a network that is made up, and a peer that plays its sensors, over DDS."""

# ruff: noqa: E402  # the first lines decide whether and how rclpy is imported
from __future__ import annotations

import gc
import importlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

# Before rclpy is imported: fields of messages are checked for type.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"

rclpy = pytest.importorskip("rclpy")

from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy

from radcam_depth_ros.estimator import Computation, Estimator, EstimatorConfig
from radcam_depth_ros.frame import CameraModel, DepthResult, Frame
from radcam_depth_ros.messages import encode_camera_info, encode_image, encode_points
from radcam_depth_ros.node import depth_node
from radcam_depth_ros.node.topics.factory import build_message, message_class

# Nodes of a fixed name are disturbed by others: each process has a domain that neither the demo nor other tests use.
DOMAINS = (*range(1, 10), *range(70, 102))
DOMAIN_ID = DOMAINS[os.getpid() % len(DOMAINS)]
OTHER_DOMAIN_ID = DOMAINS[(os.getpid() + len(DOMAINS) // 2) % len(DOMAINS)]
"""Of tests that find a node by its name: one of an earlier test, failed or killed, may still be in the graph."""
ROOT = Path(__file__).parents[2]
CAMERA = CameraModel(96, 64, 100.0, 100.0, 47.5, 31.5)
SECOND_NS = 1_000_000_000
RADAR_LOOKING_ALONG = [0.0, 0.0, 0.0, 0.5, -0.5, 0.5, 0.5]
"""A radar in the camera's place: x forward, y left, z up."""
INPUTS = {
    "image": "sensor_msgs/msg/Image",
    "camera_info": "sensor_msgs/msg/CameraInfo",
    "radar/points": "sensor_msgs/msg/PointCloud2",
}


@dataclass
class FakeEstimator:
    """Depth is the number of returns in front of the camera, and 1 m more; takes as long as it is told.

    Keeps the stamps of its frames, the places of the returns by stamp, and for which camera it was warmed up in which
    thread.
    """

    config: EstimatorConfig
    seconds: float = 0.0
    error: Exception | None = None
    tells_classes: bool = False
    only_size: tuple[int, int] | None = None
    stamps_ns: list[int] = field(default_factory=list)
    radar_m: dict[int, np.ndarray] = field(default_factory=dict)
    warmed_up: list[tuple[CameraModel, str]] = field(default_factory=list)
    card: Any = field(default_factory=lambda: SimpleNamespace(focal_length_px=100.0))

    def describe(self) -> str:
        return "made up"

    @property
    def computation(self) -> Computation:
        return Computation("float32", 1, "")

    def can_adjust(self, config: EstimatorConfig) -> bool:
        return Estimator.can_adjust(self, config)

    def adjust(self, config: EstimatorConfig) -> None:
        assert self.can_adjust(config)
        self.config = config

    def warm_up(self, camera: CameraModel) -> None:
        self.warmed_up.append((camera, threading.current_thread().name))

    def prepare(self, frame: Frame) -> Any:
        return SimpleNamespace(frame=frame, radar=frame.radar.xyz_m[frame.radar.xyz_m[:, 2] > 0])

    def run(self, inputs: Any) -> None:
        time.sleep(self.seconds)
        if self.error is not None:
            raise self.error
        self.stamps_ns.append(inputs.frame.stamp_ns)
        self.radar_m[inputs.frame.stamp_ns] = inputs.frame.radar.xyz_m

    def finish(self, inputs: Any, depths: None, *, classes: bool) -> DepthResult:
        frame, in_view = inputs.frame, len(inputs.radar)
        shape = frame.image.shape[:2]
        dense, semi_dense = np.full(shape, 1.0 + in_view, np.float32), np.full(shape, np.nan, np.float32)
        confidence = np.full(shape, 0.5, np.float32)
        shown = np.full(shape, 13, np.uint8) if classes and self.tells_classes else None
        return DepthResult(frame.stamp_ns, frame.frame_id, frame.camera, dense, semi_dense, confidence, in_view, shown)


class Peer:
    """Sensors and listeners in a node of their own, which is spun while something is waited for."""

    def __init__(self, context: Context, name: str = "peer", namespace: str = "") -> None:
        self.context = context
        self.peer = Node(
            name, context=context, namespace=namespace, start_parameter_services=False, enable_rosout=False
        )
        self.listens_to = ""
        """The only node whose diagnostics are kept; empty for all."""
        self.listens_since_ns = 0
        """Diagnostics with a stamp before it are not kept, either: on a busy machine old ones may still wait."""
        self._peer_executor = SingleThreadedExecutor(context=context)
        self._peer_executor.add_node(self.peer)
        self._publishers: dict[str, Any] = {}
        self.depth: list[Any] = []
        self.logs: list[str] = []
        self.diagnostics: list[dict[str, Any]] = []
        self.now_ns = 100 * SECOND_NS
        self.subscribe("depth/image_rect", "sensor_msgs/msg/Image", self.depth.append)
        self.subscribe("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", self._on_diagnostics)
        self.subscribe("/rosout", "rcl_interfaces/msg/Log", lambda log: self.logs.append(log.msg))

    def _on_diagnostics(self, message: Any) -> None:
        is_wanted = stamp_of(message) >= self.listens_since_ns
        if is_wanted and self.listens_to in ("", message.status[0].hardware_id):
            self.diagnostics.append({status.name.split(": ", 1)[1]: status for status in message.status})

    def close(self) -> None:
        self._peer_executor.remove_node(self.peer)
        self.peer.destroy_node()

    def subscribe(self, topic: str, type_name: str, callback: Callable[[Any], Any], **qos: Any) -> None:
        profile = QoSProfile(**{"depth": 50, "reliability": ReliabilityPolicy.RELIABLE, **qos})
        self.peer.create_subscription(message_class(type_name), topic, callback, profile)

    def advertise(self, topic: str, type_name: str, **qos: Any) -> None:
        profile = QoSProfile(**{"depth": 50, "reliability": ReliabilityPolicy.RELIABLE, **qos})
        self._publishers[topic] = self.peer.create_publisher(message_class(type_name), topic, profile)

    def until(self, condition: Callable[[], Any], timeout_s: float = 150.0, what: str = "") -> Any:
        """Spins the peer until a condition holds; returns its value."""
        deadline = time.monotonic() + timeout_s
        while not (value := condition()):
            assert time.monotonic() < deadline, f"{what or 'it'} did not come about; logs: {self.logs}"
            self._peer_executor.spin_once(timeout_sec=0.02)
        return value

    def connect(self, *without: str) -> None:
        """Advertises the sensors; waits until the node hears them and the peer hears the node."""
        for topic, type_name in INPUTS.items():
            if topic not in self._publishers and topic not in without:
                self.advertise(topic, type_name)
        self.until(
            lambda: (
                all(publisher.get_subscription_count() for publisher in self._publishers.values())
                and self.peer.count_publishers("depth/image_rect")
                and self.diagnostics
            ),
            what="discovery",
        )

    def unadvertise(self, topic: str) -> None:
        self.peer.destroy_publisher(self._publishers.pop(topic))

    def send(self, topic: str, message: Any) -> None:
        if topic in self._publishers:
            self._publishers[topic].publish(message)

    # Messages that are well.

    def image(self, camera: CameraModel = CAMERA, frame_id: str = "camera") -> Any:
        pixels = np.full((camera.height, camera.width, 3), 99, np.uint8)
        return encode_image(build_message, pixels, self.now_ns, frame_id)

    def camera_info(self, camera: CameraModel = CAMERA) -> Any:
        return encode_camera_info(build_message, camera, self.now_ns, "camera")

    def cloud(self, x: Any = (10.0, 20.0), names: str = "xyz", frame_id: str = "radar") -> Any:
        """A cloud of points in a row along the first of three fields, with an RCS and a Doppler that vary."""
        x = np.asarray(x, np.float32)
        zeros = np.zeros_like(x)
        changing = (np.arange(len(x)) + self.now_ns // 10**8 % 10).astype(np.float32)
        columns = {**dict(zip(names, (x, zeros, zeros), strict=True)), "rcs": changing, "radial_speed": -changing}
        return encode_points(build_message, columns, self.now_ns, frame_id)

    def send_pair(self, image: Any = None, cloud: Any = None, camera_info: Any = None) -> None:
        """Sends what belongs to one moment; what is not given is well."""
        self.send("camera_info", camera_info or self.camera_info())
        self.send("radar/points", cloud or self.cloud())
        self.send("image", image or self.image())

    def send_until(self, condition: Callable[[], Any], send: Callable[[], Any] | None = None, what: str = "") -> Any:
        """Sends ten times a second until a condition holds: best effort may lose a message."""
        next_s = 0.0

        def step() -> Any:
            nonlocal next_s
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + 0.1
                self.now_ns += SECOND_NS // 10
                (send or self.send_pair)()
            return condition()

        return self.until(step, what=what)

    def await_depth(self, send: Callable[[], Any] | None = None) -> Any:
        """Sends until depth of a message sent from now on comes."""
        before_ns = self.now_ns
        self.send_until(lambda: self.depth and stamp_of(self.depth[-1]) > before_ns, send, what="depth")
        return self.depth[-1]

    def status(self, name: str, text: str) -> Any:
        """The first line of diagnostics about a part that has a text in it; None when there is none."""
        return next((d[name] for d in self.diagnostics if name in d and text in d[name].message), None)


class Bench(Peer):
    """A peer with the node under test, which runs in a thread of its own, or in another one's."""

    def __init__(
        self,
        context: Context,
        parameters: Mapping[str, Any],
        make: Callable[..., Any],
        args: Sequence[str],
        namespace: str = "",
        beside: Bench | None = None,
    ) -> None:
        super().__init__(context, namespace=namespace)
        self.fake: Any = None

        def make_estimator(config: EstimatorConfig) -> Any:
            self.fake = make(config)
            return self.fake

        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        self.node = depth_node.RadcamDepthNode(
            make_estimator,
            context=context,
            namespace=namespace,
            parameter_overrides=overrides,
            cli_args=["--ros-args", *args],
        )
        self.listens_to = self.node.get_fully_qualified_name() if namespace else ""
        self._executor = SingleThreadedExecutor(context=context) if beside is None else beside._executor
        self._executor.add_node(self.node)
        self._transition = self.peer.create_client(service_class("ChangeState"), "radcam_depth/change_state")
        self._state = self.peer.create_client(service_class("GetState"), "radcam_depth/get_state")
        self._set = self.peer.create_client(SetParameters, "radcam_depth/set_parameters")
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        if beside is None:
            self._thread = threading.Thread(target=self._spin, name="node under test")
            self._thread.start()

    def _spin(self) -> None:
        while not self._stop.is_set():
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        """Ends the node; the second time does nothing."""
        if not hasattr(self, "node"):
            return
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
        self._executor.remove_node(self.node)
        self.node.destroy_node()
        del self.node
        super().close()

    def _call(self, client: Any, request: Any) -> Any:
        self.until(client.service_is_ready, what=client.srv_name)
        future = client.call_async(request)
        self.until(future.done, what=client.srv_name)
        return future.result()

    def change_state(self, label: str) -> bool:
        request = service_class("ChangeState").Request()
        request.transition.label = label
        return bool(self._call(self._transition, request).success)

    @property
    def state(self) -> str:
        return str(self._call(self._state, service_class("GetState").Request()).current_state.label)

    def set_parameter(self, name: str, value: Any) -> str:
        """Sets a parameter as `ros2 param set` does; returns the reason of a refusal."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        (result,) = self._call(self._set, request).results
        assert bool(result.reason) != result.successful
        return str(result.reason)


def service_class(name: str) -> Any:
    return getattr(importlib.import_module("lifecycle_msgs.srv"), name)


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec) * SECOND_NS + int(message.header.stamp.nanosec)


@contextmanager
def _context(domain_id: int) -> Iterator[Context]:
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    yield context
    rclpy.shutdown(context=context)


@pytest.fixture(scope="module")
def context() -> Iterator[Context]:
    with _context(DOMAIN_ID) as context:
        yield context


@pytest.fixture(autouse=True, scope="session")
def _quick_diagnostics() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(depth_node, "DIAGNOSTICS_PERIOD_S", 0.1)
        yield


@pytest.fixture
def run_process() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Runs Python with arguments in a process that hears this one's nodes, and ends it after the test."""
    processes: list[subprocess.Popen[str]] = []

    def run(*arguments: str) -> subprocess.Popen[str]:
        environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN_ID), "PYTHONPATH": str(ROOT)}
        command = [sys.executable, *arguments]
        pipe = subprocess.PIPE
        processes.append(subprocess.Popen(command, env=environment, stdout=pipe, stderr=pipe, text=True))
        return processes[-1]

    yield run
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture
def run(run_process: Callable[..., Any]) -> Callable[..., Any]:
    """Starts a node in a process of its own, see `sleeping_node`: `run("inference", "-p", "autostart:=false")`."""
    script, extrinsics = str(ROOT / "test/sleeping_node.py"), f"camera_from_radar:={RADAR_LOOKING_ALONG}"
    return lambda phase, *arguments: run_process(script, phase, "--ros-args", "-p", extrinsics, *arguments)


@pytest.fixture
def peer(context: Context) -> Iterator[Peer]:
    """Sensors and listeners for a node in a process of its own."""
    peer = Peer(context)
    yield peer
    peer.close()


@pytest.fixture
def driver() -> Iterator[Peer]:
    """Sensors in a DDS participant of their own: in one participant a topic has one type at a time."""
    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN_ID)
    driver = Peer(context, "driver")
    yield driver
    driver.close()
    rclpy.shutdown(context=context)


@contextmanager
def _starter(context: Context) -> Iterator[Callable[..., Bench]]:
    benches: list[Bench] = []
    # A module's node, which its last test still referred to: its end would take the topic of logs from this one.
    gc.collect()

    def start(
        make: Callable[..., Any] = FakeEstimator,
        args: Sequence[str] = (),
        namespace: str = "",
        beside: Bench | None = None,
        **parameters: Any,
    ) -> Bench:
        given = {"camera_from_radar": RADAR_LOOKING_ALONG, "max_wait_s": 0.02, **parameters}
        given = {name: value for name, value in given.items() if value is not None}
        benches.append(Bench(context, given, make, args, namespace, beside))
        return benches[-1]

    yield start
    while benches:
        benches.pop().close()
    # rclpy ends a lifecycle node only with its state machine, when nothing refers to it any more.
    gc.collect()


@pytest.fixture
def start_apart() -> Iterator[Callable[..., Bench]]:
    """The same as `start` in a domain in which no other node of this kind is."""
    with _context(OTHER_DOMAIN_ID) as context, _starter(context) as start:
        yield start


@pytest.fixture
def start(context: Context) -> Iterator[Callable[..., Bench]]:
    """Starts a node: `start(depth_encoding="16UC1")`; its extrinsics are given by parameter unless they are None."""
    with _starter(context) as start:
        yield start


@pytest.fixture(scope="module")
def start_for_module(context: Context) -> Iterator[Callable[..., Bench]]:
    """The same for a node that several tests use."""
    with _starter(context) as start:
        yield start


@pytest.fixture(scope="session")
def make_estimator() -> Callable[..., Any]:
    """Makes an estimator without a network, see `FakeEstimator`."""
    return FakeEstimator


@pytest.fixture(scope="session")
def extrinsics() -> list[float]:
    """The parameter `camera_from_radar` of a radar in the camera's place."""
    return RADAR_LOOKING_ALONG
