"""Collects facts about a topic while its bag is read."""

from __future__ import annotations

from typing import Any

import numpy as np

from radcam_depth_ros.bags import RADAR_SCAN, RADAR_TYPES, BagError, BagMessage, TopicInfo, read_header
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.inspection.report import CameraFacts, CloudFacts, ImageFacts, TopicFacts
from radcam_depth_ros.inspection.timing import timing_of
from radcam_depth_ros.messages import (
    SCAN_FIELDS,
    Calibration,
    FieldAliases,
    RadarContents,
    RadarFields,
    decode_depth,
    decode_image,
    decode_radar,
)

_SAMPLES = 5
"""Messages of a topic that are decoded whole; of all others only the header is read."""
_DEPTH_ENCODINGS = ("32fc1", "16uc1")


class Recording:
    """One topic.

    Args:
        info: The topic.
        role: What it would be taken for.

    Attributes:
        info: The topic.
        role: What it would be taken for.
        stamps_ns: Of the messages that have a header.
        logs_ns: When messages were recorded.
        frame_ids: Frames in the headers, in the order in which they came.
        problem: Why messages cannot be read at all; empty when they can.
    """

    def __init__(self, info: TopicInfo, role: str) -> None:
        self.info, self.role = info, role
        self.stamps_ns: list[int] = []
        self.logs_ns: list[int] = []
        self.frame_ids: dict[str, None] = {}
        self.problem = ""
        self._samples: list[Any] = []
        self._counts: list[int] = []
        self._radar_problem = ""
        self._taken = RadarFields()
        self._contents = RadarContents(FieldAliases())

    def add(self, item: BagMessage) -> None:
        """Takes note of a message."""
        self.logs_ns.append(item.log_time_ns)
        try:
            if item.message_type.has_header:
                header = read_header(item.raw)
                self.stamps_ns.append(header.stamp_ns)
                self.frame_ids.setdefault(header.frame_id)
            if self.role == "radar":
                self._add_sweep(item.message)
            if len(self._samples) < _SAMPLES:
                self._samples.append(item.message)
        except BagError as error:
            self.problem = self.problem or str(error)

    def _add_sweep(self, message: Any) -> None:
        # By the message, not by the topic's type: a bag may hold both types under one name.
        is_scan = hasattr(message, "returns")
        self._counts.append(len(message.returns) if is_scan else int(message.width) * int(message.height))
        try:
            sweep = decode_radar(message)
        except RadcamDepthError as error:
            self._radar_problem = self._radar_problem or str(error)
        else:
            self._taken = sweep.fields if len(sweep.returns) else self._taken
            self._contents.add(sweep.returns, sweep.fields)

    @property
    def times_ns(self) -> list[int]:
        """Stamps where messages have some, else when they were recorded."""
        return self.stamps_ns if any(self.stamps_ns) else self.logs_ns

    def topic_facts(self) -> TopicFacts:
        """The topic, with its timing."""
        times_ns = self.times_ns
        timing = timing_of(times_ns)
        delays_ns = np.subtract(self.logs_ns[: len(self.stamps_ns)], self.stamps_ns) if self.stamps_ns else None
        return TopicFacts(
            self.info.name,
            self.info.type_name,
            self.info.count,
            None if timing.hz is None else round(timing.hz, 2),
            self.role,
            None if timing.jitter_s is None else round(1e3 * timing.jitter_s, 3),
            None if timing.largest_gap_s is None else round(timing.largest_gap_s, 4),
            timing.backwards,
            None if delays_ns is None else round(float(np.median(delays_ns)) / 1e6, 3),
            tuple(self.frame_ids),
            self.info.latched,
            self.info.reliable,
            self.stamps_ns.count(0),
        )

    def image_facts(self) -> ImageFacts:
        """Of a topic of images."""
        width = height = 0
        encoding = problem = ""
        for message in self._samples:
            encoding = str(message.encoding if hasattr(message, "encoding") else message.format)
            width, height = int(getattr(message, "width", 0)), int(getattr(message, "height", 0))
            try:
                if encoding.lower() in _DEPTH_ENCODINGS:
                    decode_depth(message)
                else:
                    height, width = decode_image(message).image.shape[:2]
            except RadcamDepthError as error:
                problem = problem or str(error)
        return ImageFacts(self.info.name, encoding, width, height, problem or self.problem)

    def camera_facts(self) -> CameraFacts:
        """Of a topic of camera_info."""
        facts = CameraFacts(self.info.name, 0, 0, None, "", (), False, self.problem)
        for message in self._samples[-1:]:
            model, distortion = str(message.distortion_model), tuple(float(value) for value in message.d)
            size = (int(message.width), int(message.height))
            try:
                calibration = Calibration(message)
            except RadcamDepthError as error:
                return CameraFacts(self.info.name, *size, None, model, distortion, any(distortion), str(error))
            camera = calibration.camera
            facts = CameraFacts(
                self.info.name,
                camera.width,
                camera.height,
                round(camera.fx, 2),
                model,
                distortion,
                calibration.lens is not None,
            )
        return facts

    def cloud_facts(self) -> CloudFacts:
        """Of a topic of point clouds or scans."""
        if self.info.type_name == RADAR_SCAN:
            names: tuple[str, ...] = SCAN_FIELDS
        else:
            message = next((sample for sample in self._samples if getattr(sample, "fields", None)), None)
            names = tuple(str(field.name) for field in message.fields) if message is not None else ()
        if self.role != "radar" or not self._counts:
            return CloudFacts(self.info.name, names, problem=self.problem)
        taken = self._taken
        return CloudFacts(
            self.info.name,
            names,
            taken.position,
            taken.rcs,
            taken.radial_speed,
            (min(self._counts), int(np.median(self._counts)), max(self._counts)),
            self.problem or self._radar_problem,
            self._contents.doubt(self.info.name),
        )

    @property
    def is_cloud(self) -> bool:
        """Whether it is a topic of point clouds or scans."""
        return self.info.type_name in RADAR_TYPES
