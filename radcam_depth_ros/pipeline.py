"""The only road from messages to depth: `accept` decodes and pairs, `process` estimates and encodes.

The live node and the replay of a bag both drive it, so that both give the same depth for the same stamp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from radcam_depth_ros.estimator import Estimator
from radcam_depth_ros.frame import CameraModel, DepthResult, Frame, ImageArray, RadcamDepthError
from radcam_depth_ros.geometry import CanonicalCamera
from radcam_depth_ros.intake import Intake, IntakeConfig
from radcam_depth_ros.messages import (
    DEPTH_ENCODINGS,
    MessageFactory,
    encode_camera_info,
    encode_cloud,
    encode_confidence,
    encode_depth,
    encode_image,
    encode_preview,
)
from radcam_depth_ros.resampling import rectify, resample_image

OUTPUT_TOPICS = {
    "depth": "depth/image_rect",
    "depth_camera_info": "depth/camera_info",
    "semi_dense": "semi_dense/image_rect",
    "semi_dense_camera_info": "semi_dense/camera_info",
    "confidence": "depth/confidence",
    "preview": "depth/preview",
    "points": "depth/points",
    "classes": "semantics/image",
}
"""Relative topic of each field of `DepthMessages`."""


class PipelineError(RadcamDepthError):
    """A setting of the pipeline that does not fit."""


@dataclass(frozen=True)
class PipelineConfig(IntakeConfig):
    """What the pipeline reads, see `IntakeConfig`, and how it writes.

    Attributes:
        depth_encoding: `32FC1` metres with NaN for "no value", or `16UC1` millimetres with 0.
        preview_near_m: Depth of the preview's warmest colour, metres.
        preview_far_m: Depth of the preview's coldest colour, metres.
    """

    depth_encoding: str = "32FC1"
    preview_near_m: float = 2.0
    preview_far_m: float = 80.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.depth_encoding not in DEPTH_ENCODINGS:
            raise PipelineError(
                f"depth_encoding must be one of {', '.join(DEPTH_ENCODINGS)}, got {self.depth_encoding!r}"
            )
        if not 0 < self.preview_near_m < self.preview_far_m:
            raise PipelineError(
                f"the preview needs 0 < preview_near_m < preview_far_m, got {self.preview_near_m} and "
                f"{self.preview_far_m}"
            )


@dataclass(frozen=True)
class DepthMessages:
    """What one frame gives.

    Attributes:
        result: The depth, as arrays.
        depth: sensor_msgs/Image, dense.
        depth_camera_info: sensor_msgs/CameraInfo of the depth images.
        semi_dense: sensor_msgs/Image, stage 1.
        semi_dense_camera_info: The same, for the sibling topic.
        confidence: sensor_msgs/Image, 32FC1, 0 to 1.
        preview: sensor_msgs/Image, rgb8; None when it was not asked for.
        points: sensor_msgs/PointCloud2; None when it was not asked for.
        classes: sensor_msgs/Image, mono8, the numbers of `classes.CLASS_NAMES`; None when it was not asked for, and of
            a network that does not tell.
    """

    result: DepthResult
    depth: Any
    depth_camera_info: Any
    semi_dense: Any
    semi_dense_camera_info: Any
    confidence: Any
    preview: Any = None
    points: Any = None
    classes: Any = None


class Pipeline(Intake):
    """Messages in, depth messages out.

    Not for several threads at once, with one exception: `process`, or `estimate` and `encode`, may run in one thread
    while another calls the rest.

    Args:
        config: What to read and how to write.
        estimator: The loaded network.
        factory: Builds the outgoing messages.
    """

    def __init__(self, config: PipelineConfig, estimator: Estimator, factory: MessageFactory) -> None:
        super().__init__(config)
        self._output = config
        self._estimator = estimator
        self._factory = factory

    def warm_up(self, camera: CameraModel) -> None:
        """Makes the network ready for a camera's images; at once where it is."""
        self._estimator.warm_up(camera)

    def process(
        self, frame: Frame, *, preview: bool = False, points: bool = False, classes: bool = False
    ) -> DepthMessages:
        """Estimates a frame's depth and writes it as messages.

        Args:
            frame: From `accept`, `expire` or `flush`.
            preview: Whether to draw the depth in colours.
            points: Whether to make a point cloud.
            classes: Whether to make the class image, where the network tells.

        Raises:
            RadcamDepthError: when the network cannot be given this frame.
        """
        return self.encode(frame, self.estimate(frame, classes=classes), preview=preview, points=points)

    def estimate(self, frame: Frame, *, classes: bool = False) -> DepthResult:
        """Estimates a frame's depth: the first half of `process`, which `encode` follows.

        Args:
            frame: From `accept`, `expire` or `flush`.
            classes: Whether to make the class image, where the network tells.

        Raises:
            RadcamDepthError: when the network cannot be given this frame.
        """
        return self._estimator.estimate(frame, classes=classes)

    def encode(
        self, frame: Frame, result: DepthResult, *, preview: bool = False, points: bool = False
    ) -> DepthMessages:
        """Writes a frame's depth as messages; the images' memory becomes theirs.

        Args:
            frame: The frame.
            result: What was estimated of it; its classes, where it has them, are written as well.
            preview: Whether to draw the depth in colours.
            points: Whether to make a point cloud.
        """
        factory, config, stamp = self._factory, self._output, (frame.stamp_ns, frame.frame_id)
        camera_info = encode_camera_info(factory, result.camera, *stamp)
        return DepthMessages(
            result=result,
            depth=encode_depth(factory, result.dense, *stamp, encoding=config.depth_encoding),
            depth_camera_info=camera_info,
            semi_dense=encode_depth(factory, result.semi_dense, *stamp, encoding=config.depth_encoding),
            semi_dense_camera_info=camera_info,
            confidence=encode_confidence(factory, result.confidence, *stamp),
            preview=encode_preview(factory, result.dense, config.preview_near_m, config.preview_far_m, *stamp)
            if preview
            else None,
            points=encode_cloud(factory, result.dense, image_at(frame, result.camera), result.camera, *stamp)
            if points
            else None,
            classes=None if result.classes is None else encode_image(factory, result.classes, *stamp),
        )


def image_at(frame: Frame, camera: CameraModel) -> ImageArray:
    """The frame's image, rectified, at the size of its depth, for colours and pictures."""
    if camera == frame.camera:
        return rectify(frame.image, camera, frame.lens)
    return resample_image(frame.image, CanonicalCamera(frame.camera, camera, camera), frame.lens)
