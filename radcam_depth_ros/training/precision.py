"""The device and number format of a training."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import torch

from radcam_depth_ros.engine import choose
from radcam_depth_ros.training.errors import TrainingError


@dataclass(frozen=True)
class Precision:
    """A device and the number format of its convolutions.

    Attributes:
        device: Where tensors are.
        dtype: float32, or bfloat16 through autocast.
    """

    device: torch.device
    dtype: torch.dtype

    @classmethod
    def choose(cls, precision: str, device: str) -> Precision:
        """From a recipe's values.

        Args:
            precision: `float32`, `bfloat16`, or `auto`: see `engine.choose`.
            device: `cpu`, `cuda` or `cuda:N`.

        Raises:
            TrainingError: for a device that is not there.
        """
        try:
            place = torch.device(device)
        except RuntimeError:
            raise TrainingError(f"device must be 'cpu' or 'cuda', got {device!r}") from None
        if place.type == "cuda" and not torch.cuda.is_available():
            raise TrainingError("device is 'cuda', but this machine has no GPU that torch can use; set device: cpu")
        return cls(place, choose(precision, place).dtype)

    def autocast(self) -> AbstractContextManager[object]:
        """The context that the forward pass runs in."""
        if self.dtype == torch.float32:
            return nullcontext()
        return torch.autocast(self.device.type, self.dtype)
