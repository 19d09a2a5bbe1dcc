"""Facts and tables of an evaluation on the terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rich.text import Text

from radcam_depth_ros.printable import printable
from radcam_depth_ros.reporting.terminal import PlainConsole, print_table

if TYPE_CHECKING:
    from radcam_depth_ros.reporting.table import Fact, Table


def print_facts_and_tables(facts: Iterable[Fact], tables: Iterable[Table]) -> None:
    """Prints facts, a line each, then tables."""
    console = PlainConsole()
    for fact in facts:
        # Not as markup: a path may hold brackets.
        console.print(Text.assemble((f"{fact.name}: ", "dim"), printable(fact.value)))
    for table in tables:
        print_table(console, table.title, table.columns, table.rows, table.note)
