"""Curves and bars over one axis, drawn as SVG."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

from radcam_depth_ros.reporting.errors import ReportError


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
            raise ReportError(f"curve {self.name!r} needs as many x as y, got {len(self.x)} and {len(self.y)}")


@dataclass(frozen=True)
class Plot:
    """Curves over one axis.

    Attributes:
        title: Above it.
        x_label: With its unit.
        y_label: With its unit.
        curves: The lines.
        note: Below it.
        bars: Values drawn as bars behind the curves, at evenly spaced x; None for no bars.
    """

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    note: str = ""
    bars: Curve | None = None


def draw_plot(plot: Plot) -> bytes:
    """A plot as an SVG file."""
    # Imported here: it takes half a second, and only a report draws.
    import matplotlib
    from matplotlib.figure import Figure

    # Text stays text; names of parts are the same each time.
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": plot.title, "font.size": 9}):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        axes = figure.subplots()
        if plot.bars is not None:
            width = 0.8 * abs(plot.bars.x[1] - plot.bars.x[0]) if len(plot.bars.x) > 1 else 0.8
            axes.bar(plot.bars.x, plot.bars.y, width, label=plot.bars.name, color="0.75")
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
