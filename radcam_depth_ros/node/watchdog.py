"""Explains why no depth comes out: missing inputs, their publishers, and the remedy."""

from __future__ import annotations

import time

from rclpy.node import Node

from radcam_depth_ros.node.health import SECOND_NS, Problems, Rate
from radcam_depth_ros.node.session import Session
from radcam_depth_ros.node.topics.graph import Graph
from radcam_depth_ros.node.topics.inputs import Input

SILENCE_S = 2.0
"""A sensor that was silent for longer is reported."""
NO_OUTPUT_S = 5.0
"""After this time without depth one line in the log says what is missing."""
_ELSEWHERE = ("transforms", "moving transforms", "frame", "clocks", "stamps", "inference", "view")
"""Parts whose problems keep depth from coming though all sensors are heard."""


class Watchdog:
    """Watches whether depth comes out of a session.

    Args:
        node: The node.
        session: The session.
        problems: What was reported.
    """

    def __init__(self, node: Node, session: Session, problems: Problems) -> None:
        self._session = session
        self._problems = problems
        self._graph = Graph(node, [source.topic for source in session.inputs])
        self._was_silent = False

    def silence_s(self, source: Input) -> float | None:
        """Seconds since a message came, or since the session began, where that is too long; None where it is not."""
        silent_s = self._since_s(self._session.rates[source.part])
        return silent_s if silent_s > SILENCE_S else None

    def why_silent(self, source: Input) -> str:
        """Why nothing comes of an input, as far as the graph tells, and what to do."""
        inputs = self._session.inputs
        beside = inputs.camera.topic if source is inputs.camera_info and self._heard(inputs.camera) else ""
        return self._graph.remedy(source, self._session.qos(source), beside)

    def lacks(self, source: Input) -> bool:
        """Whether nothing comes of an input, or nothing that can be used."""
        inputs = self._session.inputs
        if self._problems.peek(source.part):
            return True
        if source is inputs.extrinsics:
            # What is fixed may come on /tf as well, as some drivers have it.
            return not any(self._heard(transforms) for transforms in inputs.transforms)
        if source is inputs.camera_info:
            return not self._heard(source)
        return not self._heard(source) or self.silence_s(source) is not None

    def trouble(self, *, is_for_log: bool = False) -> str:
        """Says that no depth came out for long, and why; empty while depth comes, or may still come.

        Depth cannot come while the network is warmed up, so that time does not count.

        Args:
            is_for_log: A sentence that the log has already is not repeated.
        """
        session, silent_s = self._session, self._since_s(self._session.frames_out)
        if min(silent_s, session.warm_up.age_s()) <= NO_OUTPUT_S:
            return ""
        inputs = session.inputs
        needed = (inputs.camera, inputs.camera_info, *inputs.radars, inputs.extrinsics, inputs.motion)
        lacking = [source for source in needed if source is not None and self.lacks(source)]
        reasons = [self._reason(source, is_for_log) for source in lacking]
        told = {source.part for source in lacking}
        if inputs.camera_info in lacking or inputs.extrinsics in lacking:
            told.add("frame")  # Without them there is none, which is said better above.
        for part in _ELSEWHERE:
            problem = self._problem(part, is_for_log)
            if problem and part not in told:
                reasons.append(f"{part}: {problem}")
        busy_since_ns = session.busy_since_ns
        if busy_since_ns is not None and not reasons:
            reasons.append(f"the network, busy for {(time.monotonic_ns() - busy_since_ns) / SECOND_NS:.1f} s")
        if len(reasons) > 1:
            reasons = [f"({number}) {reason}" for number, reason in enumerate(reasons, 1)]
        return f"no depth for {silent_s:.0f} s; missing: {' '.join(reasons) or 'nothing that is known'}"

    def news(self) -> str:
        """What `trouble` says, the first time that it says something; empty otherwise, until depth came again."""
        was_silent, trouble = self._was_silent, self.trouble(is_for_log=True)
        self._was_silent = bool(trouble)
        return "" if was_silent else trouble

    def _since_s(self, rate: Rate) -> float:
        now_ns = time.monotonic_ns()
        age_s = rate.age_s(now_ns)
        return (now_ns - self._session.started_ns) / SECOND_NS if age_s is None else age_s

    def _heard(self, source: Input) -> bool:
        return self._session.rates[source.part].count > 0

    def _problem(self, part: str, is_for_log: bool) -> str:
        """The sentence of a part's problem, or where the log has it; empty where there is none."""
        if is_for_log and self._problems.peek(part) and self._problems.is_logged(part):
            return f'see the line above that begins with "{part}:"'
        return self._problems.peek(part) or ""

    def _reason(self, source: Input, is_for_log: bool) -> str:
        publishers = self._graph.publishers(source, self._session.qos(source))
        what = f"{source.expected} on {source.topic} ({publishers})"
        if source is self._session.inputs.camera_info and self._heard(self._session.inputs.camera):
            what = f"images come, but no {what}"
        return f"{what}: {self._problem(source.part, is_for_log) or self.why_silent(source)}"
