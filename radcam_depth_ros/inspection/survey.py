"""Reads a bag once and reports its contents for the node."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from radcam_depth_ros.bags import BagReader, read_static_transforms
from radcam_depth_ros.bags.topics import CAMERA_INFO_TYPES, IMAGE_TYPES
from radcam_depth_ros.drive.clocks import Clocks
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.geometry import TransformTree
from radcam_depth_ros.inspection import findings
from radcam_depth_ros.inspection.advice import suggest
from radcam_depth_ros.inspection.recording import Recording
from radcam_depth_ros.inspection.report import CameraFacts, ExtrinsicFacts, Finding, OffsetFacts, Report
from radcam_depth_ros.inspection.roles import Roles
from radcam_depth_ros.inspection.timing import nearest_offsets_ns
from radcam_depth_ros.messages import decode_transforms
from radcam_depth_ros.pairing import PairingConfig

_MOVING_TRANSFORMS = 200
"""Messages of /tf that are read for its frames."""
_PROGRESS_EVERY = 50


def survey(path: Path | str, progress: Callable[[int, int], None] | None = None) -> Report:
    """Reads a whole bag and reports its contents for the node, also where a sensor is missing.

    Args:
        path: A rosbag2 folder, .mcap or .db3 file.
        progress: Called with (messages read, messages in all) now and then.

    Raises:
        BagError: for a bag that cannot be read.
    """
    with BagReader(path) as reader:
        roles = Roles.of(reader.topics)
        recordings = {info.name: Recording(info, roles.role_of(info.name)) for info in reader.topics}
        total = reader.count()
        for number, item in enumerate(reader.messages(), 1):
            recordings[item.topic].add(item)
            if progress is not None and (number == total or number % _PROGRESS_EVERY == 0):
                progress(number, total)
        transforms, transform_problem = _read_transforms(reader, roles)
        seconds = reader.duration_ns / 1e9
    # Whatever the file says of their number, only topics with messages are reported, and have a role.
    recordings = {name: entry for name, entry in recordings.items() if entry.logs_ns}
    roles = Roles.of([entry.info for entry in recordings.values()])
    topics = tuple(recordings[name].topic_facts() for name in sorted(recordings))
    images = tuple(entry.image_facts() for entry in recordings.values() if entry.info.type_name in IMAGE_TYPES)
    cameras = tuple(entry.camera_facts() for entry in recordings.values() if entry.info.type_name in CAMERA_INFO_TYPES)
    clouds = tuple(entry.cloud_facts() for entry in recordings.values() if entry.is_cloud)
    extrinsics = tuple(_extrinsics(recordings, roles, transforms))
    limits = PairingConfig()
    offsets = tuple(_offsets(recordings, roles, limits))
    footprint = FrameBuilderConfig().footprint_frame
    road_is_known = any(transforms.can_transform(facts.camera_frame, footprint) for facts in extrinsics)
    found: list[Finding] = [Finding("error", transform_problem)] if transform_problem else []
    found += [
        *findings.of_topics(topics, roles),
        *findings.of_images(images, cameras, roles),
        *findings.of_clouds(clouds, roles),
        *findings.of_frames(extrinsics),
        *findings.of_extrinsics(extrinsics, road_is_known=road_is_known, footprint=footprint),
        *findings.of_offsets(offsets, limits.max_time_offset_s),
    ]
    return Report(
        str(path),
        seconds,
        topics,
        images,
        cameras,
        clouds,
        tuple(_tree(transforms)),
        extrinsics,
        offsets,
        "; ".join(roles.lacks),
        findings.by_severity(found),
        suggest(roles, topics, _camera_of(cameras, roles), clouds, extrinsics, offsets, transforms),
    )


def _camera_of(cameras: Sequence[CameraFacts], roles: Roles) -> CameraFacts | None:
    return next((facts for facts in cameras if facts.topic == roles.camera_info), None)


def _read_transforms(reader: BagReader, roles: Roles) -> tuple[TransformTree, str]:
    """The transform tree, and what is wrong with it."""
    transforms = TransformTree()
    try:
        if roles.tf_static is not None:
            transforms = read_static_transforms(reader, roles.tf_static)
        if roles.tf is not None:
            for item in islice(reader.messages([roles.tf]), _MOVING_TRANSFORMS):
                for link in decode_transforms(item.message):
                    transforms.set(link.parent_frame, link.child_frame, link.parent_from_child)
    except RadcamDepthError as error:
        return transforms, str(error)
    return transforms, ""


def _extrinsics(recordings: Mapping[str, Recording], roles: Roles, transforms: TransformTree) -> list[ExtrinsicFacts]:
    if roles.image is None:
        return []
    camera_frame = next(iter(recordings[roles.image].frame_ids), "")
    found: list[ExtrinsicFacts] = []
    for radar in roles.radars:
        radar_frame = next(iter(recordings[radar].frame_ids), "")
        try:
            if not radar_frame or not camera_frame:
                raise RadcamDepthError("a frame_id is empty")
            pose = transforms.lookup(camera_frame, radar_frame)
        except RadcamDepthError as error:
            found.append(ExtrinsicFacts(radar, radar_frame, camera_frame, problem=str(error)))
            continue
        right, down, forward = (round(float(value), 4) for value in pose.translation)
        ahead = pose.rotation[:, 0]  # the radar's x axis, as the camera sees it
        heading_deg = round(math.degrees(math.atan2(float(ahead[0]), float(ahead[2]))), 2)
        found.append(ExtrinsicFacts(radar, radar_frame, camera_frame, (right, down, forward), heading_deg))
    return found


def _offsets(recordings: Mapping[str, Recording], roles: Roles, limits: PairingConfig) -> list[OffsetFacts]:
    if roles.image is None:
        return []
    images = recordings[roles.image]
    clocks = Clocks(roles.image, roles.radars)
    for name in (roles.image, *roles.radars):
        entry = recordings[name]
        for stamp_ns, log_ns in zip(entry.times_ns, entry.logs_ns, strict=False):
            clocks.add(name, stamp_ns, log_ns)
    found: list[OffsetFacts] = []
    for radar in roles.radars:
        sweeps_ns = recordings[radar].times_ns
        if not images.stamps_ns or not sweeps_ns:
            continue
        offsets_s = nearest_offsets_ns(images.stamps_ns, sweeps_ns) / 1e9
        ahead_s = clocks.offset_s(radar)
        found.append(
            OffsetFacts(
                radar,
                round(1e3 * float(np.median(offsets_s)), 3),
                round(1e3 * float(np.percentile(np.abs(offsets_s), 95)), 3),
                round(float((np.abs(offsets_s) <= limits.max_time_offset_s).mean()), 4),
                None if ahead_s is None else round(1e3 * ahead_s, 3),
            )
        )
    return found


def _tree(transforms: TransformTree) -> list[str]:
    """All frames, each indented by two spaces below its parent."""
    children: dict[str | None, list[str]] = {}
    for frame in transforms.frames:
        children.setdefault(transforms.parent_of(frame), []).append(frame)

    def lines(parent: str | None, depth: int) -> list[str]:
        return [line for frame in children.get(parent, []) for line in ("  " * depth + frame, *lines(frame, depth + 1))]

    return lines(None, 0)
