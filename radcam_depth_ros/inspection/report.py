"""Results of an inspection."""

from __future__ import annotations

from dataclasses import dataclass

from radcam_depth_ros.inspection.suggestion import Suggestion

SEVERITIES = ("error", "warning", "note")


@dataclass(frozen=True)
class TopicFacts:
    """A topic.

    Attributes:
        topic: Its name.
        type: For example `sensor_msgs/msg/Image`.
        messages: How many there are.
        hz: Messages a second, by their stamps where they have some; None of fewer than two messages.
        role: Its use by the node; empty for none.
        jitter_ms: Of 95 % of the intervals, how far they are from the median one at most.
        largest_gap_s: The longest time between two messages, seconds.
        backwards: How often a stamp is earlier than the one before.
        delay_ms: Median time from a message's stamp to its recording; None where messages have no stamps.
        frame_ids: Frames in its headers.
        latched: Whether late subscribers get its last messages.
        reliable: Whether it was published reliable.
        unstamped: How many messages have a stamp of 0.
    """

    topic: str
    type: str
    messages: int
    hz: float | None = None
    role: str = ""
    jitter_ms: float | None = None
    largest_gap_s: float | None = None
    backwards: int = 0
    delay_ms: float | None = None
    frame_ids: tuple[str, ...] = ()
    latched: bool = False
    reliable: bool = True
    unstamped: int = 0

    @property
    def has_no_stamps(self) -> bool:
        """Whether the node would drop messages since they have a stamp of 0; one alone is a simulation's beginning."""
        return self.unstamped > 1


@dataclass(frozen=True)
class ImageFacts:
    """The images of a topic.

    Attributes:
        topic: Its name.
        encoding: As published; of compressed images, their format.
        width: Pixels; 0 where unknown.
        height: Pixels; 0 where unknown.
        problem: Why they cannot be used; empty when they can.
    """

    topic: str
    encoding: str
    width: int
    height: int
    problem: str = ""


@dataclass(frozen=True)
class CameraFacts:
    """A calibration.

    Attributes:
        topic: Its name.
        width: Pixels, of the image as published.
        height: Pixels.
        focal_length_px: Of the rectified image.
        model: Distortion model, as published.
        distortion: Its coefficients.
        is_distorted: Whether images have to be rectified.
        problem: Why it cannot be used; empty when it can.
    """

    topic: str
    width: int
    height: int
    focal_length_px: float | None
    model: str
    distortion: tuple[float, ...]
    is_distorted: bool
    problem: str = ""


@dataclass(frozen=True)
class CloudFacts:
    """The clouds or scans of a topic.

    Attributes:
        topic: Its name.
        fields: Names of the fields.
        position: Of a radar: fields taken for the position.
        rcs: Of a radar: the field taken for the radar cross section; empty for none.
        radial_speed: Of a radar: fields taken for the Doppler speed; empty for none.
        points: Of a radar: least, median and largest number of points of a cloud.
        problem: Why a radar's clouds cannot be used; empty when they can.
        doubt: Why its intensity, taken for the radar cross section, is likely the Doppler speed; empty when it is not.
    """

    topic: str
    fields: tuple[str, ...]
    position: tuple[str, ...] = ()
    rcs: str = ""
    radial_speed: tuple[str, ...] = ()
    points: tuple[int, int, int] | None = None
    problem: str = ""
    doubt: str = ""


@dataclass(frozen=True)
class ExtrinsicFacts:
    """The pose of a radar.

    Attributes:
        topic: The radar's.
        radar_frame: Frame of its clouds.
        camera_frame: Frame of the images.
        position_m: Of the radar in the camera's frame: right, down, forward; None where unknown.
        heading_deg: Where the radar's x axis points, from the camera's axis to its right; None where unknown.
        problem: Why it is unknown; empty when it is known.
    """

    topic: str
    radar_frame: str
    camera_frame: str
    position_m: tuple[float, float, float] | None = None
    heading_deg: float | None = None
    problem: str = ""


@dataclass(frozen=True)
class OffsetFacts:
    """A radar's stamps beside those of the images.

    Attributes:
        topic: The radar's.
        median_ms: Stamp of the sweep nearest to an image minus the image's, median.
        p95_ms: The same without its sign, 95th percentile.
        within: Share of the images that have a sweep within `max_time_offset_s`.
        clock_ms: How far the radar's stamps are ahead of the images' by the recorder's clock; None where it cannot be
            told.
    """

    topic: str
    median_ms: float
    p95_ms: float
    within: float
    clock_ms: float | None = None


@dataclass(frozen=True)
class Finding:
    """A finding about a bag.

    Attributes:
        severity: "error" where there will be no depth, "warning" where it will be worse, "note".
        text: The finding, and what to do about it.
    """

    severity: str
    text: str


@dataclass(frozen=True)
class Report:
    """The result of an inspection.

    Attributes:
        bag: Its path.
        seconds: From its first message to its last.
        topics: Its topics.
        images: Its images.
        cameras: Its calibrations.
        clouds: Its point clouds.
        frames: The frames of the transform trees, each indented below its parent.
        extrinsics: Where the radars are.
        offsets: The radars' stamps beside the images'.
        missing: What it lacks for a replay, in a sentence; empty when nothing.
        findings: Missing or unusual inputs, the worst first.
        suggestion: The node's parameters that fit it; None where it lacks a camera.
    """

    bag: str
    seconds: float
    topics: tuple[TopicFacts, ...]
    images: tuple[ImageFacts, ...]
    cameras: tuple[CameraFacts, ...]
    clouds: tuple[CloudFacts, ...]
    frames: tuple[str, ...]
    extrinsics: tuple[ExtrinsicFacts, ...]
    offsets: tuple[OffsetFacts, ...]
    missing: str
    findings: tuple[Finding, ...]
    suggestion: Suggestion | None
