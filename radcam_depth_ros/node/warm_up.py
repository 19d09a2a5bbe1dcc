"""Warms up the network as soon as camera_info is known, before the first image."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.node.health import SECOND_NS
from radcam_depth_ros.node.mailbox import Worker
from radcam_depth_ros.pipeline import Pipeline


class WarmUp:
    """Warms up the network for each new camera, in the thread that runs it.

    Args:
        pipeline: It knows the camera and has the network.
        worker: Its thread runs the network, so callbacks go on, and the thread's own OpenMP threads are started.
        on_error: Called in that thread with what went wrong.

    Attributes:
        camera: The camera that the network is being warmed up for; None while it is not.
    """

    def __init__(self, pipeline: Pipeline, worker: Worker[Any], on_error: Callable[[Exception], None]) -> None:
        self._pipeline = pipeline
        self._worker = worker
        self._on_error = on_error
        self._last: CameraModel | None = None
        self._ended_ns = 0
        self.camera: CameraModel | None = None

    def follow(self) -> None:
        """Looks at the pipeline's camera, and has the network warmed up where that is another than before."""
        camera = self._pipeline.frame_builder.camera
        if camera is not None and camera != self._last:
            self._last = self.camera = camera
            self._worker.prepare(partial(self._warm_up, camera))

    def age_s(self) -> float:
        """Seconds since the network was last warmed up; 0 while it is being warmed up, endless where it never was."""
        if self.camera is not None:
            return 0.0
        return (time.monotonic_ns() - self._ended_ns) / SECOND_NS if self._ended_ns else float("inf")

    def _warm_up(self, camera: CameraModel) -> None:
        self.camera = camera
        try:
            self._pipeline.estimator.warm_up(camera)
        except Exception as error:  # the boundary: a camera must never take the worker down
            self._on_error(error)
        finally:
            self._ended_ns = time.monotonic_ns()
            # Where yet another camera came meanwhile, its own preparation is next.
            if self.camera is camera:
                self.camera = None
