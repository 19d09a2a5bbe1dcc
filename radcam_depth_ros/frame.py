"""The values that cross rooms: camera, lens, radar returns, frame, depth result.

Conventions, used everywhere: depth is metres along the camera's optical axis (REP 118); camera axes are x right,
y down, z forward (REP 103, optical frame); "no value" is NaN in float images (REP 117), and +inf is "beyond the range".
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float32]
ImageArray = npt.NDArray[np.uint8]


LONGEST_SENTENCE = 2000
"""Characters of an error at most."""
_END_KEPT = 500


class RadcamDepthError(Exception):
    """Base of the errors that a user can mend: one sentence on what was expected, what came, and what to do.

    What came may be of any length: the middle of a sentence beyond `LONGEST_SENTENCE` is left out.
    """

    def __str__(self) -> str:
        text = super().__str__()
        if len(text) <= LONGEST_SENTENCE:
            return text
        return f"{text[: LONGEST_SENTENCE - _END_KEPT - 5]} ... {text[-_END_KEPT:]}"


class FrameError(RadcamDepthError):
    """A value that crosses rooms has the wrong shape, type or range."""


@dataclass(frozen=True)
class CameraModel:
    """An ideal (rectified) pinhole camera.

    Attributes:
        width: Image width in pixels.
        height: Image height in pixels.
        fx: Focal length along x in pixels.
        fy: Focal length along y in pixels.
        cx: Principal point column in pixels; pixel centres are at whole numbers.
        cy: Principal point row in pixels.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise FrameError(f"a camera needs a positive image size, got {self.width} x {self.height}")
        values = (self.fx, self.fy, self.cx, self.cy)
        if not all(np.isfinite(value) for value in values) or self.fx <= 0 or self.fy <= 0:
            raise FrameError(
                "a camera needs a finite K with positive focal lengths, got "
                f"fx={self.fx} fy={self.fy} cx={self.cx} cy={self.cy}; calibrate the camera or fix its camera_info"
            )

    @property
    def matrix(self) -> npt.NDArray[np.float64]:
        """K, (3, 3) float64."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def resized(self, width: int, height: int) -> CameraModel:
        """The same camera with an image of another size: pixel areas scale, so u + 1/2 scales, not u."""
        across, down = width / self.width, height / self.height
        return CameraModel(
            width,
            height,
            self.fx * across,
            self.fy * down,
            (self.cx + 0.5) * across - 0.5,
            (self.cy + 0.5) * down - 0.5,
        )


@dataclass(frozen=True)
class Lens:
    """How an image as it was published differs from that of its ideal camera; pixel centres are at whole numbers.

    Attributes:
        matrix: K of the published image, 9 numbers row by row.
        rotation: R, from the published to the ideal camera's axes, 9 numbers row by row.
        model: `plumb_bob`, `rational_polynomial` or `equidistant`; empty where only K and R differ.
        distortion: The model's coefficients in OpenCV's order.
    """

    matrix: tuple[float, ...]
    rotation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    model: str = ""
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.matrix) != 9 or len(self.rotation) != 9:
            raise FrameError(
                f"a lens needs 9 numbers of K and 9 of R, got {len(self.matrix)} and {len(self.rotation)}; give both "
                "matrices row by row"
            )


@dataclass(frozen=True)
class RadarReturns:
    """Radar detections as columns; which frame they are in is said by whatever holds them.

    Attributes:
        xyz_m: (N, 3) float32, metres, finite.
        rcs_dbsm: (N,) float32, radar cross section or the sensor's own intensity in dB; NaN where not given.
        radial_speed_mps: (N,) float32, along the line of sight, positive moving away; NaN where not given.
        age_s: (N,) float32, seconds from the detection to the image, negative when it came later; NaN where unknown.
    """

    xyz_m: FloatArray
    rcs_dbsm: FloatArray
    radial_speed_mps: FloatArray
    age_s: FloatArray

    def __post_init__(self) -> None:
        if self.xyz_m.ndim != 2 or self.xyz_m.shape[1] != 3 or self.xyz_m.dtype != np.float32:
            raise FrameError(f"radar xyz_m must be (N, 3) float32, got {self.xyz_m.shape} {self.xyz_m.dtype}")
        if not np.isfinite(self.xyz_m).all():
            raise FrameError("radar xyz_m must be finite; drop rows with NaN or infinity before building RadarReturns")
        for name in ("rcs_dbsm", "radial_speed_mps", "age_s"):
            column = getattr(self, name)
            if column.shape != (len(self.xyz_m),) or column.dtype != np.float32:
                raise FrameError(
                    f"radar {name} must be ({len(self.xyz_m)},) float32, got {column.shape} {column.dtype}"
                )

    def __len__(self) -> int:
        return len(self.xyz_m)

    @classmethod
    def from_points(cls, xyz_m: npt.ArrayLike) -> RadarReturns:
        """Returns of which only the positions, (N, 3) metres, are known."""
        xyz = np.asarray(xyz_m, np.float32).reshape(-1, 3)
        unknown = np.full(len(xyz), np.nan, np.float32)
        return cls(xyz, unknown, unknown, unknown)

    @classmethod
    def empty(cls) -> RadarReturns:
        """No returns at all."""
        return cls.from_points(np.zeros((0, 3), np.float32))

    @classmethod
    def concatenate(cls, parts: tuple[RadarReturns, ...]) -> RadarReturns:
        """Returns of several sweeps, in one frame, in the given order."""
        if not parts:
            return cls.empty()
        return cls(
            np.concatenate([part.xyz_m for part in parts]),
            np.concatenate([part.rcs_dbsm for part in parts]),
            np.concatenate([part.radial_speed_mps for part in parts]),
            np.concatenate([part.age_s for part in parts]),
        )


_LOWEST_HEIGHT_M = 0.001
ASSUMED_HEIGHT_M = 1.4
"""Height of a camera of which nothing is known: behind a passenger car's windscreen."""


