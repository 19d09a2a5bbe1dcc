"""Augments samples: crop, flip, light, appearance, missing or invented radar returns, errors of the road prior.

What is seen (`views`) and what is true of it change together: image, depth, returns and ground stay
consistent. What is only perceived (`appearance.restyle`, `photometric.perceive`, `appearance.develop`, `perturb_radar`,
`perturb_ground`) changes alone. All take their randomness from the generator that is passed in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray, GroundPlane
from radcam_depth_ros.training.data.appearance import AppearanceConfig, develop, restyle
from radcam_depth_ros.training.data.copy_paste import Pasting, Thing, pasted, spots_of
from radcam_depth_ros.training.data.photometric import PhotometricConfig, perceive
from radcam_depth_ros.training.data.samples import RADAR_VALUES, TrainingSample
from radcam_depth_ros.training.data.views import View
from radcam_depth_ros.training.errors import TrainingError

_U, _V, _DEPTH, _RCS, _SPEED, _AGE = range(RADAR_VALUES)


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
        elevation_noise: Probability of a radar that hardly knows how high a return is: up to `elevation_noise_deg`.
        elevation_noise_deg: Largest standard deviation of the elevation.
        depth_noise_m: Standard deviation of depth in metres.
        rcs_unknown: Probability of a radar that gives no RCS.
        speed_unknown: Probability of a radar that gives no speed.
        age_unknown: Probability of unknown ages.
        min_points: See `max_points`.
        max_points: Returns are thinned, at random, to a number drawn between these two, each order of magnitude as
            often: imaging radars give thousands, of which an iteration has no time for all.
    """

    none: float
    one_radar: float
    thinned: float
    thinned_share: float
    clutter: float
    clutter_share: float
    pixel_noise: float
    elevation_noise: float
    elevation_noise_deg: float
    depth_noise_m: float
    rcs_unknown: float
    speed_unknown: float
    age_unknown: float
    min_points: int
    max_points: int

    def __post_init__(self) -> None:
        if not 1 <= self.min_points <= self.max_points:
            raise TrainingError(
                f"returns need 1 <= min_points <= max_points, got {self.min_points} and {self.max_points}"
            )


@dataclass(frozen=True)
class GroundAugmentationConfig:
    """How far the road prior that the network is told is off.

    Attributes:
        unknown: Probability of no prior.
        height_share: Largest relative error of the camera's height.
        pitch_deg: Largest error of pitch.
        roll_deg: Largest error of roll.
    """

    unknown: float
    height_share: float
    pitch_deg: float
    roll_deg: float


@dataclass(frozen=True)
class AugmentationConfig:
    """All of it.

    Attributes:
        mirror: Probability of a left-right flip.
        focal_jitter: Largest change of the logarithm of the focal length: the image is scaled, depths are not.
        unreadable: Probability of a picture that tells little or nothing, see `unreadable`.
        foreign: Probability of another sample's picture.
        copy_paste: Probability that things of another sample are put onto the ground, see `copy_paste`.
        copy_paste_things: Greatest number of them.
        photometric: Light and colour.
        appearance: Surfaces, air and the camera's processing.
        radar: Returns.
        ground: Road prior.
    """

    mirror: float
    focal_jitter: float
    unreadable: float
    foreign: float
    copy_paste: float
    copy_paste_things: int
    photometric: PhotometricConfig
    appearance: AppearanceConfig
    radar: RadarAugmentationConfig
    ground: GroundAugmentationConfig

    def __post_init__(self) -> None:
        if not 0 <= self.mirror <= 1 or not 0 <= self.focal_jitter <= 0.5:
            raise TrainingError(
                f"mirror must be 0 to 1 and focal_jitter 0 to 0.5, got {self.mirror} and {self.focal_jitter}"
            )
        if min(self.unreadable, self.foreign) < 0 or self.unreadable + self.foreign > 1:
            raise TrainingError(
                "unreadable and foreign must be at least 0 and at most 1 together, got "
                f"{self.unreadable} and {self.foreign}"
            )
        if not 0 <= self.copy_paste <= 1 or self.copy_paste_things < 1:
            raise TrainingError(
                "copy_paste must be 0 to 1 and copy_paste_things at least 1, got "
                f"{self.copy_paste} and {self.copy_paste_things}"
            )


