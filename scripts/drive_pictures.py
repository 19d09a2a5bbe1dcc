"""Draws the pictures of a drive for the docs: a strip of three frames, and a video of all of them.

Run it from the repository's root: `.venv/bin/python scripts/drive_pictures.py docs/images`. It writes `strip.jpg` and
`drive.mp4` there. The drive is simulated, from a seed that no network trained on; the depth is the default network's.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np

from radcam_depth_ros.estimator import Estimator
from radcam_depth_ros.files import whole
from radcam_depth_ros.frame import SKY_FROM, DepthResult, Frame
from radcam_depth_ros.simulation import SimulationConfig, simulate
from radcam_depth_ros.viewing import ViewOptions, view

_QUALITY = 85


def main() -> None:
    """Writes the strip and the video."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder to write to")
    parser.add_argument("--seed", type=int, default=1000007, help="seed of the simulated drive")
    parser.add_argument("--frames", type=int, default=6, help="frames to simulate, 10 a second")
    parser.add_argument("--bag", type=Path, help="such a drive, if it is there already")
    options = parser.parse_args()
    estimator, depths = Estimator(), dict[int, DepthResult]()

    def estimate(frame: Frame) -> DepthResult:
        if frame.stamp_ns not in depths:
            result = depths[frame.stamp_ns] = estimator.estimate(frame)
            if result.sky is not None:  # as it is published with `sky: none`
                result.dense[result.sky >= SKY_FROM] = np.nan
        return depths[frame.stamp_ns]

    with tempfile.TemporaryDirectory() as folder:
        bag, strip = options.bag or Path(folder) / "drive.mcap", Path(folder) / "strip.png"
        if options.bag is None:
            simulate(SimulationConfig(), options.seed, options.frames, bag)
        view(bag, options.out / "drive.mp4", estimate, options=ViewOptions(width=960))
        view(bag, strip, estimate, options=ViewOptions(frames=3, width=1440))
        picture = cv2.imread(str(strip))
    if picture is None:
        raise SystemExit("the strip cannot be read again")
    with whole(options.out / "strip.jpg") as out:
        cv2.imwrite(str(out), picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])


if __name__ == "__main__":
    main()
