"""Writes frames and their depth as a video, a folder, one strip or a Rerun recording, whole or not at all."""

from __future__ import annotations

import importlib.util
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import cv2
import numpy as np

from radcam_depth_ros.extras import install_extra
from radcam_depth_ros.files import FileError, whole
from radcam_depth_ros.frame import DepthResult, Frame, ImageArray
from radcam_depth_ros.viewing.picture import ViewError, draw_picture
from radcam_depth_ros.viewing.timeline import timeline
from radcam_depth_ros.viewing.video import video

Add = Callable[[Frame, DepthResult], None]
AddPicture = Callable[[ImageArray], None]
VIDEO, STRIP, FOLDER, RECORDING = ".mp4", ".png", "", ".rrd"
_NEEDED = {VIDEO: ("av", "a video (.mp4)"), RECORDING: ("rerun", "showing a drive in Rerun")}
"""Packages of the extra `view`."""


def check_target(target: Path | None) -> None:
    """Refuses a place that is of no known kind, or taken, or that needs a package which is not installed.

    Args:
        target: The place; None for the viewer of Rerun.

    Raises:
        ViewError: for such a place.
    """
    suffix = RECORDING if target is None else target.suffix
    if target is not None and suffix not in (VIDEO, STRIP, FOLDER, RECORDING):
        raise ViewError(
            f"cannot save pictures as {target.name}; give a video (.mp4), a strip of frames (.png), a recording for "
            "Rerun (.rrd), or a folder's name"
        )
    if target is not None and suffix == FOLDER and target.exists():
        raise ViewError(f"{target} exists already; choose another name, or remove it")
    package, purpose = _NEEDED.get(suffix, ("", ""))
    if package and importlib.util.find_spec(package) is None:
        raise ViewError(f"{purpose} needs the package {package}, which is not installed; {install_extra('view')}")


@contextmanager
def output(target: Path | None, rate_hz: float, width: int) -> Iterator[Add]:
    """What takes frame after frame, all of one camera; the target is there when the block succeeds.

    Args:
        target: A video (.mp4), a strip (.png), a recording for Rerun (.rrd), or a folder for numbered PNGs; None for
            the viewer of Rerun.
        rate_hz: Pictures a second of a video.
        width: Of a picture, pixels.

    Raises:
        ViewError: when there was no frame, or OpenCV cannot write it.
        FileError: when it cannot be written there.
    """
    check_target(target)
    with _kind(target, rate_hz, width) as write:
        count = 0

        def add(frame: Frame, result: DepthResult) -> None:
            nonlocal count
            count += 1
            write(frame, result)

        yield add
        if not count:
            raise ViewError("no image of the bag has depth, so there is nothing to show; run `radcam-depth inspect`")


def _kind(target: Path | None, rate_hz: float, width: int) -> AbstractContextManager[Add]:
    if target is None or target.suffix == RECORDING:
        return timeline(target)
    if target.suffix == VIDEO:
        return _drawn(video(target, rate_hz), width)
    return _drawn(_strip(target) if target.suffix == STRIP else _folder(target), width)


@contextmanager
def _drawn(pictures: AbstractContextManager[AddPicture], width: int) -> Iterator[Add]:
    with pictures as add:
        yield lambda frame, result: add(draw_picture(frame, result, width))


@contextmanager
def _strip(target: Path) -> Iterator[AddPicture]:
    pictures: list[ImageArray] = []
    yield pictures.append
    if pictures:
        with whole(target) as temporary:
            _write_png(temporary, np.concatenate(pictures))


@contextmanager
def _folder(target: Path) -> Iterator[AddPicture]:
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.partial-"))
    except OSError as error:
        raise FileError(f"cannot write {target}: {error.strerror or error}; choose another place") from None
    count = 0

    def add(picture: ImageArray) -> None:
        nonlocal count
        _write_png(temporary / f"{count:06d}.png", picture)
        count += 1

    try:
        yield add
        temporary.chmod(0o755)  # mkdtemp's is for its owner alone
        temporary.rename(target)
    except OSError as error:
        raise FileError(f"cannot write {target}: {error.strerror or error}; choose another place") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _write_png(path: Path, picture: ImageArray) -> None:
    done, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    if not done:
        raise ViewError(
            f"OpenCV cannot make a PNG of {picture.shape[1]} x {picture.shape[0]} pixels; take fewer frames"
        )
    path.write_bytes(data.tobytes())
