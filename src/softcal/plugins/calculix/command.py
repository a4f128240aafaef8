"""The command `softcal crosscheck`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from softcal.cli.command import FAILED, register_command
from softcal.cli.printing import echo, print_table, shown_path
from softcal.cli.running import clock, executor_told
from softcal.cli.values import LOCAL, On, Pull, Source, Values, Workers, names, parsed_values

if TYPE_CHECKING:
    from rich.table import Table

    from softcal.plugins.calculix.crosscheck import EngineComparison

AT_REST = "at rest"


@register_command("other programs", 2)
def crosscheck(
    source: Source,
    engines: Annotated[
        str, typer.Option(metavar="NAMES", help="Such as softcal,calculix; all by default.", show_default=False)
    ] = "",
    pull: Pull = None,
    values: Values = None,
    timeout: Annotated[
        str,
        typer.Option(
            metavar="TIME",
            help="End an engine's process after this long (10min); by default 30 min, and for SOFA as in the project.",
            show_default=False,
        ),
    ] = "",
    workers: Workers = None,
    on: On = LOCAL,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write the table and the verdicts: a folder that is new or empty.", show_default=False
        ),
    ] = None,
) -> None:
    """Compare engines: the same robot, mesh and loads in each one that is installed, and whether they agree.

    Ends with 0 where all that could be compared agree, 1 where one differs or fails, or none could be compared, and 2
    where nothing moves the robot.
    """
    from softcal.quantities import QUANTITIES
    from softcal.workflows.output import require_free_folder
    from softcal.workflows.study_source import load_calibrated

    longest = QUANTITIES["duration"].read(timeout, where="--timeout") if timeout else None
    if out is not None:
        require_free_folder(out)
    project = load_calibrated(source, parsed_values(values))
    from softcal.plugins.calculix.workflow import NOTHING_MOVES, crosscheck_project, write_crosscheck
    from softcal.workflows.cases import cases

    chosen = cases(project, pull or ())
    with executor_told(on, workers) as executor, clock() as show:
        found = crosscheck_project(
            project,
            chosen,
            names(engines),
            timeout=longest,
            workers=executor,
            progress=lambda state, engine: show(f"{state or AT_REST}: {engine} compared with softcal"),
        )
    absent: dict[str, str] = {}
    refused: dict[str, str] = {}
    for state, result in found.items():
        for comparison in result.comparisons:
            echo(f"{state or AT_REST}: {comparison.engine}")
            print_table(_table(comparison))
            for change in comparison.changed:
                echo(f"For {comparison.engine}, and for softcal in this comparison: {change}")
            echo(f"{state or AT_REST}: {comparison.verdict}.\n")
        if result.still:
            echo(f"{state or AT_REST}: {NOTHING_MOVES}.\n")
        for name, why in result.failed.items():
            echo(f"{state or AT_REST}: {name} failed: {why}", err=True)
        absent |= result.absent
        refused |= result.refused
    for name, why in refused.items():
        echo(f"{name} was skipped, it does not support this robot: {why}", err=True)
    for name, why in absent.items():
        echo(f"{name} was skipped, it is not installed: {why}", err=True)
    if out is not None:
        write_crosscheck(project, found, out)
        echo(f"Wrote {shown_path(out)}")
    compared = any(result.comparisons for result in found.values())
    if not compared or not all(result.agrees for result in found.values()):
        raise typer.Exit(FAILED)


def _table(comparison: EngineComparison) -> Table:
    from rich.table import Table

    table = Table("", "unit", "softcal", comparison.engine, "differ by", "relative")
    for one in comparison.differences:
        numbers = (f"{one.softcal:.6g}", f"{one.engine:.6g}", f"{one.absolute:.1e}", f"{one.relative:.1e}")
        table.add_row(one.quantity, one.unit, *numbers)
    return table
