"""Writes a run as one HTML page: its recipe, its curves, and held-out frames."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from radcam_depth_ros.networks import Network
from radcam_depth_ros.reporting.page import write_report
from radcam_depth_ros.reporting.panel import Panel
from radcam_depth_ros.reporting.plot import Curve, Plot
from radcam_depth_ros.reporting.table import Fact
from radcam_depth_ros.training.data.samples import TrainingSample
from radcam_depth_ros.training.precision import Precision
from radcam_depth_ros.training.validation import predict

Metrics = Sequence[Mapping[str, Any]]

_PLOTS = (
    ("Loss", "weighted sum", (("train", "total", "loss"),)),
    (
        "Parts of the loss",
        "before weighting",
        tuple(("train", name, name) for name in ("association", "choice", "log_depth", "confidence")),
    ),
    (
        "Error of the dense depth",
        "m",
        (
            ("validation", "mae_50_m", "MAE within 50 m"),
            ("validation", "mae_80_m", "MAE within 80 m"),
            ("validation", "rmse_80_m", "RMSE within 80 m"),
            ("rehearsal", "mae_80_m", "MAE within 80 m, rehearsed"),
        ),
    ),
    (
        "Error of the semi-dense depth",
        "m",
        (("validation", "semi_dense_mae_m", "MAE"), ("rehearsal", "semi_dense_mae_m", "MAE, rehearsed")),
    ),
    (
        "Semi-dense depth",
        "share of the pixels within 80 m",
        (("validation", "semi_dense_share", "share"), ("rehearsal", "semi_dense_share", "share, rehearsed")),
    ),
    ("Learning rate", "step length", (("train", "learning_rate", "learning rate"),)),
    ("Gradient", "norm before clipping", (("train", "gradient_norm", "norm"),)),
)
"""Title, label of the vertical axis, and curves: kind of line, its value and name."""


def write_page(
    path: Path, title: str, facts: Sequence[tuple[str, str]], metrics: Metrics, panels: Sequence[Panel]
) -> None:
    """Writes the page, whole or not at all.

    Args:
        path: The HTML file.
        title: Its heading.
        facts: Names and values of what the run is made of, and where it stands.
        metrics: Lines of `metrics.jsonl`.
        panels: Frames to show.

    Raises:
        FileError: when it cannot be written.
    """
    lines = [Fact(name, value) for name, value in facts]
    write_report(path, title, lines, panels=panels, plots=plots_of(metrics))


def plots_of(metrics: Metrics) -> tuple[Plot, ...]:
    """The curves that there are values for."""
    plots = []
    for title, label, choices in _PLOTS:
        curves = tuple(curve for kind, column, name in choices if (curve := _curve(metrics, kind, column, name)))
        if curves:
            plots.append(Plot(title, "iteration", label, curves))
    return tuple(plots)


def panels_of(network: Network, samples: Mapping[str, TrainingSample], precision: Precision) -> tuple[Panel, ...]:
    """What a network makes of some frames.

    Args:
        network: In evaluation mode.
        samples: By title.
        precision: Number format and device.
    """
    panels = []
    for title, sample in samples.items():
        dense, semi_dense, _ = predict(network, sample, precision)
        truth = sample.depth_m.astype(np.float32)
        counts = (truth > 0) & (truth <= 80)
        error = f", MAE within 80 m {np.abs(dense - truth)[counts].mean():.2f} m" if counts.any() else ""
        uv, depth_m = sample.radar[:, :2], sample.radar[:, 2]
        panels.append(Panel(f"{title}{error}", sample.image, uv, depth_m, semi_dense, dense, truth))
    return tuple(panels)


def _curve(metrics: Metrics, kind: str, column: str, name: str) -> Curve | None:
    """A curve; what was not finite leaves a gap, and None is returned where there is nothing else."""
    points = [(line["step"], line.get(column)) for line in metrics if line["kind"] == kind]
    x, y = [step for step, _ in points], [math.nan if value is None else float(value) for _, value in points]
    return None if all(math.isnan(value) for value in y) else Curve(name, x, y, is_dashed=kind == "rehearsal")


def first_middle_last(samples: Sequence[TrainingSample]) -> list[tuple[int, TrainingSample]]:
    """First, middle and last sample, with their numbers."""
    return [(index, samples[index]) for index in sorted({0, len(samples) // 2, len(samples) - 1}) if samples]
