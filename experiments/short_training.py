"""Runs one of many short trainings that are compared: resumable, and never run twice."""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from radcam_depth_ros.files import write_text
from radcam_depth_ros.training.fit import CHECKPOINT, METRICS

RUN_FILE = "run.yaml"


@dataclass(frozen=True)
class Budget:
    """What all trainings of a comparison have in common.

    Attributes:
        bags: To train on.
        validation_bags: To validate on, once, at the end.
        cache: Folder of prepared samples.
        iterations: Of each training.
        batch: Samples an iteration.
        crop: Height and width of the crops.
        frames: Frames of the validation.
        recipe: What else differs from `radcam-depth train`'s defaults.
    """

    bags: tuple[Path, ...]
    validation_bags: tuple[Path, ...]
    cache: Path
    iterations: int
    batch: int = 4
    crop: tuple[int, int] = (320, 256)
    frames: int = 80
    recipe: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, options: argparse.Namespace, recipe: Mapping[str, Any]) -> Budget:
        """From a command's options; see `add_options`."""
        height, _, width = options.crop.partition("x")
        return cls(
            tuple(options.bags),
            tuple(options.validation_bags),
            options.cache or options.out / "cache",
            options.iterations,
            options.batch,
            (int(height), int(width)),
            options.frames,
            recipe,
        )

    @staticmethod
    def add_options(parser: argparse.ArgumentParser, iterations: int) -> None:
        """Options for all that `of` takes."""
        parser.add_argument("--bags", type=Path, nargs="+", required=True, help="to train on")
        parser.add_argument("--validation-bags", type=Path, nargs="+", required=True)
        parser.add_argument("--out", type=Path, required=True, help="folder of the runs")
        parser.add_argument("--cache", type=Path, help="of prepared samples; in --out by default")
        parser.add_argument("--iterations", type=int, default=iterations, help="of each training")
        parser.add_argument("--batch", type=int, default=4, help="samples an iteration")
        parser.add_argument("--crop", default="320x256", help="height x width of the crops, multiples of 32")
        parser.add_argument("--frames", type=int, default=80, help="frames that errors are measured on")

    def mapping(self, architecture: Mapping[str, Any], seed: int) -> dict[str, Any]:
        """The recipe of one training, as its YAML file has it."""
        recipe = dict(self.recipe)
        return {
            **recipe,
            "architecture": {**recipe.get("architecture", {}), **architecture},
            "seed": seed,
            "iterations": self.iterations,
            "checkpoint_every_minutes": 2.0,
            "phases": [{"share": 1.0, "crops": [list(self.crop)], "batch": self.batch}],
            # The averaged weights must have forgotten the first ones by the end.
            "optimiser": {
                "warm_up_iterations": min(100, self.iterations // 10),
                "average_decay": min(0.995, max(0.5, 1.0 - 10.0 / self.iterations)),
                **recipe.get("optimiser", {}),
            },
            "validation": {"every_iterations": self.iterations, "frames": self.frames},
        }


@dataclass(frozen=True)
class ShortTraining:
    """A training by `radcam-depth train` in a folder of its own.

    Attributes:
        folder: Of the run.
        budget: What it has in common with others.
        network: Its name in the registry.
        architecture: Values of its config that differ from its defaults.
        seed: Of weights, order and augmentation.
        sources: Options of `radcam-depth train` for weights that it starts or learns from: `--teacher`, for example.
    """

    folder: Path
    budget: Budget
    network: str
    architecture: Mapping[str, Any]
    seed: int = 0
    sources: Mapping[str, str] = field(default_factory=dict)

    @property
    def weights(self) -> Path:
        """The trained weights."""
        return self.folder / f"{self.network}.safetensors"

    def run(self) -> dict[str, float]:
        """Trains, or goes on where it was cut off; at once where it is done. Its only validation.

        Raises:
            SystemExit: when the training fails or is stopped, or the folder holds another training.
        """
        recipe = self.folder.with_name(f"{self.folder.name}.yaml")
        text = yaml.safe_dump(self.budget.mapping(self.architecture, self.seed), sort_keys=False)
        if self.folder.exists() and (not recipe.exists() or recipe.read_text(encoding="utf-8") != text):
            raise SystemExit(f"{self.folder} was trained by another recipe; choose another --out, or remove it")
        write_text(recipe, text)
        if not self._validation():
            self._train(recipe)
        found = self._validation()
        if found is None:
            raise SystemExit(f"expected weights and a validation in {self.folder}, found none; remove it, start again")
        return found

    def _train(self, recipe: Path) -> None:
        command = [sys.executable, "-m", "radcam_depth_ros.cli", "train", "--out", str(self.folder)]
        if (self.folder / CHECKPOINT).exists():
            command += ["--resume"]
        else:
            # Cut off before its first checkpoint: nothing is lost.
            shutil.rmtree(self.folder, ignore_errors=True)
            for option, bags in (("--bags", self.budget.bags), ("--validation-bags", self.budget.validation_bags)):
                command += [word for bag in bags for word in (option, str(bag))]
            command += ["--network", self.network, "--config", str(recipe), "--cache", str(self.budget.cache)]
            command += [word for option in self.sources.items() for word in option]
        log = self.folder.with_name(f"{self.folder.name}.log")
        with log.open("a", encoding="utf-8") as file:
            done = subprocess.run(command, stdout=file, stderr=subprocess.STDOUT, check=False)
        if done.returncode:
            raise SystemExit(f"{self.folder.name} ended with exit code {done.returncode}; {log} says why")

    def _validation(self) -> dict[str, float] | None:
        path = self.folder / METRICS
        if not path.exists() or not self.weights.exists():
            return None
        rows: list[dict[str, Any]] = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        return next((row for row in rows if row["kind"] == "validation"), None)
