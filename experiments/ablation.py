"""Ablation: the same short training with and without each part of a network, with several seeds.

Run it from the repository's root, on simulated drives, of which some are kept for validation and for measuring:

    nohup python -m experiments.ablation --bags out/drives --validation-bags out/held_out --test-bags out/test \
        --out out/ablation --iterations 2000 --seeds 3 > out/ablation.log &

The rows of `baff`: the bottom-up branch (BF), channel attention (CA) and position attention (PA), none of them, and
all; all with features that begin at random, without the second encoder, and without the correction of the choice at
half the image's size; and association by embedding and by regions, with so few returns that both can be trained. Of
`structured`: how its decoders are fused, and the weight of the road (omega). Of `lircdepth`: alone, and taught by all
terms of the distillation and by each (--teacher). Seeds come one after the other, so that what is done so far can
always be compared. Each training and measurement is kept in --out and not repeated: what was cut off goes on when the
same command is given. Errors are averaged over whole frames of the test bags, by the measures of `radcam-depth
evaluate`, at the network's size, before doubtful depths lean to geometry (`caution`), which no paper has and which
hides what a part is worth. At last `baff`'s associations are timed in turns.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import re
import signal
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from rich.console import Console
from rich.table import Table

from experiments.adjusted import adjusted
from experiments.forms import EMBEDDING, FORMS, REGIONS, Form, forms_of
from experiments.short_training import Budget, ShortTraining
from experiments.thinned_bags import thinned_bags
from radcam_depth_ros.bags import find_bags
from radcam_depth_ros.benchmarking.rotation import Schedule, in_rotation
from radcam_depth_ros.benchmarking.sections import Section, dissect
from radcam_depth_ros.benchmarking.subject import NetworkInputs, Running, Size, Subject
from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.evaluation.measures.classes import ClassMeans
from radcam_depth_ros.evaluation.measures.metrics import DepthAccumulator, DepthRange, SemiDenseAccumulator, json_number
from radcam_depth_ros.networks import registry
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training.data.batches import collate
from radcam_depth_ros.training.data.cache import CacheSettings, cached_drives
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.data.samples import TrainingSample

ERRORS = tuple(f"{measure}_{range_m}" for measure in ("mae", "rmse") for range_m in (50, 70, 80))
SUMMARY = (*ERRORS, "coverage", "semi_dense_mae")
CLASSES = tuple(f"class_{name}" for name in CLASS_NAMES)
"""The dense depth's MAE within 80 m where a pixel shows a class."""
COLUMNS = (*SUMMARY, *CLASSES)
LAST_VALIDATION_FRAMES = 20
"""Of the one validation that ends a training; errors are measured after it, on more."""


def measure(weights: Path, samples: Sequence[TrainingSample]) -> dict[str, float]:
    """The errors of a network over whole frames, by `COLUMNS`, of its own depths: none of them leans to geometry's."""
    network = adjusted(archive.load(weights), caution=0.0)
    dense, semi_dense, classes = DepthAccumulator(), SemiDenseAccumulator(), ClassMeans(DepthRange.within(80.0))
    for sample in samples:
        batch = collate([sample])
        with torch.inference_mode():
            depths = network(batch.image, batch.radar, batch.valid, batch.ground)
        truth_m, dense_m = sample.depth_m.astype(np.float32), depths.dense[0, 0].numpy()
        dense.add(dense_m, truth_m)
        semi_dense.add(depths.semi_dense[0, 0].numpy(), truth_m)
        classes.add(dense_m, truth_m, sample.classes)
    values = {f"mae_{entry.name}": entry.mae for entry in dense.result()}
    values |= {f"rmse_{entry.name}": entry.rmse for entry in dense.result()}
    covered = semi_dense.result()
    values |= {"coverage": covered.coverage, "semi_dense_mae": covered.metrics[-1].mae}
    return {**values, **dict.fromkeys(CLASSES, math.nan), **{f"class_{e.name}": e.mae for e in classes.result()[0]}}


@dataclass(frozen=True)
class _Group:
    """Forms that are trained and measured on the same.

    Attributes:
        budget: Of each training.
        test_bags: To measure on.
    """

    budget: Budget
    test_bags: tuple[Path, ...]

    def samples(self, network: str, count: int) -> tuple[TrainingSample, ...]:
        """Frames of the test bags, evenly spread, as a network takes them."""
        config = registry.create_config(network, {})
        settings = CacheSettings(config.focal_length_px, config.max_depth_m)
        samples = SampleSet.of(cached_drives(self.test_bags, self.budget.cache, settings))
        return tuple(samples[index] for index in samples.spread(count))


