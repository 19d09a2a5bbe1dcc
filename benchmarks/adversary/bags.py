"""Hostile bags through `inspect`, `replay` and `evaluate`, within this process."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch
from rosbags.rosbag2 import StoragePlugin

from benchmarks.adversary.bag_files import FRAMES, good_messages, hostile_bag, write_bag
from benchmarks.adversary.cases import (
    DONE,
    REFUSED,
    SOME_FAILED,
    Outcome,
    Place,
    attempt,
    command,
    defect,
    generator,
    same,
)
from benchmarks.adversary.good_files import write_good
from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.messages import decode_depth

_VERDICTS = {DONE: "done", REFUSED: "refused", SOME_FAILED: "some failed", None: "failed"}


class BagAttack:
    """Gives hostile bags to verbs.

    Args:
        seed: What they are made of.
        place: Where.
    """

    good_every = 25
    is_inside = True

    def __init__(self, seed: int, place: Place) -> None:
        torch.set_num_threads(1)
        self._seed, self._place = seed, place
        write_good(place.kept)
        self._model, self._messages = place.kept / "good.pt", good_messages()
        self._drives = {plugin: place.kept / plugin.name.lower() for plugin in StoragePlugin}
        for plugin, folder in self._drives.items():
            write_bag(folder, self._messages, plugin)
        # To load it takes longer than all else; `kills` does it in every process.
        config = EstimatorConfig(model_file=str(self._model), allow_exported=True, precision="float32", threads=1)
        estimator = Estimator(config)
        for verb in ("replay", "evaluate"):
            vars(sys.modules[f"radcam_depth_ros.cli.{verb}"])["load_estimator"] = lambda config: estimator
        self._expected = self._replayed(self._drives[StoragePlugin.MCAP])
        if len(self._expected) != FRAMES:
            raise RuntimeError(f"expected {FRAMES} depth images of the good drive, got {len(self._expected)}")

    def run(self, number: int) -> Outcome:
        """Gives a bag to a verb, or to two."""
        rng = generator(self._seed, "bags", number)
        what, bag = hostile_bag(rng, self._messages, self._place.inputs)
        verb = rng.choices(("inspect", "replay", "evaluate"), (5, 3, 2))[0]
        target = self._place.outputs / ("out.mcap" if verb == "replay" else "out.json")
        arguments: dict[str, tuple[object, ...]] = {
            "inspect": rng.choice((("--json", target), ("--json", "-"), ("--write-params", target), ())),
            "replay": (target, *rng.choice(((), ("--points",), ("--passthrough",)))),
            "evaluate": ("--no-baselines", *rng.choice((("--json", target), ("--report", target), ("--csv", target)))),
        }
        found: list[str] = []
        with self._place.watched() as problems:
            code = attempt(found, lambda: command(verb, bag, *arguments[verb]), (DONE, REFUSED, SOME_FAILED))
        left = self._place.left()
        if code == REFUSED and left and not (verb == "inspect" and left == ["out.json"]):
            found.append(f"refused, but left {', '.join(left)}")
        if any(name.startswith(".") for name in left):
            found.append(f"left half a file: {', '.join(left)}")
        return Outcome(f"{what}, {verb}", _VERDICTS.get(code, "failed"), (*problems, *found))

    def good(self) -> tuple[str, ...]:
        """Replays the good drive from both storages."""
        problems = []
        for plugin, drive in self._drives.items():
            try:
                found = self._replayed(drive)
            except Exception as error:
                problems.append(f"{plugin.name}: {defect(error)}")
                continue
            if not same(found, self._expected):
                problems.append(f"{plugin.name}: the replay gives another depth")
        return tuple(problems)

    def close(self) -> None:
        """Nothing was started."""

    def _replayed(self, drive: Path) -> np.ndarray:
        """Depth of all frames of a drive."""
        self._place.clear()
        target = self._place.outputs / "good.mcap"
        code = command("replay", drive, target)
        if code != DONE:
            raise RuntimeError(f"replay of a good drive ended with exit code {code}: {self._place.told()[-300:]}")
        with BagReader(target) as reader:
            (topic,) = [topic.name for topic in reader.topics if topic.name.endswith("depth/image_rect")]
            return np.stack([decode_depth(entry.message).depth_m for entry in reader.messages([topic])])
