"""Draws the README's opening picture: camera with radar returns, dense depth, and its points from behind.

Run it from the repository's root: `.venv/bin/python scripts/opening_picture.py docs/images/opening.jpg`. The
frame is of a simulated drive whose seed no network trained on; the depth is the default network's.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np

from radcam_depth_ros.drive import Sample, read_samples
from radcam_depth_ros.estimator import Estimator
from radcam_depth_ros.files import whole
from radcam_depth_ros.frame import SKY_FROM, CameraModel, DepthResult, FloatArray, ImageArray
from radcam_depth_ros.geometry import project, unproject
from radcam_depth_ros.reporting.pictures import draw_depth, draw_radar
from radcam_depth_ros.simulation import SimulationConfig, simulate

_WIDTH, _HEIGHT, _CAPTION_PX = 560, 314, 28
_FAR_M, _SURE = 60.0, 0.3
_BACKGROUND = 24


def drawn_frame(seed: int, frames: int, index: int) -> tuple[Sample, DepthResult]:
    """A frame of a simulated drive, and its depth."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "drive.mcap"
        simulate(SimulationConfig(), seed, frames, bag)
        sample = list(read_samples(bag))[index]
    result = Estimator().estimate(sample.frame)
    if result.sky is not None:  # as it is published with `sky: none`
        result.dense[result.sky >= SKY_FROM] = np.nan
    return sample, result


def seen_from_behind(points_m: FloatArray, colours: ImageArray, size: tuple[int, int]) -> ImageArray:
    """Draws points (N, 3), metres in the camera's frame, from 7 m behind and 6 m above, looking down by 14 degrees."""
    width, height = size
    angle = np.deg2rad(14.0)
    turned = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]], np.float32)
    moved = (points_m + np.array([0.0, 6.0, 7.0], np.float32)) @ turned.T
    focal = 0.75 * width
    camera = CameraModel(width, height, focal, focal, width / 2, 0.42 * height)
    order = np.argsort(-moved[:, 2])
    moved, colours = moved[order], colours[order]
    ahead = moved[:, 2] > 0.5
    uv, depth_m = project(moved[ahead], camera)
    canvas = np.full((height, width, 3), _BACKGROUND, np.uint8)
    for (u, v), z, colour in zip(uv.tolist(), depth_m.tolist(), colours[ahead].tolist(), strict=True):
        half = 1 if z > 14.0 else 2
        column, row = round(u), round(v)
        if 0 <= column < width and 0 <= row < height:
            canvas[max(row - half, 0) : row + half, max(column - half, 0) : column + half] = colour
    return canvas


def picture(sample: Sample, result: DepthResult) -> ImageArray:
    """The three panels side by side, RGB."""
    image = cv2.resize(sample.frame.image, (result.camera.width, result.camera.height))
    uv, depth_m = project(sample.frame.radar.xyz_m, result.camera)
    shown = ((result.dense < _FAR_M) & (result.confidence > _SURE))[::2, ::2]
    points = unproject(result.dense, result.camera)[::2, ::2][shown]
    cloud = seen_from_behind(points, image[::2, ::2][shown], (_WIDTH, _HEIGHT))
    panels = {
        "camera and radar returns": draw_radar(image, uv, depth_m),
        "dense depth, without the sky": draw_depth(result.dense),
        f"its points, from behind (confidence over {_SURE})": cloud,
    }
    return np.concatenate([_captioned(title, panel) for title, panel in panels.items()], axis=1)


def _captioned(title: str, panel: ImageArray) -> ImageArray:
    tile = np.full((_CAPTION_PX + _HEIGHT, _WIDTH + 4, 3), _BACKGROUND, np.uint8)
    tile[_CAPTION_PX:, :_WIDTH] = cv2.resize(panel, (_WIDTH, _HEIGHT), interpolation=cv2.INTER_AREA)
    cv2.putText(tile, title, (6, 19), cv2.FONT_HERSHEY_SIMPLEX, 0.52, (225, 225, 225), 1, cv2.LINE_AA)
    return tile


def main() -> None:
    """Writes the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="file to write, .jpg")
    parser.add_argument("--seed", type=int, default=1000007, help="seed of the simulated drive")
    parser.add_argument("--frames", type=int, default=4, help="frames to simulate; the middle one is drawn")
    options = parser.parse_args()
    drawn = picture(*drawn_frame(options.seed, options.frames, options.frames // 2))
    with whole(options.out) as out:
        cv2.imwrite(str(out), cv2.cvtColor(drawn, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    main()
