"""Evaluates drives as published on nuScenes: key frames, one scan, one radar sweep, groups of day, night and rain."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.bags import BagReader, factory, read_key_frames, read_scenario
from radcam_depth_ros.drive import DriveSettings, read_samples
from radcam_depth_ros.evaluation.drive import Drive, Predict, resize_result
from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.measures.protocols import RANGES_M, Protocol, PublishedMeans, PublishedMetrics
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.messages import encode_points, stamp_ns
from radcam_depth_ros.messages.clouds import Cloud
from radcam_depth_ros.reporting.table import Table, number

ALL = "all"
_KEPT_STATES = {"invalid_state": (0, 0), "dyn_prop": (0, 6), "ambig_state": (3, 3)}
"""The default filters of nuScenes' devkit: the first and the last value of each field that stay."""
_MAX_KEY_OFFSET_S = 0.25
"""Readings of one key frame belong together, whatever their offset; two key frames are 0.5 s apart."""


@dataclass(frozen=True)
class PublishedEvaluation:
    """Errors of a network by a published protocol.

    Attributes:
        protocol: Name of the protocol.
        network: Name of the network.
        frames: Frames that were measured.
        groups: Averages over all frames (`all`), and over those by day, at night and in rain, where there are such.
    """

    protocol: str
    network: str
    frames: int
    groups: Mapping[str, PublishedMetrics]

    def as_json(self) -> dict[str, object]:
        """Plain values: errors in metres by group and the range's end."""
        groups = {name: metrics.as_json() for name, metrics in self.groups.items()}
        return {"protocol": self.protocol, "network": self.network, "frames": self.frames, "groups": groups}

    def table(self) -> Table:
        """A row a group."""
        ranges = [f"{range_m:g}" for range_m in RANGES_M]
        columns = ("", *(f"{title} {name}" for title in ("MAE", "RMSE") for name in ranges), "frames")
        rows = tuple(
            (name, *(number(value) for value in (*entry.mae_m, *entry.rmse_m)), str(entry.frames[-1]))
            for name, entry in self.groups.items()
        )
        note = "Of each frame, then averaged over frames; the last frame of each drive is left out, as published."
        return Table(f"Error in metres by the protocol {self.protocol}, within 50, 70 and 80 m", columns, rows, note)


@dataclass(frozen=True)
class PublishedSettings(DriveSettings):
    """Reads a bag as a published evaluation does.

    Attributes:
        wanted: Stamps in nanoseconds of the messages that are read, by topic; None reads all.
        filtered: Radars whose returns pass the filters of nuScenes' devkit.
    """

    wanted: Mapping[str, frozenset[int]] | None = None
    filtered: tuple[str, ...] = ()

    @property
    def is_published(self) -> bool:
        """True."""
        return True

    def screened(self, topic: str, message: Any) -> Any:
        """The message, filtered where that is asked for; None for one that is not wanted."""
        if self.wanted is not None and stamp_ns(message.header) not in self.wanted.get(topic, ()):
            return None
        return _filtered(message) if topic in self.filtered else message


def published_settings(bag: Path, settings: DriveSettings, protocol: Protocol) -> tuple[DriveSettings, int]:
    """How a bag is read for a protocol, and how many frames of it count: all but the last one.

    A scene that was imported gives its key frames with their own scan and their own sweep of the radar ahead, unless
    radars are named. Of any other drive each image counts, with the scan and the sweeps nearest to it.

    Raises:
        BagError: for a bag that cannot be read, or lacks a sensor.
    """
    with BagReader(bag) as reader:
        key_frames, scenario = list(read_key_frames(reader)), read_scenario(reader)
        choice = settings.topics
        if choice.radars is None and not choice.preferred and "radar" in scenario:
            choice = dataclasses.replace(choice, radars=(scenario["radar"],))
        settings = dataclasses.replace(settings, topics=choice)
        topics = settings.find_topics(reader)
        if topics.lidar is None:
            raise EvaluationError(
                f"expected a LiDAR (sensor_msgs/PointCloud2) in {bag}, got {', '.join(topics.names)}; a published "
                "protocol measures against its scans: see --lidar"
            )
        if key_frames:
            key_frames = sorted((frame for frame in key_frames if topics.image in frame), key=lambda f: f[topics.image])
        frames = len(key_frames) or reader.count([topics.image])
    wanted = {
        topic: frozenset(frame[topic] for frame in key_frames[:-1] if topic in frame)
        for topic in (topics.image, topics.lidar, *topics.radars)
    }
    offset_s = _MAX_KEY_OFFSET_S if key_frames else settings.max_lidar_offset_s
    read = PublishedSettings(
        settings.frame_builder,
        settings.topics,
        "lidar",
        max_lidar_offset_s=offset_s,
        wanted=wanted if key_frames else None,
        filtered=topics.radars if protocol.filters_radar else (),
    )
    return read, frames - 1


