from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from radar_scans import SCAN, encode_scan, polar
from small_drive import (
    CAMERA,
    CAMERA_FROM_RADAR,
    PERIOD_NS,
    START_NS,
    Change,
    doppler_as_intensity,
    small_returns,
    write_changed,
)

from radcam_depth_ros.bags import BagReader, BagWriter, factory
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.inspection import Report, survey
from radcam_depth_ros.messages import (
    SCAN_FIELDS,
    StampedTransform,
    encode_camera_info,
    encode_compressed_image,
    encode_points,
)

IMAGE, INFO, RADAR = "/camera/image_raw", "/camera/camera_info", "/radar/points"


def texts(report: Report, severity: str) -> str:
    return "\n".join(finding.text for finding in report.findings if finding.severity == severity)


def parameters(report: Report) -> dict[str, object]:
    assert report.suggestion is not None
    return report.suggestion.parameters


def test_a_good_drive(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    report = survey(write_changed(tmp_path / "drive.mcap"), lambda *so_far: told.append(so_far))
    assert told == [(49, 49)]
    assert report.missing == ""
    assert texts(report, "error") == ""
    topics = {facts.topic: facts for facts in report.topics}
    assert (topics[IMAGE].hz, topics[IMAGE].jitter_ms, topics[IMAGE].largest_gap_s) == (10.0, 0.0, 0.1)
    assert (topics[IMAGE].role, topics[RADAR].role, topics["/tf_static"].latched) == ("camera", "radar", True)
    assert (topics[IMAGE].delay_ms, topics["/tf_static"].delay_ms) == (0.0, None)
    assert (topics[IMAGE].frame_ids, topics[RADAR].frame_ids) == (("camera",), ("radar",))
    image = next(facts for facts in report.images if facts.topic == IMAGE)
    assert (image.encoding, image.width, image.height, image.problem) == ("rgb8", 96, 64, "")
    (camera,) = report.cameras
    assert (camera.width, camera.focal_length_px, camera.is_distorted) == (96, 630.0, False)
    (cloud,) = report.clouds
    assert (cloud.position, cloud.rcs, cloud.radial_speed, cloud.points) == (("x", "y", "z"), "rcs", (), (4, 4, 4))
    assert report.frames == ("camera", "  radar")
    (extrinsics,) = report.extrinsics
    assert extrinsics.position_m == pytest.approx(tuple(CAMERA_FROM_RADAR.translation))
    assert extrinsics.heading_deg == pytest.approx(0.0, abs=1e-6)
    (offset,) = report.offsets
    assert (offset.median_ms, offset.p95_ms, offset.within) == (-20.0, 20.0, 1.0)
    assert parameters(report) == {
        "image_topic": IMAGE,
        "image_transport": "raw",
        "camera_info_topic": INFO,
        "radar_topics": [RADAR],
    }
    assert "camera_height_m" in texts(report, "warning")
    assert "no Doppler speed" in texts(report, "note")
    json.dumps(dataclasses.asdict(report), allow_nan=False)


@pytest.mark.parametrize(
    ("without", "words"),
    [(IMAGE, "camera image"), (INFO, "camera_info"), (RADAR, "radar"), ("/tf_static", "/tf_static")],
)
def test_what_is_missing_is_an_error(
    write_drive: Callable[..., Path], tmp_path: Path, without: str, words: str
) -> None:
    report = survey(write_drive(tmp_path / "drive.mcap", without=(without,)))
    assert words in texts(report, "error")
    assert report.findings[0].severity == "error"
    assert (report.suggestion is None) == (without in (IMAGE, INFO))
    assert bool(report.missing) == (without != "/tf_static")


def test_all_that_is_missing_is_told(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    report = survey(write_drive(tmp_path / "drive.mcap", without=(IMAGE, INFO, RADAR)))
    assert len([finding for finding in report.findings if finding.severity == "error"]) == 3


@pytest.mark.parametrize(("ahead_ms", "needed"), [(500, None), (-500, None), (3000, -3.0), (-3000, 3.0)])
def test_clocks_that_differ_are_named(tmp_path: Path, ahead_ms: int, needed: float | None) -> None:
    def shift(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        late_ns = 5_000_000_000 - (ahead_ms * 1_000_000 if topic == RADAR else 0)
        return topic, message, time_ns + late_ns

    report = survey(write_changed(tmp_path / "drive.mcap", shift))
    (offset,) = report.offsets
    assert offset.clock_ms == pytest.approx(ahead_ms)
    warning = texts(report, "warning")
    assert f"{abs(ahead_ms)} ms {'ahead of' if ahead_ms > 0 else 'behind'} the images'" in warning
    assert f"radar_time_offset_s: {-ahead_ms / 1000:.3f}" in warning
    assert parameters(report).get("radar_time_offset_s") == needed
    assert report.suggestion is not None
    names = [setting.name for setting in report.suggestion.settings]
    assert "radar_time_offset_s" in names, "what is not certain is a comment"


def test_stamps_far_apart_are_no_parameter(tmp_path: Path) -> None:
    def shift(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        if topic == RADAR:
            message.header.stamp.sec += 1000
        return topic, message, time_ns

    report = survey(write_changed(tmp_path / "drive.mcap", shift))
    assert "1000000 ms ahead" in texts(report, "warning")
    assert "radar_time_offset_s" not in parameters(report)


def test_a_slow_radar_gets_a_wider_bound(tmp_path: Path) -> None:
    def every_fifth(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        index = round((time_ns - START_NS) / PERIOD_NS)
        return topic, None if topic == RADAR and index % 5 else message, time_ns

    report = survey(write_changed(tmp_path / "drive.mcap", every_fifth, frames=31))
    assert parameters(report)["max_time_offset_s"] == pytest.approx(0.3)
    assert parameters(report)["max_wait_s"] == pytest.approx(0.3)
    assert "have no sweep of /radar/points within 0.1 s" in texts(report, "warning")


def test_compressed_images_and_their_names(tmp_path: Path) -> None:
    def compress(name: str) -> Change:
        def change(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
            if topic != IMAGE:
                return topic, message, time_ns
            pixels = np.frombuffer(message.data, np.uint8).reshape(64, 96, 3)
            return name, encode_compressed_image(factory, pixels, time_ns, "camera"), time_ns

        return change

    usual = survey(write_changed(tmp_path / "a.mcap", compress("/camera/image_raw/compressed")))
    assert parameters(usual)["image_topic"] == "/camera/image_raw"
    assert parameters(usual)["image_transport"] == "compressed"
    odd = survey(write_changed(tmp_path / "b.mcap", compress("/camera/jpeg")))
    assert parameters(odd)["image_topic"] == "/camera/jpeg"
    assert parameters(odd)["image_transport"] == "compressed_topic"
    image = next(facts for facts in odd.images if facts.topic == "/camera/jpeg")
    assert (image.width, image.height, image.problem) == (96, 64, "")


def test_contents_that_cannot_be_used_are_errors(tmp_path: Path) -> None:
    def spoil(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        if topic == IMAGE:
            message.encoding = "32SC4"
        if topic == INFO:
            message = encode_camera_info(factory, CAMERA, time_ns, "camera")
            message.k[:] = 0
        if topic == RADAR:
            message = encode_points(factory, {"p": np.zeros(3, np.float32)}, time_ns, "radar")
        return topic, message, time_ns

    errors = texts(survey(write_changed(tmp_path / "drive.mcap", spoil)), "error")
    assert "32SC4" in errors
    assert "calibrate the camera" in errors
    assert "expected a radar cloud with fields" in errors


def test_a_camera_info_of_another_size_is_an_error(tmp_path: Path) -> None:
    def resize(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        if topic == INFO:
            message.width, message.height = 192, 128
        return topic, message, time_ns

    assert "96 x 64 pixels, their camera_info says 192 x 128" in texts(
        survey(write_changed(tmp_path / "drive.mcap", resize)), "error"
    )


def test_stamps_of_0_and_frames_that_radars_share(tmp_path: Path) -> None:
    other = "/radar_rear/points"

    def spoil(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        if topic == RADAR:
            message.header.stamp.sec = message.header.stamp.nanosec = 0
        return topic, message, time_ns

    links = [StampedTransform("camera", "radar", START_NS, CAMERA_FROM_RADAR)]
    report = survey(write_changed(tmp_path / "zero.mcap", spoil, links=links))
    assert "a stamp of 0 on each message" in texts(report, "error")
    assert "radar_time_offset_s" not in texts(report, "warning")
    assert parameters(report)["radar_stamps"] == "arrival"
    (facts,) = (facts for facts in report.topics if facts.topic == RADAR)
    assert (facts.unstamped, facts.hz) == (12, pytest.approx(10))

    def double(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        index = round((time_ns - START_NS) / PERIOD_NS)
        return (other if topic == RADAR and index % 2 else topic), message, time_ns

    path = write_changed(tmp_path / "shared.mcap", double, links=links)
    report = survey(path)
    assert "/radar/points, /radar_rear/points share the frame_id radar" in texts(report, "warning")
    assert "radar_frame" not in parameters(report)
    assert report.suggestion is not None
    assert "radar_frame" in {setting.name for setting in report.suggestion.settings}


def test_radars_that_share_a_frame_get_those_that_are_called_like_their_topics(tmp_path: Path) -> None:
    names = ("/radar_front/points", "/radar_rear/points")

    def double(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        index = round((time_ns - START_NS) / PERIOD_NS)
        return (names[index % 2] if topic == RADAR else topic), message, time_ns

    frames = ("radar_front_link", "radar_rear_link")
    links = [StampedTransform("camera", frame, START_NS, CAMERA_FROM_RADAR) for frame in frames]
    report = survey(write_changed(tmp_path / "drive.mcap", double, links=links))
    assert parameters(report)["radar_frame"] == list(frames)


def test_empty_frames_pauses_and_stamps_that_go_back(tmp_path: Path) -> None:
    def spoil(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        index = round((time_ns - START_NS) / PERIOD_NS)
        if topic == RADAR:
            message.header.frame_id = ""
        if topic == IMAGE and index >= 6:
            message.header.stamp.sec += 4
        if topic == RADAR and index == 9:
            message.header.stamp.sec -= 1
        return topic, message, time_ns

    report = survey(write_changed(tmp_path / "drive.mcap", spoil))
    assert "empty frame_id; set it in the driver, or the parameter radar_frame" in texts(report, "error")
    assert "/camera/image_raw pauses for 4.1 s" in texts(report, "warning")
    assert "1 stamps on /radar/points are earlier" in texts(report, "warning")


def test_a_radar_that_looks_back_and_a_road(tmp_path: Path) -> None:
    backwards = RigidTransform(
        CAMERA_FROM_RADAR.rotation @ np.diag([-1.0, -1.0, 1.0]), np.asarray(CAMERA_FROM_RADAR.translation)
    )
    links = [
        StampedTransform("base_footprint", "camera", START_NS, RigidTransform(np.eye(3), np.array([0.0, 0.0, 1.5]))),
        StampedTransform("camera", "radar", START_NS, backwards),
    ]
    report = survey(write_changed(tmp_path / "drive.mcap", links=links))
    assert "/radar/points looks away from the camera's axis by 180 degrees" in texts(report, "warning")
    assert "camera_height_m" not in texts(report, "warning")
    assert report.frames == ("base_footprint", "  camera", "    radar")


def test_clouds_without_points_are_told(tmp_path: Path) -> None:
    def empty(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        if topic == RADAR:
            message.width, message.data = 0, np.zeros(0, np.uint8)
        return topic, message, time_ns

    assert "no cloud on /radar/points has a point" in texts(
        survey(write_changed(tmp_path / "drive.mcap", empty)), "warning"
    )


def test_a_real_drive(astyx_val: Path) -> None:
    report = survey(astyx_val)
    assert report.missing == ""
    assert texts(report, "error") == ""
    assert parameters(report)["image_transport"] == "compressed"


def with_scans(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
    """A scan in place of the cloud."""
    if topic != RADAR:
        return topic, message, time_ns
    columns = {**polar(small_returns(0)), "doppler_velocity": [1, 2, 3, 4], "amplitude": [4, 3, 2, 1]}
    return "/front/scan", encode_scan(factory, columns, time_ns, "radar"), time_ns


def test_a_scan_is_a_radar_with_its_fields(tmp_path: Path) -> None:
    report = survey(write_changed(tmp_path / "drive.mcap", with_scans))
    assert (report.missing, texts(report, "error")) == ("", "")
    (cloud,) = report.clouds
    assert (cloud.topic, cloud.fields, cloud.points) == ("/front/scan", SCAN_FIELDS, (4, 4, 4))
    assert (cloud.position, cloud.rcs, cloud.radial_speed) == (SCAN_FIELDS[:3], "amplitude", ("doppler_velocity",))
    assert parameters(report)["radar_topics"] == ["/front/scan"]
    assert "does not read" not in texts(report, "note")


def test_a_cloud_beside_a_scan_is_left_out_and_named(tmp_path: Path) -> None:
    bag = write_changed(tmp_path / "drive.mcap", lambda topic, message, time_ns: (topic, message, time_ns))
    with BagReader(bag) as reader, BagWriter(tmp_path / "both.mcap") as writer:
        for item in reader.messages():
            writer.write(item.topic, item.message, item.log_time_ns, item.type_name)
            if item.topic == RADAR:
                _, scan, time_ns = with_scans(RADAR, item.message, item.log_time_ns)
                writer.write("/radar/scan", scan, time_ns, SCAN)
    report = survey(tmp_path / "both.mcap")
    assert parameters(report)["radar_topics"] == ["/radar/scan"]
    assert f"{RADAR} is left out, since /radar/scan beside it" in texts(report, "note")


def test_degrees_in_a_scan_are_an_error_with_the_value_to_set(tmp_path: Path) -> None:
    def change(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        name, changed, recorded_ns = with_scans(topic, message, time_ns)
        if name == "/front/scan":
            changed.returns[0].azimuth = 45.0
        return name, changed, recorded_ns

    report = survey(write_changed(tmp_path / "drive.mcap", change))
    assert "radar_fields to azimuth=azimuth[deg]" in texts(report, "error")


def test_clouds_and_scans_under_one_name_are_read_by_what_each_is(tmp_path: Path) -> None:
    returns = iter(range(12))

    def change(topic: str, message: Any, time_ns: int) -> tuple[str, Any, int]:
        if topic == RADAR and next(returns) % 2:
            message = encode_scan(factory, polar(small_returns(0)), time_ns, "radar")
        return topic, message, time_ns

    report = survey(write_changed(tmp_path / "drive.mcap", change))
    (cloud,) = [facts for facts in report.clouds if facts.topic == RADAR]
    assert cloud.points == (4, 4, 4)


def test_an_intensity_that_is_likely_doppler_is_warned_of_and_suggested_as_a_comment(tmp_path: Path) -> None:
    report = survey(write_changed(tmp_path / "drive.mcap", doppler_as_intensity()))
    assert "set the parameter radar_fields to radial_speed=intensity rcs=" in texts(report, "warning")
    assert report.suggestion is not None
    (setting,) = [setting for setting in report.suggestion.settings if setting.name == "radar_fields"]
    assert (setting.value, setting.is_needed) == ("radial_speed=intensity rcs=", False)


def test_topics_whose_messages_the_file_does_not_count_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = BagReader._list_topics

    def uncounted(reader: BagReader) -> tuple[Any, ...]:
        return tuple(dataclasses.replace(topic, count=0) for topic in listed(reader))

    path = write_changed(tmp_path / "drive.mcap")
    monkeypatch.setattr(BagReader, "_list_topics", uncounted)
    assert {facts.topic for facts in survey(path).topics} >= {IMAGE, INFO, RADAR}


@pytest.mark.parametrize(("listed", "words"), [(IMAGE, "camera image"), (RADAR, "radar")])
def test_a_topic_that_the_file_lists_without_a_message_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listed: str, words: str
) -> None:
    messages = BagReader.messages

    def without(reader: BagReader, *arguments: Any) -> Iterator[Any]:
        return (item for item in messages(reader, *arguments) if item.topic != listed)

    path = write_changed(tmp_path / "drive.mcap")
    monkeypatch.setattr(BagReader, "messages", without)
    report = survey(path)
    assert listed not in {facts.topic for facts in report.topics}
    assert words in texts(report, "error")
