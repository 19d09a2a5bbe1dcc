"""The only road from messages to depth: `accept` decodes and pairs, `process` estimates and encodes.

The live node and the replay of a bag both drive it, so that both give the same depth for the same stamp.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

from radcam_depth_ros.estimator import Estimator
from radcam_depth_ros.frame import CameraModel, DepthResult, Frame, ImageArray, RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilder, FrameBuilderConfig
from radcam_depth_ros.geometry import CanonicalCamera
from radcam_depth_ros.messages import (
    COLORMAPS,
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
class OutputConfig:
    """How depth is written.

    Attributes:
        depth_encoding: `32FC1` metres with NaN for "no value", or `16UC1` millimetres with 0.
        preview_colormap: Colours of the preview, one of `COLORMAPS`.
        preview_near_m: What is nearer, in metres, has the preview's first colour.
        preview_far_m: What is further, in metres, has the preview's last colour.
        points_stride: The point cloud has a point for each square of so many pixels' width.
        points_near_m: What is nearer, in metres, gives no point.
        points_far_m: What is further, in metres, gives no point.
    """

    depth_encoding: str = "32FC1"
    preview_colormap: str = "turbo"
    preview_near_m: float = 2.0
    preview_far_m: float = 80.0
    points_stride: int = 1
    points_near_m: float = 0.0
    points_far_m: float = 1000.0

    def __post_init__(self) -> None:
        for name, known in (("depth_encoding", DEPTH_ENCODINGS), ("preview_colormap", COLORMAPS)):
            if getattr(self, name) not in known:
                raise PipelineError(f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}")
        if not 0 < self.preview_near_m < self.preview_far_m:
            raise PipelineError(
                f"the preview needs 0 < preview_near_m < preview_far_m, got {self.preview_near_m} and "
                f"{self.preview_far_m}"
            )
        if self.points_stride < 1:
            raise PipelineError(f"points_stride must be 1 (each pixel) or more, got {self.points_stride}")
        if not 0 <= self.points_near_m < self.points_far_m:
            raise PipelineError(
                f"the point cloud needs 0 <= points_near_m < points_far_m, got {self.points_near_m} and "
                f"{self.points_far_m}"
            )


@dataclass(frozen=True)
class PipelineConfig(FrameBuilderConfig):
    """What the pipeline reads, see `FrameBuilderConfig`, and how it writes.

    Attributes:
        output: How it writes.
    """

    output: OutputConfig = field(default_factory=OutputConfig)

    @classmethod
    def of(cls, frame_builder: FrameBuilderConfig, output: OutputConfig) -> PipelineConfig:
        """The config of its two parts."""
        return cls(
            **{entry.name: getattr(frame_builder, entry.name) for entry in fields(FrameBuilderConfig)}, output=output
        )

    @property
    def frame_builder(self) -> FrameBuilderConfig:
        """What is read, without how it is written."""
        return FrameBuilderConfig(**{entry.name: getattr(self, entry.name) for entry in fields(FrameBuilderConfig)})


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


class Pipeline(FrameBuilder):
    """Messages in, depth messages out.

    Not for several threads at once, with one exception: `process` or its halves may run in one thread while another
    calls the rest.

    Args:
        config: What to read and how to write.
        estimator: The loaded network.
        factory: Builds the outgoing messages.
    """

    config: PipelineConfig
    ADJUSTABLE: ClassVar[tuple[str, ...]] = (*FrameBuilder.ADJUSTABLE, "output")

    def __init__(self, config: PipelineConfig, estimator: Estimator, factory: MessageFactory) -> None:
        super().__init__(config)
        self._estimator = estimator
        self._factory = factory

    def warm_up(self, camera: CameraModel) -> None:
        """Makes the network ready for a camera's images; at once where it is."""
        self._estimator.warm_up(camera)

    def process(
        self, frame: Frame, *, preview: bool = False, points: bool = False, classes: bool = False
    ) -> DepthMessages | None:
        """Estimates a frame's depth and writes it as messages; None where it is suppressed, see `estimate`.

        Args:
            frame: From `accept`, `expire` or `flush`.
            preview: Whether to draw the depth in colours.
            points: Whether to make a point cloud.
            classes: Whether to make the class image, where the network tells.

        Raises:
            RadcamDepthError: when the network cannot be given this frame.
        """
        result = self.estimate(frame, classes=classes)
        return None if result is None else self.encode(frame, result, preview=preview, points=points)

    def estimate(self, frame: Frame, *, classes: bool = False) -> DepthResult | None:
        """Estimates a frame's depth: the first half of `process`, which `encode` follows.

        Args:
            frame: From `accept`, `expire` or `flush`.
            classes: Whether to make the class image, where the network tells.

        Returns:
            The depth; None of a frame without radar returns in view where `without_radar` is `suppress`.

        Raises:
            RadcamDepthError: when the network cannot be given this frame.
        """
        if self.is_suppressed(len(frame.radar)):
            return None
        result = self._estimator.estimate(frame, classes=classes)
        return None if self.is_suppressed(result.radar_in_view) else result

    def is_suppressed(self, returns: int) -> bool:
        """Whether a frame with so many radar returns in view is to give no depth."""
        return not returns and self.config.without_radar == "suppress"

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
        factory, config, stamp = self._factory, self.config.output, (frame.stamp_ns, frame.frame_id)
        camera_info = encode_camera_info(factory, result.camera, *stamp)
        return DepthMessages(
            result=result,
            depth=encode_depth(factory, result.dense, *stamp, encoding=config.depth_encoding),
            depth_camera_info=camera_info,
            semi_dense=encode_depth(factory, result.semi_dense, *stamp, encoding=config.depth_encoding),
            semi_dense_camera_info=camera_info,
            confidence=encode_confidence(factory, result.confidence, *stamp),
            preview=encode_preview(
                factory,
                result.dense,
                config.preview_near_m,
                config.preview_far_m,
                *stamp,
                colormap=config.preview_colormap,
            )
            if preview
            else None,
            points=encode_cloud(
                factory,
                result.dense,
                image_at(frame, result.camera),
                result.camera,
                *stamp,
                stride=config.points_stride,
                near_m=config.points_near_m,
                far_m=config.points_far_m,
            )
            if points
            else None,
            classes=None if result.classes is None else encode_image(factory, result.classes, *stamp),
        )


def image_at(frame: Frame, camera: CameraModel) -> ImageArray:
    """The frame's image, rectified, at the size of its depth, for colours and pictures."""
    if camera == frame.camera:
        return rectify(frame.image, camera, frame.lens)
    return resample_image(frame.image, CanonicalCamera(frame.camera, camera, camera), frame.lens)
