"""Replays a bag through the pipeline: every frame, in order, with the same depth as in the live node.

Reading, the network and writing have a thread each, so that the network need not wait for the other two.
"""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

from radcam_depth_ros.bags import BagMessage, BagReader, BagWriter, factory
from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.drive import DriveSettings, DriveWarning, motion_topics, prime, remarks
from radcam_depth_ros.encoder import OUTPUTS, Encoder, OutputConfig, Replayed
from radcam_depth_ros.estimator import Estimator, NetworkInputs
from radcam_depth_ros.frame import Frame, RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilder
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.pairing import unset_stamps
from radcam_depth_ros.pipeline import Pipeline

_FRAMES_UNDER_WAY = 2
"""One that the network is given while another is written; more would only cost memory."""
_MESSAGES_UNDER_WAY = 64


@dataclass(frozen=True)
class ReplayOptions:
    """What a replay writes.

    Attributes:
        namespace: Put before the depth topics, `/` for the node's own names.
        output: How depth is written.
        passthrough: Copy all messages of the input as well.
        also: Names of the outputs to write besides those that a replay always writes.
        overwrite: Replace a bag that is there.
        compress: Compress the output (zstd): about half the size, and more work than all else but the network.
    """

    namespace: str = "/"
    output: OutputConfig = field(default_factory=OutputConfig)
    passthrough: bool = False
    also: tuple[str, ...] = ()
    overwrite: bool = False
    compress: bool = False

    @property
    def wanted(self) -> tuple[str, ...]:
        """Names of all outputs to write."""
        always = (name for name, output in OUTPUTS.items() if output.replayed is Replayed.ALWAYS)
        return (*always, *self.also)


@dataclass(frozen=True)
class ReplaySummary:
    """What a replay did.

    Attributes:
        topics: The sensors that were read.
        images: Images in the input.
        frames: Depth images written.
        without_radar: Images that had no radar return in view; with `without_radar: suppress` they have no depth image.
    """

    topics: SensorTopics
    images: int
    frames: int
    without_radar: int


def replay(
    source: Path | str,
    target: Path | str,
    estimator: Estimator,
    settings: DriveSettings | None = None,
    options: ReplayOptions | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ReplaySummary:
    """Writes the depth of every image of a bag to another bag.

    Args:
        source: Rosbag2 folder or .mcap file.
        target: Bag to write; complete or not there at all.
        estimator: The loaded network.
        settings: How the input is read.
        options: What is written.
        progress: Called with (frames done, images in all).

    Raises:
        RadcamDepthError: for anything wrong with the input; nothing of the output remains then.
    """
    settings, options = settings or DriveSettings(), options or ReplayOptions()
    with BagReader(source) as reader:
        topics = settings.find_topics(reader)
        frame_builder = FrameBuilder(settings.frame_builder_of(topics))
        pipeline = Pipeline(frame_builder, estimator, Encoder(options.output, factory))
        prime(reader, frame_builder, topics)
        images = reader.count([topics.image])
        moving = motion_topics(topics, frame_builder.config)
        sensors = {topics.image, topics.camera_info, *topics.radars, *moving}
        now_ns = 0
        with (
            BagWriter(target, overwrite=options.overwrite, compress=options.compress) as writer,
            _Line(pipeline, writer, options, lambda done: progress(done, images) if progress else None) as line,
        ):
            for message in reader.messages(None if options.passthrough else sensors):
                now_ns = message.log_time_ns
                if options.passthrough:
                    line.copy(message)
                frames = frame_builder.expire(now_ns)
                if message.topic in sensors:
                    try:
                        topic = moving.get(message.topic, message.topic)
                        frames += pipeline.build(topic, message.message, now_ns)
                    except RadcamDepthError as error:
                        raise type(error)(f"{message.topic}, {line.taken} frames into the bag: {error}") from error
                for frame in frames:
                    line.process(frame, now_ns)
            for frame in frame_builder.flush():
                line.process(frame, now_ns)
    for topic, count in frame_builder.unstamped_sweeps.items():
        if count > 1:
            warnings.warn(f"{source}: {unset_stamps(topic, is_radar=True)}", DriveWarning, stacklevel=2)
    for sentence in remarks(frame_builder, line.done):
        warnings.warn(f"{source}: {sentence}", DriveWarning, stacklevel=2)
    return ReplaySummary(topics, images, line.written, line.without_radar)


class _Line:
    """Runs the network in one thread and writes in another, while the caller's reads on; all in the caller's order.

    At the end of a `with` block everything is written; what failed first is raised first.

    Args:
        pipeline: Estimates and encodes.
        writer: Writes.
        options: What is written.
        progress: Called with the number of frames that are done.

    Attributes:
        taken: Frames taken in.
        done: Frames that are done.
        written: Those of them that gave depth.
        without_radar: Those of them that had no radar return in view.
    """

    def __init__(
        self, pipeline: Pipeline, writer: BagWriter, options: ReplayOptions, progress: Callable[[int], None]
    ) -> None:
        self._pipeline, self._writer, self._progress = pipeline, writer, progress
        self._prefix, self._wanted = options.namespace.rstrip("/") + "/", options.wanted
        self._network, self._writing = ThreadPoolExecutor(1, "network"), ThreadPoolExecutor(1, "writing")
        self._waiting: deque[Future[int | None]] = deque()
        self.taken = self.done = self.written = self.without_radar = 0

    def __enter__(self) -> _Line:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            # An error of the input comes after the frames before it, as it would without threads.
            if error is None or isinstance(error, RadcamDepthError):
                while self._waiting:
                    self._take_out()
        finally:
            self._network.shutdown(cancel_futures=True)
            self._writing.shutdown(cancel_futures=True)

    def copy(self, message: BagMessage) -> None:
        """Writes a message of the input as it is."""
        self._put(self._writing.submit(self._writer.copy, message))

    def process(self, frame: Frame, now_ns: int) -> None:
        """Estimates and writes a frame's depth; returns when there is room for another."""
        inputs = self._pipeline.prepare(frame)
        depths = None if inputs is None else self._network.submit(self._pipeline.estimator.run, inputs)
        self.taken += 1
        self._put(self._writing.submit(self._write, inputs, depths, now_ns))
        while self.taken - self.done > _FRAMES_UNDER_WAY:
            self._take_out()

    def _put(self, written: Future[Any]) -> None:
        self._waiting.append(written)
        if len(self._waiting) > _MESSAGES_UNDER_WAY:
            self._take_out()

    def _take_out(self) -> None:
        in_view = self._waiting.popleft().result()
        if in_view is not None:
            self.done += 1
            self.without_radar += in_view == 0
            self._progress(self.done)

    def _write(self, inputs: NetworkInputs | None, depths: Future[Depths] | None, now_ns: int) -> int:
        """Writes a frame's outputs; gives the number of its radar returns in view."""
        if inputs is None or depths is None:
            return 0
        result = self._pipeline.finish(inputs, depths.result(), self._wanted)
        if result is None:
            return 0
        for name, message in self._pipeline.encode(inputs.frame, result, self._wanted).items():
            self._writer.write(self._prefix + OUTPUTS[name].topic, message, now_ns)
        self.written += 1
        return result.radar_in_view
