"""Reads a bag's frames with their ground truth."""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.drive.clocks import Clocks
from radcam_depth_ros.drive.sample import Sample
from radcam_depth_ros.drive.scan_use import LEFT_OUT, ScanUse
from radcam_depth_ros.drive.settings import DriveError, DriveSettings, DriveWarning
from radcam_depth_ros.drive.truth import GroundTruth
from radcam_depth_ros.frame import Frame
from radcam_depth_ros.frame_builder import FrameBuilder, FrameBuilderConfig
from radcam_depth_ros.messages import stamp_ns
from radcam_depth_ros.pairing import for_each_radar

_UNMATCHED_SHARE = 0.9
_JUDGED_FRAMES = 10
"""A share of fewer frames than this says nothing."""
_EARLY_FRAMES = 20
"""After so many frames clocks are compared: whoever reads an hour need not wait for its end."""


def prime(reader: BagReader, frame_builder: FrameBuilder, topics: SensorTopics) -> None:
    """Gives the builder a bag's transforms and its first camera_info, as a node that was there before has them.

    A recording may hold an image before the first camera_info; live, that image would be lost.
    """
    if topics.tf_static:
        for message in reader.messages([topics.tf_static]):
            frame_builder.add("/tf_static", message.message, message.log_time_ns)
    for message in reader.messages([topics.camera_info]):
        frame_builder.add(message.topic, message.message, message.log_time_ns)
        break


def motion_topics(topics: SensorTopics, config: FrameBuilderConfig) -> dict[str, str]:
    """Topics of a bag that tell the motion of the vehicle and its sensors, by the name that the node has for each."""
    odometry = {config.odometry: config.odometry} if config.moves_radar and config.odometry else {}
    return {**odometry, **({topics.tf: "/tf"} if topics.tf else {})}


def remarks(frame_builder: FrameBuilder, frames: int) -> tuple[str, ...]:
    """What a bag's frames lack, a sentence each.

    These are intensities that were taken for the RCS and are likely the Doppler speed, and radar returns that could not
    be moved to their images' time.
    """
    doubts = [contents.doubt(topic) for topic, contents in frame_builder.contents.items()]
    if frame_builder.unmoved_frames:
        doubts.append(f"in {frame_builder.unmoved_frames} of {frames} frames {frame_builder.last_motion_problem}")
    return tuple(filter(None, doubts))


def read_samples(
    path: Path | str, settings: DriveSettings | None = None, warn: Callable[[str], None] | None = None
) -> Iterator[Sample]:
    """Reads a bag's frames with their ground truth, in order, each image that has one camera_info.

    Args:
        path: A rosbag2 folder or .mcap file.
        settings: How to read it.
        warn: Called with a sentence for each optional thing that the bag lacks; a `DriveWarning` by default.

    Raises:
        RadcamDepthError: when the bag lacks what a frame needs, or holds a message that cannot be used; at the end, or
            once it is certain, also when the sensors' stamps do not fit together.
    """
    settings = settings or DriveSettings()
    warn = warn or partial(_warn_of, path)
    with BagReader(path) as reader, BagReader(path) as ahead:
        topics = settings.find_topics(reader)
        config = settings.frame_builder_of(topics)
        frame_builder, moving = FrameBuilder(config), motion_topics(topics, config)
        prime(reader, frame_builder, topics)
        # What is fixed, without the links of /tf that the frame_builder adds.
        fixed = frame_builder.transforms.copy()
        truth = GroundTruth(topics, settings, fixed, ahead, warn)
        fit = _Fit(topics, settings, frame_builder, truth)
        waiting: deque[Frame] = deque()
        wanted = {topics.image, topics.camera_info, *topics.radars, *truth.topics, *moving}
        screened = {topics.image, *topics.radars, *truth.topics}
        for message in reader.messages(wanted):
            now_ns, content = message.log_time_ns, message.message
            if message.topic in screened:
                content = settings.screened(message.topic, content)
            if content is None:
                continue
            truth.add(message.topic, content)
            waiting.extend(frame_builder.expire(now_ns))
            waiting.extend(frame_builder.add(moving.get(message.topic, message.topic), content, now_ns))
            if message.topic not in moving:
                fit.note(message.topic, stamp_ns(content.header), now_ns)
            while waiting and truth.is_complete(waiting[0], now_ns):
                yield fit.counted(truth.sample(waiting.popleft()))
        waiting.extend(frame_builder.flush())
        for frame in waiting:
            yield fit.counted(truth.sample(frame))
        fit.check(warn)
        for sentence in remarks(frame_builder, fit.frames):
            warn(sentence)


