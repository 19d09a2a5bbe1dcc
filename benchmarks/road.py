"""Everything but the network, message in to message out, at 900 x 1600: median and p99 of each part.

Run it from the repository's root: `python -m benchmarks.road`, with `--json FILE` for the figures, `--ros` for rclpy's
messages in place of rosbags', and `--frames 200` for a finer p99. The network is a stub without cost. The column "cpu"
is the processor time of all threads, which other programs on the machine disturb less than the wall's.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np
import torch
from rich.console import Console
from rich.table import Table
from torch import Tensor, nn

from radcam_depth_ros.bags import factory as bag_factory
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.encoder import OUTPUTS, Encoder, OutputConfig
from radcam_depth_ros.estimator import Estimator
from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.frame_builder import FrameBuilder, FrameBuilderConfig
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import (
    MessageFactory,
    StampedTransform,
    decode_image,
    decode_radar,
    encode_camera_info,
    encode_image,
    encode_points,
    encode_transforms,
)
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.networks.weights_io.archive import Archive, Card
from radcam_depth_ros.pipeline import Pipeline

CAMERA = CameraModel(1600, 900, 1266.0, 1266.0, 816.0, 491.5)
DISTORTION = np.array([-0.3, 0.1, 0.001, 0.001, 0.0])
RETURNS = 200
WARM_UP_FRAMES = 5
WRITTEN = tuple(name for name, output in OUTPUTS.items() if not output.is_on_demand)
CONFIG = FrameBuilderConfig(image="/image", camera_info="/camera_info", radars=("/radar",))


class NoCost(nn.Module):
    """Maps that are there already, of the size that the camera's images have for the network."""

    def __init__(self) -> None:
        super().__init__()
        self.dense = nn.Parameter(torch.rand(1, 1, 448, 800) * 50 + 1)
        self.semi_dense = nn.Parameter(torch.rand(1, 1, 112, 200) * 50 + 1)

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        """The maps, whatever the image."""
        return Depths(self.dense, self.semi_dense, self.dense)


class Stopwatch:
    """Wall and processor seconds of each part."""

    def __init__(self) -> None:
        self.parts: dict[str, list[tuple[float, float]]] = {}

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Times what is inside."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        spent = (time.perf_counter() - wall, time.process_time() - cpu)
        self.parts.setdefault(name, []).append(spent)

    def summary(self) -> dict[str, dict[str, float]]:
        """Milliseconds of each part: median and p99 of the wall's, median of the processor's."""
        rows = {name: 1e3 * np.array(spent[WARM_UP_FRAMES:]) for name, spent in self.parts.items()}
        return {
            name: {
                "median_ms": float(np.median(row[:, 0])),
                "p99_ms": float(np.percentile(row[:, 0], 99)),
                "cpu_ms": float(np.median(row[:, 1])),
            }
            for name, row in rows.items()
        }


def messages(
    make: MessageFactory, image: np.ndarray, encoding: str, distorted: bool, stamp: int
) -> tuple[Any, Any, Any]:
    """One frame's image, camera_info and cloud."""
    rng = np.random.default_rng(stamp)
    columns = rng.uniform(1, 60, (4, RETURNS)).astype(np.float32)
    columns[1] -= 30
    names = ("x", "y", "rcs", "v_doppler_mps")
    cloud = encode_points(make, dict(zip(names, columns, strict=True)), stamp, "radar")
    info = encode_camera_info(make, CAMERA, stamp, "camera")
    picture = encode_image(make, image, stamp, "camera")
    # rosbags' messages are frozen.
    object.__setattr__(picture, "encoding", encoding) if make is bag_factory else setattr(picture, "encoding", encoding)
    if distorted:
        changed = encode_distortion(make, stamp)
        object.__setattr__(info, "d", changed) if make is bag_factory else setattr(info, "d", changed)
    return picture, info, cloud


def encode_distortion(make: MessageFactory, stamp: int) -> Any:
    """Coefficients as the factory's messages hold them."""
    return make("sensor_msgs/msg/CameraInfo", d=DISTORTION).d


def measure(make: MessageFactory, estimator: Estimator, encoding: str, distorted: bool, frames: int) -> Stopwatch:
    """Times `frames` frames, part by part."""
    pipeline, watch = Pipeline(FrameBuilder(CONFIG), estimator, Encoder(OutputConfig(), make)), Stopwatch()
    along = RigidTransform(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([0.1, 0.2, -1.0]))
    down = RigidTransform(along.rotation, np.array([0.0, 1.5, -1.0]))
    links = [StampedTransform("camera", "radar", 0, along), StampedTransform("camera", "base_footprint", 0, down)]
    pipeline.build("/tf_static", encode_transforms(bag_factory, links), 0)
    noise = np.random.default_rng(0).integers(0, 255, (90, 160, 3), dtype=np.uint8)
    image = cv2.resize(noise, (CAMERA.width, CAMERA.height))
    for index in range(frames + WARM_UP_FRAMES):
        stamp = 10**9 + index * 10**8
        picture, info, cloud = messages(make, image, encoding, distorted, stamp)
        with watch.part("decode image"):
            decode_image(picture)
        with watch.part("decode cloud"):
            decode_radar(cloud)
        # The decoding above was only for its own figure: what follows is the whole way, decoding included.
        with watch.part("all"):
            with watch.part("accept camera_info, cloud and image"):
                pipeline.build("/camera_info", info, stamp)
                pipeline.build("/radar", cloud, stamp)
                (frame,) = pipeline.build("/image", picture, stamp)
            with watch.part("rectify, resample and place radar"):
                inputs = estimator.prepare(frame)
            with watch.part("to the device, to float"):
                depths = estimator.run(inputs)
            with watch.part("resample back"):
                result = estimator.finish(inputs, depths)
            with watch.part("encode"):
                pipeline.encode(frame, result, WRITTEN)
    return watch


def main() -> None:
    """Prints a table for each camera and encoding, or all as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    parser.add_argument("--ros", action="store_true", help="build rclpy's messages")
    parser.add_argument("--frames", type=int, default=100, help="how many frames to time")
    options = parser.parse_args()
    make: Callable[..., Any] = bag_factory
    if options.ros:
        from radcam_depth_ros.node.topics.factory import build_message as make  # not on a machine without ROS
    estimator = Estimator(loaded=Archive(NoCost(), Card("stub", {}, 630.0, 1.0, 100.0, "nothing")))
    found = {
        f"{camera}, {encoding}": measure(make, estimator, encoding, camera == "distorted", options.frames).summary()
        for camera in ("ideal", "distorted")
        for encoding in ("rgb8", "bgr8")
    }
    if options.json:
        write_json(found, options.json)
    if options.json == "-":
        return
    for title, parts in found.items():
        table = Table("part", "median ms", "p99 ms", "cpu ms", title=f"{CAMERA.height} x {CAMERA.width}, {title}")
        for name, row in parts.items():
            table.add_row(name, *(f"{value:.2f}" for value in row.values()))
        Console().print(table)


if __name__ == "__main__":
    main()
