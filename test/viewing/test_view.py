from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from small_drive import CAMERA, START_NS

from radcam_depth_ros.files import FileError
from radcam_depth_ros.frame import CameraModel, DepthResult, Frame, RadarReturns
from radcam_depth_ros.viewing import ViewError, ViewOptions, draw_picture, view
from radcam_depth_ros.viewing.video import _Writer

NARROW = {"width": 480}


def depth_of(frame: Frame, camera: CameraModel | None = None) -> DepthResult:
    camera = camera or frame.camera
    dense = np.full((camera.height, camera.width), 20.0, np.float32)
    semi_dense = np.where(np.arange(camera.width) < 8, dense, np.float32(np.nan))
    return DepthResult(frame.stamp_ns, frame.frame_id, camera, dense, semi_dense, dense / 100, len(frame.radar))


@pytest.fixture
def drive(write_drive: Callable[..., Path], tmp_path: Path) -> Path:
    return write_drive(tmp_path / "drive.mcap")


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def frames_of_video(path: Path) -> list[Any]:
    video, frames = cv2.VideoCapture(str(path)), []
    while (read := video.read())[0]:
        frames.append(read[1])
    video.release()
    return frames


@pytest.mark.parametrize(
    ("options", "count"), [({}, 5), ({"every": 2}, 3), ({"frames": 2}, 2), ({"every": 2, "frames": 9}, 3)]
)
def test_a_folder_has_a_picture_of_each_frame(drive: Path, tmp_path: Path, options: dict[str, int], count: int) -> None:
    told: list[tuple[int, int]] = []
    shown = view(
        drive,
        tmp_path / "out" / "pictures",
        depth_of,
        options=ViewOptions(**NARROW, **options),
        progress=lambda *so_far: told.append(so_far),
    )
    assert shown == count
    assert told == [(done + 1, count) for done in range(count)]
    assert names_in(tmp_path / "out") == ["pictures"]
    assert names_in(tmp_path / "out" / "pictures") == [f"{number:06d}.png" for number in range(count)]


