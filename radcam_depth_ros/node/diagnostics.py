"""The node's state as lines of `/diagnostics`, and as one sentence when no depth comes out."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from radcam_depth_ros.messages import MessageFactory
from radcam_depth_ros.node.health import SECOND_NS, Level, Problems, Status
from radcam_depth_ros.node.inputs import Input
from radcam_depth_ros.node.outputs import Outputs
from radcam_depth_ros.node.session import Session
from radcam_depth_ros.pairing import PairingCounts

SILENCE_S = 2.0
"""A sensor that was silent for longer is reported."""
NO_OUTPUT_S = 5.0
"""After this time without depth one line in the log says what is missing."""

_WITHOUT_RADAR = {
    "camera_only": "their depth is from the camera alone",
    "hold": "their depth is from older returns, and once these are too old from the camera alone",
    "suppress": "so they get no depth",
}

Values = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Snapshot:
    """What diagnostics are made from.

    Attributes:
        phase: The lifecycle state: unconfigured, inactive, active or finalized.
        model: What the estimator says of itself; empty when none is loaded.
        session: What lives while the node is active.
        outputs: The publishers, while the node is configured.
    """

    phase: str
    model: str = ""
    session: Session | None = None
    outputs: Outputs | None = None


class Diagnostics:
    """Looks at the node once a second and tells what it sees.

    Args:
        node: The node; its name begins each line.
        problems: What was reported.
    """

    def __init__(self, node: Node, problems: Problems) -> None:
        self._node = node
        self._problems = problems
        self._counts: PairingCounts | None = None
        self._was_silent = False

    def message(self, statuses: tuple[Status, ...], factory: MessageFactory) -> Any:
        """A diagnostic_msgs/DiagnosticArray."""
        return factory(
            "diagnostic_msgs/msg/DiagnosticArray",
            header=factory("std_msgs/msg/Header", stamp=self._node.get_clock().now().to_msg(), frame_id=""),
            status=[self._status_message(status, factory) for status in statuses],
        )

    def _status_message(self, status: Status, factory: MessageFactory) -> Any:
        return factory(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=bytes([status.level]),
            name=f"{self._node.get_name()}: {status.name}",
            message=status.message,
            hardware_id=self._node.get_fully_qualified_name(),
            values=[factory("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in status.values],
        )

    def statuses(self, snapshot: Snapshot) -> tuple[Status, ...]:
        """One line for each part of the node."""
        session = snapshot.session
        if session is None:
            self._counts = None
            idle = tuple(
                Status(part, Level.STALE, f"the node is {snapshot.phase}")
                for part in ("camera", "radar", "calibration", "pairing", "inference", "output")
            )
            return (*idle, self._model(snapshot))
        now_ns = time.monotonic_ns()
        return (
            self._sensor(session, session.inputs.camera, Level.ERROR, now_ns),
            *(self._sensor(session, radar, Level.WARN, now_ns) for radar in session.inputs.radars),
            *((self._sensor(session, odometry, Level.WARN, now_ns),) if (odometry := session.inputs.odometry) else ()),
            self._calibration(session),
            self._pairing(session),
            self._inference(session, now_ns),
            self._output(snapshot),
            self._model(snapshot),
        )

    def _model(self, snapshot: Snapshot) -> Status:
        problem = self._problems.tell("model", "parameters")
        if problem:
            return Status("model", *problem, self._problems.history("model", "parameters"))
        if not snapshot.model:
            return Status("model", Level.STALE, f"no network is loaded, the node is {snapshot.phase}")
        return Status("model", Level.OK, snapshot.model)

    def _sensor(self, session: Session, source: Input, silent_level: Level, now_ns: int) -> Status:
        rate = session.rates[source.part]
        age_s = rate.age_s(now_ns)
        values: Values = (
            ("topic", source.topic),
            ("type", source.type_name),
            ("publishers", str(self._node.count_publishers(source.topic))),
            ("messages", str(rate.count)),
            ("used", str(session.accepted[source.part])),
            ("rate [Hz]", f"{rate.hertz(now_ns):.1f}"),
            ("age [s]", "never" if age_s is None else f"{age_s:.2f}"),
            *self._problems.history(source.part),
        )
        problem = self._problems.tell(source.part)
        silent_s = (now_ns - session.started_ns) / SECOND_NS if age_s is None else age_s
        if problem:
            # Silence may well come of the problem, so the problem is told first.
            since = f" (and nothing for {silent_s:.0f} s)" if silent_s > SILENCE_S else ""
            return Status(source.part, problem[0], problem[1] + since, values)
        if silent_s > SILENCE_S:
            return Status(source.part, silent_level, self._silence(source, silent_s), values)
        if age_s is None:
            return Status(source.part, Level.STALE, f"waiting for the first message on {source.topic}", values)
        return Status(source.part, Level.OK, f"{rate.hertz(now_ns):.1f} Hz on {source.topic}", values)

    def _silence(self, source: Input, silent_s: float) -> str:
        others = {
            name
            for info in self._node.get_publishers_info_by_topic(source.topic)
            if (name := info.topic_type) != source.type_name
        }
        if others:
            why = f"it is published as {', '.join(sorted(others))}: set the parameter of the topic or image_transport"
        elif self._node.count_publishers(source.topic):
            why = "it has a publisher, which is silent or whose quality of service does not match"
        else:
            why = "nobody publishes it: start the driver, or set the topic's name"
        return f"expected {source.type_name} on {source.topic}, got nothing for {silent_s:.1f} s; {why}"

    def _calibration(self, session: Session) -> Status:
        parts = ("camera_info", "transforms", "frame")
        problem, values = self._problems.tell(*parts), self._problems.history(*parts)
        camera, info = session.pipeline.camera, session.inputs.camera_info
        values = (("frames", " ".join(session.pipeline.transforms.frames)), *values)
        if problem:
            return Status("calibration", *problem, values)
        if camera is None:
            sentence = f"expected {info.type_name} on {info.topic}, got none yet; publish the camera's calibration"
            return Status("calibration", Level.ERROR, sentence, values)
        sentence = f"{camera.width} x {camera.height} pixels, fx {camera.fx:.1f}, fy {camera.fy:.1f}"
        return Status("calibration", Level.OK, sentence, values)

    def _pairing(self, session: Session) -> Status:
        counts, before = session.pipeline.counts, self._counts
        self._counts = counts
        if before is not None and counts.resets > before.resets:
            self._problems.report(
                "pairing",
                Level.WARN,
                "expected stamps that go forward, got ones that jumped back, as in a looped bag or after a reset of "
                "the clock; images and sweeps from before are not paired with those from after",
            )
            self._problems.settle("pairing")
        values: Values = (
            ("images", str(counts.images)),
            ("paired", str(counts.paired)),
            ("unmatched", str(counts.unmatched)),
            ("out of order", str(counts.overtaken)),
            ("duplicates", str(counts.duplicates)),
            ("backward jumps", str(counts.resets)),
            *((f"{radar.name}: paired", str(radar.paired)) for radar in counts.radars),
            *((f"{radar.name}: late sweeps", str(radar.late)) for radar in counts.radars),
            *(
                (("frames without motion", str(session.pipeline.unmoved_frames)),)
                if session.pipeline.config.moves_radar
                else ()
            ),
            *self._problems.history("pairing", "view", "motion"),
        )
        problem = self._problems.tell("pairing", "view", "motion")
        if problem:
            return Status("pairing", *problem, values)
        images = counts.images - (before.images if before else 0)
        unmatched = counts.unmatched - (before.unmatched if before else 0)
        if unmatched:
            config = session.pipeline.config
            sentence = (
                f"{unmatched} images of the last second had no radar sweep within "
                f"{config.pairing.max_time_offset_s:g} s, {_WITHOUT_RADAR[config.without_radar]}; check that the radar "
                "runs and that both clocks agree"
            )
            return Status("pairing", Level.WARN, sentence, values)
        return Status("pairing", Level.OK, f"{images} images in the last second", values)

    def _inference(self, session: Session, now_ns: int) -> Status:
        latency, processing = session.latency.percentiles_ms(), session.processing.percentiles_ms()
        names = ("p50", "p95", "p99")
        values: Values = (
            *((f"latency {name} [ms]", f"{value:.1f}") for name, value in zip(names, latency, strict=False)),
            *((f"processing {name} [ms]", f"{value:.1f}") for name, value in zip(names, processing, strict=False)),
            ("frames in", str(session.frames_in)),
            ("frames out", str(session.frames_out.count)),
            ("dropped: overload", str(session.frames_dropped)),
            ("dropped: failed", str(session.frames_failed)),
            ("suppressed: without radar", str(session.frames_suppressed)),
            ("rate [Hz]", f"{session.frames_out.hertz(now_ns):.1f}"),
            *self._problems.history("inference"),
        )
        problem = self._problems.tell("inference")
        if problem:
            return Status("inference", *problem, values)
        if not latency:
            return Status("inference", Level.STALE, "no frame was processed yet", values)
        rate = session.frames_out.hertz(now_ns)
        return Status("inference", Level.OK, f"{rate:.1f} Hz, {latency[0]:.0f} ms from image to depth", values)

    def _output(self, snapshot: Snapshot) -> Status:
        session, outputs = snapshot.session, snapshot.outputs
        values = (*(outputs.subscribers() if outputs else ()), *self._problems.history("output"))
        problem = self._problems.tell("output")
        if problem:
            return Status("output", *problem, values)
        silent_s = self.silent_s(session) if session else 0.0
        if session and silent_s > NO_OUTPUT_S:
            return Status("output", Level.ERROR, self.missing(session, silent_s), values)
        return Status("output", Level.OK, "publishing", values)

    def silent_s(self, session: Session) -> float:
        """Seconds since depth came out, or since the node became active."""
        now_ns = time.monotonic_ns()
        age_s = session.frames_out.age_s(now_ns)
        return (now_ns - session.started_ns) / SECOND_NS if age_s is None else age_s

    def missing(self, session: Session, silent_s: float) -> str:
        """Why no depth comes out."""
        now_ns = time.monotonic_ns()
        reasons = []
        for source in (session.inputs.camera, session.inputs.camera_info, *session.inputs.radars):
            age_s = session.rates[source.part].age_s(now_ns)
            problem = self._problems.peek(source.part)
            is_needed_once = source is session.inputs.camera_info
            if problem:
                reasons.append(f"{source.part}: {problem}")
            elif age_s is None or (age_s > SILENCE_S and not is_needed_once):
                publishers = self._node.count_publishers(source.topic)
                reasons.append(f"{source.type_name} on {source.topic} ({publishers or 'no'} publishers)")
        for part in ("transforms", "frame", "inference", "view"):
            problem = self._problems.peek(part)
            if problem:
                reasons.append(f"{part}: {problem}")
        if session.busy_since_ns is not None and not reasons:
            reasons.append(f"the network, busy for {(now_ns - session.busy_since_ns) / SECOND_NS:.1f} s")
        return f"no depth for {silent_s:.0f} s; missing: {'; '.join(reasons) or 'nothing that is known'}"

    def watch(self, session: Session) -> str:
        """The line to log when no depth came out for long; empty when there is no news."""
        silent_s = self.silent_s(session)
        was_silent, self._was_silent = self._was_silent, silent_s > NO_OUTPUT_S
        return self.missing(session, silent_s) if self._was_silent and not was_silent else ""
