"""A bag through the pipeline, offline: every frame, in order, the same depth as in the live node.

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
from radcam_depth_ros.drive import DriveSettings, DriveWarning, motion_topics, prime, unmoved
from radcam_depth_ros.estimator import Estimator, NetworkInputs
from radcam_depth_ros.frame import DepthResult, Frame, RadcamDepthError
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.pipeline import OUTPUT_TOPICS, OutputConfig, Pipeline, PipelineConfig

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
        preview: Write the preview too.
        points: Write the point cloud too.
        overwrite: Replace a bag that is there.
        compress: Compress the output (zstd): about half the size, and more work than all else but the network.
    """

    namespace: str = "/"
    output: OutputConfig = field(default_factory=OutputConfig)
    passthrough: bool = False
    preview: bool = False
    points: bool = False
    overwrite: bool = False
    compress: bool = False


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
        config = PipelineConfig.of(settings.frame_builder_of(topics), options.output)
        pipeline = Pipeline(config, estimator, factory)
        prime(reader, pipeline, topics)
        images = reader.count([topics.image])
        moving = motion_topics(topics, config)
        sensors = {topics.image, topics.camera_info, *topics.radars, *moving}
        now_ns = 0
        with (
            BagWriter(target, overwrite=options.overwrite, compress=options.compress) as writer,
            _Line(
                pipeline, estimator, writer, options, lambda done: progress(done, images) if progress else None
            ) as line,
        ):
            for message in reader.messages(None if options.passthrough else sensors):
                now_ns = message.log_time_ns
                if options.passthrough:
                    line.copy(message)
                frames = pipeline.expire(now_ns)
                if message.topic in sensors:
                    try:
                        topic = moving.get(message.topic, message.topic)
                        frames += pipeline.accept(topic, message.message, now_ns)
                    except RadcamDepthError as error:
                        raise type(error)(f"{message.topic}, {line.taken} frames into the bag: {error}") from error
                for frame in frames:
                    line.process(frame, now_ns)
            for frame in pipeline.flush():
                line.process(frame, now_ns)
    if pipeline.unmoved_frames:
        warnings.warn(f"{source}: {unmoved(pipeline, line.done)}", DriveWarning, stacklevel=2)
    suppressed = line.without_radar if pipeline.is_suppressed(0) else 0
    return ReplaySummary(topics, images, line.done - suppressed, line.without_radar)


class _Line:
    """Runs the network in one thread and writes in another, while the caller's reads on; all in the caller's order.

    At the end of a `with` block everything is written; what failed first is raised first.

    Args:
        pipeline: Encodes.
        estimator: Runs the network.
        writer: Writes.
        options: What is written.
        progress: Called with the number of frames that are done.

    Attributes:
        taken: Frames taken in.
        done: Frames that are done.
        without_radar: Those of them that had no radar return in view.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        estimator: Estimator,
        writer: BagWriter,
        options: ReplayOptions,
        progress: Callable[[int], None],
    ) -> None:
        self._pipeline, self._estimator, self._writer = pipeline, estimator, writer
        self._options, self._progress = options, progress
        self._network, self._writing = ThreadPoolExecutor(1, "network"), ThreadPoolExecutor(1, "writing")
        self._waiting: deque[Future[DepthResult | None]] = deque()
        self.taken = self.done = self.without_radar = 0

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
        inputs = self._estimator.prepare(frame)
        depths = self._network.submit(self._estimator.run, inputs)
        self.taken += 1
        self._put(self._writing.submit(self._write, inputs, depths, now_ns))
        while self.taken - self.done > _FRAMES_UNDER_WAY:
            self._take_out()

    def _put(self, written: Future[Any]) -> None:
        self._waiting.append(written)
        if len(self._waiting) > _MESSAGES_UNDER_WAY:
            self._take_out()

    def _take_out(self) -> None:
        result = self._waiting.popleft().result()
        if result is not None:
            self.done += 1
            self.without_radar += result.radar_in_view == 0
            self._progress(self.done)

    def _write(self, inputs: NetworkInputs, depths: Future[Depths], now_ns: int) -> DepthResult:
        result = self._estimator.finish(inputs, depths.result())
        if self._pipeline.is_suppressed(result.radar_in_view):
            return result
        options = self._options
        messages = self._pipeline.encode(inputs.frame, result, preview=options.preview, points=options.points)
        prefix = options.namespace.rstrip("/") + "/"
        for name, topic in OUTPUT_TOPICS.items():
            message = getattr(messages, name)
            if message is not None:
                self._writer.write(prefix + topic, message, now_ns)
        return result