def test_a_video_is_what_browsers_play(drive: Path, tmp_path: Path) -> None:
    """H.264 with the index in front, so that it starts before all of it is there."""
    view(drive, tmp_path / "drive.mp4", depth_of, options=ViewOptions(**NARROW))
    with av.open(str(tmp_path / "drive.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
    written = (tmp_path / "drive.mp4").read_bytes()
    assert 0 < written.index(b"moov") < written.index(b"mdat")


def test_a_video_that_cannot_be_read_again_is_refused(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_Writer, "_write", lambda *_: None)
    with pytest.raises(FileError, match="disk"):
        view(drive, tmp_path / "drive.mp4", depth_of, options=ViewOptions(**NARROW))
    assert names_in(tmp_path) == ["drive.mcap"]


@pytest.mark.parametrize(("package", "name"), [("av", "drive.mp4"), ("rerun", "drive.rrd"), ("rerun", None)])
def test_a_missing_package_is_told_with_its_extra(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, name: str | None
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ViewError, match=rf"{package}, which is not installed; install the extra `view`"):
        view(drive, tmp_path / name if name else None, depth_of)
    assert names_in(tmp_path) == ["drive.mcap"]


def test_a_recording_for_rerun_has_all_on_one_timeline(drive: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the extra `view` is not installed")
    target = tmp_path / "out" / "drive.rrd"
    assert view(drive, target, depth_of) == 5
    assert names_in(target.parent) == ["drive.rrd"]
    tool = [str(Path(sys.executable).parent / "rerun"), "rrd"]
    subprocess.run([*tool, "verify", str(target)], check=True, capture_output=True, timeout=60)
    told = subprocess.run([*tool, "stats", str(target)], check=True, capture_output=True, text=True, timeout=60).stdout
    for entity in ("image", "returns", "depth", "semi_dense", "confidence"):
        assert f"/camera/{entity}: 5\n" in told
    assert "\n/points: 5\n" in told
    assert "\n/returns: 5\n" in told


def test_a_viewer_that_does_not_start_is_told(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rerun = pytest.importorskip("rerun", reason="the extra `view` is not installed")
    given: dict[str, Any] = {}

    def refuse(**options: Any) -> None:
        given.update(options)
        raise RuntimeError("no display\nand much more")

    monkeypatch.setattr(rerun, "spawn", refuse)
    with pytest.raises(ViewError, match=r"cannot be started: no display; give --save FILE.rrd"):
        view(drive, None, depth_of)
    assert Path(given["executable_path"]).is_file(), "also where it is not on the path"


def test_a_video_has_all_frames_at_the_rate_of_the_camera(drive: Path, tmp_path: Path) -> None:
    target = tmp_path / "out" / "drive.mp4"
    assert view(drive, target, depth_of, options=ViewOptions(**NARROW)) == 5
    frames = frames_of_video(target)
    assert len(frames) == 5
    assert frames[0].shape[1] == 480
    assert frames[0].shape[0] % 2 == 0
    assert names_in(target.parent) == ["drive.mp4"]


@pytest.mark.parametrize(("frames", "count"), [(None, 5), (2, 2), (1, 1)])
def test_a_strip_has_evenly_spread_frames(drive: Path, tmp_path: Path, frames: int | None, count: int) -> None:
    stamps_ns: list[int] = []

    def estimate(frame: Frame) -> DepthResult:
        stamps_ns.append(frame.stamp_ns)
        return depth_of(frame)

    assert view(drive, tmp_path / "strip.png", estimate, options=ViewOptions(frames=frames, **NARROW)) == count
    picture = cv2.imread(str(tmp_path / "strip.png"))
    assert picture is not None
    assert picture.shape[0] % count == 0
    assert stamps_ns[0] == START_NS
    if count == 2:
        assert stamps_ns[1] == START_NS + 400_000_000


def test_frames_without_depth_are_left_out(drive: Path, tmp_path: Path) -> None:
    def estimate(frame: Frame) -> DepthResult | None:
        return depth_of(frame) if frame.stamp_ns > START_NS else None

    assert view(drive, tmp_path / "pictures", estimate, options=ViewOptions(**NARROW)) == 4


@pytest.mark.parametrize("name", ["video.mp4", "strip.png", "pictures", "drive.rrd"])
@pytest.mark.parametrize("failure", ["no depth", "error"])
def test_nothing_remains_after_a_failure(drive: Path, tmp_path: Path, name: str, failure: str) -> None:
    if name.endswith(".rrd"):
        pytest.importorskip("rerun", reason="the extra `view` is not installed")
    frames = 0

    def estimate(frame: Frame) -> DepthResult | None:
        nonlocal frames
        frames += 1
        if failure == "no depth":
            return None
        if frames == 3:
            raise ValueError("broken")
        return depth_of(frame)

    with pytest.raises(ViewError if failure == "no depth" else ValueError, match=r"nothing to show|broken"):
        view(drive, tmp_path / name, estimate, options=ViewOptions(**NARROW))
    assert names_in(tmp_path) == ["drive.mcap"]


@pytest.mark.parametrize(
    ("name", "words"), [("video.avi", "give a video"), ("there", "exists already"), ("drive.mcap", "give a video")]
)
def test_a_target_that_does_not_fit_is_refused(drive: Path, tmp_path: Path, name: str, words: str) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(ViewError, match=words):
        view(drive, tmp_path / name, depth_of)


def test_a_folder_that_cannot_be_written_is_told(drive: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError, match="choose"):
        view(drive, drive / "pictures", depth_of, options=ViewOptions(**NARROW))


@pytest.mark.parametrize(
    ("options", "words"), [({"every": 0}, "every"), ({"frames": 0}, "frames"), ({"width": 100}, "at least 480")]
)
def test_options_that_make_no_sense_are_refused(options: dict[str, int], words: str) -> None:
    with pytest.raises(ViewError, match=words):
        ViewOptions(**options)


def make_frame() -> Frame:
    image = np.full((CAMERA.height, CAMERA.width, 3), 90, np.uint8)
    return Frame(START_NS, "camera", image, CAMERA, RadarReturns.from_points([[0.0, 0.0, 5.0], [0.5, 0.2, 40.0]]))


def test_a_picture_shows_camera_and_both_depths() -> None:
    picture = draw_picture(make_frame(), depth_of(make_frame()), 600)
    assert picture.shape[1] == 600
    assert all(size % 2 == 0 for size in picture.shape[:2])
    camera, dense, semi_dense = (picture[26:-42, start : start + 190] for start in (0, 200, 400))
    assert (camera == 90).all(axis=2).mean() > 0.5
    assert len(np.unique(dense.reshape(-1, 3), axis=0)) > 1, "radar returns are drawn in"
    assert (semi_dense[:, 60:] == semi_dense[0, -1]).all(), "no value is one colour"
    assert tuple(semi_dense[30, 5]) != tuple(semi_dense[30, -5])


def test_depth_at_the_networks_size_is_shown_too() -> None:
    half = CameraModel(48, 32, 315.0, 315.0, 23.5, 15.5)
    assert draw_picture(make_frame(), depth_of(make_frame(), half), 600).shape[1] == 600
