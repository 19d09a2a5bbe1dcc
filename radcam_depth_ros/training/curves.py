"""The record of a run: one JSON object a line, and the same for TensorBoard where that is asked for."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from radcam_depth_ros.extras import install_extra
from radcam_depth_ros.files import write_text
from radcam_depth_ros.training.errors import TrainingError


class MetricsLog:
    """`metrics.jsonl`: lines with `kind` `train` or `validation` and `step`; lines of one run, however often resumed.

    Args:
        path: The file.
        resume_step: Lines after this step were written by a run that was cut off, and are dropped; None drops all.
        tensorboard: Write events into the folder `tensorboard` beside it as well.

    Raises:
        TrainingError: when TensorBoard is asked for and not installed.
    """

    def __init__(self, path: Path, resume_step: int | None, tensorboard: bool = False) -> None:
        self._path = path
        self._events = _events(path.parent / "tensorboard", resume_step or 0) if tensorboard else None
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
        if self._events is not None:
            for name, value in values.items():
                self._events.add_scalar(f"{kind}/{name}", value, step)
            self._events.flush()


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """All whole lines of a `metrics.jsonl`; none when it does not exist."""
    if not path.is_file():
        return []
    # A run that was killed while it wrote leaves half a line at the end.
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.endswith("}")]


def require_tensorboard() -> Any:
    """The class that writes events.

    Raises:
        TrainingError: when TensorBoard is not installed.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise TrainingError(
            "TensorBoard is not installed; leave --tensorboard out, since report.html in the run's folder has the same "
            f"curves, or {install_extra('train')}"
        ) from None
    return SummaryWriter


def _events(folder: Path, step: int) -> Any:
    return require_tensorboard()(str(folder), purge_step=step + 1)
