"""Several processes, on one machine or more, that train one network together: each has a part of every batch."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import Any, TypeVar

import torch
from torch import Tensor, distributed
from torch.autograd import Function

from radcam_depth_ros.training.errors import TrainingError

ValueT = TypeVar("ValueT")

_PATIENCE = timedelta(hours=4)
"""How long the others wait while the first one prepares samples."""


class _Sum(Function):
    """What each process adds is part of what all get: so is the gradient of all part of what each gets."""

    @staticmethod
    def forward(ctx: Any, values: Tensor) -> Tensor:
        total = values.clone()
        distributed.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        total = gradient.clone()
        distributed.all_reduce(total)
        return total


@dataclass(frozen=True)
class Ranks:
    """This process among those that train together; alone by default, where all of this does nothing.

    Attributes:
        rank: Which of them this is.
        size: How many there are.
    """

    rank: int = 0
    size: int = 1

    @property
    def is_first(self) -> bool:
        """Whether this is the one that writes and prints."""
        return self.rank == 0

    def add(self, values: Tensor) -> Tensor:
        """The sum over all processes; no gradient passes."""
        if self.size > 1:
            values = values.detach().clone()
            distributed.all_reduce(values)
        return values

    def add_with_gradient(self, values: Tensor) -> Tensor:
        """The sum over all processes, for a loss that is itself the sum of all processes' losses."""
        if self.size == 1:
            return values
        total: Tensor = _Sum.apply(values)  # type: ignore[no-untyped-call]  # torch leaves it without types
        return total

    def of_first(self, value: ValueT) -> ValueT:
        """What the first process has."""
        if self.size == 1:
            return value
        values = [value]
        distributed.broadcast_object_list(values)
        return values[0]

    def gather(self, value: ValueT) -> list[ValueT]:
        """What each has, in the order of their ranks."""
        if self.size == 1:
            return [value]
        values: list[ValueT | None] = [None] * self.size
        distributed.all_gather_object(values, value)
        return [entry for entry in values if entry is not None]

    @contextmanager
    def first_goes_ahead(self) -> Iterator[None]:
        """The first process runs the block before the others do: it builds what they find."""
        if self.size > 1 and not self.is_first:
            distributed.barrier()
        yield
        if self.size > 1 and self.is_first:
            distributed.barrier()

    def part_of(self, batch: int) -> int:
        """Number of samples of a batch that are this process's.

        Raises:
            TrainingError: when the batch cannot be split.
        """
        if batch % self.size:
            raise TrainingError(
                f"a batch of {batch} samples cannot be split evenly among {self.size} processes; give the recipe's "
                f"phases a batch that is a multiple of {self.size}"
            )
        return batch // self.size


@contextmanager
def joined() -> Iterator[Ranks]:
    """The processes that `torchrun` started; this one alone without it.

    Raises:
        TrainingError: when the others cannot be reached.
    """
    size = int(os.environ.get("WORLD_SIZE", "1"))
    if size == 1:
        yield Ranks()
        return
    backend = "gloo"
    if torch.cuda.is_available():
        torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")))
        backend = "cpu:gloo,cuda:nccl"
    try:
        distributed.init_process_group(backend, timeout=_PATIENCE)
    except (RuntimeError, ValueError) as error:
        raise TrainingError(
            f"cannot reach the other processes of this training ({str(error).splitlines()[0]}); start it by torchrun"
        ) from None
    try:
        yield Ranks(distributed.get_rank(), size)
    finally:
        distributed.destroy_process_group()
