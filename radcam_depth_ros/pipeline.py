"""The processing pipeline: build frames of messages, estimate their depth, encode it as messages.

The live node and the replay of a bag both use it, so both give the same depth for the same stamp.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from radcam_depth_ros.encoder import OUTPUTS, Encoder, OutputConfig
from radcam_depth_ros.estimator import Estimator, EstimatorConfig, NetworkInputs
from radcam_depth_ros.frame import DepthResult, Frame
from radcam_depth_ros.frame_builder import FrameBuilder, FrameBuilderConfig
from radcam_depth_ros.networks import Depths


class Pipeline:
    """Messages in, depth messages out, in three steps: `build`, `estimate`, `encode`.

    Each step may run in a thread of its own, but no step in two threads at once, but for `decode`.

    Args:
        frame_builder: Decodes and pairs.
        estimator: Runs the network.
        encoder: Makes the outgoing messages.
    """

    def __init__(self, frame_builder: FrameBuilder, estimator: Estimator, encoder: Encoder) -> None:
        self.frame_builder = frame_builder
        self.estimator = estimator
        self._encoder = encoder

    def adjust(self, frame_builder: FrameBuilderConfig, estimator: EstimatorConfig, output: OutputConfig) -> None:
        """Takes up configs that differ in what can change between two frames.

        Raises:
            RadcamDepthError: when more differs.
        """
        self.frame_builder.adjust(frame_builder)
        self.estimator.adjust(estimator)
        self._encoder.config = output

    def build(self, topic: str, message: Any, now_ns: int) -> tuple[Frame, ...]:
        """Takes one message and gives the frames that are complete now, see `FrameBuilder.add`."""
        return self.frame_builder.add(topic, message, now_ns)

    def decode(self, topic: str, message: Any) -> Any:
        """The first part of `build`, which may run in any thread, see `FrameBuilder.decode`."""
        return self.frame_builder.decode(topic, message)

    def take(self, topic: str, content: Any, now_ns: int, arrived_ns: int | None = None) -> tuple[Frame, ...]:
        """The last part of `build`, with what `decode` gave."""
        return self.frame_builder.take(topic, content, now_ns, arrived_ns)

    def estimate(self, frame: Frame, wanted: Collection[str]) -> DepthResult | None:
        """Estimates a frame's depth: `prepare`, the network, `finish`.

        Args:
            frame: The frame.
            wanted: Names of the outputs that `encode` is to make of it.

        Returns:
            The depth; None for a frame without radar returns in view where `without_radar` is `suppress`.

        Raises:
            RadcamDepthError: when the network cannot be given this frame.
        """
        inputs = self.prepare(frame)
        return None if inputs is None else self.finish(inputs, self.estimator.run(inputs), wanted)

    def prepare(self, frame: Frame) -> NetworkInputs | None:
        """The first part of `estimate`, before the network runs; None as there."""
        return None if self._is_suppressed(len(frame.radar)) else self.estimator.prepare(frame)

    def finish(self, inputs: NetworkInputs, depths: Depths, wanted: Collection[str]) -> DepthResult | None:
        """The last part of `estimate`, with what the network gave; None as there."""
        if self._is_suppressed(len(inputs.radar)):
            return None
        return self.estimator.finish(inputs, depths, classes=any(OUTPUTS[name].needs_classes for name in wanted))

    def encode(self, frame: Frame, result: DepthResult, wanted: Collection[str]) -> dict[str, Any]:
        """Encodes a frame's depth as messages, see `Encoder.encode`."""
        return self._encoder.encode(frame, result, wanted)

    def _is_suppressed(self, returns: int) -> bool:
        return not returns and self.frame_builder.config.without_radar == "suppress"
