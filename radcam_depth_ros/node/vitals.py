"""Makes a diagnostic status for each part of the running node."""

from __future__ import annotations

import time

import numpy as np
from rclpy.node import Node

from radcam_depth_ros.messages import RadarContents
from radcam_depth_ros.node.health import SECOND_NS, Level, Problems, Rate, Status
from radcam_depth_ros.node.session import Session
from radcam_depth_ros.node.topics.inputs import Input
from radcam_depth_ros.node.topics.outputs import Outputs
from radcam_depth_ros.node.watchdog import Watchdog
from radcam_depth_ros.pairing import CLOCK_WARNING_S, PairingCounts, clock_warning
from radcam_depth_ros.printable import printable

Values = tuple[tuple[str, str], ...]
_NEAR_SHARE = 0.8
"""Images that wait for more than this share of `max_wait_s` are told."""
_WITHOUT_RADAR = {
    "camera_only": "their depth is from the camera alone",
    "hold": "their depth is from older returns, and once these are too old from the camera alone",
    "suppress": "so they get no depth",
}


class Vitals:
    """Looks at a session, once for each diagnostics message.

    Args:
        node: The node.
        session: What lives while it is active.
        outputs: Its publishers.
        problems: What was reported.
    """

    def __init__(self, node: Node, session: Session, outputs: Outputs, problems: Problems) -> None:
        self._node = node
        self._session = session
        self._outputs = outputs
        self._problems = problems
        self.watchdog = Watchdog(node, session, problems)
        self._before = session.frame_builder.counts
        self._leaps_before = 0
        self._are_clocks_told = False
        self._told: dict[str, str] = {}  # by radar: what it is read from, as the log has it
        self._doubted: set[str] = set()

    def statuses(self) -> tuple[Status, ...]:
        """One for each part."""
        inputs = self._session.inputs
        return (
            self._sensor(inputs.camera, Level.ERROR),
            *(self._sensor(radar, Level.WARN) for radar in inputs.radars),
            *((self._sensor(inputs.motion, Level.WARN),) if inputs.motion else ()),
            self._calibration(),
            self._pairing(),
            self._inference(),
            self._output(),
        )

    def _sensor(self, source: Input, silent_level: Level) -> Status:
        session = self._session
        rate, contents = session.rates[source.part], session.frame_builder.contents.get(source.topic)
        values: Values = (
            ("topic", source.topic),
            ("type", source.type_name),
            *self._counts(source),
            *_pace(rate),
            *self._stamps(source),
            *(contents.values() if contents else ()),
            *self._problems.history(source.part),
        )
        problem, silent_s = self._problems.show(source.part), self.watchdog.silence_s(source)
        if problem:
            # Silence may well come of the problem, so the problem is told first.
            since = "" if silent_s is None else f" (and nothing for {silent_s:.0f} s)"
            return Status(source.part, problem[0], problem[1] + since, values)
        if silent_s is not None:
            sentence = (
                f"expected {source.expected} on {source.topic}, got nothing for {silent_s:.1f} s; "
                f"{self.watchdog.why_silent(source)}"
            )
            return Status(source.part, silent_level, sentence, values)
        if not rate.count:
            return Status(source.part, Level.STALE, f"waiting for the first message on {source.topic}", values)
        sentence = f"{rate.hertz(time.monotonic_ns()):.1f} Hz on {source.topic}"
        lacks = self._contents_problem(source, contents) if contents else ""
        if lacks:
            return Status(source.part, Level.WARN, f"{sentence}, but {lacks}", values)
        return Status(source.part, Level.OK, sentence, values)

    def _contents_problem(self, source: Input, contents: RadarContents) -> str:
        """What is wrong with what a radar is read from; the log has what that is, and a doubt about it, once."""
        summary, logger = contents.summary(), self._node.get_logger()
        if summary and self._told.get(source.part) != summary:
            self._told[source.part] = summary
            logger.info(printable(f"{source.part}: reads {source.type_name}: {summary}"))
        doubt = contents.doubt(source.topic)
        if doubt and source.part not in self._doubted:
            self._doubted.add(source.part)
            logger.warning(printable(f"{source.part}: {doubt}"))
        return contents.problem(source.topic)

    def _counts(self, source: Input, prefix: str = "") -> Values:
        session, part = self._session, source.part
        publishers, lost = session.publishers(source), str(session.lost[part].count)
        counts = {
            "publishers": publishers,
            "messages": session.rates[part].count,
            "used": session.used[part],
            "not usable": session.unusable[part],
            "undecodable": session.undecodable[part],
            "too large": session.too_large[part],
            "dropped before they were decoded": session.reader.dropped[part],
            # Numbers of several publishers cannot be told apart.
            "lost before they came": lost if publishers <= 1 else f"{lost} or more, of {publishers} publishers",
        }
        return tuple((prefix + name, str(count)) for name, count in counts.items())

    def _stamps(self, source: Input) -> Values:
        session, values = self._session, []
        stamps, offset = session.stamps.get(source.part), session.stamp_offsets.get(source.part)
        missing = stamps.missing_share() if stamps else None
        if missing is not None:
            values.append(("missing between stamps [%]", f"{100 * missing:.0f}"))
        offset_s = offset.seconds() if offset else None
        if offset_s is not None:
            ahead_s = offset_s + session.radar_time_offset_s(source)
            values.append(("stamps ahead of the camera's [ms]", f"{ahead_s * 1e3:.0f}"))
        if source in session.inputs.radars:
            is_by_arrival = session.frame_builder.config.is_stamped_by_arrival(source.topic)
            values.append(("stamps", "arrival" if is_by_arrival else "header"))
        return tuple(values)

    def _calibration(self) -> Status:
        session = self._session
        parts, info, camera = (
            ("camera_info", "transforms", "moving transforms", "frame"),
            session.inputs.camera_info,
            session.frame_builder.camera,
        )
        values = (
            *_pace(session.rates[info.part]),
            *(
                value
                for source in (info, *session.inputs.transforms)
                for value in self._counts(source, f"{source.part}: ")
            ),
            ("frames", " ".join(session.frame_builder.transforms.frames)),
            *self._problems.history(*parts),
        )
        problem, extrinsics = self._problems.show(*parts), session.inputs.extrinsics
        if problem:
            level, sentence = problem
            if extrinsics and not self._problems.peek(extrinsics.part) and self.watchdog.lacks(extrinsics):
                sentence += f"; {self.watchdog.why_silent(extrinsics)}"
            return Status("calibration", level, sentence, values)
        if camera is None:
            sentence = f"expected {info.type_name} on {info.topic}, got none yet; {self.watchdog.why_silent(info)}"
            return Status("calibration", Level.ERROR, sentence, values)
        sentence = f"{camera.width} x {camera.height} pixels, fx {camera.fx:.1f}, fy {camera.fy:.1f}"
        return Status("calibration", Level.OK, sentence, values)

    def _pairing(self) -> Status:
        counts, before = self._session.frame_builder.counts, self._before
        self._before = counts
        self._check_stamps(counts, before)
        parts = ("clocks", "pairing", "stamps", "view", "motion")
        values = (*self._pairing_values(counts), *self._problems.history(*parts))
        problem = self._problems.show(*parts)
        if problem:
            return Status("pairing", *problem, values)
        unmatched = counts.unmatched - before.unmatched
        if unmatched and self._session.inputs.radars:
            config = self._session.frame_builder.config
            sentence = (
                f"{unmatched} images of the last second had no radar sweep within "
                f"{config.pairing.max_time_offset_s:g} s, {_WITHOUT_RADAR[config.without_radar]}; check that the radar "
                "runs and that both clocks agree"
            )
            return Status("pairing", Level.WARN, sentence, values)
        sentence = f"{counts.images - before.images} images in the last second{self._long_wait()}"
        return Status("pairing", Level.OK, sentence, values)

    def _long_wait(self) -> str:
        """That images wait nearly as long as they may; empty where they do not."""
        builder = self._session.frame_builder
        wait_s, limit_s = float(np.median(builder.waits_s or 0.0)), builder.config.pairing.max_wait_s
        if not limit_s or wait_s < _NEAR_SHARE * limit_s:
            return ""
        return (
            f"; they wait {wait_s * 1e3:.0f} ms for radar sweeps, near max_wait_s, {limit_s:g} s: sweeps come late, or "
            "irregularly and out of order"
        )

    def _pairing_values(self, counts: PairingCounts) -> Values:
        frame_builder = self._session.frame_builder
        values = [
            ("images", str(counts.images)),
            ("paired", str(counts.paired)),
            ("unmatched", str(counts.unmatched)),
            ("waiting", str(counts.waiting)),
            ("out of order", str(counts.overtaken)),
            ("duplicates", str(counts.duplicates)),
            ("backward jumps", str(counts.resets)),
        ]
        if frame_builder.waits_s:
            found = np.percentile(frame_builder.waits_s, (50, 99))
            values += [
                (f"wait {name} [ms]", f"{value * 1e3:.1f}") for name, value in zip(("p50", "p99"), found, strict=True)
            ]
        for radar in counts.radars:
            values += [
                (f"{radar.name}: paired", str(radar.paired)),
                (f"{radar.name}: late sweeps", str(radar.late)),
                (f"{radar.name}: duplicates", str(radar.duplicates)),
            ]
            offsets_s = frame_builder.offsets_s[radar.name]
            if offsets_s:
                found = np.percentile(np.abs(offsets_s), (50, 99))
                values += [
                    (f"{radar.name}: dt {name} [ms]", f"{value * 1e3:.1f}")
                    for name, value in zip(("p50", "p99"), found, strict=True)
                ]
        if frame_builder.config.moves_radar:
            values.append(("frames without motion", str(frame_builder.unmoved_frames)))
        return tuple(values)

    def _check_stamps(self, counts: PairingCounts, before: PairingCounts) -> None:
        problems = self._problems
        if counts.resets > before.resets:
            problems.report(
                "pairing",
                Level.WARN,
                "expected stamps that go forward, got ones that jumped back, as in a looped bag or after a reset of "
                "the clock; images and sweeps from before are not paired with those from after",
            )
            problems.settle("pairing")
        self._check_leaps()
        duplicates = counts.duplicates - before.duplicates
        if duplicates > 0:
            problems.report(
                "stamps",
                Level.WARN,
                f"expected a stamp of its own on each image, got {duplicates} images in the last second that had one "
                "that was there already and were dropped; look for a second publisher, or a driver that sets no stamps",
            )
        elif counts.images > before.images:
            problems.settle("stamps")
        self._check_clocks()

    def _check_leaps(self) -> None:
        clock = self._session.clock
        if clock.leaps > self._leaps_before:
            self._problems.report(
                "pairing",
                Level.WARN,
                f"expected /clock to run on, it leapt {clock.last_leap_ns / SECOND_NS:.0f} s ahead, as where a "
                "playback is moved or two of them publish it; images that waited for radar sweeps wait no longer",
            )
            self._problems.settle("pairing")
        self._leaps_before = clock.leaps

    def _check_clocks(self) -> None:
        session = self._session
        for radar in session.inputs.radars:
            set_s = session.radar_time_offset_s(radar)
            apart_s = session.stamp_offsets[radar.part].apart_s(CLOCK_WARNING_S, set_s)
            if apart_s is not None and not session.stamps[radar.part].are_unset:
                # Arrivals tell no more than hundredths.
                sentence = clock_warning(radar.topic, round(apart_s, 2), "by when they arrive", set_s)
                self._problems.report("clocks", Level.WARN, sentence, quietly=self._are_clocks_told)
                self._are_clocks_told = True
                return
        self._problems.settle("clocks")

    def _inference(self) -> Status:
        session = self._session
        values: Values = (
            *session.latencies.values(),
            ("frames in", str(session.frames_in)),
            ("frames out", str(session.frames_out.count)),
            *_pace(session.frames_out),
            *self._problems.history("inference"),
        )
        problem = self._problems.show("inference")
        if problem:
            return Status("inference", *problem, values)
        camera = session.warm_up.camera
        if camera is not None:
            sentence = f"the network is being warmed up for images of {camera.width} x {camera.height} pixels"
            return Status("inference", Level.STALE, sentence, values)
        latency = session.latencies.percentiles_ms("latency")
        if not latency:
            return Status("inference", Level.STALE, "no frame was processed yet", values)
        rate = session.frames_out.hertz(time.monotonic_ns())
        return Status("inference", Level.OK, f"{rate:.1f} Hz, {latency[0]:.0f} ms from image to depth", values)

    def _output(self) -> Status:
        session = self._session
        camera, counts = session.inputs.camera.part, session.frame_builder.counts
        values = (
            *_pace(session.frames_out),
            ("images", str(session.rates[camera].count)),
            ("frames out", str(session.frames_out.count)),
            ("dropped: unreadable", str(session.unusable[camera])),
            ("dropped: before decoding", str(session.reader.dropped[camera])),
            ("dropped: duplicate", str(counts.duplicates)),
            ("dropped: no calibration or transform", str(session.images_unusable)),
            ("dropped: overload", str(session.frames_dropped)),
            ("dropped: failed", str(session.frames_failed)),
            ("dropped: without radar", str(session.frames_suppressed)),
            *self._outputs.subscribers(),
            *self._problems.history("output"),
        )
        problem = self._problems.show("output")
        if problem:
            return Status("output", *problem, values)
        trouble = self.watchdog.trouble()
        if trouble:
            return Status("output", Level.ERROR, trouble, values)
        if not session.frames_out.count:
            return Status("output", Level.STALE, "no depth yet", values)
        return Status("output", Level.OK, "publishing", values)


def _pace(rate: Rate) -> Values:
    now_ns = time.monotonic_ns()
    age_s = rate.age_s(now_ns)
    return (
        ("rate [Hz]", f"{rate.hertz(now_ns):.1f}"),
        ("age [s]", "never" if age_s is None else f"{age_s:.2f}"),
    )
