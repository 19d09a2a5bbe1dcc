"""Simulated pictures beside the statistics of real ones: brightness, spectrum, edges and colours.

Run it from the repository's root: `python -m benchmarks.contact_sheet --out sheet.png --bags BAGS --json -`. The first
pictures of simulated drives are drawn on the sheet, with histograms and spectra of them and of the bags; nothing that a
bag shows is written. Every picture is measured at a width of 640 pixels. The table has medians over the pictures, with
the 10th and 90th percentiles.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import track
from rich.table import Table

from radcam_depth_ros import configuration, messages
from radcam_depth_ros.bags import BagReader, find_bags
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.files import whole
from radcam_depth_ros.frame import FloatArray, ImageArray
from radcam_depth_ros.simulation import SimulationConfig, simulate

WIDTH_PX = 640
BINS, BANDS = 32, 24
_EDGE = 0.15
_NOT_SEEN = ("imaging_radar", "lidar", "odometry")
SIMULATED = "simulated"


def luminance(image: ImageArray) -> FloatArray:
    """(H, W) float32, 0 to 1, of a picture (H, W, 3) uint8 RGB, `WIDTH_PX` wide."""
    size = (WIDTH_PX, max(1, round(image.shape[0] * WIDTH_PX / image.shape[1])))
    grey = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    return np.asarray(grey, np.float32) / np.float32(255)


def spectrum(grey: FloatArray) -> FloatArray:
    """(BANDS,) mean logarithm (base 10) of the power of luminance (H, W), by frequency from 0.01 to 0.5 a pixel."""
    height, width = grey.shape
    window = np.outer(np.hanning(height), np.hanning(width))
    power = np.abs(np.fft.rfft2((grey - grey.mean()) * window)) ** 2 / np.sum(window**2)
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None])
    band = np.digitize(frequency.ravel(), np.geomspace(0.01, 0.5, BANDS + 1)) - 1
    inside = (band >= 0) & (band < BANDS)
    total = np.bincount(band[inside], power.ravel()[inside], BANDS)
    return np.asarray(np.log10(total / np.maximum(np.bincount(band[inside], minlength=BANDS), 1) + 1e-12), np.float32)


def measures(image: ImageArray) -> dict[str, float]:
    """Statistics of a picture (H, W, 3) uint8 RGB."""
    grey, levels = luminance(image), spectrum(luminance(image))
    centres = np.log10(np.geomspace(0.01, 0.5, BANDS + 1))
    centres = (centres[1:] + centres[:-1]) / 2
    slope = np.polyfit(centres[4:-3], levels[4:-3], 1)[0]
    across, down = (cv2.Sobel(grey, cv2.CV_32F, *order, scale=0.25) for order in ((1, 0), (0, 1)))
    colours = cv2.resize(image, grey.shape[::-1], interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(colours.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    chroma = np.hypot(lab[..., 1], lab[..., 2])
    return {
        "brightness": float(grey.mean()),
        "contrast": float(grey.std()),
        "dark share": float((grey < 0.08).mean()),
        "clipped share": float((grey > 0.97).mean()),
        "spectrum's slope": float(slope),
        "fine detail": float(levels[-6:-2].mean()),
        "edge density": float((np.hypot(across, down) > _EDGE).mean()),
        "saturation": float(cv2.cvtColor(colours, cv2.COLOR_RGB2HSV)[..., 1].mean() / 255),
        "chroma": float(chroma.mean()),
        "cast": float(np.hypot(lab[..., 1].mean(), lab[..., 2].mean())),
    }


def summary(images: Iterable[ImageArray]) -> dict[str, Any]:
    """Median, 10th and 90th percentile of each statistic over pictures, their mean histogram and mean spectrum."""
    rows, histograms, spectra = [], [], []
    for image in images:
        grey = luminance(image)
        rows.append(measures(image))
        histograms.append(np.histogram(grey, BINS, (0, 1))[0] / grey.size)
        spectra.append(spectrum(grey))
    if not rows:
        raise SystemExit("expected at least one picture, got none; give bags with images, and --drives of at least 1")
    percentiles = {
        name: [float(value) for value in np.percentile([row[name] for row in rows], (10, 50, 90))] for name in rows[0]
    }
    histogram, mean = np.mean(histograms, axis=0), np.mean(spectra, axis=0)
    return {"pictures": len(rows), **percentiles, "histogram": histogram.tolist(), "spectrum": mean.tolist()}


def simulated(config: SimulationConfig, seeds: Sequence[int]) -> list[ImageArray]:
    """The first picture of each seed."""
    off = {name: dataclasses.replace(getattr(config, name), enabled=False) for name in _NOT_SEEN}
    seen = dataclasses.replace(config, **off)
    images = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in track(seeds, "simulating"):
            bag = Path(folder) / f"{seed}.mcap"
            simulate(seen, seed, 1, bag)
            images += pictures_of(bag, 1)
    return images


def pictures_of(bag: Path, count: int) -> list[ImageArray]:
    """So many pictures of a bag, spread over it."""
    with BagReader(bag) as reader:
        topic = DriveSettings(ground_truth="none").find_topics(reader).image
        wanted = set(np.linspace(0, reader.count([topic]) - 1, count).astype(int).tolist())
        found = (message.message for index, message in enumerate(reader.messages({topic})) if index in wanted)
        return [messages.decode_image(message).image for message in found]


def draw(images: Sequence[ImageArray], rows: Mapping[str, Mapping[str, Any]], out: Path) -> None:
    """Writes the sheet: pictures, and below them mean histograms and spectra of all rows."""
    columns = 6
    lines = -(-len(images) // columns)
    figure = Figure(figsize=(18, 1.9 * lines + 4), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(lines + 1, columns, height_ratios=[1.0] * lines + [2.0])
    for index, image in enumerate(images):
        axes = figure.add_subplot(grid[index // columns, index % columns])
        axes.imshow(image, aspect="equal")
        axes.set_axis_off()
    half = columns // 2
    left, right = figure.add_subplot(grid[lines, :half]), figure.add_subplot(grid[lines, half:])
    for name, row in rows.items():
        left.plot(np.linspace(0, 1, BINS), row["histogram"], label=name)
        right.plot(np.geomspace(0.01, 0.5, BANDS), row["spectrum"], label=name)
    left.set(xlabel="luminance", ylabel="share of the pixels")
    right.set(xlabel="frequency, 1 / pixel", ylabel="log10 of the power", xscale="log")
    left.legend()
    with whole(out) as path:
        figure.savefig(path, format="png", dpi=70)


def table_of(rows: Mapping[str, Mapping[str, Any]]) -> Table:
    """The statistics as a table."""
    table = Table("statistic", *(f"{name} ({row['pictures']})" for name, row in rows.items()))
    for name in measures(np.zeros((64, 64, 3), np.uint8)):
        cells = ("{1:.3g} ({0:.3g} to {2:.3g})".format(*row[name]) for row in rows.values())
        table.add_row(name, *cells)
    return table


def main() -> None:
    """Prints the table and writes the sheet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="sheet to write, .png")
    parser.add_argument("--config", type=Path, default=Path("config/training_drives.yaml"), help="simulation settings")
    parser.add_argument("--seed", type=int, default=703000, help="first of the simulated drives")
    parser.add_argument("--drives", type=int, default=24, help="how many")
    parser.add_argument("--bags", type=Path, nargs="*", default=[], help="real drives: bags or folders of bags")
    parser.add_argument("--frames", type=int, default=50, help="pictures of each bag")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    given = yaml.safe_load(options.config.read_text(encoding="utf-8"))
    config = configuration.build(SimulationConfig, given, str(options.config))
    images = simulated(config, range(options.seed, options.seed + options.drives))
    rows = {SIMULATED: summary(images)}
    for place in options.bags:
        rows[place.name] = summary(image for bag in find_bags([place]) for image in pictures_of(bag, options.frames))
    if options.out:
        draw(images, rows, options.out)
    if options.json:
        write_json(rows, options.json)
    if options.json != "-":
        Console().print(table_of(rows))


if __name__ == "__main__":
    main()
