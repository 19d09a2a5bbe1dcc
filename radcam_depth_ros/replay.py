"""A bag through the pipeline, offline: every frame, in order, the same depth as in the live node."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from radcam_depth_ros.bags import BagReader, BagWriter, factory
from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.drive import DriveSettings, prime
from radcam_depth_ros.estimator import Estimator
from radcam_depth_ros.frame import Frame, RadcamDepthError
from radcam_depth_ros.pipeline import OUTPUT_TOPICS, Pipeline, PipelineConfig


@dataclass(frozen=True)
class ReplayOptions:
    """What a replay writes.

    Attributes:
        namespace: Put before the depth topics, `/` for the node's own names.
        depth_encoding: As in PipelineConfig.
        passthrough: Copy all messages of the input as well.
        preview: Write the preview too.
        points: Write the point cloud too.
        overwrite: Replace a bag that is there.
    """

    namespace: str = "/"
    depth_encoding: str = "32FC1"
    passthrough: bool = False
    preview: bool = False
    points: bool = False
    overwrite: bool = False


@dataclass(frozen=True)
class ReplaySummary:
    """What a replay did.

    Attributes:
        topics: The sensors that were read.
        images: Images in the input.
        frames: Depth images written.
        without_radar: Those of them that had no radar return in view.
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
        topics = settings.topics(reader)
        config = PipelineConfig(**settings.intake(topics).__dict__, depth_encoding=options.depth_encoding)
        pipeline = Pipeline(config, estimator, factory)
        prime(reader, pipeline, topics)
        images, done, without_radar = reader.count([topics.image]), 0, 0
        wanted = None if options.passthrough else {topics.image, topics.camera_info, *topics.radars}
        now_ns = 0
        with BagWriter(target, overwrite=options.overwrite) as writer:
            for message in reader.messages(wanted):
                now_ns = message.log_time_ns
                if options.passthrough:
                    writer.copy(message)
                frames = pipeline.expire(now_ns)
                if message.topic in (topics.image, topics.camera_info, *topics.radars):
                    try:
                        frames += pipeline.accept(message.topic, message.message, now_ns)
                    except RadcamDepthError as error:
                        raise type(error)(f"{message.topic}, {done} frames into the bag: {error}") from error
                for frame in frames:
                    without_radar += _write(writer, pipeline, frame, now_ns, options)
                    done += 1
                    if progress is not None:
                        progress(done, images)
            for frame in pipeline.flush():
                without_radar += _write(writer, pipeline, frame, now_ns, options)
                done += 1
                if progress is not None:
                    progress(done, images)
    return ReplaySummary(topics, images, done, without_radar)


def _write(writer: BagWriter, pipeline: Pipeline, frame: Frame, now_ns: int, options: ReplayOptions) -> bool:
    """Writes one frame's depth; says whether the network was given no radar return."""
    messages = pipeline.process(frame, preview=options.preview, points=options.points)
    prefix = options.namespace.rstrip("/") + "/"
    for name, topic in OUTPUT_TOPICS.items():
        message = getattr(messages, name)
        if message is not None:
            writer.write(prefix + topic, message, now_ns)
    return messages.result.radar_in_view == 0
