"""Orders samples by a function of seed and position, without state.

A run that is resumed, and each of several processes that share a batch, so find the same samples.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


class Order:
    """An endless order of samples: each comes once an epoch, in another order each time.

    Args:
        count: Number of samples.
        seed: Of the orders.
    """

    def __init__(self, count: int, seed: int | tuple[int, ...]) -> None:
        self._count = count
        self._seed = seed if isinstance(seed, tuple) else (seed,)
        self._epochs: dict[int, npt.NDArray[np.int64]] = {}

    def index(self, place: int) -> int:
        """The sample at a place."""
        epoch, offset = divmod(place, self._count)
        order = self._epochs.get(epoch)
        if order is None:
            order = np.random.default_rng((*self._seed, epoch)).permutation(self._count)
            # Batches are made ahead across the end of an epoch: two orders are in use at once.
            self._epochs = {key: value for key, value in self._epochs.items() if key >= epoch - 1}
            self._epochs[epoch] = order
        return int(order[offset])


def rehearsals_before(place: int, share: float) -> int:
    """How many of the places before `place` are rehearsals: `share` of them, evenly spread."""
    return int(np.floor(place * share + 1e-9))
