"""Hostile messages: see `benchmarks.fuzz`, which sends them; here each is a case."""

from __future__ import annotations

import warnings

import torch

from benchmarks.adversary.cases import Outcome, Place
from benchmarks.adversary.good_files import write_good
from benchmarks.fuzz import Fuzz
from radcam_depth_ros.estimator import Estimator, EstimatorConfig


class MessageAttack:
    """Sends messages one after another; what one leaves behind, the next ones meet.

    Args:
        seed: What they are made of.
        place: Where the weights are.
    """

    good_every = 100
    is_inside = True

    def __init__(self, seed: int, place: Place) -> None:
        torch.set_num_threads(1)
        write_good(place.kept)
        config = EstimatorConfig(
            model_file=str(place.kept / "good.pt"), allow_exported=True, precision="float32", threads=1
        )
        self._fuzz, self._place = Fuzz(Estimator(config), seed), place
        warnings.simplefilter("error")
        self._told = 0

    def run(self, number: int) -> Outcome:
        """Sends a message, or a few that belong together."""
        with self._place.watched() as problems:
            kinds, is_refused = self._fuzz.send(number)
        return Outcome(kinds, "refused" if is_refused else "taken", (*problems, *self._news()))

    def good(self) -> tuple[str, ...]:
        """Sends good pairs."""
        self._fuzz.recover()
        return self._news()

    def close(self) -> None:
        """Nothing was started."""

    def _news(self) -> tuple[str, ...]:
        """Defects that were not told yet."""
        defects, self._told = self._fuzz.figures.defects[self._told :], len(self._fuzz.figures.defects)
        return tuple(f"{defect.kind}: {defect.problem}" for defect in defects)
