"""Shows frames and their depth in Rerun, on one timeline: in its viewer, or as an .rrd file."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from radcam_depth_ros.encoder import image_at
from radcam_depth_ros.files import whole
from radcam_depth_ros.frame import SKY_FROM, DepthResult, FloatArray, Frame, ImageArray
from radcam_depth_ros.geometry import project, unproject
from radcam_depth_ros.messages import colorise
from radcam_depth_ros.reporting.pictures import FAR_M, NEAR_M, encode
from radcam_depth_ros.viewing.picture import ViewError

_TIMELINE = "stamp"
_POINTS = 40_000
"""About so many points of a frame are shown."""
_BLOCK_BYTES = 1 << 20
_PATIENCE_S = 60.0
_RETURN_RADIUS_PX, _RETURN_RADIUS_M = 4.0, 0.25


@contextmanager
def timeline(target: Path | None) -> Iterator[Callable[[Frame, DepthResult], None]]:
    """What takes frame after frame with its depth.

    Args:
        target: The .rrd file, there when the block succeeds; None for the viewer, which is started.

    Raises:
        FileError: when it cannot be written there.
        ViewError: when the viewer cannot be started.
    """
    import rerun

    recording = rerun.RecordingStream("radcam_depth")
    if target is None:
        _start_viewer(recording)
        yield lambda frame, result: _log(recording, frame, result)
        _flush(recording)
        return
    with whole(target) as temporary, _Pipe(temporary) as pipe:
        recording.save(pipe.entrance, default_blueprint=_layout())
        try:

            def add(frame: Frame, result: DepthResult) -> None:
                _log(recording, frame, result)
                recording.flush()
                pipe.check()

            yield add
        finally:
            recording.disconnect()


def _start_viewer(recording: Any) -> None:
    """Starts the viewer of this environment, which need not be on the path, and connects the recording to it."""
    import rerun

    places = (str(Path(sys.executable).parent), os.environ.get("PATH", ""))
    program = shutil.which("rerun", path=os.pathsep.join(places))
    try:
        rerun.spawn(executable_path=program, recording=recording, default_blueprint=_layout())
    except (OSError, RuntimeError) as error:
        reason = str(error).partition("\n")[0]
        raise ViewError(f"the viewer of Rerun cannot be started: {reason}; give --save FILE.rrd") from None


def _flush(recording: Any) -> None:
    """Waits until the viewer has all; one that was closed takes no more."""
    try:
        recording.flush(timeout_sec=_PATIENCE_S)
    except (OSError, RuntimeError) as error:
        reason = str(error).partition("\n")[0]
        raise ViewError(f"the viewer of Rerun did not take the frames: {reason}; give --save FILE.rrd") from None


class _Pipe:
    """Copies what Rerun writes into a file: by itself it neither tells of a full disk nor ends on one.

    Args:
        path: The file.

    Attributes:
        entrance: What Rerun writes to.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._error: OSError | None = None
        self._folder = tempfile.TemporaryDirectory(prefix="radcam_depth_view_")
        self.entrance = Path(self._folder.name) / "recording.rrd"
        self._copying = threading.Thread(target=self._copy, name="recording", daemon=True)

    def __enter__(self) -> _Pipe:
        os.mkfifo(self.entrance)
        self._copying.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):  # lets the copying end where nothing was written
            os.close(os.open(self.entrance, os.O_WRONLY | os.O_NONBLOCK))
        self._copying.join()
        self._folder.cleanup()
        if kind is None:
            self.check()

    def check(self) -> None:
        """Raises the OSError that ended the copying, if one did."""
        if self._error is not None:
            raise self._error

    def _copy(self) -> None:
        with self.entrance.open("rb", buffering=0) as pipe:
            try:
                with self._path.open("wb") as file:
                    while block := pipe.read(_BLOCK_BYTES):
                        file.write(block)
            except OSError as error:
                self._error = error
            while pipe.read(_BLOCK_BYTES):  # so that Rerun can end
                pass


