"""Depth frames a second and latency of the live node, fed over DDS on this machine.

    .venv/bin/python -m benchmarks.node_rate --size 448x800 --size 256x448 --seconds 20 --json out/node_rate.json

The node is a process of its own. This process publishes images, camera_info and radar points, always the same ones with
new stamps, and takes the depth images as bytes. `--in-flight` images are under way at any moment: with 2, the node
always has one that waits, so that it is never idle, and drops none. `--hz` publishes at a fixed rate instead.
"""

from __future__ import annotations

import argparse
import os
import struct
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import yaml
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rich.console import Console

from demo.process import DemoError, NodeProcess, keep_to_this_machine
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.messages import encode_camera_info, encode_image, encode_points
from radcam_depth_ros.node.topics.factory import build_message, message_class
from radcam_depth_ros.reporting.terminal import print_table

DEPTH = "depth/image_rect"
INPUTS = {
    "camera_info": "sensor_msgs/msg/CameraInfo",
    "radar/points": "sensor_msgs/msg/PointCloud2",
    "image": "sensor_msgs/msg/Image",
}
RADAR_IN_THE_CAMERA = [0.0, 0.0, 0.0, 0.5, -0.5, 0.5, 0.5]
"""A radar in the camera's place: x forward, y left, z up."""
FULL_SIZE_FOCAL_PX, NETWORK_FOCAL_PX = 1266.0, 630.0
"""Of 900 rows and more, and of smaller images: both show the network the same angle."""
START_TIMEOUT_S = 180.0
LOST_S = 3.0
LOST_LATENCIES = 5.0
"""An image is given up after so many seconds, or so many of the longest latencies so far."""
WARM_UP_FRAMES = 5


@dataclass(frozen=True)
class Rate:
    """What came out of the node.

    Attributes:
        height: Rows of the published images.
        width: Columns.
        seconds: How long was measured.
        sent: Images that were published.
        latencies_ms: From publishing an image to its depth's arrival here, of each depth image.
        node_cpu: CPU seconds a second of the node.
        feeder_cpu: The same of this process.
    """

    height: int
    width: int
    seconds: float
    sent: int
    latencies_ms: tuple[float, ...]
    node_cpu: float
    feeder_cpu: float

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        quantiles: list[Any] = [None] * 3
        if self.latencies_ms:
            quantiles = np.percentile(self.latencies_ms, (50, 90, 99)).round(1).tolist()
        return {
            "height": self.height,
            "width": self.width,
            "seconds": round(self.seconds, 2),
            "frames_per_s": round(len(self.latencies_ms) / self.seconds, 2),
            "latency_ms": dict(zip(("median", "p90", "p99"), quantiles, strict=True)),
            "sent": self.sent,
            "received": len(self.latencies_ms),
            "dropped": self.sent - len(self.latencies_ms),
            "node_cpu": round(self.node_cpu, 2),
            "feeder_cpu": round(self.feeder_cpu, 2),
        }


class Feeder:
    """Publishes the sensors and listens for depth.

    Args:
        node: The ROS node that it does so with.
        camera: Of the images.
        points: Number of radar points.
    """

    def __init__(self, node: Node, camera: CameraModel, points: int) -> None:
        self._node = node
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._publishers = {
            name: node.create_publisher(message_class(kind), name, qos) for name, kind in INPUTS.items()
        }
        self._messages = _messages(camera, points)
        self._under_way: dict[int, float] = {}
        self.latencies_ms: list[float] = []
        self.sent = 0
        node.create_subscription(message_class(INPUTS["image"]), DEPTH, self._on_depth, qos, raw=True)

    @property
    def is_connected(self) -> bool:
        """Whether the node hears all that is published, and publishes depth."""
        heard = all(publisher.get_subscription_count() for publisher in self._publishers.values())
        return bool(heard and self._node.count_publishers(DEPTH))

    @property
    def in_flight(self) -> int:
        """Images whose depth is still to come."""
        patience_s = max(LOST_S, LOST_LATENCIES * 1e-3 * max(self.latencies_ms, default=0.0))
        oldest_s = time.monotonic() - patience_s
        self._under_way = {stamp: sent_s for stamp, sent_s in self._under_way.items() if sent_s > oldest_s}
        return len(self._under_way)

    def send(self) -> None:
        """Publishes one moment: radar and camera_info first, so that the image need not wait."""
        stamp_ns = time.time_ns()
        for name, message in self._messages.items():
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
            if name == "image":
                self._under_way[stamp_ns] = time.monotonic()
            self._publishers[name].publish(message)
        self.sent += 1

    def start_anew(self) -> None:
        """Forgets what was counted so far."""
        self._under_way.clear()
        self.latencies_ms.clear()
        self.sent = 0

    def _on_depth(self, raw: bytes) -> None:
        # A message begins with 4 bytes that tell its encoding; then comes its header's stamp.
        seconds, nanoseconds = struct.unpack_from("<iI", raw, 4)
        sent_s = self._under_way.pop(seconds * 1_000_000_000 + nanoseconds, None)
        if sent_s is not None:
            self.latencies_ms.append(1e3 * (time.monotonic() - sent_s))


def _messages(camera: CameraModel, points: int) -> dict[str, Any]:
    """The messages that are published again and again, in the order of publishing."""
    generator = np.random.default_rng(0)
    image = generator.integers(0, 255, (camera.height, camera.width, 3), np.uint8)
    depth = generator.uniform(3.0, 80.0, points).astype(np.float32)
    # Within the image: x forward, y left.
    y = (depth * generator.uniform(-0.4, 0.4, points) * camera.width / camera.fx).astype(np.float32)
    cloud = {"x": depth, "y": y, "z": np.zeros(points, np.float32), "rcs": np.full(points, 5.0, np.float32)}
    return {
        "camera_info": encode_camera_info(build_message, camera, 0, "camera"),
        "radar/points": encode_points(build_message, cloud, 0, "radar"),
        "image": encode_image(build_message, image, 0, "camera"),
    }


