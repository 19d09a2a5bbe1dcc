from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from small_drive import CAMERA, PERIOD_NS, START_NS

from radcam_depth_ros.bags import BagMessage, BagReader, BagWriter, factory
from radcam_depth_ros.drive import read_samples
from radcam_depth_ros.messages import encode_camera_info, encode_confidence, encode_depth
from radcam_depth_ros.viewing import RecordedDepth, find_recorded_depth

ALL = ("depth/image_rect", "depth/camera_info", "semi_dense/image_rect", "depth/confidence")


def write_recording(
    path: Path, depths_m: dict[int, float], late_ns: int = 0, prefix: str = "/", topics: Iterable[str] = ALL
) -> Path:
    """Depth that is the same all over, of some of the small drive's frames."""
    with BagWriter(path) as writer:
        for index, depth_m in depths_m.items():
            stamp_ns = START_NS + index * PERIOD_NS
            dense = np.full((CAMERA.height, CAMERA.width), depth_m, np.float32)
            where = (stamp_ns, "camera")
            messages = {
                "depth/image_rect": encode_depth(factory, dense, *where),
                "semi_dense/image_rect": encode_depth(factory, np.full_like(dense, np.nan), *where),
                "depth/camera_info": encode_camera_info(factory, CAMERA, *where),
                "depth/confidence": encode_confidence(factory, np.full_like(dense, 0.5), *where),
            }
            for number, topic in enumerate(topics):
                writer.write(prefix + topic, messages[topic], stamp_ns + late_ns * (number + 1))
    return path


def depths_of(recording: Path, drive: Path) -> list[float | None]:
    with BagReader(recording) as reader:
        namespace = find_recorded_depth(reader)
        assert namespace is not None
        predict = RecordedDepth(reader, namespace).predict
        results = [predict(sample.frame) for sample in read_samples(drive)]
    assert all(result is None or result.camera == CAMERA for result in results)
    return [None if result is None else float(result.dense[0, 0]) for result in results]


@pytest.mark.parametrize("late_ns", [0, 20_000_000, 30_000_000])
@pytest.mark.parametrize("prefix", ["/", "/front/"])
def test_frames_get_their_own_depth(
    write_drive: Callable[..., Path], tmp_path: Path, late_ns: int, prefix: str
) -> None:
    """Also when the bag has it under the time of its arrival, the last of a frame after the first of the next."""
    drive = write_drive(tmp_path / "drive.mcap")
    recording = write_recording(tmp_path / "depth.mcap", {1: 5.0, 2: 6.0, 4: 7.0}, late_ns, prefix)
    assert depths_of(recording, drive) == [None, 5, 6, None, 7]


def test_depth_alone_is_enough(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "drive.mcap")
    recording = write_recording(tmp_path / "depth.mcap", {0: 5.0, 3: 7.0}, topics=ALL[:2])
    assert depths_of(recording, drive) == [5, None, None, 7, None]


def test_a_bag_without_depth_has_none(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    with BagReader(write_drive(tmp_path / "drive.mcap")) as reader:
        assert find_recorded_depth(reader) is None
    with BagReader(write_recording(tmp_path / "depth.mcap", {0: 5.0}, topics=ALL[:1])) as reader:
        assert find_recorded_depth(reader) is None


class Looped:
    """A recording that is heard again and again."""

    def __init__(self, reader: BagReader) -> None:
        self._reader, self.topics = reader, reader.topics

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        return chain.from_iterable(self._reader.messages(topics) for _ in range(3))


@pytest.mark.parametrize("last", [16, 17])
def test_live_stamps_may_begin_anew(write_drive: Callable[..., Path], tmp_path: Path, last: int) -> None:
    """Also where the last image of a round had no depth, and where depth came that had no image."""
    frames = [sample.frame for sample in read_samples(write_drive(tmp_path / "drive.mcap", frames=17))]
    recording = write_recording(tmp_path / "depth.mcap", {0: 5.0, 1: 5.5, 2: 6.0, last: 7.0})
    with BagReader(recording) as reader:
        predict = RecordedDepth(Looped(reader), is_live=True).predict
        shown = [predict(frame) for _ in range(3) for frame in frames]
    depths_m = [None if result is None else float(result.dense[0, 0]) for result in shown]
    assert depths_m[:3] == [5.0, 5.5, 6.0]
    assert depths_m[16] == (7.0 if last == 16 else None)
    for first in (17, 34):
        assert depths_m[first + 1 : first + 3] == [5.5, 6.0]
