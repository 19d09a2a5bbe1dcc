"""Holds everything that lives while the node is active: subscriptions, pairing, the worker, and counters."""

from __future__ import annotations

import time
import traceback
from collections import Counter, OrderedDict
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

from radcam_depth_ros.frame import Frame, RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilderError
from radcam_depth_ros.messages import MOST_RETURNS
from radcam_depth_ros.node.arrival import ArrivalClock
from radcam_depth_ros.node.health import SECOND_NS, Level, Problems, Rate
from radcam_depth_ros.node.latency import FrameTimes, Latencies, LatencyTopics
from radcam_depth_ros.node.mailbox import Worker
from radcam_depth_ros.node.stamps import LostMessages, SensorStamps, StampOffset
from radcam_depth_ros.node.topics.inputs import Input, Inputs
from radcam_depth_ros.node.topics.outputs import Outputs
from radcam_depth_ros.node.topics.reader import Reader, Reading, TooLargeError, UndecodableError
from radcam_depth_ros.node.topics.subscriptions import Subscriptions
from radcam_depth_ros.node.warm_up import WarmUp
from radcam_depth_ros.pairing import for_each_radar, unset_stamps
from radcam_depth_ros.pipeline import Pipeline

EXPIRY_PERIOD_S = 0.02
_IMAGES_REMEMBERED = 256


@dataclass(frozen=True)
class Ticket:
    """A frame on its way to the network.

    Attributes:
        frame: The frame.
        arrived_ns: When its image came, on the steady clock.
        decoded_ns: When that was decoded.
    """

    frame: Frame
    arrived_ns: int
    decoded_ns: int


