"""Compares what helps a network trained on simulated drives on real ones: short trainings, one change each.

Run it from the repository's root, with simulated drives to train on and a real one to measure on:

    nohup python -m experiments.transfer --bags out/drives --validation-bags out/held_out --real-bag real/drive \
        --out out/transfer --iterations 1500 > out/transfer.log &

Each row differs from the recipe in one thing. Nothing of the real drive is seen in training. A row that is trained and
measured already is not done again: what was cut off goes on when the same command is given. With one seed and a short
training, differences of a few per cent say nothing. `--levers` takes some rows alone, `--json FILE` writes the figures.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from experiments.short_training import Budget, ShortTraining
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.drive import DriveSettings, read_samples
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.evaluation.drive import EvaluationSettings, evaluate_drive
from radcam_depth_ros.files import write_text

SHIPPED = "as shipped"
STRONG_LIGHT = {
    "tone": 0.9,
    "colour": 0.8,
    "grey": 0.25,
    "illumination": 0.5,
    "shadow": 0.4,
    "blur": 0.3,
    "noise": 0.5,
    "noise_level": 0.05,
}
NO_LIGHT = dict.fromkeys(("tone", "colour", "grey", "illumination", "shadow", "blur", "noise"), 0.0)
APPEARANCE = {
    "recolour": 0.3,
    "texture": 0.2,
    "tone_curve": 0.3,
    "channel_mixing": 0.1,
    "spectrum": 0.2,
    "equalise": 0.1,
    "sharpen": 0.1,
    "jpeg": 0.2,
}


@dataclass(frozen=True)
class Lever:
    """One thing that is done otherwise.

    Attributes:
        architecture: Values of `baff`'s config.
        recipe: Values of the recipe.
        sources: As `ShortTraining.sources`.
    """

    architecture: Mapping[str, Any] = field(default_factory=dict)
    recipe: Mapping[str, Any] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)


LEVERS = {
    SHIPPED: Lever(),
    "batch norm throughout": Lever({"instance_norm": 0}),
    "instance norm on all levels": Lever({"instance_norm": 4}),
    "the road is not corrected": Lever({"road": False}),
    "no road prior": Lever({"ground_prior": False}),
    "the road is always known": Lever(recipe={"augmentation": {"ground": {"unknown": 0.0}}}),
    "features of ImageNet": Lever({"context": "mobilenet_v2"}, sources={"--backbone-weights": "imagenet"}),
    "no change of light": Lever(recipe={"augmentation": {"photometric": NO_LIGHT}}),
    "strong changes of light": Lever(recipe={"augmentation": {"photometric": STRONG_LIGHT}}),
    "random appearance": Lever(recipe={"augmentation": {"appearance": APPEARANCE}}),
    "other skies": Lever(recipe={"augmentation": {"appearance": {"sky": 0.5}}}),
    "radars without elevation": Lever(recipe={"augmentation": {"radar": {"elevation_noise": 0.4}}}),
    "focal length varies": Lever(recipe={"augmentation": {"focal_jitter": 0.1}}),
    "the sky counts in full": Lever(recipe={"loss": {"choice_sky": 1.0}}),
    "sky between twigs counts": Lever(recipe={"loss": {"sky_margin_px": 0}}),
}


def measured(training: ShortTraining, bag: Path) -> dict[str, float]:
    """MAE and RMSE within 50 m on a real drive, metres; and those of geometry alone."""
    path = training.folder / "real.json"
    if not path.exists():
        estimator = Estimator(EstimatorConfig(model_file=str(training.weights), precision="float32"))
        settings = EvaluationSettings("baff", baselines=("ground_nearest",))
        found = evaluate_drive(read_samples(bag, DriveSettings()), estimator.estimate, settings)
        dense, geometry = found.dense.within(50), found.baselines["ground_nearest"].within(50)
        figures = {"mae": dense.mae, "rmse": dense.rmse, "geometry_mae": geometry.mae, "geometry_rmse": geometry.rmse}
        write_text(path, json.dumps(figures))
    figures = json.loads(path.read_text(encoding="utf-8"))
    return {str(name): float(value) for name, value in figures.items()}


def main() -> None:
    """Trains, measures, prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    Budget.add_options(parser, iterations=1500)
    parser.add_argument("--real-bag", type=Path, required=True, help="a real drive with a LiDAR")
    parser.add_argument("--levers", nargs="+", choices=LEVERS, default=list(LEVERS), metavar="NAME")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    table = Table(title=f"{options.iterations} iterations; {options.real_bag.name} within 50 m, simulated within 80 m")
    for column in ("lever", "real MAE", "real RMSE", "simulated MAE"):
        table.add_column(column, justify="left" if column == "lever" else "right")
    rows: dict[str, dict[str, float]] = {}
    for name in options.levers:
        lever = LEVERS[name]
        training = ShortTraining(
            options.out / name.replace(" ", "_"),
            Budget.of(options, lever.recipe),
            "baff",
            lever.architecture,
            sources=lever.sources,
        )
        simulated = training.run()
        rows[name] = {**measured(training, options.real_bag), "simulated_mae_80_m": simulated["mae_80_m"]}
        row = rows[name]
        table.add_row(name, *(f"{row[key]:.2f}" for key in ("mae", "rmse", "simulated_mae_80_m")))
        Console().print(f"{name}: {row}")
    first = next(iter(rows.values()))
    table.add_row("geometry alone", f"{first['geometry_mae']:.2f}", f"{first['geometry_rmse']:.2f}", "")
    Console().print(table)
    if options.json:
        write_json(rows, options.json)


if __name__ == "__main__":
    main()
