"""The observer of a run, and the reports that it is given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from radcam_depth_ros.training.validation import ValidationResult


@dataclass(frozen=True)
class StepReport:
    """What an observer is told after each iteration.

    Attributes:
        step: Iterations done.
        progress: Share of the run that is done, 0 to 1.
        loss: Mean of the total loss over the last iterations.
        iterations_per_second: Over the last iterations.
        best_score: Lowest validation error so far, metres.
    """

    step: int
    progress: float
    loss: float
    iterations_per_second: float
    best_score: float


@dataclass(frozen=True)
class ValidationReport:
    """What an observer is told after each validation.

    Attributes:
        step: Iterations done.
        result: On the validation samples.
        rehearsal: On those of a former training, where it is rehearsed.
        is_best: Whether these are the best weights so far.
    """

    step: int
    result: ValidationResult
    rehearsal: ValidationResult | None
    is_best: bool


class Observer(Protocol):
    """Follows a run: a progress bar, or nothing."""

    def on_step(self, report: StepReport) -> None:
        """After each iteration."""

    def on_validation(self, report: ValidationReport) -> None:
        """After each validation."""

    def on_note(self, text: str) -> None:
        """When something happened that a user should know."""