class Session:
    """Reads the inputs, pairs in the callbacks, runs the network in a thread, publishes.

    Args:
        node: The node.
        pipeline: A fresh one: nothing of an earlier session is left in it.
        inputs: What to read; the topics of the pipeline's config.
        outputs: Where to publish.
        latency_topics: Where to publish how long each frame took.
        problems: Where to report.
    """

    def __init__(
        self,
        node: Node,
        pipeline: Pipeline,
        inputs: Inputs,
        outputs: Outputs,
        latency_topics: LatencyTopics,
        problems: Problems,
    ) -> None:
        self._node = node
        self.pipeline, self.frame_builder = pipeline, pipeline.frame_builder
        self._inputs = inputs
        self._outputs = outputs
        self._latency_topics = latency_topics
        self._problems = problems
        self.clock = ArrivalClock(node)
        self._images: OrderedDict[int, tuple[int, int]] = OrderedDict()  # by stamp: when it came and was decoded
        self.rates = {source.part: Rate() for source in inputs}
        """Messages of each part, good ones and bad ones."""
        self.used = {source.part: 0 for source in inputs}
        """How many of them could be used."""
        self.lost = {source.part: LostMessages() for source in inputs}
        self.unusable: Counter[str] = Counter()
        """How many of each part could not be used."""
        self.undecodable: Counter[str] = Counter()
        """Of these, how many were no messages of their type."""
        self.too_large: Counter[str] = Counter()
        """Of these, how many were larger than what is read."""
        self._publishers: dict[str, int] = {}  # of each part, as far as that was looked up
        self.stamps = {source.part: SensorStamps() for source in (inputs.camera, *inputs.radars)}
        self.stamp_offsets = {radar.part: StampOffset() for radar in inputs.radars}
        """Of each radar, as it is stamped: without `radar_time_offset_s`."""
        self.frames_in = self.frames_failed = self.images_unusable = self.frames_suppressed = 0
        self.frames_out = Rate()
        self.latencies = Latencies()
        self.busy_since_ns: int | None = None
        self._is_motion_told = False
        self._is_closed = False
        self.reader = Reader(node, inputs, pipeline.decode, self._on_read)
        self._worker: Worker[Ticket] = Worker(self._work, "radcam_depth")
        self.warm_up = WarmUp(pipeline, self._worker, self._on_inference_error)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._expiry = node.create_timer(EXPIRY_PERIOD_S, self._on_expiry, clock=steady)
        self._subscriptions: Subscriptions | None = None
        try:
            self._subscriptions = Subscriptions(
                node, inputs, self._on_message, self._on_unheard, problems.settle, steady
            )
        except Exception:
            self.close()
            raise
        # The first subscriptions of a process can take seconds, in which nothing could come.
        self.started_ns = time.monotonic_ns()

    @property
    def inputs(self) -> Inputs:
        """What is read."""
        return self._inputs if self._subscriptions is None else self._subscriptions.inputs

    @property
    def frames_dropped(self) -> int:
        """Frames that were dropped for a newer one since the network was busy."""
        return self._worker.dropped

    def qos(self, source: Input) -> QoSProfile:
        """What an input is subscribed with, parameters counted in."""
        return source.qos if self._subscriptions is None else self._subscriptions.qos(source)

    def radar_time_offset_s(self, radar: Input) -> float:
        """What is added to a radar's stamps."""
        given = self.frame_builder.config.pairing.radar_time_offset_s
        offsets_s = for_each_radar("radar_time_offset_s", given, len(self.inputs.radars))
        return offsets_s[self.inputs.radars.index(radar)]

    def close(self, timeout_s: float | None = None) -> bool:
        """Stops reading and publishing; False when the network was still busy after `timeout_s`."""
        self._is_closed = True
        self._node.destroy_timer(self._expiry)
        if self._subscriptions is not None:
            self._subscriptions.close()
        self.reader.close(timeout_s)
        return self._worker.close(timeout_s)

    def publishers(self, source: Input) -> int:
        """How many publishers an input has now."""
        count = self._publishers[source.part] = self._node.count_publishers(source.topic)
        return count

    def _on_message(self, source: Input, raw: bytes, number: int | None) -> None:
        now_ns = time.monotonic_ns()
        self.rates[source.part].tick(now_ns)
        self.lost[source.part].add(number, partial(self._known_publishers, source))
        self.reader.put(source, raw, now_ns)

    def _known_publishers(self, source: Input) -> int:
        # Several were counted a second ago or so; asked for each message that would cost more than most messages do.
        known = self._publishers.get(source.part, 0)
        return known if known > 1 else self.publishers(source)

    def _on_read(self, reading: Reading) -> None:
        source = reading.source
        try:
            frames = self._take(reading)
        except FrameBuilderError as error:
            self._check(reading)
            self._on_unusable_image(error)
        except Exception as error:  # the boundary: a message must never take the node down
            self.unusable[source.part] += 1
            self._on_unusable(source.part, error)
        else:
            self._check(reading)
            if source is self.inputs.camera_info:
                self.warm_up.follow()
            self._hand_over(frames)

    def _take(self, reading: Reading) -> tuple[Frame, ...]:
        if reading.source is self.inputs.camera and reading.message is not None:
            self._images[_stamp_ns(reading.message)] = (reading.arrived_ns, reading.decoded_ns)
            if len(self._images) > _IMAGES_REMEMBERED:
                self._images.popitem(last=False)
        if reading.error is not None:
            raise reading.error
        return self.pipeline.take(reading.source.topic, reading.content, self.clock.now_ns(), self._arrived_ns(reading))

    def _arrived_ns(self, reading: Reading) -> int:
        """When a message came, on the clock that sensors are stamped by."""
        return int(self._node.get_clock().now().nanoseconds) - (time.monotonic_ns() - reading.arrived_ns)

    def _on_unusable(self, part: str, error: Exception) -> None:
        if isinstance(error, TooLargeError):
            # Once in the log: what is left out does no harm, and who publishes it may go on for ever.
            self._problems.report(part, Level.WARN, str(error), quietly=self.too_large[part] > 0)
            self.too_large[part] += 1
        elif isinstance(error, RadcamDepthError):
            self.undecodable[part] += isinstance(error, UndecodableError)
            self._problems.report(part, Level.ERROR, str(error))
        else:
            self._on_defect(part, error)

    def _on_expiry(self) -> None:
        try:
            frames = self.frame_builder.expire(self.clock.now_ns())
        except RadcamDepthError as error:
            self._on_unusable_image(error)
        except Exception as error:  # the boundary, as above
            self._on_defect("pairing", error)
        else:
            self._hand_over(frames)

    def _check(self, reading: Reading) -> None:
        """Takes note of a message that could be read, and of what can be wrong with it all the same."""
        source, message, arrived_ns = reading.source, reading.message, reading.arrived_ns
        self.used[source.part] += 1
        config = self.frame_builder.config
        if source is self.inputs.camera:
            self.stamps[source.part].add(_stamp_ns(message), arrived_ns)
        if source in self.inputs.radars:
            sweep_ns = config.sweep_ns(source.topic, _stamp_ns(message), self._arrived_ns(reading))
            self.stamps[source.part].add(sweep_ns, arrived_ns)
            self.stamp_offsets[source.part].add(sweep_ns, arrived_ns, self.stamps[self.inputs.camera.part])
        has_frame = message.header.frame_id or config.camera_frame if source is self.inputs.camera else True
        # Where the extrinsics come from /tf_static, no frame can be made at all and the pipeline says so.
        if not has_frame and config.camera_from_radar:
            self._problems.report(
                source.part,
                Level.WARN,
                f"expected a frame_id in the images on {source.topic}, got an empty one, so the depth has none either; "
                "set it in the driver, or set the parameter camera_frame",
            )
            return
        dropped = self.frame_builder.dropped_returns.get(source.topic, 0)
        if source.part in self.stamps and self.stamps[source.part].are_unset:
            is_radar = source in self.inputs.radars
            self._problems.report(source.part, Level.WARN, unset_stamps(source.topic, is_radar=is_radar))
        elif source in self.inputs.transforms and self.frame_builder.transform_problem:
            self._problems.report(source.part, Level.WARN, self._transform_problem())
        elif source is self.inputs.odometry and self.frame_builder.odometry_problem:
            self._problems.report(source.part, Level.WARN, self.frame_builder.odometry_problem)
        elif dropped:
            self._problems.report(
                source.part,
                Level.WARN,
                f"expected finite positions on {source.topic}, got {dropped} returns with NaN or infinity, which are "
                "left out; look at the driver's filter",
            )
        elif self.frame_builder.thinned_returns.get(source.topic):
            self._problems.report(
                source.part,
                Level.WARN,
                f"expected at most {MOST_RETURNS} returns in a sweep on {source.topic}, got "
                f"{self.frame_builder.thinned_returns[source.topic]} more: the nearest are used; set a threshold in "
                "the driver",
            )
        else:
            self._problems.settle(source.part)

    def _transform_problem(self) -> str:
        """What disagrees among transforms, and who publishes them."""
        names = {
            source.topic: sorted({entry.node_name for entry in self._node.get_publishers_info_by_topic(source.topic)})
            for source in self.inputs.transforms
        }
        who = "; ".join(f"{topic} is published by {', '.join(found)}" for topic, found in names.items() if found)
        problem = self.frame_builder.transform_problem
        return f"{problem} ({who})" if who else problem

    def _hand_over(self, frames: tuple[Frame, ...]) -> None:
        if frames:
            self._problems.settle("frame")
            self._check_motion()
        for frame in frames:
            self.frames_in += 1
            now_ns = time.monotonic_ns()
            self._worker.put(Ticket(frame, *self._images.pop(frame.stamp_ns, (now_ns, now_ns))))

    def _work(self, ticket: Ticket) -> None:
        frame, outputs = ticket.frame, self._outputs
        taken_ns = self.busy_since_ns = time.monotonic_ns()
        try:
            result = self.pipeline.estimate(frame, outputs.wanted())
            estimated_ns = time.monotonic_ns()
            if result is None:
                self._on_suppressed()
                return
            outputs.publish(self.pipeline.encode(frame, result, outputs.wanted()))
        except Exception as error:  # the boundary: a frame must never take the worker down
            self.frames_failed += 1
            self._on_inference_error(error)
        else:
            now_ns = time.monotonic_ns()
            times = FrameTimes(ticket.arrived_ns, ticket.decoded_ns, taken_ns, estimated_ns, now_ns)
            self.latencies.add(times)
            self._latency_topics.publish(times)
            self.frames_out.tick(now_ns)
            self._problems.settle("inference")
            self._check_view(len(frame.radar), result.radar_in_view)
        finally:
            self.busy_since_ns = None

    def _on_inference_error(self, error: Exception) -> None:
        if isinstance(error, RadcamDepthError):
            self._problems.report("inference", Level.ERROR, str(error))
        elif not self._is_closed:
            self._on_defect("inference", error)

    def _on_suppressed(self) -> None:
        self.frames_suppressed += 1
        self._problems.settle("inference")
        self._problems.report(
            "view",
            Level.WARN,
            "expected radar returns in view of the camera, got none, so the image gets no depth; check the radar, or "
            "set the parameter without_radar to camera_only",
        )

    def _check_view(self, returns: int, in_view: int) -> None:
        if returns and not in_view:
            self._problems.report(
                "view",
                Level.WARN,
                f"expected radar returns in view of the camera, got 0 of {returns}: all are behind it, outside of its "
                "image or too far away; check the extrinsics and the radar's frame_id",
            )
        else:
            self._problems.settle("view")

    def _check_motion(self) -> None:
        """Where returns cannot be moved to the image's time: depth comes all the same, so the log has it once."""
        problem = self.frame_builder.motion_problem
        if problem:
            self._problems.report("motion", Level.WARN, problem, quietly=self._is_motion_told)
            self._is_motion_told = True
        else:
            self._problems.settle("motion")

    def _on_unusable_image(self, error: Exception) -> None:
        self.images_unusable += 1
        # Where camera_info itself is the problem, that it is missing is no news.
        is_news = self._problems.peek("camera_info") is None and self._problems.peek("transforms") is None
        self._problems.report("frame", Level.ERROR, str(error), quietly=not is_news)

    def _on_unheard(self, part: str, sentence: str) -> None:
        self._problems.report(part, Level.ERROR, sentence)

    def _on_defect(self, part: str, error: Exception) -> None:
        self._problems.report(
            part,
            Level.ERROR,
            f"this was skipped: an unexpected {type(error).__name__}: {error}; it is a defect of radcam_depth_ros, "
            "please report it with the message that caused it",
        )
        self._node.get_logger().debug("".join(traceback.format_exception(error)))


def _stamp_ns(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * SECOND_NS + int(stamp.nanosec)
