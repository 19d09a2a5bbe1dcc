"""Encodes a frame's depth as ROS messages; the table `OUTPUTS` has every output topic with its type and its encoder.

The node's publishers, the bag of a replay, the README's table and the launch file's arguments all follow this table.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from radcam_depth_ros.frame import SKY_FROM, CameraModel, DepthResult, FloatArray, Frame, ImageArray, RadcamDepthError
from radcam_depth_ros.geometry import CanonicalCamera
from radcam_depth_ros.messages import (
    COLORMAPS,
    DEPTH_ENCODINGS,
    MessageFactory,
    encode_camera_info,
    encode_cloud,
    encode_compressed_depth,
    encode_confidence,
    encode_depth,
    encode_image,
    encode_preview,
    png_problem,
)
from radcam_depth_ros.resampling import rectify, resample_image
from radcam_depth_ros.setting import check_choices, setting

SKIES = ("infinity", "none")


class EncoderError(RadcamDepthError):
    """An output setting that cannot be used."""


@dataclass(frozen=True)
class OutputConfig:
    """How depth is written."""

    depth_encoding: str = setting(
        "32FC1",
        'Encoding of depth images (REP 118). 32FC1 is metres with NaN for "no value", 16UC1 millimetres with 0.',
        choices=DEPTH_ENCODINGS,
        live=True,
    )
    preview_colormap: str = setting(
        "turbo",
        "Colours of depth/preview. In turbo and jet near is red, in the others light; black means no value.",
        choices=COLORMAPS,
        live=True,
    )
    preview_near_m: float = setting(
        2.0, "Depth of the preview's first colour, in metres; all that is nearer has it too.", 0.01, 1000.0, live=True
    )
    preview_far_m: float = setting(
        80.0, "Depth of the preview's last colour, in metres; all that is farther has it too.", 0.01, 1000.0, live=True
    )
    min_confidence: float = setting(
        0.0,
        "Minimum confidence of published dense depth: below it there is no value and no point. It leaves the sky as it "
        "is.",
        0.0,
        1.0,
        live=True,
    )
    points_stride: int = setting(
        1, "Pixel step of depth/points: 1 makes a point of each pixel, 4 of a sixteenth of them.", 1, 64, live=True
    )
    points_near_m: float = setting(0.0, "Minimum depth of published points, in metres.", 0.0, 1000.0, live=True)
    points_far_m: float = setting(1000.0, "Maximum depth of published points, in metres.", 0.0, 1000.0, live=True)
    points_min_confidence: float = setting(
        0.1,
        "Minimum confidence of published points; min_confidence counts for them as well.",
        0.0,
        1.0,
        live=True,
    )
    points_organized: bool = setting(
        False,
        "Whether depth/points has the height and width of the depth image, over points_stride, with NaN where a pixel "
        "gives no point. false: it has the points alone.",
        live=True,
    )
    points_max_rate_hz: float = setting(
        0.0, "Maximum rate of depth/points, in clouds a second by their stamps; 0 is no limit.", 0.0, 1000.0, live=True
    )
    sky: str = setting(
        "infinity",
        "Dense depth of pixels that show the sky, where the network tells them: infinity is +Inf (REP 117: beyond the "
        "range), none is NaN. Both are 0 in 16UC1, and give no point.",
        choices=SKIES,
        live=True,
    )

    def __post_init__(self) -> None:
        check_choices(self, EncoderError)
        if not 0 < self.preview_near_m < self.preview_far_m:
            raise EncoderError(
                f"the preview needs 0 < preview_near_m < preview_far_m, got {self.preview_near_m} and "
                f"{self.preview_far_m}"
            )
        if self.points_stride < 1:
            raise EncoderError(f"points_stride must be 1 (each pixel) or more, got {self.points_stride}")
        if not 0 <= self.points_near_m < self.points_far_m:
            raise EncoderError(
                f"the point cloud needs 0 <= points_near_m < points_far_m, got {self.points_near_m} and "
                f"{self.points_far_m}"
            )


@dataclass(frozen=True)
class EncoderInput:
    """Everything that an output's encoder may use.

    Attributes:
        factory: Builds messages.
        config: How depth is written.
        frame: The frame.
        result: Its depth.
    """

    factory: MessageFactory
    config: OutputConfig
    frame: Frame
    result: DepthResult

    @property
    def stamp(self) -> tuple[int, str]:
        """Stamp (ns) and frame_id of the messages."""
        return self.frame.stamp_ns, self.frame.frame_id

    @cached_property
    def dense(self) -> FloatArray:
        """The dense depth as it is published, (H, W) float32 metres: without what is doubtful, and without the sky."""
        sky, dense, config = self.result.sky, self.result.dense, self.config
        if config.min_confidence > 0:
            # NaN is no confidence.
            doubtful = ~(self.result.confidence >= np.float32(config.min_confidence))
            np.copyto(dense, np.float32(np.nan), where=doubtful)
        if sky is not None:
            value = np.float32(np.inf if config.sky == "infinity" else np.nan)
            np.copyto(dense, value, where=sky >= SKY_FROM)
        return dense

    @cached_property
    def camera_info(self) -> Any:
        """sensor_msgs/CameraInfo of the depth images."""
        return encode_camera_info(self.factory, self.result.camera, *self.stamp)


class Replayed(enum.Enum):
    """When a replay writes an output."""

    ALWAYS = "always"
    WITH_OPTION = "with the option of its name"
    NEVER = "never"


@dataclass(frozen=True)
class Output:
    """One output topic.

    Attributes:
        name: Its key in `OUTPUTS`.
        topic: Topic name, relative to the node's namespace.
        type_name: Message type.
        encode: Makes the message.
        description: What the message holds, for the README.
        is_on_demand: The node makes it only while the topic has a subscriber.
        needs_classes: Only networks with a class output have it.
        replayed: When a replay writes it.
        problem: Says why it cannot be made on this machine; an empty text where it can.
    """

    name: str
    topic: str
    type_name: str
    encode: Callable[[EncoderInput], Any]
    description: str
    is_on_demand: bool = False
    needs_classes: bool = False
    replayed: Replayed = Replayed.ALWAYS
    problem: Callable[[], str] = str


def _depth(given: EncoderInput) -> Any:
    return encode_depth(given.factory, given.dense, *given.stamp, encoding=given.config.depth_encoding)


def _compressed_depth(given: EncoderInput) -> Any:
    return encode_compressed_depth(given.factory, given.dense, *given.stamp, encoding=given.config.depth_encoding)


def _semi_dense(given: EncoderInput) -> Any:
    return encode_depth(given.factory, given.result.semi_dense, *given.stamp, encoding=given.config.depth_encoding)


def _camera_info(given: EncoderInput) -> Any:
    return given.camera_info


def _confidence(given: EncoderInput) -> Any:
    return encode_confidence(given.factory, given.result.confidence, *given.stamp)


def _preview(given: EncoderInput) -> Any:
    config = given.config
    range_m = (config.preview_near_m, config.preview_far_m)
    return encode_preview(given.factory, given.dense, *range_m, *given.stamp, colormap=config.preview_colormap)


def _points(given: EncoderInput) -> Any:
    config, result = given.config, given.result
    return encode_cloud(
        given.factory,
        given.dense,
        image_at(given.frame, result.camera),
        result.confidence,
        result.camera,
        *given.stamp,
        stride=config.points_stride,
        near_m=config.points_near_m,
        far_m=config.points_far_m,
        min_confidence=config.points_min_confidence,
        organized=config.points_organized,
    )


def _semantics(given: EncoderInput) -> Any:
    return encode_image(given.factory, given.result.classes, *given.stamp)  # type: ignore[arg-type]  # needs_classes


_IMAGE, _CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
OUTPUTS = {
    output.name: output
    for output in (
        Output(
            "depth",
            "depth/image_rect",
            _IMAGE,
            _depth,
            'Dense depth: 32FC1 in metres, or 16UC1 in millimetres with 0 for "no value" (`depth_encoding`).',
        ),
        Output(
            "compressed_depth",
            "depth/image_rect/compressedDepth",
            "sensor_msgs/msg/CompressedImage",
            _compressed_depth,
            "Dense depth as image_transport's compressedDepth plugin writes it, a PNG of 16 bits.",
            is_on_demand=True,
            replayed=Replayed.WITH_OPTION,
            problem=png_problem,
        ),
        Output(
            "depth_camera_info",
            "depth/camera_info",
            _CAMERA_INFO,
            _camera_info,
            "Calibration of the dense depth image, as depth_image_proc expects it.",
        ),
        Output(
            "semi_dense",
            "semi_dense/image_rect",
            _IMAGE,
            _semi_dense,
            "Semi-dense depth: depth of the associated radar return where both stages are confident, NaN elsewhere.",
        ),
        Output(
            "semi_dense_camera_info",
            "semi_dense/camera_info",
            _CAMERA_INFO,
            _camera_info,
            "Calibration of the semi-dense depth image.",
        ),
        Output(
            "confidence",
            "depth/confidence",
            _IMAGE,
            _confidence,
            "32FC1, 0 to 1: probability that the dense depth is within 10 % of the truth.",
        ),
        Output(
            "preview",
            "depth/preview",
            _IMAGE,
            _preview,
            "rgb8, dense depth in colours: near is warm or light (`preview_colormap`).",
            is_on_demand=True,
            replayed=Replayed.WITH_OPTION,
        ),
        Output(
            "points",
            "depth/points",
            "sensor_msgs/msg/PointCloud2",
            _points,
            "Dense depth as points x y z rgb confidence, thinned by `points_stride`.",
            is_on_demand=True,
            replayed=Replayed.WITH_OPTION,
        ),
        Output(
            "semantics",
            "semantics/image",
            _IMAGE,
            _semantics,
            "mono8, the Cityscapes class (0 to 18) of each pixel, at the size of the dense depth.",
            is_on_demand=True,
            needs_classes=True,
        ),
    )
}
"""Every output topic, by name."""


class Pace:
    """Leaves out what comes at more than a rate, by stamps, so that live and replayed depth are thinned alike."""

    def __init__(self) -> None:
        self._due_ns: int | None = None

    def is_due(self, stamp_ns: int, rate_hz: float) -> bool:
        """Whether the next one may be made; it is counted then. A rate of 0 is no limit.

        What is due is a time table, and a quarter of a period early is on time: so stamps that jitter keep the rate.
        """
        if rate_hz <= 0:
            self._due_ns = None
            return True
        period_ns = round(1e9 / rate_hz)
        slack_ns = period_ns // 4
        early_ns = 0 if self._due_ns is None else self._due_ns - stamp_ns
        if slack_ns < early_ns <= period_ns + slack_ns:
            return False
        # After a pause, or a jump back, the time table begins anew.
        is_on_time = self._due_ns is not None and -period_ns < early_ns <= slack_ns
        self._due_ns = stamp_ns + period_ns + (early_ns if is_on_time else 0)
        return True


class Encoder:
    """Encodes depth as messages.

    Args:
        config: How depth is written; may be replaced between two frames.
        factory: Builds the messages.
    """

    def __init__(self, config: OutputConfig, factory: MessageFactory) -> None:
        self.config = config
        self._factory = factory
        self._points_pace = Pace()

    def encode(self, frame: Frame, result: DepthResult, wanted: Collection[str]) -> dict[str, Any]:
        """Encodes a frame's depth; the images' memory becomes the messages'.

        Args:
            frame: The frame.
            result: Its depth.
            wanted: Names of the outputs to make.

        Returns:
            A message for each wanted output, by its name; those that need classes only where the result has classes,
            points only where `points_max_rate_hz` lets them.
        """
        given = EncoderInput(self._factory, self.config, frame, result)
        return {
            name: output.encode(given)
            for name, output in OUTPUTS.items()
            if name in wanted
            and not (output.needs_classes and result.classes is None)
            and (name != "points" or self._points_pace.is_due(frame.stamp_ns, self.config.points_max_rate_hz))
        }


def image_at(frame: Frame, camera: CameraModel) -> ImageArray:
    """The frame's image, rectified, at the size of its depth."""
    if camera == frame.camera:
        return rectify(frame.image, camera, frame.lens)
    return resample_image(frame.image, CanonicalCamera(frame.camera, camera, camera), frame.lens)