class Ablation:
    """Trains and measures all forms, whatever of it is not done yet.

    Args:
        options: Of the command.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        text = options.config.read_text(encoding="utf-8") if options.config else ""
        recipe: dict[str, Any] = yaml.safe_load(text) or {}
        full = dataclasses.replace(Budget.of(options, recipe), frames=min(options.frames, LAST_VALIDATION_FRAMES))
        self._groups = {False: _Group(full, find_bags(options.test_bags))}
        if any(FORMS[name].has_few_returns for name in options.forms):
            augmentation = recipe.get("augmentation", {})
            limits = {"min_points": max(1, options.returns // 4), "max_points": options.returns}
            radar = {**augmentation.get("radar", {}), **limits}
            folder = options.out / "few_returns"
            few = dataclasses.replace(
                full,
                validation_bags=thinned_bags(
                    find_bags(options.validation_bags), folder / "validation", options.returns
                ),
                recipe={**recipe, "augmentation": {**augmentation, "radar": radar}},
            )
            test_bags = thinned_bags(find_bags(options.test_bags), folder / "test", options.returns)
            self._groups[True] = _Group(few, test_bags)
        self.errors: dict[str, dict[int, dict[str, float]]] = {name: {} for name in options.forms}

    def run(self, name: str, seed: int) -> dict[str, float]:
        """Trains and measures a form with a seed."""
        form = FORMS[name]
        group = self._groups[form.has_few_returns]
        folder = self._options.out / f"{re.sub(r'[^a-z0-9.]+', '_', name.lower())}_{seed}"
        sources = {"--teacher": str(self._options.teacher)} if form.is_taught else {}
        if form.is_taught and self._options.teacher is None:
            raise SystemExit(f"{name} learns from a teacher: give its weight file with --teacher")
        if self._options.backbone_weights is not None and not form.is_random:
            sources["--backbone-weights"] = self._options.backbone_weights
        budget = dataclasses.replace(group.budget, recipe={**group.budget.recipe, **form.recipe})
        training = ShortTraining(folder, budget, form.network, form.architecture, seed, sources)
        training.run()
        path = folder / "errors.json"
        asked = {"bags": [str(bag.resolve()) for bag in group.test_bags], "frames": self._options.frames}
        known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        if {key: known.get(key) for key in asked} != asked:
            found = measure(training.weights, group.samples(form.network, self._options.frames))
            known = {**asked, "errors": {column: json_number(value) for column, value in found.items()}}
            write_json(known, str(path))
        # Where the semi-dense depth is empty it has no error.
        errors = {column: math.nan if value is None else value for column, value in known["errors"].items()}
        self.errors[name][seed] = errors
        return errors

    def as_json(self) -> dict[str, Any]:
        """All that is known so far."""
        return {
            "iterations": self._options.iterations,
            "batch": self._options.batch,
            "crop": self._options.crop,
            "frames": self._options.frames,
            "returns": self._options.returns,
            "forms": {
                name: {
                    "seeds": {str(seed): _plain(row) for seed, row in rows.items()},
                    "mean": _plain({column: statistics.fmean(_column(rows, column)) for column in COLUMNS}),
                    "spread": _plain({column: _spread(_column(rows, column)) for column in COLUMNS}),
                    "against": FORMS[name].against,
                    "relative": {
                        column: dict(
                            zip(("mean", "spread"), map(json_number, relative(self.errors, name, column)), strict=True)
                        )
                        for column in ERRORS
                    },
                }
                for name, rows in self.errors.items()
                if rows
            },
        }


def _column(rows: Mapping[int, Mapping[str, float]], column: str) -> list[float]:
    return [row[column] for row in rows.values()]


def _plain(values: Mapping[str, float]) -> dict[str, float | int | None]:
    return {name: json_number(value) for name, value in values.items()}


def _spread(values: Sequence[float]) -> float:
    """Standard deviation over seeds; NaN where there are too few to say."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else math.nan


def relative(errors: Mapping[str, Mapping[int, Mapping[str, float]]], name: str, column: str) -> tuple[float, float]:
    """How much larger a form's error is than its reference's, as a share: mean and deviation over common seeds.

    NaN where there are none, or too few to say.
    """
    rows, others = errors[name], errors.get(FORMS[name].against, {})
    ratios = [rows[seed][column] / others[seed][column] - 1.0 for seed in rows if seed in others]
    return (statistics.fmean(ratios), _spread(ratios)) if ratios else (math.nan, math.nan)


def tables(ablation: Ablation) -> tuple[Table, ...]:
    """Errors, those by class, and errors relative to the form it is held against; each mean ± deviation over seeds."""
    done = {name: rows for name, rows in ablation.errors.items() if rows}
    absolute, by_class = Table(title="Error in metres"), Table(title="MAE in metres within 80 m, by class")
    for table, columns in ((absolute, SUMMARY), (by_class, CLASSES)):
        _head(table, "form", "seeds", *columns)
        for name, rows in done.items():
            table.add_row(name, str(len(rows)), *(_cell(_column(rows, column), column) for column in columns))
    change = Table(title="Change of the error")
    _head(change, "form", "against", *ERRORS)
    for name in done:
        pairs = (relative(ablation.errors, name, column) for column in ERRORS)
        change.add_row(name, FORMS[name].against, *(_percent(mean, spread) for mean, spread in pairs))
    return absolute, by_class, change


