"""Bags that do not fit together: one sentence each, that says what was expected, what came and what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from small_drive import without_radar_stamps, write_changed

from radcam_depth_ros.bags.errors import BagError
from radcam_depth_ros.drive import DriveError, DriveSettings, TopicChoice, read_samples
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.pairing import PairingConfig
from radcam_depth_ros.training.data.cache import CacheSettings, build_drive
from radcam_depth_ros.training.errors import TrainingError

Write = Callable[..., Path]


@pytest.fixture
def bag_without_stamps(tmp_path: Path) -> Path:
    """The small drive with a radar that sets no stamps."""
    return write_changed(tmp_path / "zero.mcap", without_radar_stamps)


def refuses(bag: Path, sentence: str, settings: DriveSettings | None = None) -> None:
    """Reading ends with the sentence, and a cache of the bag leaves nothing behind."""
    settings = settings or DriveSettings(accumulate="where_possible")
    with pytest.raises(DriveError, match=sentence):
        list(read_samples(bag, settings, lambda note: None))
    folder = bag.parent / "cache"
    with pytest.raises((DriveError, TrainingError), match=sentence):
        build_drive(bag, folder / "drive", CacheSettings(100.0, 100.0, settings))
    assert not list(folder.iterdir())


@pytest.mark.parametrize("wanted", ["exact", "both"])
def test_ground_truth_that_is_not_there(write_drive_with: Write, wanted: str) -> None:
    refuses(
        write_drive_with(), rf"ground_truth '{wanted}' needs a topic.*name them", DriveSettings(ground_truth=wanted)
    )


def test_a_lidar_topic_that_is_not_there(write_drive_with: Write) -> None:
    with pytest.raises(BagError, match="no lidar topic /velodyne"):
        list(read_samples(write_drive_with(), DriveSettings(topics=TopicChoice(lidar="/velodyne"))))


def test_a_lidar_whose_place_nobody_knows(write_drive_with: Write) -> None:
    sentence = r"scans on /lidar/points cannot be brought.*'velodyne' is not known.*record /tf_static"
    refuses(write_drive_with(lidar_frame="velodyne"), sentence)


@pytest.mark.parametrize(
    ("sensor", "clock_s", "sentence"),
    [
        ("lidar", -3.2, r"stamps on /lidar/points are 3\.20 s behind those on /camera/image_raw; synchronise"),
        ("lidar", 2.5, r"stamps on /lidar/points are 2\.50 s ahead of"),
        ("radar", -7.0, r"stamps on /radar/points are 7\.00 s behind"),
        ("radar", 3600.0, r"stamps on /radar/points are 3600\.00 s ahead of"),
    ],
)
@pytest.mark.parametrize("log_clocks", [False, True])
def test_clocks_that_are_seconds_apart(
    write_drive_with: Write, sensor: str, clock_s: float, sentence: str, log_clocks: bool
) -> None:
    # Where the recorder's clock tells nothing, the stamps of the beginnings do: two hundredths of a second less well.
    wanted = sentence.replace(r"\.20", r"\.(18|20)").replace(r"\.50", r"\.5[02]").replace(r"\.00", r"\.\d\d")
    if log_clocks:
        wanted = wanted.replace("7", "(6|7)")
    refuses(write_drive_with(**{f"{sensor}_clock_s": clock_s}, log_clocks=log_clocks), wanted)


def test_a_clock_that_is_put_right_by_hand(write_drive_with: Write) -> None:
    settings = DriveSettings(FrameBuilderConfig(pairing=PairingConfig(radar_time_offset_s=7.0)))
    samples = list(read_samples(write_drive_with(radar_clock_s=-7.0, radar_frames=12), settings))
    assert all(len(sample.frame.radar) for sample in samples)


def test_a_radar_without_stamps_is_named_and_read_by_arrival(bag_without_stamps: Path) -> None:
    refuses(bag_without_stamps, "a stamp of 0 on each message.*set radar_stamps: arrival")
    settings = DriveSettings(FrameBuilderConfig(radar_stamps="arrival"))
    samples = list(read_samples(bag_without_stamps, settings))
    assert len(samples) == 12
    assert all(len(sample.frame.radar) == 4 for sample in samples)


def test_images_that_find_no_radar(write_drive_with: Write) -> None:
    sentence = r"28 of 30 images have no radar sweep: /radar/points has 1 for 30 images"
    refuses(write_drive_with(frames=30, radar_frames=1), sentence)


def test_images_that_find_no_scan(write_drive_with: Write) -> None:
    bag = write_drive_with(frames=30, lidar_every=25)
    told: list[str] = []
    samples = list(read_samples(bag, DriveSettings(), told.append))
    assert sum(sample.source == "lidar" for sample in samples) == 2
    assert told == ["28 of 30 images have no ground truth: /lidar/points has 2 for 30 images; record it all the time"]
    sentence = (
        r"30 of 30 images have no ground truth: the nearest on /lidar/points is typically 0\.020 s away.*0\.001 s"
    )
    refuses(write_drive_with(frames=30), sentence, DriveSettings(max_lidar_offset_s=0.001))
