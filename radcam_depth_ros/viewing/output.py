"""Writes pictures as a video, a folder or one strip, whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from radcam_depth_ros.files import FileError, whole
from radcam_depth_ros.frame import ImageArray
from radcam_depth_ros.viewing.picture import ViewError

Add = Callable[[ImageArray], None]
VIDEO, STRIP, FOLDER = ".mp4", ".png", ""


def check_target(target: Path) -> None:
    """Refuses a place that is of no known kind, or taken.

    Raises:
        ViewError: for such a place.
    """
    if target.suffix not in (VIDEO, STRIP, FOLDER):
        raise ViewError(
            f"cannot save pictures as {target.name}; give a video (.mp4), a strip of frames (.png), or a folder's name"
        )
    if target.suffix == FOLDER and target.exists():
        raise ViewError(f"{target} exists already; choose another name, or remove it")


@contextmanager
def output(target: Path, rate_hz: float) -> Iterator[Add]:
    """What takes picture after picture, all of one size; the target is there when the block succeeds.

    Args:
        target: A video (.mp4), a strip (.png), or a folder for numbered PNGs.
        rate_hz: Pictures a second of a video.

    Raises:
        ViewError: when there was no picture, or OpenCV cannot write it.
        FileError: when it cannot be written there.
    """
    check_target(target)
    kinds = {VIDEO: _video, STRIP: _strip, FOLDER: _folder}
    with kinds[target.suffix](target, rate_hz) as write:
        count = 0

        def add(picture: ImageArray) -> None:
            nonlocal count
            count += 1
            write(picture)

        yield add
        if not count:
            raise ViewError("no image of the bag has depth, so there is nothing to show; run `radcam-depth inspect`")


@contextmanager
def _video(target: Path, rate_hz: float) -> Iterator[Add]:
    with whole(target) as temporary:
        writer: Any = None
        count = 0

        def add(picture: ImageArray) -> None:
            nonlocal writer, count
            count += 1
            if writer is None:
                height, width = picture.shape[:2]
                code = cv2.VideoWriter.fourcc(*"mp4v")
                writer = cv2.VideoWriter(str(temporary), code, rate_hz, (width, height))
                if not writer.isOpened():
                    raise ViewError(
                        f"this build of OpenCV ({cv2.__version__}) cannot write {target}; check that its folder can be "
                        "written, or give a folder's name for single pictures"
                    )
            writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))

        try:
            yield add
        finally:
            if writer is not None:
                writer.release()
        _require_frames(temporary, target, count)


def _require_frames(written: Path, target: Path, count: int) -> None:
    """Opens a video again: OpenCV does not say when the disk is full."""
    video = cv2.VideoCapture(str(written))
    try:
        found = 0
        while found < count and video.grab():
            found += 1
    finally:
        video.release()
    if found < count:
        raise FileError(
            f"cannot write {target}: of {count} pictures {found} are in the video; is the disk full? Make room, or "
            "choose another place"
        )


@contextmanager
def _strip(target: Path, _: float) -> Iterator[Add]:
    pictures: list[ImageArray] = []
    yield pictures.append
    if pictures:
        with whole(target) as temporary:
            _write_png(temporary, np.concatenate(pictures))


@contextmanager
def _folder(target: Path, _: float) -> Iterator[Add]:
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