def measure(camera: CameraModel, options: argparse.Namespace) -> Rate:
    """Starts a node, feeds it and counts.

    Raises:
        DemoError: when the node ends or gives no depth.
    """
    with tempfile.TemporaryDirectory() as folder:
        parameters = {
            "camera_from_radar": RADAR_IN_THE_CAMERA,
            "camera_height_m": 1.5,
            **given_parameters(options.parameter),
        }
        file = Path(folder) / "node.yaml"
        file.write_text(yaml.safe_dump({"radcam_depth": {"ros__parameters": parameters}}), encoding="utf-8")
        with NodeProcess(file, Path(folder) / "node.log") as process, _spinning() as (node, executor):
            feeder = Feeder(node, camera, options.points)
            _await_depth(feeder, process, executor)
            return _count(feeder, process, executor, camera, options)


def given_parameters(entries: list[str]) -> dict[str, Any]:
    """The node's parameters from entries such as `threads:=1`."""
    parted = (entry.partition(":=") for entry in entries)
    return {name: yaml.safe_load(value) for name, _, value in parted}


def _await_depth(feeder: Feeder, process: NodeProcess, executor: SingleThreadedExecutor) -> None:
    """Feeds the node until it is warm."""
    deadline_s = time.monotonic() + START_TIMEOUT_S
    while len(feeder.latencies_ms) < WARM_UP_FRAMES:
        process.check()
        if process.problem or time.monotonic() > deadline_s:
            raise DemoError(f"expected depth from the node, got none; its log ends with:\n{process.last_lines}")
        if feeder.is_connected and not feeder.in_flight:
            feeder.send()
        executor.spin_once(timeout_sec=0.05)


def _count(
    feeder: Feeder,
    process: NodeProcess,
    executor: SingleThreadedExecutor,
    camera: CameraModel,
    options: argparse.Namespace,
) -> Rate:
    """Feeds a warm node for as long as was asked."""
    feeder.start_anew()
    pids = (process.pid, os.getpid())
    began_s, began_cpu_s = time.monotonic(), [_cpu_s(pid) for pid in pids]
    while (now_s := time.monotonic()) < began_s + options.seconds:
        process.check()
        if options.hz is None:
            is_due = feeder.in_flight < options.in_flight
        else:
            is_due = now_s >= began_s + feeder.sent / options.hz
        if is_due:
            feeder.send()
        executor.spin_once(timeout_sec=0 if is_due else 0.002)
    seconds = time.monotonic() - began_s
    node_cpu, feeder_cpu = ((_cpu_s(pid) - before) / seconds for pid, before in zip(pids, began_cpu_s, strict=True))
    # What is still under way was neither dropped nor received.
    sent = feeder.sent - feeder.in_flight
    return Rate(camera.height, camera.width, seconds, sent, tuple(feeder.latencies_ms), node_cpu, feeder_cpu)


def _cpu_s(pid: int) -> float:
    """CPU seconds of a process and its threads."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _spinning() -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    rclpy.init(args=[])
    node = rclpy.create_node("node_rate")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def _camera(size: str) -> CameraModel:
    height, width = (int(side) for side in size.split("x"))
    focal_px = FULL_SIZE_FOCAL_PX if height >= 900 else NETWORK_FOCAL_PX
    return CameraModel(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--size", action="append", type=_camera, help="HEIGHTxWIDTH; repeat it for several [448x800]")
    parser.add_argument("--points", type=int, default=60, help="radar points a frame [60]")
    parser.add_argument("--seconds", type=float, default=20.0, help="how long to measure each size [20]")
    parser.add_argument("--in-flight", type=int, default=2, help="images under way at any moment [2]")
    parser.add_argument("--hz", type=float, help="publish at this rate, whatever the node makes of it")
    parser.add_argument("--parameter", action="append", default=[], metavar="NAME:=VALUE", help="for the node")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    return parser.parse_args(arguments)


def print_rates(rates: Sequence[Mapping[str, Any]]) -> None:
    """Prints the figures of each size, as `Rate.as_json` gives them."""
    rows = tuple(
        (
            f"{rate['height']} x {rate['width']}",
            str(rate["frames_per_s"]),
            *("" if value is None else str(value) for value in rate["latency_ms"].values()),
            *(str(rate[name]) for name in ("sent", "dropped", "node_cpu", "feeder_cpu")),
        )
        for rate in rates
    )
    columns = ("image", "frames/s", "median ms", "p90 ms", "p99 ms", "sent", "dropped", "node CPU", "feeder CPU")
    note = "Latency: from publishing an image to its depth's arrival. CPU: processor seconds a second."
    print_table(Console(), "depth frames a second of the live node", columns, rows, note)


def main(arguments: list[str] | None = None) -> int:
    """Measures each size and prints a table."""
    options = parse(arguments)
    keep_to_this_machine()
    try:
        rates = [measure(camera, options).as_json() for camera in options.size or [_camera("448x800")]]
    except DemoError as error:
        print(f"node_rate: {error}", file=sys.stderr)
        return 1
    if options.json:
        write_json({"points": options.points, "sizes": rates}, options.json)
    if options.json != "-":
        print_rates(rates)
    return 0


if __name__ == "__main__":
    sys.exit(main())