@dataclass(frozen=True)
class GroundPlane:
    """The flat road under the vehicle, seen from the camera.

    Attributes:
        height_m: Height of the camera above the road; NaN where unknown.
        up: The road's unit normal in camera axes (x right, y down, z forward); (0, -1, 0) for a level camera.
        is_assumed: Whether both are assumed, since nothing tells them.
    """

    height_m: float = float("nan")
    up: tuple[float, float, float] = (0.0, -1.0, 0.0)
    is_assumed: bool = False

    def __post_init__(self) -> None:
        if np.isfinite(self.height_m) and self.height_m < _LOWEST_HEIGHT_M:
            raise FrameError(
                f"the camera's height above the road must be positive, {_LOWEST_HEIGHT_M} m or more, got "
                f"{self.height_m} m; mend the transform to the footprint frame, or set the parameter camera_height_m"
            )
        if not abs(float(np.linalg.norm(self.up)) - 1.0) < 1e-3:
            raise FrameError(f"the road's normal must be a unit vector, got {self.up}")

    @property
    def is_known(self) -> bool:
        """Whether the camera's height is known or assumed."""
        return bool(np.isfinite(self.height_m))

    def or_assumed(self) -> GroundPlane:
        """This road; where it is not known, that of a level camera at `ASSUMED_HEIGHT_M`."""
        return self if self.is_known else GroundPlane(ASSUMED_HEIGHT_M, is_assumed=True)


@dataclass(frozen=True)
class Frame:
    """One image with the radar returns that belong to it: all that an estimate is made from.

    Attributes:
        stamp_ns: The image's stamp, nanoseconds.
        frame_id: The camera's optical frame.
        image: (H, W, 3) uint8 RGB as it was published: rectified already where `lens` is None, else see
            `resampling.rectify`.
        camera: The rectified camera; its size is the image's.
        radar: Returns in the camera's frame; may be empty.
        ground: The flat road, unknown by default.
        radar_counts: How many of the returns are of each radar, in the order of `radar`; empty where nobody asked.
        lens: How the image differs from the camera's; None where it does not.
    """

    stamp_ns: int
    frame_id: str
    image: ImageArray
    camera: CameraModel
    radar: RadarReturns
    ground: GroundPlane = field(default_factory=GroundPlane)
    radar_counts: tuple[int, ...] = ()
    lens: Lens | None = None

    def __post_init__(self) -> None:
        expected = (self.camera.height, self.camera.width, 3)
        if self.image.shape != expected or self.image.dtype != np.uint8:
            raise FrameError(
                f"the image must be {expected} uint8 RGB like its camera, got {self.image.shape} {self.image.dtype}"
            )
        if self.radar_counts and sum(self.radar_counts) != len(self.radar):
            raise FrameError(f"radar_counts {self.radar_counts} must add up to the {len(self.radar)} radar returns")

    @property
    def radar_parts(self) -> tuple[RadarReturns, ...]:
        """The returns of each radar; all in one part where `radar_counts` is empty."""
        if not self.radar_counts:
            return (self.radar,)
        ends = np.cumsum(self.radar_counts)
        return tuple(
            RadarReturns(
                self.radar.xyz_m[end - count : end],
                self.radar.rcs_dbsm[end - count : end],
                self.radar.radial_speed_mps[end - count : end],
                self.radar.age_s[end - count : end],
            )
            for end, count in zip(ends, self.radar_counts, strict=True)
        )


SKY_FROM = 0.5
"""Probability of the sky from which on a pixel has no depth."""


@dataclass(frozen=True)
class DepthResult:
    """What an estimate gives, at the size of `camera`.

    Attributes:
        stamp_ns: The image's stamp, nanoseconds.
        frame_id: The camera's optical frame.
        camera: Intrinsics of the depth images.
        dense: (H, W) float32 metres, finite.
        semi_dense: (H, W) float32 metres, NaN where no radar return was associated.
        confidence: (H, W) float32, 0 to 1.
        radar_in_view: Number of radar returns that the network was given.
        classes: (H, W) uint8, what a pixel shows, as `classes.CLASS_NAMES`; None of a network that does not tell.
        sky: (H, W) float32, 0 to 1, the probability that a pixel shows the sky; None of a network that does not tell.
    """

    stamp_ns: int
    frame_id: str
    camera: CameraModel
    dense: FloatArray
    semi_dense: FloatArray
    confidence: FloatArray
    radar_in_view: int
    classes: ImageArray | None = None
    sky: FloatArray | None = None

    def __post_init__(self) -> None:
        expected = (self.camera.height, self.camera.width)
        for name in ("dense", "semi_dense", "confidence", "sky"):
            image = getattr(self, name)
            if image is None:
                continue
            if image.shape != expected or image.dtype != np.float32:
                raise FrameError(f"{name} must be {expected} float32, got {image.shape} {image.dtype}")
        if self.classes is not None and (self.classes.shape != expected or self.classes.dtype != np.uint8):
            raise FrameError(f"classes must be {expected} uint8, got {self.classes.shape} {self.classes.dtype}")
