"""Makes many samples of one: crop, flip, light and colour, radars that miss or invent returns, a road prior that is off.

What is seen (`crop`, `mirror`) and what is true of it change together: image, depth, returns and ground stay consistent.
What is only perceived (`photometric`, `perturb_radar`, `perturb_ground`) changes alone. All take their randomness from
the generator that is passed in.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray, GroundPlane, ImageArray
from radcam_depth_ros.training.samples import RADAR_COLUMNS, UNKNOWN_CLASS, TrainingSample

_U, _V, _DEPTH, _RCS, _SPEED, _AGE = range(RADAR_COLUMNS)
CROP_MARGIN_PX = 80
"""Half of the width of a return's region of interest, as of `baff`."""

ValueT = TypeVar("ValueT", bound=np.generic)

_LUMA = np.array([0.299, 0.587, 0.114], np.float32)


@dataclass(frozen=True)
class PhotometricConfig:
    """Light and colour. Each effect has a probability and a strength.

    Attributes:
        tone: Probability of brightness, contrast and gamma, together.
        brightness: Largest change of the logarithm of brightness.
        contrast: Largest change of the logarithm of contrast.
        gamma: Largest change of the logarithm of gamma.
        colour: Probability of white balance and saturation, together.
        white_balance: Largest change of the logarithm of a channel.
        grey: Probability of no colour at all.
        illumination: Probability of a smooth random field of light: breaks the tie between brightness and distance.
        illumination_strength: Standard deviation of its logarithm.
        shadow: Probability of darkened patches, which dark asphalt and shadows are in real pictures.
        blur: Probability of a Gaussian blur of up to `blur_px`.
        blur_px: See `blur`.
        noise: Probability of noise of up to `noise_level`.
        noise_level: Largest standard deviation, of a range of 1.
    """

    tone: float = 0.8
    brightness: float = 0.5
    contrast: float = 0.4
    gamma: float = 0.3
    colour: float = 0.7
    white_balance: float = 0.2
    grey: float = 0.1
    illumination: float = 0.5
    illumination_strength: float = 0.35
    shadow: float = 0.35
    blur: float = 0.15
    blur_px: float = 1.5
    noise: float = 0.4
    noise_level: float = 0.03


@dataclass(frozen=True)
class RadarAugmentationConfig:
    """What happens to radar returns.

    Attributes:
        none: Probability of no return at all.
        one_radar: Probability of one radar alone, where a drive has several.
        thinned: Probability of leaving returns out; then a share of up to `thinned_share` goes.
        thinned_share: See `thinned`.
        clutter: Probability of invented returns; then up to `clutter_share` of the number of true ones, or 3.
        clutter_share: See `clutter`.
        pixel_noise: Standard deviation of u and v in pixels.
        depth_noise_m: Standard deviation of depth in metres.
        rcs_unknown: Probability of a radar that gives no RCS.
        speed_unknown: Probability of a radar that gives no speed.
        age_unknown: Probability of unknown ages.
        max_points: No more returns than this are kept, at random.
    """

    none: float = 0.05
    one_radar: float = 0.6
    thinned: float = 0.4
    thinned_share: float = 0.6
    clutter: float = 0.3
    clutter_share: float = 0.15
    pixel_noise: float = 1.0
    depth_noise_m: float = 0.1
    rcs_unknown: float = 0.15
    speed_unknown: float = 0.15
    age_unknown: float = 0.15
    max_points: int = 96


@dataclass(frozen=True)
class GroundAugmentationConfig:
    """How far the road prior that the network is told is off.

    Attributes:
        unknown: Probability of no prior.
        height_share: Largest relative error of the camera's height.
        pitch_deg: Largest error of pitch.
        roll_deg: Largest error of roll.
    """

    unknown: float = 0.15
    height_share: float = 0.08
    pitch_deg: float = 1.2
    roll_deg: float = 0.6


@dataclass(frozen=True)
class AugmentationConfig:
    """All of it.

    Attributes:
        mirror: Probability of a left-right flip.
        photometric: Light and colour.
        radar: Returns.
        ground: Road prior.
    """

    mirror: float = 0.5
    photometric: PhotometricConfig = field(default_factory=PhotometricConfig)
    radar: RadarAugmentationConfig = field(default_factory=RadarAugmentationConfig)
    ground: GroundAugmentationConfig = field(default_factory=GroundAugmentationConfig)


