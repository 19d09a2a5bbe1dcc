"""Writes a contact sheet of simulated drives.

Run it from the repository's root: `.venv/bin/python scripts/simulation_sheet.py docs/images/simulation.jpg`. Each tile
is the first image of a seed beside its exact depth, red near and blue far. `--set world.street=tunnel` changes the
configuration, `--seeds 1-20` the seeds.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from radcam_depth_ros import configuration, messages
from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.files import whole
from radcam_depth_ros.frame import FloatArray, ImageArray
from radcam_depth_ros.simulation import SimulationConfig, simulate

_NEAREST_M, _FARTHEST_M = 2.0, 120.0
# The default camera at half its size: as large as a tile needs.
_CAMERA = {"width": 400, "height": 224, "min_focal_length_px": 315.0, "max_focal_length_px": 315.0}
_NOT_SEEN = ("radar", "imaging_radar", "lidar", "odometry")


def picture_and_depth(config: SimulationConfig, seed: int) -> tuple[ImageArray, FloatArray]:
    """The first image (H, W, 3) of a seed, RGB, and its depth (H, W) in metres."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "drive.mcap"
        simulate(config, seed, 1, bag)
        with BagReader(bag) as reader:
            found = {message.topic: message.message for message in reader.messages()}
    image = messages.decode_image(found["/camera/image_raw/compressed"]).image
    return image, messages.decode_depth(found["/ground_truth/depth"]).depth_m


def tile(config: SimulationConfig, seed: int, width: int) -> ImageArray:
    """Picture and depth of a seed side by side, `width` pixels in all, the seed's number in a corner."""
    image, depth = picture_and_depth(config, seed)
    size = (width // 2, round(width / 2 * image.shape[0] / image.shape[1]))
    halves = [
        cv2.resize(part, size, interpolation=cv2.INTER_AREA)
        for part in (image, messages.colorise(depth, _NEAREST_M, _FARTHEST_M))
    ]
    both = np.ascontiguousarray(np.hstack(halves))
    cv2.putText(both, str(seed), (4, size[1] - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(both, str(seed), (4, size[1] - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1, cv2.LINE_AA)
    return np.asarray(both, np.uint8)


def main() -> None:
    """Writes the sheet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="file to write, .jpg")
    parser.add_argument("--seeds", default="1000000-1000039", help="first and last seed")
    parser.add_argument("--columns", type=int, default=4, help="tiles in a row")
    parser.add_argument("--width", type=int, default=420, help="of a tile, pixels")
    parser.add_argument("--quality", type=int, default=80, help="of the JPEG")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="e.g. world.street=tunnel")
    options = parser.parse_args()
    settings: dict[str, dict[str, Any]] = {name: {"enabled": False} for name in _NOT_SEEN}
    settings["camera"] = dict(_CAMERA)
    for setting in options.set:
        key, _, value = setting.partition("=")
        section, _, name = key.partition(".")
        settings.setdefault(section, {})[name] = yaml.safe_load(value)
    config = configuration.build(SimulationConfig, settings, "--set")
    first, _, last = options.seeds.partition("-")
    tiles = [tile(config, seed, options.width) for seed in range(int(first), int(last or first) + 1)]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % options.columns)
    rows = [np.hstack(tiles[start : start + options.columns]) for start in range(0, len(tiles), options.columns)]
    _, encoded = cv2.imencode(".jpg", np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, options.quality])
    with whole(options.out) as temporary:
        temporary.write_bytes(encoded.tobytes())


if __name__ == "__main__":
    main()
