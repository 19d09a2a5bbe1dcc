"""Findings about a bag: missing or unusual inputs, and what to do about them."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Sequence

from radcam_depth_ros.bags import RADAR_TYPES
from radcam_depth_ros.inspection.report import (
    SEVERITIES,
    CameraFacts,
    CloudFacts,
    ExtrinsicFacts,
    Finding,
    ImageFacts,
    OffsetFacts,
    TopicFacts,
)
from radcam_depth_ros.inspection.roles import Roles
from radcam_depth_ros.pairing import CLOCK_WARNING_S, clock_warning, unset_stamps

_GAP_S = 1.0
_GAP_PERIODS = 5.0
_SHARE_WITH_SWEEP = 0.9
_SENSOR_ROLES = ("camera", "camera_info", "radar")
_error, _warning, _note = (functools.partial(Finding, severity) for severity in SEVERITIES)


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The worst first; those of one severity in their order."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def of_topics(topics: Sequence[TopicFacts], roles: Roles) -> Iterator[Finding]:
    """Missing topics, gaps, stamps and frames of the sensors."""
    for sentence in roles.lacks:
        yield _error(sentence)
    for topic in topics:
        if "radar" in topic.type.lower() and topic.type not in RADAR_TYPES:
            yield _note(
                f"{topic.topic} is of {topic.type}, which the node does not read; use the driver's topic of single "
                "returns, sensor_msgs/PointCloud2 or radar_msgs/RadarScan"
            )
        if topic.topic in roles.beside:
            scan = roles.beside[topic.topic]
            yield _note(
                f"{topic.topic} is left out, since {scan} beside it has what the radar measures; if it is another "
                "radar's, name both in radar_topics"
            )
        if topic.role not in _SENSOR_ROLES:
            continue
        if topic.has_no_stamps and topic.role != "camera_info":
            yield _error(unset_stamps(topic.topic, is_radar=topic.role == "radar"))
        if topic.backwards:
            yield _warning(
                f"{topic.backwards} stamps on {topic.topic} are earlier than the one before; the node starts its "
                "pairing anew at each jump, so look for a second publisher or a clock that is set back"
            )
        period_s = 1 / topic.hz if topic.hz else 0.0
        gap_s = topic.largest_gap_s or 0.0
        if topic.role != "camera_info" and gap_s > max(_GAP_S, _GAP_PERIODS * period_s):
            yield _warning(
                f"{topic.topic} pauses for {gap_s:.1f} s, its messages come every {period_s:.2f} s elsewhere; the "
                "sensor was off, or the recorder lost messages"
            )
        if topic.role != "camera_info" and "" in topic.frame_ids:
            parameter = "camera_frame" if topic.role == "camera" else "radar_frame"
            yield _error(
                f"messages on {topic.topic} have an empty frame_id; set it in the driver, or the parameter {parameter}"
            )


def of_frames(extrinsics: Sequence[ExtrinsicFacts]) -> Iterator[Finding]:
    """Radars that cannot be told apart by their frames."""
    for frame in sorted({facts.radar_frame for facts in extrinsics if facts.radar_frame}):
        topics = [facts.topic for facts in extrinsics if facts.radar_frame == frame]
        if len(topics) > 1:
            yield _warning(
                f"{', '.join(topics)} share the frame_id {frame}, so that all are taken to be in one place; where they "
                "are not, set frames in the drivers, or the parameter radar_frame, one for each of radar_topics"
            )


def of_images(images: Sequence[ImageFacts], cameras: Sequence[CameraFacts], roles: Roles) -> Iterator[Finding]:
    """Images and calibration of the camera."""
    image = next((facts for facts in images if facts.topic == roles.image), None)
    camera = next((facts for facts in cameras if facts.topic == roles.camera_info), None)
    if image is not None and image.problem:
        yield _error(f"{image.topic}: {image.problem}")
    if camera is not None and camera.problem:
        yield _error(f"{camera.topic}: {camera.problem}")
    elif camera is not None and image is not None and image.width:
        if (camera.width, camera.height) != (image.width, image.height):
            yield _error(
                f"the images on {image.topic} have {image.width} x {image.height} pixels, their camera_info says "
                f"{camera.width} x {camera.height}; publish the camera_info of the resized image, or set its binning "
                "and region of interest"
            )
        elif camera.is_distorted and "rect" in image.topic.rsplit("/", 1)[-1]:
            yield _warning(
                f"{image.topic} sounds rectified, but its camera_info has distortion ({camera.model}); "
                "image_is_rectified: true keeps the node from rectifying it again"
            )


def of_clouds(clouds: Sequence[CloudFacts], roles: Roles) -> Iterator[Finding]:
    """Fields and points of the radars."""
    for cloud in clouds:
        if cloud.topic not in roles.radars:
            continue
        if cloud.problem:
            yield _error(f"{cloud.topic}: {cloud.problem}")
            continue
        if cloud.points is None or not cloud.points[2]:
            yield _warning(f"no cloud on {cloud.topic} has a point; check the driver's filters")
            continue
        if cloud.doubt:
            yield _warning(cloud.doubt)
            continue
        for words, found in (("radar cross section", cloud.rcs), ("Doppler speed", cloud.radial_speed)):
            if not found:
                yield _note(
                    f"{cloud.topic} has no {words} by a name that is known, only {' '.join(cloud.fields)}; the node "
                    "does without"
                )


def of_extrinsics(extrinsics: Sequence[ExtrinsicFacts], *, road_is_known: bool, footprint: str) -> Iterator[Finding]:
    """Where the radars and the road are."""
    for facts in extrinsics:
        if facts.problem and facts.radar_frame and facts.camera_frame:
            yield _error(
                f"{facts.topic}: {facts.problem}; record /tf_static, or set the parameter camera_from_radar "
                "(x y z qx qy qz qw)"
            )
        elif facts.heading_deg is not None and abs(facts.heading_deg) > 90.0:
            yield _warning(
                f"{facts.topic} looks away from the camera's axis by {abs(facts.heading_deg):.0f} degrees, so that the "
                "camera sees little of it; check the extrinsics, or leave this radar out"
            )
    if extrinsics and not road_is_known:
        yield _warning(
            f"no transform to {footprint}, so the road is not known; set camera_height_m (and camera_pitch_deg), "
            "which helps much"
        )


def of_offsets(offsets: Sequence[OffsetFacts], limit_s: float) -> Iterator[Finding]:
    """The radars' stamps beside the images'."""
    for facts in offsets:
        clock_ms = facts.clock_ms
        if clock_ms is not None and abs(clock_ms) > CLOCK_WARNING_S * 1e3:
            yield _warning(clock_warning(facts.topic, clock_ms / 1e3, "by the recorder's clock"))
        elif facts.within < _SHARE_WITH_SWEEP:
            yield _warning(
                f"{100 * (1 - facts.within):.0f} % of the images have no sweep of {facts.topic} within {limit_s:g} s, "
                f"the nearest is up to {facts.p95_ms:.0f} ms away; check the sensors' clocks, or raise "
                "max_time_offset_s"
            )