def augment(
    sample: TrainingSample, size: tuple[int, int], config: AugmentationConfig, rng: np.random.Generator
) -> tuple[TrainingSample, FloatArray]:
    """One random version of a sample.

    Args:
        sample: As cached.
        size: (height, width) of the crop.
        config: Probabilities and strengths.
        rng: Where all randomness comes from.

    Returns:
        The sample, and its image after photometric changes, (H, W, 3) float32, 0 to 1.
    """
    height, width = size
    top = _offset(sample.camera.height, height, rng)
    left = _offset(sample.camera.width, width, rng)
    result = crop(sample, top, left, height, width)
    if rng.random() < config.mirror:
        result = mirror(result)
    radar, source = perturb_radar(result, config.radar, rng)
    ground = perturb_ground(result.ground, config.ground, rng)
    result = replace(result, radar=radar, radar_source=source, ground=ground)
    return result, photometric(result.image, config.photometric, rng)


def crop(sample: TrainingSample, top: int, left: int, height: int, width: int) -> TrainingSample:
    """Cuts a window out; where it reaches beyond the image, the image is black and nothing else is known.

    Returns stay, whatever their row, as radars know little of height, when their column is near enough to the window
    that their region of interest reaches into it; `estimator.radar_columns` keeps such ones, too.
    """
    camera = CameraModel(
        width, height, sample.camera.fx, sample.camera.fy, sample.camera.cx - left, sample.camera.cy - top
    )
    radar = sample.radar.copy()
    radar[:, _U] -= left
    radar[:, _V] -= top
    inside = (radar[:, _U] > -CROP_MARGIN_PX) & (radar[:, _U] < width - 1 + CROP_MARGIN_PX)
    return replace(
        sample,
        image=_window(sample.image, top, left, height, width, 0),
        depth_m=_window(sample.depth_m, top, left, height, width, np.nan),
        classes=_window(sample.classes, top, left, height, width, UNKNOWN_CLASS),
        radar=radar[inside],
        radar_source=sample.radar_source[inside],
        camera=camera,
    )


def mirror(sample: TrainingSample) -> TrainingSample:
    """The same street with left and right exchanged: images, principal point, returns and the road's normal."""
    last = sample.camera.width - 1
    radar = sample.radar.copy()
    radar[:, _U] = last - radar[:, _U]
    up_x, up_y, up_z = sample.ground.up
    return replace(
        sample,
        image=sample.image[:, ::-1],
        depth_m=sample.depth_m[:, ::-1],
        classes=sample.classes[:, ::-1],
        radar=radar,
        camera=replace(sample.camera, cx=last - sample.camera.cx),
        ground=GroundPlane(sample.ground.height_m, (-up_x, up_y, up_z)),
    )


def perturb_radar(
    sample: TrainingSample, config: RadarAugmentationConfig, rng: np.random.Generator
) -> tuple[FloatArray, npt.NDArray[np.uint8]]:
    """Chooses radars, leaves returns out, invents some, adds noise, forgets columns.

    Returns:
        Returns (N, 6) float32 with N <= max_points, and the radar of each.
    """
    radar, source = sample.radar, sample.radar_source
    if rng.random() < config.none:
        return radar[:0], source[:0]
    radars = np.unique(source)
    if len(radars) > 1 and rng.random() < config.one_radar:
        chosen = source == rng.choice(radars)
        radar, source = radar[chosen], source[chosen]
    if rng.random() < config.thinned:
        kept = rng.random(len(radar)) >= rng.uniform(0, config.thinned_share)
        radar, source = radar[kept], source[kept]
    radar = radar + rng.standard_normal(radar.shape, np.float32) * np.float32(
        [config.pixel_noise, config.pixel_noise, config.depth_noise_m, 0, 0, 0]
    )
    if rng.random() < config.clutter:
        invented = _clutter(sample.camera, radar, config, rng)
        radar = np.concatenate([radar, invented])
        source = np.concatenate([source, rng.choice(radars, len(invented)) if len(radars) else np.zeros(len(invented))])
    if len(radar) > config.max_points:
        kept = rng.choice(len(radar), config.max_points, replace=False)
        radar, source = radar[kept], source[kept]
    for column, probability in (
        (_RCS, config.rcs_unknown),
        (_SPEED, config.speed_unknown),
        (_AGE, config.age_unknown),
    ):
        if rng.random() < probability:
            radar[:, column] = np.nan
    in_front = radar[:, _DEPTH] > 0
    return radar[in_front], source[in_front].astype(np.uint8)


def perturb_ground(ground: GroundPlane, config: GroundAugmentationConfig, rng: np.random.Generator) -> GroundPlane:
    """The road prior with an error of height, pitch and roll, or none."""
    unknown, height, pitch, roll = rng.random(), *rng.uniform(-1, 1, 3)
    if unknown < config.unknown or not ground.is_known:
        return GroundPlane()
    x, y, z = ground.up
    angle = np.deg2rad(pitch * config.pitch_deg)
    y, z = y * np.cos(angle) - z * np.sin(angle), y * np.sin(angle) + z * np.cos(angle)
    angle = np.deg2rad(roll * config.roll_deg)
    x, y = x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)
    return GroundPlane(ground.height_m * (1 + height * config.height_share), (float(x), float(y), float(z)))


