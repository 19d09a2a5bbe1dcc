"""Paints what plants and roads look like from close by: leaves, chippings, cracks, patches, seams and stains."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray

WEAR_M = 40.0
"""Metres that a map of wear covers before it repeats."""
_MAP = 1024


def leaves(rng: np.random.Generator, size: int, count: int, length_px: float) -> FloatArray:
    """Leaves over the dark between them: (size, size, 3) float32 that tiles, of mean 0.6."""
    tile = np.full((size, size, 3), rng.uniform(0.06, 0.2), np.float32)
    # Later leaves lie above earlier ones and get more light.
    tone = np.linspace(0.25, 1.0, count) * rng.uniform(0.7, 1.3, count)
    place = rng.integers(0, size, (count, 2))
    long = np.maximum(length_px * rng.uniform(0.6, 1.4, count), 1.5)
    turn, warm = rng.uniform(0, 360, count), rng.normal(0, 0.12, count)
    for index in range(count):
        colour = (tone[index] * (1 + warm[index]), tone[index], tone[index] * (1 - warm[index]))
        x, y = (int(value) for value in place[index])
        axes = (int(long[index]), max(1, int(long[index] * 0.45)))
        for dx in _wraps(x, axes[0], size):
            for dy in _wraps(y, axes[0], size):
                cv2.ellipse(tile, (x + dx, y + dy), axes, turn[index], 0, 360, colour, -1)
    return np.asarray(tile * np.float32(0.6 / max(float(tile.mean()), 1e-3)), np.float32)


def _wraps(place: int, reach: int, size: int) -> tuple[int, ...]:
    """Shifts at which something at a place is drawn so that the tile's edges fit."""
    if place < reach:
        return 0, size
    return (0, -size) if place >= size - reach else (0,)


def chippings(rng: np.random.Generator, size: int) -> FloatArray:
    """Stones of several sizes in bitumen: (size, size) float32 of mean 1 that tiles."""
    total = np.zeros((size, size), np.float32)
    for step, weight in ((1, 0.5), (2, 0.6), (4, 0.3)):
        stones = rng.standard_normal((size // step, size // step), dtype=np.float32)
        total += np.float32(weight) * np.repeat(np.repeat(stones, step, axis=0), step, axis=1)
    return np.asarray(1 + rng.uniform(0.08, 0.28) * total, np.float32)


def road_wear(rng: np.random.Generator) -> FloatArray:
    """What years do to a road, as factors of its albedo: (N, N) float32 over `WEAR_M` squared that tiles."""
    size, shade = _MAP, np.ones((_MAP, _MAP), np.float32)
    per_metre = size / WEAR_M
    for x, y, length, width in rng.random((int(rng.integers(0, 9)), 4)):
        # Patches of another age, with a dark seam around.
        corner = np.array([x, y]) * size
        side = np.array([0.6 + 6 * length, 0.4 + 2 * width]) * per_metre
        low, high = (tuple(int(v) for v in place) for place in (corner, np.minimum(corner + side, size - 1)))
        cv2.rectangle(shade, low, high, rng.uniform(0.6, 1.3), -1)
        cv2.rectangle(shade, low, high, rng.uniform(0.35, 0.8), 1)
    for _ in range(int(rng.integers(0, 26))):
        _crack(rng, shade, rng.uniform(0.25, 0.75))
    for x, y, reach in rng.random((int(rng.integers(0, 40)), 3)):
        axes = (int((0.05 + 0.5 * reach**3) * per_metre) + 1, int((0.05 + 0.4 * reach**3) * per_metre) + 1)
        cv2.ellipse(shade, (int(x * size), int(y * size)), axes, 0, 0, 360, rng.uniform(0.55, 0.95), -1)
    return np.asarray(cv2.GaussianBlur(shade, (0, 0), 0.6, borderType=cv2.BORDER_REFLECT), np.float32)


def _crack(rng: np.random.Generator, shade: npt.NDArray[np.floating], tone: float) -> None:
    """A crack that wanders on, mostly along or across the road."""
    steps = int(rng.integers(20, 160))
    heading = rng.choice([0.0, np.pi / 2]) + np.cumsum(rng.normal(0, 0.25, steps)) * 0.6
    walk = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]) * 4 + rng.normal(0, 1.2, (steps, 2)), axis=0)
    line = (walk + rng.uniform(0, _MAP, 2)).astype(np.int32).reshape(-1, 1, 2)
    for shift in (-_MAP, 0):
        cv2.polylines(shade, [line + shift], False, tone, int(rng.integers(1, 3)))
