"""Printing of tables and warnings, shared by the commands."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from softcal.errors import Fault

if TYPE_CHECKING:
    from rich.table import Table

    from softcal.report.tables import ReportTable

LOG_WIDTH = 160  # a log does not wrap


def shown_path(path: Path) -> str:
    """A path as it is typed in the present folder, without `a/../b`; absolute where that is shorter."""
    absolute = os.path.abspath(path)
    try:
        return min(os.path.relpath(path), absolute, key=len)
    except ValueError:  # it lies on another drive
        return absolute


def print_table(table: Table) -> None:
    """Print a table of texts as they are, in the width of the terminal, or of a log.

    A wider table is printed in parts below each other, each with some of the columns and the first one, which names the
    rows, so that no number is cut off or wrapped if one column besides the names fits.
    """
    from rich.console import Console

    # Names may hold brackets and colons, which are no marks of Rich's.
    console = Console(markup=False, emoji=False)
    if not console.is_terminal:
        console = Console(markup=False, emoji=False, width=LOG_WIDTH)
    for part in _parts(table, console.width):
        console.print(part)


def print_report_table(table: ReportTable) -> None:
    """Print a table of a report."""
    from rich.table import Table

    shown = Table(*(column.header for column in table.columns), caption=table.note or None)
    for row in table.shown():
        shown.add_row(*row)
    print_table(shown)


def print_warnings(warnings: Iterable[str | Fault]) -> None:
    """Print each warning to the error stream."""
    for warning in warnings:
        typer.echo(f"Warning: {warning}", err=True)


def _parts(table: Table, width: int) -> list[Table]:
    """Divide a table into tables within the width."""
    names, *columns = [[str(column.header), *map(str, column.cells)] for column in table.columns]
    sections = [row.end_section for row in table.rows]
    if _frame(len(columns)) + sum(max(map(_width, column)) for column in [names, *columns]) <= width:
        return [table]
    # Dotted names of parameters may break at their dots.
    columns = [[re.sub(r"(?<=[a-z0-9])\.(?=[a-z])", ".\n", header), *cells] for header, *cells in columns]
    narrowest = max(_width(word) for name in names for word in name.split() or [""])
    parts: list[Table] = []
    first = 0
    while first < len(columns):
        last = first + 1
        while last < len(columns) and _room(columns[first : last + 1], width) >= narrowest:
            last += 1
        parts.append(_part(names, columns[first:last], sections, _room(columns[first:last], width)))
        first = last
    return parts


def _part(names: Sequence[str], columns: Sequence[Sequence[str]], sections: Sequence[bool], room: int) -> Table:
    """Some columns, with the rows that are not empty in them; names wrap within `room` characters."""
    from rich.table import Table

    narrow = room < max(_width(word) for name in names for word in name.split() or [""])
    part = Table()
    part.add_column(names[0], overflow="fold", width=None if narrow else min(room, max(map(_width, names))))
    for header, *_ in columns:
        part.add_column(header, overflow="fold", no_wrap=not narrow)
    for i, name in enumerate(names[1:], 1):
        cells = [column[i] for column in columns]
        if any(cells):
            part.add_row(name, *cells)
        if sections[i - 1] and part.row_count:
            part.add_section()
    return part


def _room(columns: Sequence[Sequence[str]], width: int) -> int:
    """Width left by these columns for the names of the rows."""
    return width - _frame(len(columns)) - sum(max(map(_width, column)) for column in columns)


def _frame(n_columns: int) -> int:
    """Width of lines and margins of a table with `n_columns` columns besides the names."""
    return 3 * (n_columns + 1) + 1


def _width(text: str) -> int:
    from rich.cells import cell_len

    return max(map(cell_len, text.split("\n")))
