"""Hostile weight files: they are refused with a sentence, or are as the good ones."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import torch

from benchmarks.adversary.cases import DONE, REFUSED, Outcome, Place, attempt, command, defect, generator, same
from benchmarks.adversary.good_files import Hostile, write_good
from benchmarks.adversary.weight_files import hostile_file
from radcam_depth_ros.frame import LONGEST_SENTENCE, RadcamDepthError
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.networks.weights_io.archive import Archive

_BY_VERB = 0.05
"""Share of the files that `radcam-depth export` reads; the others are loaded as verbs and the node do it."""


class ArchiveAttack:
    """Loads hostile weight files.

    Args:
        seed: What they are made of.
        place: Where.
    """

    good_every = 100
    is_inside = True

    def __init__(self, seed: int, place: Place) -> None:
        torch.set_num_threads(1)
        self._seed, self._place = seed, place
        self._good = write_good(place.kept)
        self._files = (place.kept / "good.pt", place.kept / "good.safetensors")
        self._expected = [_depth(archive.load(file)) for file in self._files]

    def run(self, number: int) -> Outcome:
        """Loads a file, or has `export` read it."""
        rng = generator(self._seed, "archives", number)
        hostile = hostile_file(rng, self._good)
        path = self._place.inputs / f"hostile{hostile.suffix}"
        path.write_bytes(hostile.content)
        for name, content in hostile.beside:
            (self._place.inputs / name).write_bytes(content)
        found: list[str] = []
        with self._place.watched() as problems:
            verdict = (self._by_verb if rng.random() < _BY_VERB else self._by_loading)(path, hostile, rng, found)
        return Outcome(hostile.what, verdict, (*problems, *found))

    def good(self) -> tuple[str, ...]:
        """Loads the good files."""
        files = zip(self._files, self._expected, strict=True)
        return tuple(problem for file, expected in files for problem in _compared(file, expected))

    def close(self) -> None:
        """Nothing was started."""

    def _by_loading(self, path: Path, hostile: Hostile, rng: random.Random, found: list[str]) -> str:
        # The node's own default is to take no export at all.
        allowed = rng.random() < 0.9
        try:
            loaded = archive.load(path, allow_exported=allowed)
        except RadcamDepthError as error:
            if not 10 < len(str(error)) <= LONGEST_SENTENCE:
                found.append(f"a sentence of {len(str(error))} characters")
            return "refused"
        except Exception as error:
            found.append(defect(error))
            return "failed"
        if not hostile.may_load or (not allowed and path.suffix != ".safetensors"):
            found.append("it was loaded")
        if hostile.must_equal and not same(_depth(loaded), self._expected[hostile.suffix == ".safetensors"]):
            found.append("it was loaded and gives another depth")
        return "loaded"

    def _by_verb(self, path: Path, hostile: Hostile, rng: random.Random, found: list[str]) -> str:
        target = self._place.outputs / "out.pt"
        code = attempt(found, lambda: command("export", target, "--model", path))
        if code == DONE and not hostile.may_load:
            found.append("it was exported")
        if code == REFUSED and self._place.left():
            found.append(f"refused, but left {', '.join(self._place.left())}")
        return {DONE: "loaded", REFUSED: "refused"}.get(code or 0, "failed") if code is not None else "failed"


def _compared(file: Path, expected: np.ndarray) -> list[str]:
    """What is wrong with a good file."""
    try:
        return [] if same(_depth(archive.load(file)), expected) else [f"{file.name} gives another depth"]
    except Exception as error:
        return [f"{file.name}: {defect(error)}"]


def _depth(loaded: Archive) -> np.ndarray:
    """What a network gives for an input that is always the same."""
    image = torch.linspace(0, 1, 3 * 64 * 96).reshape(1, 3, 64, 96)
    radar, ground = torch.tensor([[[40.0, 30, 20, 5, 1, 0]]]), torch.full((1, 4), float("nan"))
    with torch.inference_mode():
        dense: np.ndarray = loaded.network(image, radar, torch.ones(1, 1, dtype=torch.bool), ground)[0].numpy()
    return dense
