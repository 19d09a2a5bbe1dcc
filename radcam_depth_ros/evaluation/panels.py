"""Selects the frames of an evaluation that a report shows: evenly spaced ones and the worst."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from radcam_depth_ros.evaluation.drive import Observation
from radcam_depth_ros.reporting.panel import Panel


class PanelKeeper:
    """Keeps a few evenly spaced frames of drives of any length, and the worst ones: a failure's picture says most.

    Pass `add` to `evaluate_drives` as its observer. No more than twice the number of panels are held at a time.

    Args:
        count: Number of evenly spaced frames.
        worst: Number of frames with the largest errors.
    """

    def __init__(self, count: int = 4, worst: int = 3) -> None:
        self._count, self._worst_count = count, worst
        self._seen, self._step = 0, 1
        self._kept: list[tuple[int, Panel]] = []
        self._worst: list[tuple[float, Panel]] = []

    def add(self, observation: Observation) -> None:
        """Looks at a frame; frames come in order."""
        number, mae_m = self._seen, observation.mae_m
        self._seen += 1
        is_even = self._count > 0 and number % self._step == 0
        # A comparison with NaN, of a frame without ground truth, is false.
        is_bad = self._worst_count > 0 and mae_m > (
            self._worst[-1][0] if len(self._worst) == self._worst_count else -1.0
        )
        if not is_even and not is_bad:
            return
        # What is not shown is not kept: full images of a few frames are much memory.
        panel = _panel(observation)
        if is_bad:
            worst = [*self._worst, (mae_m, panel)]
            self._worst = sorted(worst, key=lambda entry: -entry[0])[: self._worst_count]
        if is_even:
            self._kept.append((number, panel))
        if len(self._kept) > 2 * self._count:
            self._step *= 2
            self._kept = [kept for kept in self._kept if kept[0] % self._step == 0]

    def panels(self) -> tuple[Panel, ...]:
        """The frames that were kept, in their order, then the worst ones, the worst of all first."""
        picks = np.unique(np.linspace(0, len(self._kept) - 1, min(self._count, len(self._kept))).round().astype(int))
        panels = [self._kept[pick][1] for pick in picks]
        for place, (_, panel) in enumerate(self._worst):
            remark = "the worst" if not place else f"number {place + 1} of the worst"
            panels.append(dataclasses.replace(panel, title=f"{panel.title}, {remark}"))
        return tuple(panels)


def _panel(observation: Observation) -> Panel:
    frame, name = observation.sample.frame, observation.drive.name
    error = f", MAE {observation.mae_m:.2f} m" if math.isfinite(observation.mae_m) else ""
    place = f"frame {observation.index}{f' of {name}' if name else ''}"
    title = f"{place}, stamp {frame.stamp_ns / 1e9:.3f} s{error}"
    geometry_m = observation.baselines.get("ground_nearest")
    return Panel.of(title, frame, observation.result, observation.sample.depth_m, geometry_m)
