"""The record of a run: one JSON object a line, and a picture of it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from radcam_depth_ros.files import whole, write_text
from radcam_depth_ros.training.samples import TrainingError


class MetricsLog:
    """`metrics.jsonl`: lines with `kind` `train` or `validation` and `step`; lines of one run, however often resumed.

    Args:
        path: The file.
        resume_step: Lines after this step were written by a run that was cut off, and are dropped; None drops all.
    """

    def __init__(self, path: Path, resume_step: int | None) -> None:
        self._path = path
        kept = [] if resume_step is None else [line for line in read_metrics(path) if line["step"] <= resume_step]
        write_text(path, "".join(json.dumps(line) + "\n" for line in kept))

    def add(self, kind: str, step: int, values: Mapping[str, float]) -> None:
        """Adds a line; numbers that are not finite become null. TrainingError when it cannot be written."""
        numbers = {name: round(value, 6) if math.isfinite(value) else None for name, value in values.items()}
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"kind": kind, "step": step, **numbers}) + "\n")
        except OSError as error:
            raise TrainingError(f"cannot write {self._path}: {error.strerror or error}") from None


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """All whole lines of a `metrics.jsonl`; none when it does not exist."""
    if not path.is_file():
        return []
    # A run that was killed while it wrote leaves half a line at the end.
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.endswith("}")]


def draw_curves(metrics: list[dict[str, Any]], path: Path, title: str) -> None:
    """Draws losses, learning rate and validation errors over the iterations as a PNG."""
    # Imported here: it takes a second, and most users of this module only read.
    from matplotlib.figure import Figure

    panels = (
        ("loss", "train", ("total",)),
        ("parts of the loss", "train", ("association", "dense_m", "confidence")),
        ("dense error, m", "validation", ("mae_50_m", "rmse_50_m", "mae_80_m", "rmse_80_m")),
        ("semi-dense", "validation", ("semi_dense_mae_m", "semi_dense_share")),
    )
    figure = Figure(figsize=(11, 7), layout="constrained")
    figure.suptitle(title)
    for axes, (name, kind, columns) in zip(figure.subplots(2, 2).flat, panels, strict=True):
        for column in columns:
            points = [(line["step"], line[column]) for line in metrics if line["kind"] == kind and line.get(column)]
            axes.plot(*zip(*points, strict=True) if points else ([], []), label=column, linewidth=1)
        axes.set_title(name)
        axes.set_xlabel("iteration")
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
        axes.legend()
    with whole(path) as partial:
        figure.savefig(partial, format="png", dpi=90)
