"""The command `softcal crosscheck`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from softcal.cli.app import FAILED, app, told
from softcal.cli.export_commands import Pull, Source, protocols_of
from softcal.cli.values import Values, names, parsed_values

if TYPE_CHECKING:
    from softcal.export.crosscheck import Comparison


@app.command()
@told
def crosscheck(
    source: Source,
    engines: Annotated[
        str, typer.Option(metavar="NAMES", help="Such as softcal,calculix; by default all.", show_default=False)
    ] = "",
    pull: Pull = None,
    values: Values = None,
) -> None:
    """Compare engines: the same robot, mesh and loads in each one that is installed, and whether they agree."""
    from softcal.project.crosschecking import crosscheck_project
    from softcal.project.exporting import load_calibrated

    project = load_calibrated(source, parsed_values(values))
    found = crosscheck_project(project, protocols_of(project, pull), names(engines))
    absent: dict[str, str] = {}
    failed = compared = 0
    for state, result in found.items():
        for comparison in result.comparisons:
            _print(state, comparison)
        for name, why in result.failed.items():
            typer.echo(f"{state or 'at rest'}: {name} failed: {why}", err=True)
        absent |= result.absent
        failed += len(result.failed)
        compared += len(result.comparisons)
    for name, why in absent.items():
        typer.echo(f"{name} was left out, it is not installed: {why}", err=True)
    if failed or not compared:
        raise typer.Exit(FAILED)


def _print(state: str, comparison: Comparison) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(state or "at rest", "unit", "softcal", comparison.engine, "difference", "relative")
    for one in comparison.differences:
        table.add_row(
            one.quantity,
            one.unit,
            f"{one.softcal:.6g}",
            f"{one.engine:.6g}",
            f"{one.absolute:.2e}",
            f"{one.relative:.1e}",
        )
    console = Console()
    if not console.is_terminal:
        console = Console(width=160)  # a log does not wrap
    console.print(table)
    for change in comparison.changed:
        typer.echo(f"For {comparison.engine}, and softcal beside it: {change}")
    typer.echo(f"{state or 'at rest'}: {comparison.verdict}.")
