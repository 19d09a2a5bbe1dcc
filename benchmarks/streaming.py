"""Training data of many drives: how much memory reading it takes, and how fast it comes.

Run it from the repository's root: `python -m benchmarks.streaming --out FOLDER`, with `--json FILE` for the figures. A
drive of random images is written once and linked as often as it takes, so that 20,000 samples of 448 x 800 pixels need
no more room than ten; the folder is removed in the end. Batches are then made as in training, in a process of its own,
whose memory is read from the kernel: in all (VmHWM), and what is its own and no file's (RssAnon).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from benchmarks.memory import memory_mib
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.frame import CameraModel, GroundPlane
from radcam_depth_ros.training.data.batches import BatchMaker, prefetch
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.data.samples import (
    FORMAT_VERSION,
    CachedDrive,
    DriveCard,
    SampleWriter,
    TrainingSample,
)
from radcam_depth_ros.training.recipe import recipe_of

FRAMES_PER_DRIVE = 10
CROP = (320, 256)
BATCH = 4


@dataclass(frozen=True)
class Figures:
    """What was measured.

    Attributes:
        samples: Of the data set.
        read: Samples that batches were made of.
        samples_per_s: Of these.
        cpu_ms: Processor time a sample.
        open_s: Time to open all drives.
        open_files: Files that were open in the end, of the process as a whole.
        peak_mib: Greatest resident memory (VmHWM), with Python, numpy and torch.
        own_mib: Resident memory that is no file's, in the end (RssAnon).
        base_mib: Resident memory before any drive was opened.
    """

    samples: int
    read: int
    samples_per_s: float
    cpu_ms: float
    open_s: float
    open_files: int
    peak_mib: float
    own_mib: float
    base_mib: float


def write_drives(folder: Path, samples: int, camera: CameraModel, returns: int) -> None:
    """Writes one drive, and links to it for all others."""
    rng = np.random.default_rng(0)
    first = folder / "0"
    first.mkdir(parents=True)
    shape = (camera.height, camera.width)
    card = DriveCard(FORMAT_VERSION, "made up", "", "", {}, FRAMES_PER_DRIVE, camera, ("/radar/points",), ())
    with SampleWriter(first) as writer:
        for index in range(FRAMES_PER_DRIVE):
            single = np.where(rng.random(shape) < 0.01, np.float16(20), np.float16(np.nan))
            sample = TrainingSample(
                image=rng.integers(0, 255, (*shape, 3), np.uint8),
                depth_m=rng.uniform(1, 80, shape).astype(np.float16),
                classes=rng.integers(0, 19, shape, np.uint8),
                radar=rng.uniform(1, 50, (returns, 6)).astype(np.float32),
                radar_source=np.zeros(returns, np.uint8),
                camera=camera,
                ground=GroundPlane(1.5),
                depth_single_m=single,
            )
            writer.write(sample, index)
        writer.finish(card)
    for number in range(1, -(-samples // FRAMES_PER_DRIVE)):
        (folder / str(number)).mkdir()
        for file in first.iterdir():
            os.link(file, folder / str(number) / file.name)


def measure(folder: Path, batches: int) -> Figures:
    """Opens all drives and makes batches, as a training would."""
    base_mib = memory_mib("VmRSS")
    started = time.perf_counter()
    samples = SampleSet.of([CachedDrive(place) for place in sorted(folder.iterdir())])
    opened_s = time.perf_counter() - started
    maker = BatchMaker(samples, recipe_of("baff").augmentation, 0)
    started, cpu = time.perf_counter(), time.process_time()
    with ThreadPoolExecutor(1) as pool, closing(prefetch(maker, 0, BATCH, [CROP], pool, 3, BATCH)) as made:
        read = sum(len(batch.image) for batch in islice(made, batches))
    seconds = time.perf_counter() - started
    return Figures(
        samples=len(samples),
        read=read,
        samples_per_s=read / seconds,
        cpu_ms=1000 * (time.process_time() - cpu) / read,
        open_s=opened_s,
        open_files=len(list(Path("/proc/self/fd").iterdir())),
        peak_mib=memory_mib("VmHWM"),
        own_mib=memory_mib("RssAnon"),
        base_mib=base_mib,
    )


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="a folder that is not there yet, for the drives")
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("--batches", type=int, default=500, help="batches of four to make")
    parser.add_argument("--returns", type=int, default=300, help="radar returns a sample")
    parser.add_argument("--size", default="448x800", help="height x width of the images")
    parser.add_argument("--json", help="write the figures as JSON to a file, - for stdout")
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        print(json.dumps(asdict(measure(options.out, options.batches))))
        return
    height, width = (int(part) for part in options.size.split("x"))
    try:
        camera = CameraModel(width, height, 630.0, 630.0, width / 2, height / 2)
        write_drives(options.out, options.samples, camera, options.returns)
        command = [sys.executable, "-m", "benchmarks.streaming", "--out", str(options.out), "--measure"]
        done = subprocess.run([*command, "--batches", str(options.batches)], stdout=subprocess.PIPE, check=True)
    finally:
        shutil.rmtree(options.out, ignore_errors=True)
    figures = json.loads(done.stdout)
    for name, value in figures.items():
        print(f"{name:>15} {value:10.1f}", file=sys.stderr)
    if options.json:
        write_json(figures, options.json)


if __name__ == "__main__":
    main()
