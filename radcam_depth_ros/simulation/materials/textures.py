"""The texture atlas: procedural tiles in all sizes, and the lookup of their colours."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.simulation.materials.tiles import TILE, paint_tiles, random_tiles

_BORDER = 2
_LEVELS = 8


class TextureAtlas:
    """All tiles of a world at all sizes in one image.

    Colours are relative to the material's colour. The fourth channel says how much of the surface's gloss there is, so
    that the windows of a facade shine and its wall does not.
    """

    def __init__(
        self, rng: np.random.Generator, is_random: bool = False, lettering: bool = False, wear: bool = False
    ) -> None:
        """Paints the tiles.

        Args:
            rng: Random generator.
            is_random: With patterns that have nothing to do with what they are on.
            lettering: With letters and pictures on vehicles, shops and boards.
            wear: With leaves and chippings in fine detail.
        """
        tiles = random_tiles(rng) if is_random else paint_tiles(rng, lettering, wear)
        self._columns = 6
        rows = -(-len(tiles) // self._columns)
        pitches = [(TILE >> level) + 2 * _BORDER for level in range(_LEVELS)]
        self._left = np.cumsum([0, *(pitch * self._columns for pitch in pitches)])[:-1].astype(np.float32)
        self._atlas = np.zeros((pitches[0] * rows, sum(pitches) * self._columns, 4), np.uint8)
        for index, tile in enumerate(tiles):
            shrunk = tile
            for level, pitch in enumerate(pitches):
                if level > 0:
                    shrunk = cv2.resize(shrunk, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
                # Square roots spend the eight bits where the eye (and a dark road) needs them.
                padded = np.pad(np.sqrt(shrunk), ((_BORDER, _BORDER), (_BORDER, _BORDER), (0, 0)), mode="wrap")
                row, column = divmod(index, self._columns)
                x, y = int(self._left[level]) + column * pitch, row * pitch
                self._atlas[y : y + pitch, x : x + pitch] = np.clip(padded * 255 + 0.5, 0, 255)

    def sample(
        self, texture: npt.NDArray[np.uint8], uv: FloatArray, tiles_per_pixel: npt.NDArray[np.floating]
    ) -> tuple[FloatArray, FloatArray]:
        """Looks colours up, in the size of tile that fits the pixel.

        Args:
            texture: (N,) uint8, values of `Texture`.
            uv: (N, 2) float32, in tiles.
            tiles_per_pixel: (N,) float32, how much of a tile one pixel covers.

        Returns:
            Colour (N, 3) float32 and gloss (N,) float32, both relative.
        """
        level = np.log2(np.maximum(tiles_per_pixel * TILE, 1e-6))
        level = np.clip(level + 0.25, 0, _LEVELS - 1).astype(np.int32)
        size = (TILE >> level).astype(np.float32)
        pitch = size + 2 * _BORDER
        row, column = np.divmod(texture, np.uint8(self._columns))
        x = self._left[level] + column * pitch + _BORDER - 0.5 + (uv[:, 0] - np.floor(uv[:, 0])) * size
        y = row * pitch + _BORDER - 0.5 + (uv[:, 1] - np.floor(uv[:, 1])) * size
        count, width = len(x), 1024
        rows = max(1, -(-count // width))
        maps = np.zeros((2, rows * width), np.float32)
        maps[0, :count], maps[1, :count] = x, y
        columns, lines = maps.reshape(2, rows, width)
        found = cv2.remap(self._atlas, columns, lines, cv2.INTER_LINEAR).reshape(-1, 4)[:count]
        linear = np.square(found.astype(np.float32) * np.float32(1 / 255))
        return linear[:, :3], linear[:, 3]