def _warn_of(path: Path | str, sentence: str) -> None:
    warnings.warn(f"{path}: {sentence}", DriveWarning, stacklevel=2)


class _Fit:
    """Whether images, radars and ground truth of a bag fit together in time."""

    def __init__(
        self, topics: SensorTopics, settings: DriveSettings, frame_builder: FrameBuilder, truth: GroundTruth
    ) -> None:
        self._clocks = Clocks(topics.image, topics.radars)
        self._topics, self._settings = topics, settings
        self._frame_builder, self._truth = frame_builder, truth
        offsets_s = for_each_radar(
            "radar_time_offset_s", settings.frame_builder.pairing.radar_time_offset_s, len(topics.radars)
        )
        self._radar_offsets_ns = {
            topic: round(offset_s * 1e9) for topic, offset_s in zip(topics.radars, offsets_s, strict=True)
        }
        self.frames = self._blind = 0
        self._left_out: list[ScanUse] = []

    def note(self, topic: str, time_ns: int, now_ns: int) -> None:
        """Takes note of a message's times."""
        if topic in self._topics.radars:
            time_ns = self._frame_builder.config.sweep_ns(topic, time_ns, now_ns) + self._radar_offsets_ns[topic]
        self._clocks.add(topic, time_ns, now_ns)

    def counted(self, sample: Sample) -> Sample:
        """Takes note of a sample."""
        self.frames += 1
        self._blind += sample.source == "none"
        if sample.scan is not None and sample.scan.use == LEFT_OUT:
            self._left_out.append(sample.scan)
        if self.frames == _EARLY_FRAMES:
            self._check_clocks()
        return sample

    def check(self, warn: Callable[[str], None]) -> None:
        """At a bag's end: refuses one whose radars or ground truth fit hardly any image."""
        self._check_clocks()
        if self.frames < _JUDGED_FRAMES:
            return
        limit_s = self._settings.frame_builder.pairing.max_time_offset_s
        counts = self._frame_builder.counts
        if counts.radars and counts.unmatched >= _UNMATCHED_SHARE * self.frames:
            reason = self._clocks.reason(counts.radars[0].name, limit_s)
            raise DriveError(f"{counts.unmatched} of {self.frames} images have no radar sweep: {reason}")
        for radar in counts.radars:
            if radar.unmatched >= _UNMATCHED_SHARE * self.frames:
                reason = self._clocks.reason(radar.name, limit_s)
                warn(f"{radar.unmatched} of {self.frames} images have no sweep of {radar.name}: {reason}")
        topic = self._truth.depth_topic
        if topic is not None and self._blind >= _UNMATCHED_SHARE * self.frames:
            reason = self._why_blind(topic)
            sentence = f"{self._blind} of {self.frames} images have no ground truth: {reason}"
            if self._blind == self.frames:
                raise DriveError(sentence)
            warn(sentence)

    def _why_blind(self, topic: str) -> str:
        if len(self._left_out) > self._blind / 2:
            return (
                f"{len(self._left_out)} scans on {topic} cannot be moved to the images' time, since "
                f"{self._left_out[-1].reason}; record the vehicle's motion all the time"
            )
        exact = topic == self._topics.depth
        return self._clocks.reason(topic, 0.0 if exact else self._settings.max_lidar_offset_s)

    def _check_clocks(self) -> None:
        topic = self._truth.depth_topic
        wrong = self._clocks.wrong((*self._topics.radars, *((topic,) if topic else ())))
        if wrong is not None:
            raise DriveError(wrong)
