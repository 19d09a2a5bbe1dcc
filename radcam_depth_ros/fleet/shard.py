"""Shares of the drives for jobs that run apart: `i/n`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from radcam_depth_ros.fleet.errors import FleetError

EntryT = TypeVar("EntryT")


@dataclass(frozen=True)
class Shard:
    """One share of several.

    Attributes:
        index: Which one, counted from 0 (Kubernetes, AWS Batch) or from 1: `0/n` and `n/n` are the same, so that
            either way of counting takes each drive once.
        count: How many there are.
    """

    index: int = 0
    count: int = 1

    def __post_init__(self) -> None:
        if self.count < 1 or not 0 <= self.index <= self.count:
            raise FleetError(
                f"expected a shard i/n with n of at least 1 and i from 0 to n, got {self.index}/{self.count}; count "
                "either from 0 to n - 1 or from 1 to n"
            )

    @classmethod
    def parse(cls, text: str) -> Shard:
        """From `i/n`; FleetError for anything else."""
        found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
        if found is None:
            raise FleetError(f"expected a shard as i/n, such as 0/8 for the first of eight, got {text!r}")
        return cls(int(found[1]), int(found[2]))

    def take(self, entries: Sequence[EntryT]) -> tuple[EntryT, ...]:
        """Every n-th entry: neighbours, which are often alike, go to different shards."""
        return tuple(entries[self.index % self.count :: self.count])
