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


class MixedOrder:
    """Which sample comes at which place, where some of another set are mixed in.

    Args:
        count: Number of samples.
        seed: Of the orders.
        rehearsed: Number of samples that are mixed in.
        share: Their share of all places.
    """

    def __init__(self, count: int, seed: int, rehearsed: int = 0, share: float = 0.0) -> None:
        self._seed = seed
        self._orders = [(0, Order(count, (seed, 0)))]
        self._rehearsal_order = Order(max(rehearsed, 1), (seed, 2))
        self._share = share if rehearsed else 0.0

    def at(self, place: int) -> tuple[bool, int]:
        """Whether a rehearsal comes at a place, and which sample of its set it is."""
        before = rehearsals_before(place, self._share)
        if rehearsals_before(place + 1, self._share) > before:
            return True, self._rehearsal_order.index(before)
        own = place - before
        start, order = next(entry for entry in reversed(self._orders) if entry[0] <= own)
        return False, order.index(own - start)

    def grow(self, count: int, place: int) -> None:
        """From a place on there are `count` samples, in another order."""
        start = place - rehearsals_before(place, self._share)
        # Batches are made ahead across a growth: two orders are in use at once.
        self._orders = [self._orders[-1], (start, Order(count, (self._seed, 0, start)))]


def rehearsals_before(place: int, share: float) -> int:
    """How many of the places before `place` are rehearsals: `share` of them, evenly spread."""
    return int(np.floor(place * share + 1e-9))
