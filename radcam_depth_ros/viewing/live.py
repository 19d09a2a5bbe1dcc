"""Draws the depth of a running node from live topics."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from radcam_depth_ros.bags import BagError, SensorTopics
from radcam_depth_ros.bags.topics import TopicChooser
from radcam_depth_ros.drive import DriveSettings, motion_topics
from radcam_depth_ros.frame import DepthResult, Frame, RadcamDepthError
from radcam_depth_ros.frame_builder import TRANSFORM_TOPICS, FrameBuilder, FrameBuilderConfig
from radcam_depth_ros.viewing.output import STRIP, check_target, output
from radcam_depth_ros.viewing.picture import ViewError
from radcam_depth_ros.viewing.recorded import RecordedDepth, Source, find_recorded_depth
from radcam_depth_ros.viewing.view import RATES_HZ, STRIP_FRAMES, ViewOptions, frames_of

FoundT = TypeVar("FoundT")
_DOMAIN = "the ROS domain"
_TIMED_PICTURES = 5
"""The rate of a video is that of so many first pictures."""


class LiveSource(Source, Protocol):
    """Live topics."""

    def find(self, find: Callable[[], FoundT]) -> FoundT:
        """What is found once it can be; the last RadcamDepthError where it cannot."""

    def describe(self, topics: Collection[str]) -> str:
        """What came on some topics, for a sentence."""

    def stop(self) -> None:
        """Ends all that is read."""


def view_live(
    source: LiveSource,
    target: Path | str | None,
    settings: DriveSettings | None = None,
    options: ViewOptions | None = None,
    namespace: str | None = None,
    progress: Callable[[int], None] = lambda shown: None,
    warn: Callable[[str], None] = lambda sentence: None,
) -> int:
    """Draws what a node publishes, beside the images that it is of, until the source ends.

    Args:
        source: The live topics.
        target: A video (.mp4), a strip of the first frames below one another (.png), a recording for Rerun (.rrd), or a
            folder to make; None for the viewer of Rerun.
        settings: Which topics are the camera and the radars.
        options: Which frames; of those that have depth.
        namespace: Of the node's topics; by default where its depth is found.
        progress: Called with the number of pictures so far.
        warn: Called with a sentence for each thing that is left out of the pictures.

    Returns:
        The number of pictures.

    Raises:
        RadcamDepthError: when the topics are not there, nothing comes on them, or the target cannot be written.
    """
    target = None if target is None else Path(target)
    settings, options = settings or DriveSettings(), options or ViewOptions()
    check_target(target)
    topics, place = source.find(lambda: _find(source, settings, namespace))
    if not topics.radars:
        warn(f"radar returns are not drawn: radars with {TRANSFORM_TOPICS[0]} were not found")
    refused: list[RadcamDepthError] = []
    depth = RecordedDepth(source, place, is_live=True)
    numbered = enumerate(_frames(source, depth, topics, settings, options, refused.append), 1)
    is_strip = target is not None and target.suffix == STRIP
    frames = itertools.islice(numbered, options.frames or (STRIP_FRAMES if is_strip else None))
    first = list(itertools.islice(frames, _TIMED_PICTURES))
    if not first:
        raise ViewError(
            f"no image came with depth: {source.describe((topics.image, topics.camera_info, *depth.topics))}"
            f"{f'; {refused[-1]}' if refused else ''}; see whether the node is active, and /diagnostics"
        )
    gaps_s = np.diff([frame.stamp_ns for _, (frame, _) in first]) / 1e9
    forward_s = gaps_s[gaps_s > 0]  # not those of stamps that begin anew
    rate_hz = 1 / float(np.median(forward_s)) if forward_s.size else 1.0
    shown = 0
    with output(target, float(np.clip(rate_hz, *RATES_HZ)), options.width) as add:
        for shown, (frame, result) in itertools.chain(first, frames):
            add(frame, result)
            progress(shown)
    return shown


def _find(source: LiveSource, settings: DriveSettings, namespace: str | None) -> tuple[SensorTopics, str]:
    """Camera and radars, and where the depth is."""
    wanted = None if namespace is None else f"/{namespace.strip('/')}/".replace("//", "/")
    found = find_recorded_depth(source, wanted)
    if found is None:
        place = wanted or "any namespace"
        raise ViewError(
            f"no node publishes depth/image_rect and depth/camera_info in {place}; start and activate it, or see that "
            f"both have one ROS_DOMAIN_ID. There is {', '.join(topic.name for topic in source.topics) or 'nothing'}"
        )
    wanted_topics = settings.topics
    chooser = TopicChooser(source.topics, _DOMAIN, wanted_topics.preferred)
    radars = wanted_topics.radars
    if settings.frame_builder.needs_transforms and not chooser.find_transforms("tf_static"):
        radars = ()
    elif radars is None:
        try:
            radars = chooser.find_radars()
        except BagError:
            radars = ()
    topics = replace(wanted_topics, radars=radars, lidar=None, depth=None, classes=None, odometry=None)
    return replace(topics.find(source.topics, _DOMAIN), odometry=None), found


def _frame_builder_of(topics: SensorTopics, settings: DriveSettings) -> FrameBuilderConfig:
    """How frames are made of live topics, which may lack the radars."""
    if not topics.radars:
        settings = replace(
            settings, frame_builder=replace(settings.frame_builder, without_radar="camera_only", camera_from_radar=())
        )
    return settings.frame_builder_of(topics)


def _frames(
    source: LiveSource,
    depth: RecordedDepth,
    topics: SensorTopics,
    settings: DriveSettings,
    options: ViewOptions,
    refused: Callable[[RadcamDepthError], None],
) -> Iterator[tuple[Frame, DepthResult]]:
    """The frames that have depth, with it."""
    frame_builder = FrameBuilder(_frame_builder_of(topics, settings))
    names = motion_topics(topics, frame_builder.config) | (
        {topics.tf_static: TRANSFORM_TOPICS[0]} if topics.tf_static else {}
    )
    messages = source.messages({topics.image, topics.camera_info, *topics.radars, *names})
    results = ((frame, depth.predict(frame)) for frame in frames_of(messages, frame_builder, names, refused))
    complete = ((frame, result) for frame, result in results if result is not None)
    yield from itertools.islice(complete, 0, None, options.every)
