"""A bag, or a part of it, once or again and again."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from radcam_depth_ros.bag_player.player import (
    CLOCK_TOPIC,
    CLOCK_TYPE,
    PlayedMessage,
    PlayedTopic,
    Player,
    message_class,
)
from radcam_depth_ros.bags import BagReader, TopicInfo
from radcam_depth_ros.frame import RadcamDepthError

PLAYER_NODE = "radcam_depth_player"
_QUEUE_DEPTH = 10
_LATCHED_DEPTH = 1000
"""Every broadcaster of fixed transforms sends a message of its own, and a late subscriber needs them all."""


class PlaybackError(RadcamDepthError):
    """A bag, or a part of it, that cannot be played."""


@dataclass(frozen=True)
class PlayOptions:
    """What is played, and how.

    Attributes:
        rate: Seconds of the recording in one second.
        loop: Begin anew at the end, until interrupted.
        start_s: Seconds of the recording to leave out at its beginning.
        duration_s: Seconds of the recording to play; None plays to its end.
        topics: What is played of it; empty for all.
        clock: Publish the recording's time on /clock.
        delay_s: Seconds to wait before the first message, in which subscribers find the publishers.
    """

    rate: float = 1.0
    loop: bool = False
    start_s: float = 0.0
    duration_s: float | None = None
    topics: tuple[str, ...] = ()
    clock: bool = False
    delay_s: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.rate < math.inf:
            raise PlaybackError(f"the rate must be positive, 1 for the recording's own, got {self.rate}")
        for name, value in (("start", self.start_s), ("delay", self.delay_s)):
            if not 0 <= value < math.inf:
                raise PlaybackError(f"the {name} must be 0 or a positive number of seconds, got {value}")
        if self.duration_s is not None and not 0 < self.duration_s < math.inf:
            raise PlaybackError(f"the duration must be a positive number of seconds, got {self.duration_s}")


@dataclass(frozen=True)
class Progress:
    """How far it is.

    Attributes:
        round: 1 in the first pass over the bag.
        played_s: Seconds of the recording that were played in this round.
        total_s: Seconds of the recording in each round.
    """

    round: int
    played_s: float
    total_s: float


class Playback:
    """A bag that is to be played.

    Args:
        path: A rosbag2 folder, .mcap or .db3 file.
        options: What is played, and how.

    Attributes:
        topics: What is played.
        left_out: A sentence for each type that cannot be published here.

    Raises:
        RadcamDepthError: for a bag that cannot be read, a topic that it lacks, or when nothing is left to play.
    """

    def __init__(self, path: Path | str, options: PlayOptions) -> None:
        self._path, self._options = Path(path), options
        with BagReader(path) as reader:
            reader.count(options.topics)  # names what it lacks
            chosen = [
                topic
                for topic in reader.topics
                if topic.count
                and (not options.topics or topic.name in options.topics)
                and not (options.clock and topic.name == CLOCK_TOPIC)  # there can be only one
            ]
            self._start_ns = reader.start_ns + round(options.start_s * 1e9)
            self._stop_ns = reader.start_ns + reader.duration_ns + 1
            if self._start_ns >= self._stop_ns:
                raise PlaybackError(
                    f"{path} is {reader.duration_ns / 1e9:.1f} s long, nothing of it is after {options.start_s:g} s; "
                    "start earlier"
                )
        if options.duration_s is not None:
            self._stop_ns = min(self._stop_ns, self._start_ns + round(options.duration_s * 1e9))
        missing = {topic.type_name: reason for topic in chosen if (reason := why_not(topic.type_name))}
        self.topics = tuple(_played(topic) for topic in chosen if topic.type_name not in missing)
        self.left_out = tuple(
            f"{', '.join(topic.name for topic in chosen if topic.type_name == name)} cannot be published: {reason}"
            for name, reason in missing.items()
        )
        if not self.topics:
            raise PlaybackError("; ".join((f"nothing of {path} can be played", *self.left_out)))
        if options.clock and (reason := why_not(CLOCK_TYPE)):
            raise PlaybackError(f"{CLOCK_TOPIC} cannot be published: {reason}, or play without it")

    @property
    def total_s(self) -> float:
        """Seconds of the recording in each round."""
        return (self._stop_ns - self._start_ns) / 1e9

    def run(self, progress: Callable[[Progress], None] = lambda _: None) -> None:
        """Plays; returns at the end, or never when it loops. Ctrl-C raises KeyboardInterrupt, and all is cleaned up.

        Args:
            progress: Called after each message.
        """
        options = self._options
        with BagReader(self._path) as reader, ros_node(PLAYER_NODE) as node:
            player = Player(node, self.topics, options.rate, clock=options.clock)
            time.sleep(options.delay_s)
            for number in itertools.count(1):

                def played(time_ns: int, number: int = number) -> None:
                    progress(Progress(number, (time_ns - self._start_ns) / 1e9, self.total_s))

                player.play(self._messages(reader), start_ns=self._start_ns, played=played)
                if not options.loop:
                    break
            player.finish()

    def _messages(self, reader: BagReader) -> Iterator[PlayedMessage]:
        """What latched topics said before the start, as a subscriber would have it, and then all that is played."""
        latched = [topic.name for topic in self.topics if topic.latched]
        before: Iterable[PlayedMessage] = reader.messages(latched, stop_ns=self._start_ns) if latched else ()
        names = {topic.name for topic in self.topics}
        return itertools.chain(before, reader.messages(names, start_ns=self._start_ns, stop_ns=self._stop_ns))


def _played(topic: TopicInfo) -> PlayedTopic:
    depth = topic.queue_depth or _QUEUE_DEPTH
    if topic.latched:
        depth = max(depth, min(topic.count, _LATCHED_DEPTH))
    return PlayedTopic(topic.name, topic.type_name, topic.reliable or topic.latched, topic.latched, depth)


def why_not(type_name: str) -> str:
    """Why messages of a type can neither be published nor heard here; empty when they can."""
    package, _, name = type_name.partition("/")
    try:
        message_class(type_name)
    except ImportError:
        return f"the package {package} is not installed; source the ROS workspace that has it"
    except (AttributeError, ValueError):
        return f"the package {package} that is installed has no {name}"
    return ""


@contextmanager
def ros_node(name: str) -> Iterator[Node]:
    """A node in a context of its own, without services; one that only publishes needs no executor."""
    context = Context()
    # Ctrl-C is Python's own here: rclpy's handler would end the context under the publishers' feet.
    rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = Node(name, context=context, start_parameter_services=False, enable_rosout=False)
    try:
        yield node
    finally:
        node.destroy_node()
        context.try_shutdown()
