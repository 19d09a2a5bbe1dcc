"""Replaces pictures by ones that tell little or nothing: black, even, noisy, blurred, very dark, washed out."""

from __future__ import annotations

import cv2
import numpy as np

from radcam_depth_ros.frame import FloatArray

FAINT = ("blurred", "dark", "gloomy", "washed_out")
"""Kinds that may still tell something of the road."""

KINDS = ("black", "even", "noise", "upside_down", *FAINT)


def unreadable(image: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, bool]:
    """A picture that tells little of what is in front of the camera, and whether it may tell anything.

    Args:
        image: (H, W, 3) float32, 0 to 1.
        rng: Where all randomness comes from.

    Returns:
        (H, W, 3) float32, 0 to 1; and False where nothing of the road can be seen.
    """
    kind = KINDS[int(rng.integers(len(KINDS)))]
    noise = rng.standard_normal(image.shape, np.float32)
    if kind == "black":
        result = np.zeros_like(image)
    elif kind == "even":
        result = np.full_like(image, rng.random())
    elif kind == "noise":
        result = 0.5 + np.float32(rng.uniform(0.05, 0.5)) * noise
    elif kind == "blurred":
        result = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(4.0, 20.0)))
    elif kind == "dark":
        result = image * np.float32(rng.uniform(0.01, 0.15)) + np.float32(rng.uniform(0.0, 0.02)) * noise
    elif kind == "gloomy":
        result = np.clip(image, 1e-4, 1.0) ** np.float32(rng.uniform(2.5, 6.0)) + 0.02 * noise
    elif kind == "washed_out":
        result = 1.0 - (1.0 - image) * np.float32(rng.uniform(0.05, 0.4))
    else:
        result = image[::-1]
    clipped: FloatArray = np.clip(result, 0.0, 1.0).astype(np.float32)
    return clipped, kind in FAINT
