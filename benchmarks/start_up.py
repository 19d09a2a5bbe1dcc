"""Seconds from process start to the first depth image of the live node, and to the answer of `--help`.

    .venv/bin/python benchmarks/start_up.py --repeats 3 --json start_up.json

A small publisher in this process sends a camera's and a radar's messages while the node starts.
"""

from __future__ import annotations

import argparse
import functools
import os
import resource
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", "59")

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.messages import encode_camera_info, encode_image, encode_points
from radcam_depth_ros.node.topics.factory import build_message, message_class

VERBS = ("", "simulate", "replay", "evaluate", "train", "export", "networks", "inspect")
PERIOD_S = 0.2
LIMIT_S = 120.0
START = "import sys; from radcam_depth_ros.node import main; sys.exit(main())"
RADAR_AT_CAMERA = "[0.0, 0.0, 0.0, 0.5, -0.5, 0.5, 0.5]"
TYPES = {
    "image": "sensor_msgs/msg/Image",
    "camera_info": "sensor_msgs/msg/CameraInfo",
    "radar/points": "sensor_msgs/msg/PointCloud2",
}


class Sensors:
    """Publishes one grey frame again and again, with new stamps, and notes when the first depth image comes."""

    def __init__(self, camera: CameraModel) -> None:
        self.node = Node("sensors")
        self.first_depth_s: float | None = None
        qos = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
        self._publishers = {
            topic: self.node.create_publisher(message_class(kind), topic, qos) for topic, kind in TYPES.items()
        }
        points = {"x": np.full(20, 20.0), "y": np.linspace(-5.0, 5.0, 20), "z": np.zeros(20)}
        columns = {name: values.astype(np.float32) for name, values in points.items()}
        image = np.full((camera.height, camera.width, 3), 128, np.uint8)
        self._messages = {
            "camera_info": encode_camera_info(build_message, camera, 0, "camera"),
            "radar/points": encode_points(build_message, columns, 0, "radar"),
            "image": encode_image(build_message, image, 0, "camera"),
        }
        self.node.create_subscription(message_class(TYPES["image"]), "depth/image_rect", self._on_depth, qos)
        self.node.create_timer(PERIOD_S, self._on_timer)

    def _on_timer(self) -> None:
        stamp = self.node.get_clock().now().to_msg()
        for topic, message in self._messages.items():
            message.header.stamp = stamp
            self._publishers[topic].publish(message)

    def _on_depth(self, message: Any) -> None:
        if self.first_depth_s is None:
            self.first_depth_s = time.perf_counter()


def first_depth_s(camera: CameraModel, log: Any) -> float:
    """Seconds from the start of the node's process to its first depth image."""
    rclpy.init()
    try:
        sensors = Sensors(camera)
        start_s = time.perf_counter()
        command = [sys.executable, "-c", START, "--ros-args", "-p", f"camera_from_radar:={RADAR_AT_CAMERA}"]
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        try:
            while sensors.first_depth_s is None:
                rclpy.spin_once(sensors.node, timeout_sec=0.05)
                if process.poll() is not None or time.perf_counter() - start_s > LIMIT_S:
                    raise SystemExit("the node gave no depth; give --log FILE and look there")
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(20)
        return sensors.first_depth_s - start_s
    finally:
        rclpy.try_shutdown()


def help_s(verb: str) -> float:
    """Seconds that `radcam-depth VERB --help` takes."""
    command = [sys.executable, "-m", "radcam_depth_ros.cli", *verb.split(), "--help"]
    start_s = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start_s


def measured(name: str, repeats: int, measure: Callable[[], float]) -> dict[str, Any]:
    """Repeats a measurement; prints and returns a row of the table.

    On a busy machine the time that the started processes had on a processor says more than the time that passed.
    """
    before_s = _children_cpu_s()
    values = [measure() for _ in range(repeats)]
    cpu_s = (_children_cpu_s() - before_s) / repeats
    row = {"name": name, "median_s": statistics.median(values), "min_s": min(values), "max_s": max(values)}
    print(f"{name:34s} {row['median_s']:8.2f} {row['min_s']:8.2f} {row['max_s']:8.2f} {cpu_s:8.2f}", flush=True)
    return {**row, "mean_cpu_s": cpu_s}


def _children_cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Measures, prints a table and writes JSON where it is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--size", default="448x800", help="rows x columns of the image")
    parser.add_argument("--log", type=Path, help="file for what the node logs")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    height, width = (int(value) for value in options.size.split("x"))
    camera = CameraModel(width, height, 630.0, 630.0, (width - 1) / 2, (height - 1) / 2)
    print(f"{'seconds':34s} {'median':>8s} {'min':>8s} {'max':>8s} {'CPU':>8s}")
    with (options.log or Path(os.devnull)).open("w", encoding="utf-8") as log:
        rows = [measured("start to first depth image", options.repeats, lambda: first_depth_s(camera, log))]
    for verb in VERBS:
        name = " ".join(["radcam-depth", *verb.split(), "--help"])
        rows.append(measured(name, options.repeats, functools.partial(help_s, verb)))
    if options.json:
        figures = {"cpus": os.cpu_count(), "load_1_min": os.getloadavg()[0], "size": options.size, "rows": rows}
        write_json(figures, options.json)


if __name__ == "__main__":
    main()