def photometric(image: ImageArray, config: PhotometricConfig, rng: np.random.Generator) -> FloatArray:
    """Light and colour: (H, W, 3) uint8 to (H, W, 3) float32, 0 to 1."""
    curve = np.broadcast_to(np.linspace(0, 1, 256, dtype=np.float32)[:, None], (256, 3))
    if rng.random() < config.tone:
        gamma, contrast, brightness = np.exp(
            rng.uniform(-1, 1, 3) * [config.gamma, config.contrast, config.brightness]
        ).astype(np.float32)
        curve = ((curve**gamma - 0.5) * contrast + 0.5) * brightness
    saturation = 1.0
    if rng.random() < config.colour:
        curve = curve * np.exp(rng.uniform(-1, 1, 3) * config.white_balance).astype(np.float32)
        saturation = rng.uniform(0.2, 1.6)
    if rng.random() < config.grey:
        saturation = 0.0
    # One table look-up does all that depends on a pixel's value alone.
    result = np.stack([np.take(curve[:, channel], image[..., channel]) for channel in range(3)], axis=-1)
    if saturation != 1.0:
        # out = saturation * x + (1 - saturation) * luma, as one 3 x 3 matrix.
        mixing = np.eye(3, dtype=np.float32) * saturation + (1 - saturation) * np.tile(_LUMA, (3, 1))
        result = cv2.transform(result, mixing.astype(np.float32))
    light = _light(image.shape[0], image.shape[1], config, rng)
    if light is not None:
        result *= light[..., None]
    if rng.random() < config.blur:
        sigma = rng.uniform(0.3, max(config.blur_px, 0.3))
        result = cv2.GaussianBlur(result, (0, 0), sigma)
    if rng.random() < config.noise:
        level = np.float32(rng.uniform(0, config.noise_level))
        result += rng.standard_normal(result.shape, np.float32) * level
    clipped: FloatArray = np.clip(result, 0, 1, out=result)
    return clipped


def _light(height: int, width: int, config: PhotometricConfig, rng: np.random.Generator) -> FloatArray | None:
    """A factor for each pixel (H, W), or None for an even light."""
    light: FloatArray | None = None
    if rng.random() < config.illumination:
        rows, columns = rng.integers(2, 6, 2)
        field = rng.standard_normal((int(rows), int(columns)), np.float32) * np.float32(config.illumination_strength)
        light = np.exp(cv2.resize(field, (width, height), interpolation=cv2.INTER_CUBIC))
    if rng.random() < config.shadow:
        # Drawn small and enlarged: soft edges, and cheap.
        small = np.ones((height // 4, width // 4), np.float32)
        for _ in range(int(rng.integers(1, 4))):
            centre = rng.random(2) * [width / 4, height / 4]
            corners = centre + rng.standard_normal((int(rng.integers(3, 7)), 2)) * [width / 16, height / 16]
            darker = float(rng.uniform(0.3, 0.8))
            cv2.fillConvexPoly(small, cv2.convexHull(corners.astype(np.int32)), darker)
        small = cv2.GaussianBlur(small, (0, 0), float(rng.uniform(0.3, 3.0)))
        shadow = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
        light = shadow if light is None else light * shadow
    return light


def _clutter(
    camera: CameraModel, radar: FloatArray, config: RadarAugmentationConfig, rng: np.random.Generator
) -> FloatArray:
    """Invented returns: anywhere in the image, near ones as often as far ones, with values like the true ones'."""
    count = int(rng.integers(1, max(3, round(config.clutter_share * len(radar))) + 1))
    invented = np.full((count, RADAR_COLUMNS), np.nan, np.float32)
    invented[:, _U] = rng.uniform(0, camera.width - 1, count)
    invented[:, _V] = rng.uniform(0, camera.height - 1, count)
    invented[:, _DEPTH] = rng.uniform(2.0, 90.0, count)
    if len(radar):
        invented[:, _RCS:] = radar[rng.integers(0, len(radar), count), _RCS:]
    return invented


def _offset(length: int, wanted: int, rng: np.random.Generator) -> int:
    """Where a window begins; at 0 when it does not fit."""
    position = rng.random()
    return int(position * (max(length - wanted, 0) + 1))


def _window(
    values: npt.NDArray[ValueT], top: int, left: int, height: int, width: int, fill: float
) -> npt.NDArray[ValueT]:
    part = values[top : top + height, left : left + width]
    if part.shape[:2] == (height, width):
        return part
    result = np.full((height, width, *values.shape[2:]), fill, values.dtype)
    result[: part.shape[0], : part.shape[1]] = part
    return result
