"""Facts and tables of text."""

from __future__ import annotations

import math
from dataclasses import dataclass

from radcam_depth_ros.reporting.errors import ReportError


@dataclass(frozen=True)
class Fact:
    """A name and a value above a report's tables."""

    name: str
    value: str


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        title: Above it.
        columns: Headings; the first column names the row.
        rows: Cells, as many a row as there are columns.
        note: Below it; explains its terms.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ReportError(f"table {self.title!r} has {len(self.columns)} columns, but {len(row)} cells: {row}")


def number(value: float, digits: int = 2) -> str:
    """A number for a cell; a dash where there is none."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"