def _layout() -> Any:
    """Camera, depth and confidence on the left, the points on the right."""
    import rerun.blueprint as blueprint

    flat = (
        blueprint.Spatial2DView(
            origin="camera", name="Camera and returns", contents=["camera/image", "camera/returns"]
        ),
        blueprint.Spatial2DView(origin="camera", name="Dense depth", contents=["camera/depth"]),
        blueprint.Spatial2DView(origin="camera", name="Semi-dense depth", contents=["camera/semi_dense"]),
        blueprint.Spatial2DView(origin="camera", name="Confidence", contents=["camera/confidence"]),
    )
    space = blueprint.Spatial3DView(origin="/", name="Points and returns", contents=["points", "returns", "camera"])
    return blueprint.Blueprint(
        blueprint.Horizontal(blueprint.Grid(*flat), space), blueprint.TimePanel(timeline=_TIMELINE)
    )


def _log(recording: Any, frame: Frame, result: DepthResult) -> None:
    import rerun

    camera, dense = result.camera, _without_sky(result)
    image = image_at(frame, camera)
    uv, depth_m = project(frame.radar.xyz_m, camera)
    recording.set_time(_TIMELINE, timestamp=np.datetime64(frame.stamp_ns, "ns"))
    # The optical frame of REP 103: x right, y down, z forward.
    recording.log("/", rerun.ViewCoordinates.RDF)
    recording.log(
        "camera",
        rerun.Pinhole(
            image_from_camera=camera.matrix,
            resolution=(camera.width, camera.height),
            camera_xyz=rerun.ViewCoordinates.RDF,
            image_plane_distance=2.0,
        ),
    )
    recording.log("camera/image", rerun.EncodedImage(contents=encode(image, ".jpg"), media_type="image/jpeg"))
    seen = np.isfinite(uv).all(axis=1) & (depth_m > 0)
    colours = _colours(depth_m)
    recording.log("camera/returns", rerun.Points2D(uv[seen], colors=colours[seen], radii=-_RETURN_RADIUS_PX))
    recording.log("returns", rerun.Points3D(frame.radar.xyz_m, colors=colours, radii=_RETURN_RADIUS_M))
    for name, depth in (("depth", dense), ("semi_dense", result.semi_dense)):
        shown = np.nan_to_num(depth, nan=0.0, posinf=0.0)  # 0 is "no value" to Rerun
        recording.log(
            f"camera/{name}",
            rerun.DepthImage(shown.astype(np.float16), meter=1.0, depth_range=(NEAR_M, FAR_M), colormap="turbo"),
        )
    confidence = np.nan_to_num(result.confidence * 255).astype(np.uint8)
    recording.log("camera/confidence", rerun.Image(confidence, color_model="L"))
    points_m, point_colours = _points(dense, image, result)
    recording.log("points", rerun.Points3D(points_m, colors=point_colours, radii=-1.5))


def _without_sky(result: DepthResult) -> FloatArray:
    """The dense depth, NaN in the sky."""
    if result.sky is None:
        return result.dense
    return np.where(result.sky >= SKY_FROM, np.float32(np.nan), result.dense)


def _points(dense: FloatArray, image: ImageArray, result: DepthResult) -> tuple[FloatArray, ImageArray]:
    """Points (N, 3) in metres and their colours (N, 3) uint8, of evenly spread pixels nearer than the scale's end."""
    stride = max(1, round((dense.size / _POINTS) ** 0.5))
    thin = (slice(None, None, stride), slice(None, None, stride))
    shown = (dense[thin] > 0) & (dense[thin] < FAR_M)
    return unproject(dense, result.camera)[thin][shown], image[thin][shown]


def _colours(depth_m: FloatArray) -> ImageArray:
    """(N, 3) uint8, on the scale of all pictures."""
    return colorise(depth_m[:, None].astype(np.float32), NEAR_M, FAR_M)[:, 0]
