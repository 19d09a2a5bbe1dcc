"""Writes pictures as an H.264 video that browsers play, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radcam_depth_ros.files import FileError, whole
from radcam_depth_ros.frame import ImageArray

if TYPE_CHECKING:
    from av.error import FFmpegError

_CODEC, _PIXELS = "libx264", "yuv420p"  # the one pair that every browser plays
_OPTIONS = {"crf": "20", "preset": "veryfast"}
_INDEX_FIRST = {"movflags": "faststart"}
_BT709, _LIMITED_RANGE = 1, 1
"""Numbers of ITU-T H.273: what players take HD video for, said in the file."""


@contextmanager
def video(target: Path, rate_hz: float) -> Iterator[Callable[[ImageArray], None]]:
    """What takes picture after picture, all of one even size; the video is there when the block succeeds.

    Args:
        target: The .mp4 file.
        rate_hz: Pictures a second.

    Raises:
        FileError: when it cannot be written there.
    """
    with whole(target) as temporary:
        writer = _Writer(temporary, Fraction(rate_hz).limit_denominator(1000))
        try:
            try:
                yield writer.add
            finally:
                writer.close()
            if writer.count:
                _require_frames(temporary, target, writer.count)
        except _ffmpeg_error() as error:
            raise FileError(
                f"cannot write {target}: {error.strerror}; is the disk full? Make room, or choose another place"
            ) from None


def _ffmpeg_error() -> type[FFmpegError]:
    from av.error import FFmpegError

    return FFmpegError


class _Writer:
    """A video under way; its size is that of the first picture."""

    def __init__(self, path: Path, rate_hz: Fraction) -> None:
        self._path, self._rate_hz = path, rate_hz
        self._container: Any = None
        self._stream: Any = None
        self.count = 0

    def add(self, picture: ImageArray) -> None:
        from av import VideoFrame
        from av.video.reformatter import ColorRange, Colorspace

        if self._container is None:
            self._open(*picture.shape[:2])
        self.count += 1
        frame = VideoFrame.from_ndarray(picture, format="rgb24").reformat(
            format=_PIXELS, dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
        )
        self._write(frame)

    def close(self) -> None:
        """Writes what is left, also after a failure; the file is closed."""
        if self._container is None:
            return
        container, self._container = self._container, None
        try:
            container.mux(self._stream.encode(None))
        finally:
            container.close()

    def _write(self, frame: Any) -> None:
        self._container.mux(self._stream.encode(frame))

    def _open(self, height: int, width: int) -> None:
        import av

        self._container = av.open(str(self._path), "w", format="mp4", container_options=_INDEX_FIRST)
        self._stream = self._container.add_stream(_CODEC, rate=self._rate_hz, options=_OPTIONS)
        self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, _PIXELS
        context = self._stream.codec_context
        context.colorspace = context.color_primaries = context.color_trc = _BT709
        context.color_range = _LIMITED_RANGE


def _require_frames(written: Path, target: Path, count: int) -> None:
    """Opens a video again: what a full disk cut off is not always told when it is written."""
    import av

    with av.open(str(written)) as container:
        found = sum(1 for _ in container.decode(video=0))
    if found < count:
        raise FileError(
            f"cannot write {target}: of {count} pictures {found} are in the video; is the disk full? Make room, or "
            "choose another place"
        )
