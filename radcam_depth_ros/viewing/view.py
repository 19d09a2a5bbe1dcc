"""Draws a bag's frames with their depth."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radcam_depth_ros.bags import BagReader, SensorTopics
from radcam_depth_ros.drive import DriveSettings, motion_topics, prime
from radcam_depth_ros.frame import DepthResult, Frame, RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilder
from radcam_depth_ros.viewing.output import STRIP, check_target, output
from radcam_depth_ros.viewing.picture import SMALLEST_WIDTH, ViewError
from radcam_depth_ros.viewing.recorded import StoredMessage

STRIP_FRAMES = 5
RATES_HZ = (1.0, 120.0)


@dataclass(frozen=True)
class ViewOptions:
    """Which frames are shown, and how large.

    Attributes:
        every: Only every so many-th image.
        frames: At most so many; None for all of a video or folder, and a few of a strip.
        width: Of a picture, pixels.
    """

    every: int = 1
    frames: int | None = None
    width: int = 1920

    def __post_init__(self) -> None:
        if self.every < 1 or (self.frames is not None and self.frames < 1):
            raise ViewError(f"every and frames must be at least 1, got {self.every} and {self.frames}")
        if self.width < SMALLEST_WIDTH:
            raise ViewError(f"a picture needs a width of at least {SMALLEST_WIDTH} pixels, got {self.width}")


def view(
    bag: Path | str,
    target: Path | str | None,
    estimate: Callable[[Frame], DepthResult | None],
    settings: DriveSettings | None = None,
    options: ViewOptions | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> int:
    """Draws a bag's frames.

    Args:
        bag: A rosbag2 folder or .mcap file.
        target: A video (.mp4), a strip of evenly spread frames below one another (.png), a recording for
            Rerun (.rrd), or a folder to make; None for the viewer of Rerun.
        estimate: Gives a frame's depth; a frame of which it gives None is left out.
        settings: How the bag is read.
        options: Which frames.
        progress: Called with (frames looked at, frames to look at).

    Returns:
        The number of pictures.

    Raises:
        RadcamDepthError: for a bag that cannot be used, or a target that cannot be written.
    """
    target = None if target is None else Path(target)
    settings, options = settings or DriveSettings(), options or ViewOptions()
    check_target(target)
    with BagReader(bag) as reader:
        topics = settings.find_topics(reader)
        images = reader.count([topics.image])
        picks = _picks(images, options, spread=target is not None and target.suffix == STRIP)
        seconds = reader.duration_ns / 1e9
        rate_hz = (images - 1) / seconds / options.every if seconds > 0 else 1.0
        shown = looked_at = 0
        with output(target, float(np.clip(rate_hz, *RATES_HZ)), options.width) as add:
            for index, frame in enumerate(_frames(reader, topics, settings)):
                if index not in picks:
                    continue
                result = estimate(frame)
                if result is not None:
                    add(frame, result)
                    shown += 1
                looked_at += 1
                progress(looked_at, len(picks))
                if looked_at == len(picks):
                    break
    return shown


def _picks(images: int, options: ViewOptions, *, spread: bool) -> frozenset[int]:
    """Indices of the images to show: the first ones, or evenly spread ones."""
    indices = range(0, images, options.every)
    if not spread:
        return frozenset(indices[: options.frames])
    count = min(options.frames or STRIP_FRAMES, len(indices))
    return frozenset(indices[place] for place in np.linspace(0, len(indices) - 1, count).round().astype(int))


def _frames(reader: BagReader, topics: SensorTopics, settings: DriveSettings) -> Iterator[Frame]:
    """The frames that the node would see, in their order."""
    frame_builder = FrameBuilder(settings.frame_builder_of(topics))
    prime(reader, frame_builder, topics)
    moving = motion_topics(topics, frame_builder.config)
    yield from frames_of(
        reader.messages({topics.image, topics.camera_info, *topics.radars, *moving}), frame_builder, moving
    )
    yield from frame_builder.flush()


def frames_of(
    messages: Iterable[StoredMessage],
    frame_builder: FrameBuilder,
    names: Mapping[str, str],
    refused: Callable[[RadcamDepthError], None] | None = None,
) -> Iterator[Frame]:
    """The frames that messages make.

    Args:
        messages: As they came.
        frame_builder: Takes them.
        names: What it calls a topic, where that differs.
        refused: Told of what cannot be used; by default that is raised.
    """
    for message in messages:
        try:
            frames = frame_builder.expire(message.log_time_ns)
            frames += frame_builder.add(names.get(message.topic, message.topic), message.message, message.log_time_ns)
        except RadcamDepthError as error:
            if refused is None:
                raise
            refused(error)
            continue
        yield from frames
