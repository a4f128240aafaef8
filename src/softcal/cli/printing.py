"""What many commands print alike: tables, and warnings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import typer

from softcal.errors import Fault

if TYPE_CHECKING:
    from rich.table import Table

LOG_WIDTH = 160  # a log does not wrap


def print_table(table: Table) -> None:
    """Print a table as wide as the terminal, or as a log where there is none."""
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console = Console(width=LOG_WIDTH)
    console.print(table)


def print_warnings(warnings: Iterable[str | Fault]) -> None:
    """Tell each warning on the error stream."""
    for warning in warnings:
        typer.echo(f"Warning: {warning}", err=True)
