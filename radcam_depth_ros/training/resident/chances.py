"""Random numbers of a batch: few, drawn on the host, and many, drawn on the device."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor


class Chances:
    """A source of random numbers.

    Args:
        seed: What they depend on.
        device: Where tensors are.
    """

    def __init__(self, seed: tuple[int, ...], device: torch.device) -> None:
        self.host = np.random.default_rng(seed)
        self._device = device
        self._generator = torch.Generator(device).manual_seed(int(self.host.integers(2**62)))

    def some(self, count: int, probability: float) -> list[int]:
        """Which of `count` an effect of this probability happens to; drawn on the host, so that none waits for it."""
        return np.flatnonzero(self.host.random(count) < probability).tolist()

    def uniform(self, low: float, high: float, *shape: int) -> Tensor:
        """Evenly between two numbers, float32."""
        return low + (high - low) * torch.rand(shape, generator=self._generator, device=self._device)

    def normal(self, *shape: int) -> Tensor:
        """Standard normal numbers, float32."""
        return torch.randn(shape, generator=self._generator, device=self._device)
