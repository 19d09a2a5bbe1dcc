"""Sums over frames that can be written as JSON and joined: the sums of two drives, joined, are those of both.

A drive is summed up alone, then joined with others, one after the other. So the order of all additions is the same
whether one process measures all drives or several measure some each, and so is every digit of the result.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from radcam_depth_ros.evaluation.measures.errors import EvaluationError


class Sums:
    """Base of what is summed up over frames.

    Attributes:
        SUMMED: Names of the attributes that are sums: numbers, fractions, numpy's arrays, counters, sets, other `Sums`,
            tuples and mappings of these, and growing arrays (`array`), which are put one behind the other. A mapping
            makes what it has no key for (`defaultdict`).
    """

    SUMMED: ClassVar[tuple[str, ...]]

    def plain(self) -> dict[str, Any]:
        """The sums as JSON can hold them, to the last digit."""
        return {name.lstrip("_"): _plain(getattr(self, name)) for name in self.SUMMED}

    def join(self, plain: Mapping[str, Any]) -> None:
        """Adds the sums of other frames.

        Args:
            plain: What `plain` gave of sums of the same kind and settings.

        Raises:
            EvaluationError: when they are of another kind.
        """
        try:
            for name in self.SUMMED:
                setattr(self, name, _joined(getattr(self, name), plain[name.lstrip("_")]))
        except (KeyError, TypeError, ValueError) as error:
            raise EvaluationError(
                f"expected sums as {type(self).__name__} of these settings has them, got another form ({error}); "
                "evaluate the drive again"
            ) from None


def _plain(value: Any) -> Any:
    if isinstance(value, Sums):
        return value.plain()
    if isinstance(value, (np.ndarray, array)):
        return value.tolist()
    if isinstance(value, Counter):
        return [list(pair) for pair in value.items()]
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, set):
        return sorted(value)
    return str(value) if isinstance(value, Fraction) else value


def _joined(own: Any, plain: Any) -> Any:
    if isinstance(own, Sums):
        own.join(plain)
        return own
    if isinstance(own, np.ndarray):
        added = np.asarray(plain, own.dtype)
        if added.shape != own.shape:
            raise ValueError(f"shape {added.shape} in place of {own.shape}")
        return own + added
    if isinstance(own, Counter):
        return own + Counter(dict(plain))
    if isinstance(own, dict):
        for key, entry in plain.items():
            own[key] = _joined(own[key], entry)
        return own
    if isinstance(own, array):
        return own + array(own.typecode, plain)
    if isinstance(own, tuple):
        return tuple(_joined(*pair) for pair in zip(own, plain, strict=True))
    if isinstance(own, set):
        return own | set(plain)
    return own + (Fraction(plain) if isinstance(own, Fraction) else plain)