def augment(
    sample: TrainingSample,
    size: tuple[int, int],
    config: AugmentationConfig,
    rng: np.random.Generator,
    pasting: Pasting | None = None,
    things: Sequence[Thing] = (),
) -> tuple[TrainingSample, FloatArray]:
    """One random version of a sample.

    Args:
        sample: As cached.
        size: (height, width) of the crop.
        config: Probabilities and strengths.
        rng: Where all randomness comes from, but that of `pasting`.
        pasting: How things are put onto its ground; none are without.
        things: Of other samples.

    Returns:
        The sample, and its image after photometric changes, (H, W, 3) float32, 0 to 1.
    """
    # Of their own generator: switching these effects on or off changes nothing else of a sample.
    look = rng.spawn(1)[0]
    view = View.drawn(sample.camera, size, config.focal_jitter, config.mirror, rng, look)
    seen = view.of(sample)
    if pasting is not None:
        patches, returns = pasting.planned(things, spots_of(sample), view, sample.camera.fx)
        seen = pasting.with_returns(pasted(seen, patches), returns)
    result = told(seen, config, rng)
    image = restyle(result.image, result.depth_m, result.classes, config.appearance, look)
    return result, develop(perceive(image, config.photometric, rng), config.appearance, look)


def told(sample: TrainingSample, config: AugmentationConfig, rng: np.random.Generator) -> TrainingSample:
    """The same with the returns and the road that a network is told."""
    radar, source = perturb_radar(sample, config.radar, rng)
    return replace(sample, radar=radar, radar_source=source, ground=perturb_ground(sample.ground, config.ground, rng))


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
    noise = np.array([config.pixel_noise, config.pixel_noise, config.depth_noise_m, 0, 0, 0], np.float32)
    radar = radar + rng.standard_normal(radar.shape, np.float32) * noise
    if rng.random() < config.elevation_noise:
        deviation_px = sample.camera.fy * np.tan(np.deg2rad(rng.uniform(0, config.elevation_noise_deg)))
        radar[:, _V] += deviation_px * rng.standard_normal(len(radar), np.float32)
    if rng.random() < config.clutter:
        invented = _clutter(sample.camera, radar, config, rng)
        radar = np.concatenate([radar, invented])
        source = np.concatenate([source, rng.choice(radars, len(invented)) if len(radars) else np.zeros(len(invented))])
    limit = int(np.exp(rng.uniform(np.log(config.min_points), np.log(config.max_points + 1))))
    # In random order, also where none is left out: association is trained on the first of them.
    drawn = rng.choice(len(radar), min(limit, len(radar)), replace=False)
    radar, source = radar[drawn], source[drawn]
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
    return replace(
        ground, height_m=ground.height_m * (1 + height * config.height_share), up=(float(x), float(y), float(z))
    )


def _clutter(
    camera: CameraModel, radar: FloatArray, config: RadarAugmentationConfig, rng: np.random.Generator
) -> FloatArray:
    """Invented returns: anywhere in the image, near ones as often as far ones, with values like the true ones'."""
    count = int(rng.integers(1, max(3, round(config.clutter_share * len(radar))) + 1))
    invented = np.full((count, RADAR_VALUES), np.nan, np.float32)
    invented[:, _U] = rng.uniform(0, camera.width - 1, count)
    invented[:, _V] = rng.uniform(0, camera.height - 1, count)
    invented[:, _DEPTH] = rng.uniform(2.0, 90.0, count)
    if len(radar):
        invented[:, _RCS:] = radar[rng.integers(0, len(radar), count), _RCS:]
    return invented