def _head(table: Table, *columns: str) -> None:
    for index, column in enumerate(columns):
        table.add_column(column.removeprefix("class_").replace("_", " "), justify="left" if index == 0 else "right")


def _cell(values: Sequence[float], column: str) -> str:
    scale, digits = (100, 1) if column == "coverage" else (1, 3)
    spread = _spread(values)
    mean = f"{scale * statistics.fmean(values):.{digits}f}"
    return mean if math.isnan(spread) else f"{mean} ± {scale * spread:.{digits}f}"


def _percent(mean: float, spread: float) -> str:
    if math.isnan(mean):
        return "-"
    return f"{100 * mean:+.1f} %" if math.isnan(spread) else f"{100 * mean:+.1f} ± {100 * spread:.1f} %"


def time_associations(size: tuple[int, int], returns: Sequence[int], rounds: int) -> list[dict[str, float]]:
    """Milliseconds, GFLOP and memory of stage 1 alone: for each number of returns, both forms in turns."""
    rows = []
    for count in returns:
        sections = [_association(FORMS[name], Size.padded(*size, count)) for name in (EMBEDDING, REGIONS)]
        tasks = [dataclasses.replace(section.task, name=name) for name, section in zip("ab", sections, strict=True)]
        times = in_rotation(tasks, Schedule(rounds, 120.0), "cpu", lambda done, total: None)
        row: dict[str, float] = {"returns": count}
        for name, label, section in zip(("embedding", "regions"), "ab", sections, strict=True):
            row[f"{name}_ms"] = statistics.median(times.of(label))
            row[f"{name}_gflop"] = section.gflop
            row[f"{name}_memory_mb"] = section.peak_memory_mb
        row["times_embedding"] = float(np.median(times.of("b") / times.of("a")))
        rows.append(row)
    return rows


def _association(form: Form, size: Size) -> Section:
    running = Running.start(Subject(form.network, architecture=form.architecture, precision="float32"))
    (section,) = dissect(running, NetworkInputs.synthetic(size, running.focal_length_px), "association").sections
    return section


def time_table(rows: Sequence[Mapping[str, float]]) -> Table:
    """The times of both associations."""
    table = Table(title="Association alone")
    names = ("ms", "gflop", "memory_mb")
    for column in ("returns", *(f"{form} {name}" for form in ("embedding", "regions") for name in names), "times"):
        table.add_column(column.replace("_", " "), justify="right")
    for row in rows:
        cells = (f"{row[f'{form}_{name}']:.1f}" for form in ("embedding", "regions") for name in names)
        table.add_row(f"{row['returns']:.0f}", *cells, f"{row['times_embedding']:.1f}")
    return table


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    Budget.add_options(parser, iterations=2000)
    parser.add_argument("--test-bags", type=Path, nargs="+", help="to measure on; --validation-bags by default")
    parser.add_argument("--config", type=Path, help="a recipe as of `train --config`, for what is not given here")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--network", choices=sorted({form.network for form in FORMS.values()}), default="baff")
    parser.add_argument("--forms", nargs="+", choices=FORMS, metavar="NAME", help="all of --network by default")
    parser.add_argument("--first-seed", type=int, default=0, help="of --seeds that follow one another")
    parser.add_argument("--teacher", type=Path, help="weights that taught forms learn from")
    parser.add_argument(
        "--backbone-weights", help="of all forms, as of `train`: imagenet, or a file; random by default"
    )
    parser.add_argument("--returns", type=int, default=24, help="of the forms with few returns")
    parser.add_argument("--time-returns", type=int, nargs="*", default=[10, 30, 100], help="of `baff`; none: no timing")
    parser.add_argument("--rounds", type=int, default=20, help="turns of the timing")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    options.test_bags = options.test_bags or options.validation_bags
    options.forms = options.forms or list(forms_of(options.network))
    return options


def _stop(number: int, _: object) -> None:
    # subprocess.run ends its child when this passes through it; its checkpoint is no older than two minutes.
    raise SystemExit(128 + number)


def main() -> None:
    """Trains, measures, times, prints tables."""
    options = _options()
    signal.signal(signal.SIGTERM, _stop)
    options.out.mkdir(parents=True, exist_ok=True)
    console, ablation = Console(stderr=options.json == "-"), Ablation(options)
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for name in options.forms:
            errors = ablation.run(name, seed)
            console.print(f"{name}, seed {seed}: MAE {errors['mae_80']:.3f} m, RMSE {errors['rmse_80']:.3f} m (80 m)")
            write_json(ablation.as_json(), str(options.out / "ablation.json"))
    for table in tables(ablation):
        console.print(table)
    figures = ablation.as_json()
    if options.time_returns and options.network == "baff":
        size = (448, 800)
        figures["association_time"] = time_associations(size, options.time_returns, options.rounds)
        console.print(time_table(figures["association_time"]))
    write_json(figures, str(options.out / "ablation.json"))
    if options.json:
        write_json(figures, options.json)


if __name__ == "__main__":
    main()
