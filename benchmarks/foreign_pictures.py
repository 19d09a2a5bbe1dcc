"""Depth and confidence where the camera's pictures are wrong, and where the radar is withheld.

Run it from the repository's root: `python -m benchmarks.foreign_pictures --bags BAGS --json -`. Every drive is measured
as recorded; with black pictures, noise, the pictures of another drive, and blurred pictures in place of its own; and
without radar returns. Nothing else is changed. The other drive is the next bag; of a single bag, the pictures come from
half the drive away. Geometry alone (`ground_nearest`) gets the same frames as the network: without returns where they
are withheld. Each row reads the bags once, one frame in memory at a time.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from radcam_depth_ros.bags import BagReader, find_bags, read_scenario
from radcam_depth_ros.cli.terminal.options import load_estimator, progress_bar, write_json
from radcam_depth_ros.drive import DriveSettings, Sample, read_samples
from radcam_depth_ros.estimator import EstimatorConfig
from radcam_depth_ros.evaluation.baselines import without_radar
from radcam_depth_ros.evaluation.drive import Drive, EvaluationSettings, Predict, evaluate_drives
from radcam_depth_ros.evaluation.groups import GEOMETRY
from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.summary import Evaluation
from radcam_depth_ros.frame import Frame, ImageArray

BLUR_SHARE = 0.01
"""Standard deviation of the blur, as a share of the image's width."""
NATIVE, ANOTHER = "as recorded", "another drive"
RANGES_M = (50, 80)


def replaced(frame: Frame, image: ImageArray) -> Frame:
    """The frame with another picture, resized where the sizes differ; all else stays."""
    size = (frame.camera.width, frame.camera.height)
    fitting = image if image.shape == frame.image.shape else cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return dataclasses.replace(frame, image=np.ascontiguousarray(fitting, np.uint8))


def black(frame: Frame) -> Frame:
    """The frame with a black picture."""
    return replaced(frame, np.zeros_like(frame.image))


def noise(frame: Frame) -> Frame:
    """The frame with a picture of uniform noise, the same each time."""
    generator = np.random.default_rng(abs(frame.stamp_ns))
    return replaced(frame, generator.integers(0, 256, frame.image.shape, np.uint8))


def blurred(frame: Frame) -> Frame:
    """The frame with its picture blurred by `BLUR_SHARE` of the width."""
    return replaced(frame, np.asarray(cv2.GaussianBlur(frame.image, (0, 0), BLUR_SHARE * frame.camera.width)))


CHANGES: Mapping[str, Callable[[Frame], Frame]] = {
    NATIVE: lambda frame: frame,
    "black": black,
    "noise": noise,
    "blurred": blurred,
    "radar withheld": without_radar,
}
"""Changes that need the frame alone, by the name of the row."""
ROWS = (NATIVE, "black", "noise", ANOTHER, "blurred", "radar withheld")


def other_pictures(bags: Sequence[Path], index: int, settings: DriveSettings) -> Iterator[ImageArray]:
    """Pictures of the next bag, repeated without end; of a single bag, its own from half the drive on.

    Args:
        bags: All bags.
        index: The bag whose pictures are replaced.
        settings: How bags are read.

    Raises:
        EvaluationError: when there is no other picture.
    """
    settings = dataclasses.replace(settings, ground_truth="none")
    other = bags[(index + 1) % len(bags)]
    start = images_of(other, settings) // 2 if len(bags) == 1 else 0
    is_own = len(bags) == 1 and start == 0
    while True:
        pictures = islice(read_samples(other, settings), start, None)
        first = None if is_own else next(pictures, None)
        if first is None:
            raise EvaluationError(f"expected pictures that could replace those of {bags[index]}, got none; add a bag")
        yield first.frame.image
        for sample in pictures:
            yield sample.frame.image
        start = 0


def changed(
    name: str, bags: Sequence[Path], index: int, limit: int | None, settings: DriveSettings
) -> Iterator[Sample]:
    """Frames of a bag with the change of a row; the ground truth stays.

    Args:
        name: One of `ROWS`.
        bags: All bags.
        index: The bag.
        limit: Number of frames at most; None for all.
        settings: How bags are read.
    """
    samples = islice(read_samples(bags[index], settings), limit)
    if name == ANOTHER:
        for sample, image in zip(samples, other_pictures(bags, index, settings), strict=False):
            yield dataclasses.replace(sample, frame=replaced(sample.frame, image))
    else:
        for sample in samples:
            yield dataclasses.replace(sample, frame=CHANGES[name](sample.frame))


