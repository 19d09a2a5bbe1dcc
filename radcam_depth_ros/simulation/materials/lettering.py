"""Paints what is written and pictured on vehicles, shops and boards."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray

_LETTERS = "ABCDEFGHIKLMNOPRSTUVWZ"
_VOWELS = "AEIOU"
_FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX,
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_COMPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
    cv2.FONT_HERSHEY_SCRIPT_COMPLEX,
)
# Linear RGB that prints are made of, white and dark ones more often than bright ones.
_INKS = (
    *((0.85, 0.85, 0.83), (0.85, 0.85, 0.83), (0.02, 0.02, 0.025), (0.02, 0.05, 0.22), (0.5, 0.02, 0.02)),
    *((0.02, 0.18, 0.06), (0.75, 0.45, 0.02), (0.1, 0.3, 0.6), (0.35, 0.36, 0.37)),
)


def livery(rng: np.random.Generator, size: int) -> FloatArray:
    """A vehicle's flank, twice as long as it is high: (size, size, 3) float32, linear RGB."""
    wide = _ground(rng, 2 * size, size)
    if rng.random() < 0.6:
        _band(rng, wide)
    if rng.random() < 0.6:
        _picture(rng, wide, int(rng.integers(2, 6)))
    for _ in range(int(rng.integers(1, 4))):
        write(rng, wide, size * float(rng.uniform(0.05, 0.24)))
    return np.asarray(cv2.resize(wide, (size, size), interpolation=cv2.INTER_AREA), np.float32)


def poster(rng: np.random.Generator, size: int) -> FloatArray:
    """A printed board: (size, size, 3) float32, linear RGB; its first row is the lowest, as `quads` maps textures."""
    board = _ground(rng, size, size)
    _picture(rng, board, int(rng.integers(4, 12)))
    for _ in range(int(rng.integers(1, 5))):
        write(rng, board, size * float(rng.uniform(0.05, 0.2)))
    return np.ascontiguousarray(board[::-1])


def write(rng: np.random.Generator, picture: FloatArray, height_px: float) -> None:
    """Writes a word of letters `height_px` high somewhere into a picture (H, W, 3), in place, in an ink that shows."""
    count = int(rng.integers(3, 11))
    drawn = [
        (_LETTERS, _VOWELS)[place % 2][int(rng.integers(5 if place % 2 else len(_LETTERS)))] for place in range(count)
    ]
    font, thick = _FONTS[int(rng.integers(len(_FONTS)))], int(rng.integers(1, 5))
    scale = height_px / 22
    word = "".join(drawn)
    (width, tall), _ = cv2.getTextSize(word, font, scale, thick)
    x = int(rng.uniform(0, max(1, picture.shape[1] - width)))
    y = int(rng.uniform(tall, max(tall + 1, picture.shape[0] - 4)))
    around = picture[max(0, y - tall) : y + 1, x : x + width].mean() if width > 0 else 0.5
    ink = _ink(rng)
    if abs(float(np.mean(ink)) - float(around)) < 0.2:
        ink = (0.03, 0.03, 0.03) if around > 0.35 else (0.85, 0.85, 0.83)
    # OpenCV writes into bytes only.
    cover = np.zeros(picture.shape[:2], np.uint8)
    cv2.putText(cover, word, (x, y), font, scale, 255, thick, cv2.LINE_AA)
    share = cover[..., None] * np.float32(1 / 255)
    picture += share * (np.array(ink, np.float32) - picture)


def _ink(rng: np.random.Generator) -> tuple[float, float, float]:
    red, green, blue = np.clip(np.array(_INKS[int(rng.integers(len(_INKS)))]) * rng.uniform(0.7, 1.15), 0, 1)
    return float(red), float(green), float(blue)


def _ground(rng: np.random.Generator, width: int, height: int) -> FloatArray:
    """One colour, often white, or one that fades into another."""
    first = np.array((0.8, 0.8, 0.78) if rng.random() < 0.5 else _ink(rng))
    second = np.array(_ink(rng)) if rng.random() < 0.25 else first
    share = np.linspace(0, 1, width)[None, :, None]
    return np.asarray(np.broadcast_to(first * (1 - share) + second * share, (height, width, 3)), np.float32).copy()


def _band(rng: np.random.Generator, picture: npt.NDArray[np.floating]) -> None:
    """A straight or slanting stripe in the lower half."""
    height, width = picture.shape[:2]
    low, thick, slant = rng.uniform(0.45, 0.9) * height, rng.uniform(0.04, 0.2) * height, rng.normal(0, 0.12) * height
    corners = np.array([(0, low), (width, low + slant), (width, low + slant + thick), (0, low + thick)], np.int32)
    cv2.fillPoly(picture, [corners], _ink(rng))


def _picture(rng: np.random.Generator, picture: npt.NDArray[np.floating], count: int) -> None:
    """Round, angular and cornered shapes over one another."""
    height, width = picture.shape[:2]
    for kind, x, y, size in rng.random((count, 4)):
        centre, reach = np.array([x * width, y * height]), (0.05 + 0.3 * size**2) * height
        if kind < 0.4:
            axes = (int(reach) + 1, int(reach * rng.uniform(0.4, 1)) + 1)
            cv2.ellipse(picture, (int(centre[0]), int(centre[1])), axes, 360 * kind, 0, 360, _ink(rng), -1, cv2.LINE_AA)
        else:
            angle = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 8))))
            corners = centre + reach * np.column_stack([np.cos(angle), np.sin(angle)])
            cv2.fillPoly(picture, [corners.astype(np.int32)], _ink(rng), cv2.LINE_AA)
