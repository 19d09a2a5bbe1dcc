"""Tells how many pixels of wires before the sky can be seen at all, and how many of these keep their depth.

Run it from the repository's root, on drives with wires that the network was not trained on:

    radcam-depth simulate out/wires --seeds 740000:740010 --frames 4 --config CONFIG    # with world: {wires: 1.0}
    python -m experiments.wires --bags out/wires

A wire's pixel is held against the sky in the 9 x 9 pixels around it: by how many of the sky's own standard deviations
(of at least one grey level) it differs from the sky's median.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.progress import track
from rich.table import Table

from radcam_depth_ros.bags import find_bags
from radcam_depth_ros.classes import WIRE
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.frame import SKY_FROM, FloatArray
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training.data.batches import collate
from radcam_depth_ros.training.data.cache import CacheSettings, cached_drives
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.data.samples import TrainingSample
from radcam_depth_ros.training.drives import refuse_test_drives

REACH_PX = 4
LEAST_SKY_PX = 20
EDGES = (0.0, 1.0, 2.0, 3.0, float("inf"))


def deviations(sample: TrainingSample) -> FloatArray:
    """Of each wire's pixel before the sky, how far it stands out of it; NaN elsewhere. (H, W) float32."""
    grey, sky = sample.image.mean(axis=2), np.isinf(sample.depth_m)
    result = np.full(sky.shape, np.nan, np.float32)
    for row, column in np.argwhere(sample.classes == WIRE):
        around = tuple(slice(max(0, at - REACH_PX), at + REACH_PX + 1) for at in (row, column))
        values = grey[around][sky[around]]
        if len(values) >= LEAST_SKY_PX:
            result[row, column] = abs(grey[row, column] - np.median(values)) / max(values.std(), 1.0)
    return result


def main() -> None:
    """Prints a row for each range of deviations."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bags", type=Path, nargs="+", required=True)
    parser.add_argument("--model", default="baff", help="a network's name, or a weight file")
    parser.add_argument("--cache", type=Path, default=Path("out/cache"), help="of prepared samples")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    loaded = archive.load(options.model)
    bags = find_bags(options.bags)
    refuse_test_drives(bags)
    settings = CacheSettings(loaded.card.focal_length_px, loaded.card.max_depth_m)
    samples = SampleSet.of(cached_drives(bags, options.cache, settings, 2))
    stood_out, kept = [], []
    for index in track(range(len(samples)), "looking at wires"):
        batch, found = collate([samples[index]]), deviations(samples[index])
        with torch.inference_mode():
            depths = loaded.network(batch.image, batch.radar, batch.valid, batch.ground)
        if depths.sky is None:
            parser.error(f"{loaded.card.network} does not tell the sky; give another --model")
        size = found.shape
        sky = torch.nn.functional.interpolate(depths.sky, size, mode="bilinear", align_corners=False)[0, 0].numpy()
        known = np.isfinite(found)
        stood_out.append(found[known])
        kept.append(sky[known] < SKY_FROM)
    deviation, is_kept = np.concatenate(stood_out), np.concatenate(kept)
    rows = []
    for low, high in pairwise(EDGES):
        within = (deviation >= low) & (deviation < high)
        share, kept_share = within.mean(), is_kept[within].mean() if within.any() else None
        rows.append({"from": low, "to": high if np.isfinite(high) else None, "share": share, "kept": kept_share})
    if options.json:
        write_json({"model": str(options.model), "pixels": len(deviation), "rows": rows}, options.json)
    if options.json == "-":
        return
    table = Table("deviations of the sky", "share of pixels", "kept", title=f"{len(deviation)} pixels of wires")
    for row in rows:
        place = f"{row['from']:.0f} to {row['to']:.0f}" if row["to"] else f"{row['from']:.0f} and more"
        table.add_row(place, f"{100 * row['share']:.0f} %", "" if row["kept"] is None else f"{100 * row['kept']:.0f} %")
    Console().print(table)


if __name__ == "__main__":
    main()
