"""The command `softcal next-test`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo, print_table
from softcal.cli.running import executor_told
from softcal.cli.study import CalibrationName, end_study
from softcal.cli.values import LOCAL, On, Workers


@register_command("plan", 1)
def next_test(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.", show_default=False)],
    parameter: Annotated[
        str,
        typer.Option(
            "--for",
            metavar="PARAMETER",
            help="Parameter whose interval counts; the first of the robot by default.",
            show_default=False,
        ),
    ] = "",
    calibration: CalibrationName = "",
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="A folder, new or empty, for the table.", show_default=False),
    ] = None,
    workers: Workers = None,
    on: On = LOCAL,
) -> None:
    """Rank further bench tests by the interval that a parameter is expected to have after each."""
    from softcal.workflows.output import require_free_folder

    if out is not None:
        require_free_folder(out)
    from rich.table import Table

    from softcal.calibration.results.digits import format_interval
    from softcal.workflows.next_test import NEXT_TEST, rank, run_source

    source = run_source(run, calibration)
    with executor_told(on, workers) as executor:
        tests = rank(source, parameter, workers=executor)
    table = Table("candidate", f"{tests.parameter}, 95 %", "length", "all parameters")
    table.add_row("(at present)", format_interval(tests.interval, tests.unit) if tests.interval else "none", "1", "1")
    table.add_section()
    for outlook in tests.outlooks:
        if not outlook.failure:
            interval = format_interval(outlook.interval, tests.unit) if outlook.interval else "none"
            table.add_row(outlook.candidate.name, interval, _share(outlook.share), _share(outlook.joint))
    print_table(table)
    for outlook in tests.outlooks:
        if outlook.failure:
            echo(f"Not possible: {outlook.candidate.name}, {outlook.failure}")
    end_study(NEXT_TEST, tests, source, out, tests.notes, run)


def _share(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
