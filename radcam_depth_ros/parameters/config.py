"""The node's config: one dataclass of all its parts."""

from __future__ import annotations

from dataclasses import dataclass, field

from radcam_depth_ros.encoder import OutputConfig
from radcam_depth_ros.estimator import EstimatorConfig
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.frame_builder import COMPRESSED_SUFFIX, FrameBuilderConfig
from radcam_depth_ros.setting import check_choices, setting

IMAGE_TRANSPORTS = ("raw", "compressed", "compressed_topic")


class ParameterError(RadcamDepthError):
    """A parameter with a value that cannot be used."""


@dataclass(frozen=True)
class NodeConfig:
    """All that the node can be told."""

    autostart: bool = setting(
        True,
        "Whether the node configures and activates itself at start. false leaves it to a lifecycle manager (nav2, ros2 "
        "lifecycle set).",
        read_only=True,
    )
    image_transport: str = setting(
        "raw",
        "Type of the images. raw: sensor_msgs/Image. compressed: sensor_msgs/CompressedImage, jpeg or png, on "
        "<image_topic>/compressed, as image_transport names it. compressed_topic: the same on image_topic itself.",
        choices=IMAGE_TRANSPORTS,
    )
    frame_builder: FrameBuilderConfig = field(default_factory=FrameBuilderConfig)
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    output: OutputConfig = field(default_factory=OutputConfig)

    def __post_init__(self) -> None:
        check_choices(self, ParameterError)

    @property
    def image_topic(self) -> str:
        """The images' topic as `image_transport` has it, before the node's namespace and remappings."""
        name = self.frame_builder.image
        if self.image_transport == "compressed":
            return f"{name.removesuffix(COMPRESSED_SUFFIX)}{COMPRESSED_SUFFIX}"
        return name

    @property
    def is_compressed(self) -> bool:
        """Whether the images are sensor_msgs/CompressedImage."""
        return self.image_transport != "raw"
