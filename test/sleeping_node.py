"""The node as a process, with a network that is made up: `python sleeping_node.py PHASE --ros-args ...`.

It sleeps in one phase, `configure` or `inference`, since neither loading nor an inference can be interrupted; in any
other it gives each image a depth of 1 m at once.
"""

from __future__ import annotations

import functools
import sys
import time
from types import SimpleNamespace
from typing import Any

import numpy as np

from radcam_depth_ros.estimator import Computation, EstimatorConfig
from radcam_depth_ros.frame import CameraModel, DepthResult, Frame
from radcam_depth_ros.node import depth_node, main


class Sleeper:
    """In place of an estimator."""

    tells_classes = False
    only_size = None
    card = SimpleNamespace(focal_length_px=100.0)

    def __init__(self, phase: str, config: EstimatorConfig) -> None:
        self._phase = phase
        self._nap("configure")

    def _nap(self, phase: str) -> None:
        if phase == self._phase:
            print("busy", flush=True)
            time.sleep(60)

    def can_adjust(self, config: EstimatorConfig) -> bool:
        return True

    def adjust(self, config: EstimatorConfig) -> None:
        pass

    def warm_up(self, camera: CameraModel) -> None:
        pass

    def describe(self) -> str:
        return "a sleeper"

    @property
    def computation(self) -> Computation:
        return Computation("float32", 1, "")

    def prepare(self, frame: Frame) -> Any:
        return SimpleNamespace(frame=frame, radar=frame.radar.xyz_m)

    def run(self, inputs: Any) -> None:
        self._nap("inference")

    def finish(self, inputs: Any, depths: None, *, classes: bool) -> DepthResult:
        frame = inputs.frame
        dense = np.ones(frame.image.shape[:2], np.float32)
        return DepthResult(frame.stamp_ns, frame.frame_id, frame.camera, dense, dense, dense, len(frame.radar), None)


if __name__ == "__main__":
    node: Any = functools.partial(depth_node.RadcamDepthNode, functools.partial(Sleeper, sys.argv[1]))
    depth_node.RadcamDepthNode = node  # main takes it from there
    main(sys.argv[1:])