def published_drives(
    bags: Iterable[Path], settings: DriveSettings, protocol: Protocol, limit: int | None = None
) -> tuple[list[Drive], int]:
    """The drives of some bags as a protocol has them, and how many frames these have.

    Args:
        bags: All are looked at before any is read.
        settings: How bags are read, apart from what the protocol says.
        protocol: The protocol.
        limit: Of each bag at most so many frames.

    Raises:
        RadcamDepthError: for a bag that cannot be read, lacks a sensor, or has one frame alone.
    """
    drives, total = [], 0
    for bag in bags:
        own, frames = published_settings(bag, settings, protocol)
        if frames < 1:
            raise EvaluationError(
                f"expected two frames or more in {bag}, got {frames + 1}: a protocol leaves out the last one"
            )
        frames = min(frames, limit or frames)
        with BagReader(bag) as reader:
            scenario = read_scenario(reader)
        drives.append(Drive(islice(read_samples(bag, own), frames), bag.stem, scenario))
        total += frames
    return drives, total


def evaluate_published(
    drives: Iterable[Drive],
    predict: Predict,
    protocol: Protocol,
    network: str = "network",
    progress: Callable[[], None] = lambda: None,
) -> PublishedEvaluation:
    """Estimates and measures every frame of some drives by a protocol.

    Args:
        drives: Frames as `published_settings` has them read, without the last one of each.
        predict: Returns the depth of a frame.
        protocol: How it is measured.
        network: Name in the result.
        progress: Called after each frame.

    Raises:
        EvaluationError: when no frame has ground truth, or a depth image cannot be the same view as its frame.
    """
    sums = PublishedSums()
    for drive in drives:
        sums.join(sum_published(drive, predict, protocol, progress).plain())
    return sums.result(protocol, network)


class PublishedSums(Sums):
    """Sums of one or several drives by a published protocol."""

    SUMMED = ("_groups", "_frames")

    def __init__(self) -> None:
        self._groups: defaultdict[str, PublishedMeans] = defaultdict(PublishedMeans)
        self._frames = 0

    def add(self, names: Iterable[str], measures: npt.NDArray[np.float64]) -> None:
        """Adds a frame's measures, as of `Protocol.measure`, to groups of these names."""
        for name in names:
            self._groups[name].add(measures)
        self._frames += 1

    def result(self, protocol: Protocol, network: str) -> PublishedEvaluation:
        """The averages so far; EvaluationError when no frame has ground truth."""
        groups = {name: mean.result() for name, mean in self._groups.items()}
        if ALL not in groups or not groups[ALL].frames[-1]:
            raise EvaluationError(
                f"expected LiDAR points within {RANGES_M[-1]:g} m in some of {self._frames} frames, got none; a drive "
                "needs two images or more with scans, and the vehicle's motion"
            )
        return PublishedEvaluation(protocol.name, network, self._frames, groups)


def sum_published(
    drive: Drive, predict: Predict, protocol: Protocol, progress: Callable[[], None] = lambda: None
) -> PublishedSums:
    """Estimates and sums up every frame of one drive; arguments and errors as of `evaluate_published`."""
    sums, names = PublishedSums(), (ALL, *_groups_of(drive.scenario))
    for sample in drive.samples:
        depth = predict(sample.frame)
        if depth is None:
            raise EvaluationError("expected a depth image of each frame, got none; a protocol leaves no frame out")
        sums.add(names, protocol.measure(resize_result(depth, sample.frame).dense, sample.depth_m))
        progress()
    return sums


def _groups_of(scenario: Mapping[str, str]) -> tuple[str, ...]:
    """The groups of a drive's frames; none where it does not say."""
    time_of_day = scenario.get("time_of_day")
    light = () if time_of_day is None else ("night",) if time_of_day == "night" else ("day",)
    return (*light, *(("rain",) if scenario.get("weather") == "rain" else ()))


def _filtered(message: Any) -> Any:
    """A radar's cloud without the returns that the devkit leaves out; as it is where it has no such states."""
    cloud = Cloud(message)
    fields = [cloud.find((str(field.name),)) for field in cloud.fields]
    columns = {field.name: cloud.column(field) for field in fields if field is not None}
    if not all(name in columns for name in _KEPT_STATES):
        return message
    kept = np.ones(cloud.count, np.bool_)
    for name, (first, last) in _KEPT_STATES.items():
        kept &= (columns[name] >= first) & (columns[name] <= last)
    values = {name: column[kept] for name, column in columns.items()}
    return encode_points(factory, values, stamp_ns(message.header), str(message.header.frame_id))
