"""Tables for a terminal of any width: nothing is cut off, and only prose is wrapped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, JustifyMethod
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from radcam_depth_ros.printable import printable

_INDENT, _GAP = "  ", "   "


class PlainConsole(Console):
    """rich's console for texts that others gave: no markup in them, and no control characters."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(markup=False, **settings)

    def print(self, *objects: Any, **settings: Any) -> None:
        """As rich has it."""
        super().print(*(printable(item) if isinstance(item, str) else item for item in objects), **settings)


_NOTHING = "-"
_UNBOUNDED = 100_000


def print_table(
    console: Console,
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    note: str = "",
    *,
    justify: JustifyMethod = "right",
) -> None:
    """Prints a table in the first form that fits the console.

    The forms are: with lines between the columns; without them; transposed; one block a row. A block has the row's
    first cell as its heading, and below it the other cells with their columns' names.

    Args:
        console: Where to print.
        title: Above the table.
        columns: Headings; the first column names the row.
        rows: Cells, as many a row as there are columns. No cell is read as rich's markup.
        note: Below the table; explains its terms.
        justify: Of all columns but the first: `right` for numbers, `left` for words.
    """
    columns, rows = [printable(column) for column in columns], [[printable(cell) for cell in row] for row in rows]
    console.print(Text(printable(title), style="table.title"))
    head, *body = tuple(zip(columns, *rows, strict=True))
    for table in (
        _grid(columns, rows, justify),
        _grid(columns, rows, justify, has_lines=False),
        _grid(head, body, "right"),
    ):
        if _width(console, table) <= console.width:
            console.print(table)
            break
    else:
        _print_blocks(console, columns, rows)
    if note:
        console.print(Text(printable(note), style="table.caption"))


def _grid(
    columns: Sequence[str], rows: Iterable[Sequence[str]], justify: JustifyMethod, *, has_lines: bool = True
) -> Table:
    table = Table() if has_lines else Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for index, column in enumerate(columns):
        table.add_column(Text(column), justify=justify if index else "left", no_wrap=True)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def _width(console: Console, table: Table) -> int:
    """Columns of the terminal that a table takes where nothing is wrapped."""
    return Measurement.get(console, console.options.update(max_width=_UNBOUNDED), table).maximum


def _print_blocks(console: Console, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    for name, *cells in rows:
        console.print(Text(name, style="bold"))
        entries = [cell or _NOTHING for cell in cells]
        if len(entries) > 1:
            entries = [f"{column}: {entry}" for column, entry in zip(columns[1:], entries, strict=True)]
        for line in _filled(entries, console.width - len(_INDENT)):
            for part in Text(line).wrap(console, console.width - len(_INDENT)):
                part.rstrip()
                console.print(Text(_INDENT) + part)


def _filled(entries: Iterable[str], width: int) -> list[str]:
    """As many entries on a line as fit; an entry that is longer than a line has one of its own."""
    lines: list[str] = []
    for entry in entries:
        joined = f"{lines[-1]}{_GAP}{entry}" if lines else entry
        if lines and cell_len(joined) <= width:
            lines[-1] = joined
        else:
            lines.append(entry)
    return lines