def figures(evaluation: Evaluation) -> dict[str, Any]:
    """Errors of the network and of geometry alone, the share of worse frames, and the calibration of the confidence."""
    plain = evaluation.as_json()
    worse: Any = plain["worse_than_geometry"]
    geometry = evaluation.baselines[GEOMETRY]
    calibration = evaluation.reliability.overall.as_json()
    return {
        "frames": evaluation.frames,
        **{f"mae_{range_m}": evaluation.dense.within(range_m).mae for range_m in RANGES_M},
        **{f"geometry_mae_{range_m}": geometry.within(range_m).mae for range_m in RANGES_M},
        **{f"worse_frames_share_{range_m}": worse[f"{range_m}"]["frames_share"] for range_m in RANGES_M},
        "ece": calibration["ece"],
        "largest_fall": calibration["largest_fall"],
    }


def measure(
    bags: Sequence[Path],
    predict: Predict,
    limit: int | None = None,
    settings: DriveSettings | None = None,
    advance: Callable[[], None] = lambda: None,
) -> dict[str, dict[str, Any]]:
    """Measures every row.

    Args:
        bags: The drives.
        predict: Depth of a frame.
        limit: Frames of each bag at most.
        settings: How bags are read.
        advance: Called after each frame of each row.

    Returns:
        Figures by the name of the row.

    Raises:
        EvaluationError: when no frame has ground truth, or there is no other picture.
    """
    settings = settings or DriveSettings()
    scenarios = [scenario_of(bag) for bag in bags]

    def counted(samples: Iterator[Sample]) -> Iterator[Sample]:
        for sample in samples:
            yield sample
            advance()

    rows = {}
    for name in ROWS:
        drives = (
            Drive(counted(changed(name, bags, index, limit, settings)), bag.name, scenarios[index])
            for index, bag in enumerate(bags)
        )
        evaluation = evaluate_drives(drives, predict, EvaluationSettings(baselines=(GEOMETRY,)))
        if not evaluation.has_ground_truth:
            raise EvaluationError("expected ground truth within 100 m of some frame of the bags, got none")
        rows[name] = figures(evaluation)
    return rows


def images_of(bag: Path, settings: DriveSettings) -> int:
    """Number of a bag's images."""
    with BagReader(bag) as reader:
        return reader.count([settings.find_topics(reader).image])


def scenario_of(bag: Path) -> Mapping[str, str]:
    """The scenario of a bag."""
    with BagReader(bag) as reader:
        return read_scenario(reader)


def table_of(rows: Mapping[str, Mapping[str, Any]]) -> Table:
    """The figures as a table."""
    table = Table("pictures", *(name.replace("_", " ") for name in next(iter(rows.values()))))
    for name, row in rows.items():
        cells = (
            "-" if value is None else f"{value:.3f}" if isinstance(value, float) else str(value)
            for value in row.values()
        )
        table.add_row(name, *cells)
    return table


def main() -> None:
    """Measures, prints a table, writes JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--bags", type=Path, nargs="+", required=True, help="drives with ground truth, or their folders"
    )
    parser.add_argument("--network", default="baff", help="network whose weights come with the package")
    parser.add_argument("--model", default="", help="weight file in place of the network's own")
    parser.add_argument("--device", default="cpu", help="device that runs the network")
    parser.add_argument("--precision", default="auto", help="number format of the network")
    parser.add_argument("--limit", type=int, help="frames of each bag at most")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    bags, settings = find_bags(options.bags), DriveSettings()
    config = EstimatorConfig(options.network, options.model, device=options.device, precision=options.precision)
    estimator = load_estimator(dataclasses.replace(config, allow_exported=True))
    images = [images_of(bag, settings) for bag in bags]
    total = len(ROWS) * sum(min(count, options.limit or count) for count in images)
    with progress_bar() as progress:
        task = progress.add_task("measuring", total=total)
        rows = measure(bags, estimator.estimate, options.limit, settings, lambda: progress.advance(task))
    # Of the table and the JSON only one can be on stdout.
    Console(stderr=options.json == "-").print(table_of(rows))
    if options.json:
        values = {
            "bags": [str(bag) for bag in bags],
            "weights": estimator.describe(),
            "precision": estimator.computation.precision,
            "pictures": rows,
        }
        write_json(values, options.json)


if __name__ == "__main__":
    main()
