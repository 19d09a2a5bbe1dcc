"""Selects the frames of an evaluation that a report shows: evenly spaced ones, the best, the middle and the worst."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from radcam_depth_ros.evaluation.drive import Observation
from radcam_depth_ros.reporting.panel import Highlight, Panel

_NEAR_THE_MIDDLE = 3
"""So many frames near the median error are held; the median is known at the end alone."""


class PanelKeeper:
    """Keeps a few evenly spaced frames of drives of any length, and the worst ones: a failure's picture says most.

    Pass `add` to `evaluate_drives` as its observer. No more than twice the number of panels, and four, are held.

    Args:
        count: Number of evenly spaced frames.
        worst: Number of frames with the largest errors.
    """

    def __init__(self, count: int = 4, worst: int = 3) -> None:
        self._count, self._worst_count = count, worst
        self._seen, self._step = 0, 1
        self._kept: list[tuple[int, Panel]] = []
        self._worst: list[tuple[float, Panel]] = []
        self._best: list[tuple[float, Panel]] = []
        self._middle: list[tuple[float, Panel]] = []
        self._errors_m: list[float] = []

    def add(self, observation: Observation) -> None:
        """Looks at a frame; frames come in order."""
        number, mae_m = self._seen, observation.mae_m
        self._seen += 1
        is_even = self._count > 0 and number % self._step == 0
        # A comparison with NaN, of a frame without ground truth, is false.
        is_bad = self._worst_count > 0 and mae_m > (
            self._worst[-1][0] if len(self._worst) == self._worst_count else -1.0
        )
        is_best = bool(mae_m < (self._best[0][0] if self._best else math.inf))
        is_middle = math.isfinite(mae_m) and self._is_nearer_the_middle(mae_m)
        if not (is_even or is_bad or is_best or is_middle):
            return
        # What is not shown is not kept: full images of a few frames are much memory.
        panel = _panel(observation)
        if is_bad:
            worst = [*self._worst, (mae_m, panel)]
            self._worst = sorted(worst, key=lambda entry: -entry[0])[: self._worst_count]
        if is_best:
            self._best = [(mae_m, panel)]
        if is_middle:
            self._middle = self._nearest([*self._middle, (mae_m, panel)])[:_NEAR_THE_MIDDLE]
        if is_even:
            self._kept.append((number, panel))
        if len(self._kept) > 2 * self._count:
            self._step *= 2
            self._kept = [kept for kept in self._kept if kept[0] % self._step == 0]

    def _is_nearer_the_middle(self, mae_m: float) -> bool:
        """Notes an error, and whether its frame is nearer to the median of all so far than one that is held."""
        self._errors_m.append(mae_m)
        if len(self._middle) < _NEAR_THE_MIDDLE:
            return True
        median_m = float(np.median(self._errors_m))
        return abs(mae_m - median_m) < max(abs(error_m - median_m) for error_m, _ in self._middle)

    def _nearest(self, entries: list[tuple[float, Panel]]) -> list[tuple[float, Panel]]:
        median_m = float(np.median(self._errors_m))
        return sorted(entries, key=lambda entry: abs(entry[0] - median_m))

    def highlights(self) -> tuple[Highlight, ...]:
        """The best frame, one of about the median error, and the worst; without ground truth evenly spaced ones.

        Of a drive of few frames some are left out, so that none is shown twice.
        """
        if not self._errors_m:
            picks = np.unique(np.linspace(0, len(self._kept) - 1, min(3, len(self._kept))).round().astype(int))
            return tuple(Highlight("a frame", self._kept[pick][1]) for pick in picks)
        wanted = (("the best frame", self._best), ("the middle frame", self._nearest(self._middle)))
        shown: list[Highlight] = []
        last = self._worst[0][1] if self._worst else None
        for title, entries in wanted:
            others = {highlight.panel.title for highlight in shown} | ({last.title} if last else set())
            free = [panel for _, panel in entries if panel.title not in others]
            shown += [Highlight(title, free[0])] if free else []
        return (*shown, Highlight("the worst frame", last)) if last else tuple(shown)

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
