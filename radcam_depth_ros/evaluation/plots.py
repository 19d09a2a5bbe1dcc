"""Curves for a report, as SVG."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

from radcam_depth_ros.evaluation.metrics import EvaluationError
from radcam_depth_ros.evaluation.sparsification import REMOVED, SparsificationCurve
from radcam_depth_ros.evaluation.summary import Evaluation
from radcam_depth_ros.evaluation.tables import BASELINE_TITLES, DENSE


@dataclass(frozen=True)
class Curve:
    """One line of a plot.

    Attributes:
        name: In the legend.
        x: Along the horizontal axis.
        y: Along the vertical axis, as many as `x`; NaN leaves a gap.
        is_dashed: Whether it is a bound rather than a result.
    """

    name: str
    x: Sequence[float]
    y: Sequence[float]
    is_dashed: bool = False

    def __post_init__(self) -> None:
        if len(self.x) != len(self.y):
            raise EvaluationError(f"curve {self.name!r} needs as many x as y, got {len(self.x)} and {len(self.y)}")


@dataclass(frozen=True)
class Plot:
    """Curves over one axis.

    Attributes:
        title: Above it.
        x_label: With its unit.
        y_label: With its unit.
        curves: The lines.
        note: Below it.
    """

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    note: str = ""


def plots_of(evaluation: Evaluation) -> tuple[Plot, ...]:
    """Error over distance, and over the share of the pixels that the confidence leaves out."""
    dense = evaluation.dense.distances
    distances = (
        Curve(DENSE, dense.middles_m, dense.mae_m),
        *(
            Curve(BASELINE_TITLES[name], depth.distances.middles_m, depth.distances.mae_m, is_dashed=True)
            for name, depth in evaluation.baselines.items()
        ),
    )
    plots = [Plot("Error over distance", "distance of the ground truth, m", "MAE, m", distances)]
    sparsification = evaluation.sparsification
    if sparsification.frames:
        plots += [
            _sparsification_plot("MAE", sparsification.mae, sparsification.within_m),
            _sparsification_plot("RMSE", sparsification.rmse, sparsification.within_m),
        ]
    return tuple(plots)


def _sparsification_plot(measure: str, curve: SparsificationCurve, within_m: float) -> Plot:
    removed = [100 * share for share in REMOVED]
    note = (
        f"Error of what is left when the least confident pixels are left out (within {within_m:g} m). The oracle "
        f"leaves out the largest errors first; the area between the two (AUSE) is {curve.ause_m:.3f} m."
    )
    curves = (
        Curve("by confidence", removed, curve.by_confidence),
        Curve("oracle", removed, curve.oracle, is_dashed=True),
    )
    return Plot(f"Sparsification, {measure}", "pixels left out, %", f"{measure}, m", curves, note)


def draw_plot(plot: Plot) -> bytes:
    """A plot as an SVG file."""
    # Imported here: it takes half a second, and only a report draws.
    import matplotlib
    from matplotlib.figure import Figure

    # Text stays text; names of parts are the same each time.
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": plot.title, "font.size": 9}):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        axes = figure.subplots()
        for curve in plot.curves:
            axes.plot(curve.x, curve.y, "--" if curve.is_dashed else "-", label=curve.name, linewidth=1.5)
        axes.set(xlabel=plot.x_label, ylabel=plot.y_label)
        axes.set_ylim(bottom=0)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
        axes.legend(frameon=False)
        file = io.BytesIO()
        figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()
