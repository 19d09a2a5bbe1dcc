"""Suggests the node's parameters for a bag."""

from __future__ import annotations

import math
from collections.abc import Sequence

from radcam_depth_ros.geometry import TransformTree
from radcam_depth_ros.inspection.report import CameraFacts, CloudFacts, ExtrinsicFacts, OffsetFacts, TopicFacts
from radcam_depth_ros.inspection.roles import Roles
from radcam_depth_ros.inspection.suggestion import (
    Setting,
    Suggestion,
    extrinsic_parameters,
    topic_parameters,
)
from radcam_depth_ros.pairing import CLOCK_CERTAIN_S, CLOCK_WARNING_S, MAX_TIME_OFFSET_S, PairingConfig

_REASONS = {
    "image_topic": "The camera.",
    "image_transport": "How its images are published.",
    "camera_info_topic": "Its calibration.",
    "radar_topics": "The radars.",
}


def suggest(
    roles: Roles,
    topics: Sequence[TopicFacts],
    camera: CameraFacts | None,
    clouds: Sequence[CloudFacts],
    extrinsics: Sequence[ExtrinsicFacts],
    offsets: Sequence[OffsetFacts],
    transforms: TransformTree,
) -> Suggestion | None:
    """The parameters that fit a bag; None where it lacks a camera or its calibration."""
    if roles.image is None or roles.camera_info is None:
        return None
    image_type = next(facts.type for facts in topics if facts.topic == roles.image)
    values = topic_parameters(roles.image, image_type, roles.camera_info, roles.radars)
    settings = [Setting(name, value, _REASONS[name]) for name, value in values.items()]
    if camera is not None and camera.is_distorted and "rect" in roles.image.rsplit("/", 1)[-1]:
        settings.append(
            Setting("image_is_rectified", True, "By its name the image is rectified; camera_info has the raw one's.")
        )
    settings += _fields(roles, clouds)
    settings += _frames(extrinsics, transforms)
    settings += _extrinsics(extrinsics, transforms)
    settings += _stamps(roles.radars, topics, offsets)
    settings += _pairing(topics, offsets)
    return Suggestion(tuple(settings))


def _fields(roles: Roles, clouds: Sequence[CloudFacts]) -> list[Setting]:
    doubtful = {cloud.topic: cloud.rcs for cloud in clouds if cloud.doubt}
    if not doubtful:
        return []
    texts = [f"radial_speed={doubtful[radar]} rcs=" if radar in doubtful else "" for radar in roles.radars]
    reason = f"Only if the intensity on {', '.join(doubtful)} is the Doppler speed, as it seems."
    return [Setting("radar_fields", texts if len(texts) > 1 else texts[0], reason, is_needed=False)]


def _frames(extrinsics: Sequence[ExtrinsicFacts], transforms: TransformTree) -> list[Setting]:
    """Frames for radars that share one, where the tree has one that is called like each topic."""
    if len({facts.radar_frame for facts in extrinsics}) == len(extrinsics):
        return []
    found = [_frame_like(facts.topic, transforms) for facts in extrinsics]
    is_known = all(found) and len(set(found)) == len(found)
    values = found if is_known else [facts.radar_frame for facts in extrinsics]
    reason = (
        "Radars share a frame_id; these frames are called like their topics."
        if is_known
        else ("Radars share a frame_id. Where they are not in one place, write a frame for each of radar_topics.")
    )
    return [Setting("radar_frame", values, reason, is_needed=is_known)]


def _frame_like(topic: str, transforms: TransformTree) -> str:
    """The only frame that begins with a part of a topic's name; empty where there is none, or several."""
    parts = tuple(part for part in topic.split("/") if part)
    found = [frame for frame in transforms.frames if frame.startswith(parts)]
    return found[0] if len(found) == 1 else ""


def _stamps(radars: Sequence[str], topics: Sequence[TopicFacts], offsets: Sequence[OffsetFacts]) -> list[Setting]:
    """Stamps by arrival for radars that have none, or another clock than a correction can mend."""
    without = {facts.topic for facts in topics if facts.has_no_stamps}
    without |= {facts.topic for facts in offsets if abs(facts.clock_ms or 0.0) > MAX_TIME_OFFSET_S * 1e3}
    values = ["arrival" if radar in without else "header" for radar in radars]
    if "arrival" not in values:
        return []
    reason = "Its stamps are 0, or of a clock that is far off: sweeps are stamped by when they come."
    return [Setting("radar_stamps", values if len({*values}) > 1 else values[0], reason)]


def _extrinsics(extrinsics: Sequence[ExtrinsicFacts], transforms: TransformTree) -> list[Setting]:
    if not extrinsics or any(facts.problem for facts in extrinsics):
        return []
    frames = [facts.radar_frame for facts in extrinsics]
    (values,) = extrinsic_parameters(transforms, extrinsics[0].camera_frame, frames).values()
    numbers = [round(value, 6) for value in values] if isinstance(values, list) else []
    reason = "Not needed while /tf_static is published; this is what the bag's says, for where it is not."
    return [Setting("camera_from_radar", numbers, reason, is_needed=False)]


def _pairing(topics: Sequence[TopicFacts], offsets: Sequence[OffsetFacts]) -> list[Setting]:
    settings = _clock(offsets)
    radars = {facts.topic for facts in offsets}
    slowest_s = max((1 / facts.hz for facts in topics if facts.topic in radars and facts.hz), default=0.0)
    usual = PairingConfig()
    needed_s = math.ceil(100 * 0.6 * slowest_s) / 100  # half a period, and some for its jitter
    if usual.max_time_offset_s < needed_s <= MAX_TIME_OFFSET_S:
        reason = f"A sweep of the slowest radar comes every {slowest_s:.2f} s: the nearest is up to half of that away."
        settings.append(Setting("max_time_offset_s", needed_s, reason))
        settings.append(Setting("max_wait_s", needed_s, "So that the later of two sweeps can be the nearer one."))
    return settings


def _clock(offsets: Sequence[OffsetFacts]) -> list[Setting]:
    """One value for all radars, which the parameter is: of the one that is farthest off."""
    known = [facts for facts in offsets if facts.clock_ms is not None]
    worst = max(known, key=lambda facts: abs(facts.clock_ms or 0.0), default=None)
    if worst is None or worst.clock_ms is None or abs(worst.clock_ms) <= CLOCK_WARNING_S * 1e3:
        return []
    value_s = round(-worst.clock_ms / 1e3, 3)
    if abs(value_s) > MAX_TIME_OFFSET_S:
        return []
    certain = abs(worst.clock_ms) > CLOCK_CERTAIN_S * 1e3
    reason = f"Stamps on {worst.topic} against the images', by the recorder's clock" + (
        "." if certain else "; only if it is no delay of a driver."
    )
    return [Setting("radar_time_offset_s", value_s, reason, is_needed=certain)]
