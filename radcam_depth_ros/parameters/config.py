"""All that the node can be told, as one dataclass."""

from __future__ import annotations

from dataclasses import dataclass, field

from radcam_depth_ros.encoder import OutputConfig
from radcam_depth_ros.estimator import EstimatorConfig
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.frame_builder import COMPRESSED_SUFFIX, FrameBuilderConfig

IMAGE_TRANSPORTS = ("raw", "compressed", "compressed_topic")


class ParameterError(RadcamDepthError):
    """A parameter with a value that cannot be used."""


@dataclass(frozen=True)
class NodeConfig:
    """All that the node can be told.

    Attributes:
        autostart: Configure and activate without being asked.
        image_transport: `raw` takes sensor_msgs/Image, `compressed` takes sensor_msgs/CompressedImage beside the
            images' topic, as image_transport names it, `compressed_topic` on that topic itself.
        frame_builder: What is read, and how frames are made of it.
        estimator: How depth is estimated.
        output: How depth is written.
    """

    autostart: bool = True
    image_transport: str = "raw"
    frame_builder: FrameBuilderConfig = field(default_factory=FrameBuilderConfig)
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    output: OutputConfig = field(default_factory=OutputConfig)

    def __post_init__(self) -> None:
        if self.image_transport not in IMAGE_TRANSPORTS:
            raise ParameterError(
                f"image_transport must be one of {', '.join(IMAGE_TRANSPORTS)}, got {self.image_transport!r}"
            )

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
