"""Measures coverage and error of semi-dense depth by tau, to choose a network's threshold.

Run it from the repository's root, on drives that the network was not trained on:

    python -m experiments.threshold --bags out/held_out --model out/run/baff.safetensors
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

from experiments.adjusted import adjusted
from radcam_depth_ros.bags import find_bags
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training.data.cache import CacheSettings, cached_drives
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.drives import refuse_test_drives
from radcam_depth_ros.training.precision import Precision
from radcam_depth_ros.training.validation import validate

THRESHOLDS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.8)


def main() -> None:
    """Prints a row for each tau."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bags", type=Path, nargs="+", required=True)
    parser.add_argument("--model", default="baff", help="a network's name, or a weight file")
    parser.add_argument("--cache", type=Path, default=Path("out/cache"), help="of prepared samples")
    parser.add_argument("--frames", type=int, default=80, help="how many frames, evenly spread")
    parser.add_argument("--thresholds", type=float, nargs="+", default=THRESHOLDS)
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    loaded = archive.load(options.model)
    card = loaded.card
    bags = find_bags(options.bags)
    refuse_test_drives(bags)
    drives = cached_drives(bags, options.cache, CacheSettings(card.focal_length_px, card.max_depth_m), 2)
    samples = SampleSet.of(drives)
    chosen = [samples[index] for index in samples.spread(options.frames)]
    precision = Precision.choose("float32", "cpu")
    rows = []
    for threshold in track(options.thresholds, "evaluating"):
        network = adjusted(loaded, threshold=threshold)
        rows.append({"threshold": threshold, **dataclasses.asdict(validate(network, chosen, precision)[0])})
    if options.json:
        write_json({"model": str(options.model), "frames": len(chosen), "rows": rows}, options.json)
    if options.json == "-":
        return
    table = Table("tau", "semi-dense share", "semi-dense MAE m", "dense MAE 80 m", title=f"{len(chosen)} frames")
    for row in rows:
        table.add_row(
            f"{row['threshold']:.3f}",
            f"{100 * row['semi_dense_share']:.1f} %",
            f"{row['semi_dense_mae_m']:.2f}",
            f"{row['mae_80_m']:.2f}",
        )
    Console().print(table)


if __name__ == "__main__":
    main()
