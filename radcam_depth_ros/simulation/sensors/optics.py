"""Optics between scene and sensor: glare, drops and dirt, blur, colour fringes, motion blur."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.settings.randomness import log_uniform, pick

_COARSE = 8
_SMEAR_STEPS = 5


class Optics:
    """The windscreen and lens of one camera, drawn once."""

    def __init__(self, rng: np.random.Generator, width: int, height: int, rain: float, dirty: bool = False) -> None:
        """Draws glass for images of a size.

        Args:
            rng: Random generator.
            width: Pixels.
            height: Pixels.
            rain: How much rain falls, 0 to 1.
            dirty: Whether dirt sticks to it.
        """
        self._rain = rain
        self._veil = rng.uniform(0, 0.03) if rng.random() < 0.8 else rng.uniform(0.03, 0.12)
        self._glare = log_uniform(rng, 0.01, 0.15)
        self._blur = pick(rng, (0.0, rng.uniform(0.3, 0.6), rng.uniform(0.6, 1.2)), (0.35, 0.47, 0.18))
        self._fringe = rng.normal(0, 0.0012) if rng.random() < 0.3 else 0.0
        fall = rng.uniform(0, 0.45)
        x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height) * height / width)
        self._vignette = (1 - fall * (x * x + y * y) / (1 + (height / width) ** 2)).astype(np.float32)[..., None]
        self._drops = _spots(rng, width, height, int(rng.integers(4, 60)), 0.012) if rng.random() < 0.6 * rain else None
        self._dirt = _spots(rng, width, height, int(rng.integers(3, 30)), 0.05) if dirty else None
        # Dirt takes light away and scatters what falls on it: mud is dark, dust in the sun is bright.
        self._opaque, self._dust = rng.uniform(0.15, 0.7), log_uniform(rng, 0.15, 1.3)

    def through(self, light: FloatArray, rng: np.random.Generator) -> FloatArray:
        """The light (H, W, 3) that reaches the sensor of light (H, W, 3) where 1 is as bright as can be told."""
        height, width = light.shape[:2]
        coarse = (-(-width // _COARSE), -(-height // _COARSE))
        small = cv2.resize(np.minimum(light, 60), coarse, interpolation=cv2.INTER_AREA)
        light = light * self._vignette
        light += self._glared(small, width, height)
        if self._rain > 0:
            light = self._rained(light, small, rng)
        if self._dirt is not None:
            scattered = small.mean(axis=(0, 1)) * np.float32(self._dust)
            light = light + self._dirt * np.float32(self._opaque) * (scattered - light)
        if self._blur > 0:
            light = cv2.GaussianBlur(np.minimum(light, 8), (0, 0), self._blur)
        if self._fringe:
            for channel, sign in ((0, 1.0), (2, -1.0)):
                scale = 1 + sign * self._fringe
                shrunk = np.array([[scale, 0, (1 - scale) * width / 2], [0, scale, (1 - scale) * height / 2]])
                plane = np.ascontiguousarray(light[..., channel])
                light[..., channel] = cv2.warpAffine(plane, shrunk, (width, height), borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(light, np.float32)

    def _glared(self, small: FloatArray, width: int, height: int) -> FloatArray:
        """Light that is scattered in the glass: around what is too bright, and a little everywhere."""
        excess = np.maximum(small - 1, 0)
        halo = 0.7 * cv2.GaussianBlur(excess, (0, 0), 1.2) + 0.3 * cv2.GaussianBlur(excess, (0, 0), 8.0)
        veil = self._veil * np.minimum(small, 4).mean(axis=(0, 1), dtype=np.float64)
        wide = cv2.resize(halo * np.float32(self._glare), (width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(wide + veil.astype(np.float32), np.float32)

    def _rained(self, light: FloatArray, small: FloatArray, rng: np.random.Generator) -> FloatArray:
        height, width = light.shape[:2]
        streaks = np.zeros((height, width), np.uint8)
        slant = rng.normal(0, 0.15)
        count = int(self._rain * 350 * width * height / 360_000)
        for x, y, length, alpha in rng.random((count, 4)) * [width, height, 0.06 * height, 90]:
            end = (int(x + slant * length), int(y + length))
            cv2.line(streaks, (int(x), int(y)), end, int(alpha) + 10, 1, cv2.LINE_AA)
        share = cv2.blur(streaks, (2, 2)).astype(np.float32)[..., None] * np.float32(1 / 255)
        light = light + share * (small.mean(axis=(0, 1)) * np.float32(1.3) - light) * np.float32(0.6)
        if self._drops is not None:
            # A drop is a small lens: it shows the scene upside down and out of focus.
            turned = cv2.resize(cv2.blur(small[::-1], (5, 5)), (width, height), interpolation=cv2.INTER_LINEAR)
            light = light + self._drops * (turned - light)
        return light


def _spots(rng: np.random.Generator, width: int, height: int, count: int, size: float) -> FloatArray:
    """(H, W, 1) how much of the view soft spots at random places take; `size` is a share of the width."""
    mask = np.zeros((height, width), np.float32)
    for x, y, scale in rng.random((count, 3)):
        radius = max(1, round(size * width * (0.2 + scale**3)))
        axes = (radius, max(1, round(radius * rng.uniform(0.7, 1.5))))
        cv2.ellipse(mask, (int(x * width), int(y * height)), axes, 0, 0, 360, rng.uniform(0.4, 0.95), -1)
    return np.asarray(cv2.GaussianBlur(mask, (0, 0), max(0.8, size * width * 0.15))[..., None], np.float32)


def motion_field(
    camera: CameraModel,
    world_from_camera: RigidTransform,
    depth_m: FloatArray,
    velocity: FloatArray,
    own_velocity: npt.NDArray[np.float64],
    own_turn: npt.NDArray[np.float64],
    step: int = 1,
) -> FloatArray:
    """(H / step, W / step, 2) float32, how fast things move through the picture, pixels a second.

    Args:
        camera: Intrinsics.
        world_from_camera: The camera's pose.
        depth_m: (H, W) along z.
        velocity: (H, W, 3) of what is seen, m/s in world axes.
        own_velocity: (3,) of the camera, m/s in world axes.
        own_turn: (3,) of the camera, rad/s in world axes.
        step: Of so many rows and columns one each is looked at.
    """
    height, width = depth_m.shape
    depth_m, velocity = depth_m[::step, ::step], velocity[::step, ::step]
    x = ((np.arange(0, width, step, dtype=np.float32) - np.float32(camera.cx)) / np.float32(camera.fx))[None]
    y = ((np.arange(0, height, step, dtype=np.float32) - np.float32(camera.cy)) / np.float32(camera.fy))[:, None]
    into_camera = world_from_camera.rotation.astype(np.float32)
    vx, vy, vz = np.moveaxis((velocity - own_velocity.astype(np.float32)) @ into_camera, -1, 0)
    wx, wy, wz = own_turn.astype(np.float32) @ into_camera
    nearness = 1 / depth_m
    across = (vx - x * vz) * nearness + x * y * wx - (1 + x * x) * wy + y * wz
    down = (vy - y * vz) * nearness + (1 + y * y) * wx - x * y * wy - x * wz
    return np.stack([across * np.float32(camera.fx), down * np.float32(camera.fy)], axis=-1)


def smeared(light: FloatArray, shift_px: FloatArray) -> FloatArray:
    """Light (H, W, 3) that moves by (H, W, 2) pixels while the shutter is open; the shift may be coarser."""
    if np.percentile(np.abs(shift_px), 95) < 0.7:
        return light
    height, width = light.shape[:2]
    shift_px = cv2.resize(shift_px, (width, height), interpolation=cv2.INTER_LINEAR)
    column, row = np.arange(width, dtype=np.float32)[None], np.arange(height, dtype=np.float32)[:, None]
    total = np.zeros_like(light)
    for step in np.linspace(-0.5, 0.5, _SMEAR_STEPS, dtype=np.float32):
        x, y = column + step * shift_px[..., 0], row + step * shift_px[..., 1]
        total += cv2.remap(light, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(total / np.float32(_SMEAR_STEPS), np.float32)
