"""The command `softcal fleet`."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from softcal.cli.calibration_lines import CalibrationLines
from softcal.cli.command import register_command, resumable
from softcal.cli.printing import echo, print_report_table, shown_path
from softcal.cli.running import executor_told, page_beside
from softcal.cli.values import LOCAL, On, WithPage, WithReport, Workers, as_typed, calibration_options, names

if TYPE_CHECKING:
    from softcal.plugins.fleet.workflow import Observer


@register_command("judge", 6)
def fleet(  # noqa: PLR0913 (one argument for each option)
    table: Annotated[
        Path,
        typer.Argument(
            metavar="TABLE",
            help="Table with a row for each specimen, or a folder with it as fleet.csv.",
            show_default=False,
        ),
    ],
    template: Annotated[
        Path | None,
        typer.Option(
            metavar="PROJECT", help="Project file of all specimens; project.yaml beside the table by default."
        ),
    ] = None,
    by: Annotated[
        str,
        typer.Option(
            metavar="NAMES", help="Compare by these factors (filament,printer); by default all.", show_default=False
        ),
    ] = "",
    method: Annotated[
        str | None, typer.Option(help="least-squares, tpe, grid; default: as in the template.", show_default=False)
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="A setting of the calibration, such as starts=5; repeat for more."),
    ] = None,
    workers: Workers = None,
    on: On = LOCAL,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the fleet; 'fleet' beside the table by default.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the fleet in the folder.")] = False,
    report: WithReport = True,
    watch: WithPage = False,
) -> None:
    """Calibrate many specimens by one template, and say how they differ: spread, by factor, E against the infill."""
    options = calibration_options(option, {"method": method})
    from softcal.plugins.fleet.workflow import fleet as calibrate_fleet

    folder = out if out is not None else (table if table.is_dir() else table.parent) / "fleet"
    typed: dict[str, Any] = {"template": template and str(template), "by": by or None, "method": method}
    typed |= {"option": option, "workers": workers, "on": None if on == LOCAL else on}
    again = f"softcal fleet {shlex.quote(shown_path(table))} --out {shlex.quote(shown_path(folder))}"
    again += f"{as_typed(typed)} --resume"
    changes = {"method": method, **options}
    with page_beside(folder, wanted=watch):
        with resumable(folder, "What was calibrated", again, "fleet.json"):
            with executor_told(on, workers) as executor, _bar() as show:
                found = calibrate_fleet(
                    table,
                    template=template,
                    out=folder,
                    resume=resume,
                    workers=executor,
                    by=names(by),
                    progress=show,
                    **changes,
                )
            from softcal.plugins.fleet.tables import fleet_tables
            from softcal.plugins.fleet.verdict import fleet_sentences

            for report_table in fleet_tables(found.specimens, found.statement):
                if report_table.rows:
                    print_report_table(report_table)
            for sentence in fleet_sentences(found.specimens, found.statement):
                echo(sentence.text)
            if found.stopped_by is not None:
                raise found.stopped_by
        echo(f"Fleet: {shown_path(folder)}")
        if report:
            from softcal.plugins.fleet.report import write_fleet_report

            echo(f"Report: {shown_path(write_fleet_report(found))}")


@contextmanager
def _bar() -> Generator[Observer]:
    """On a terminal, a progress bar for what is done with the specimens; elsewhere lines now and then."""
    if not sys.stderr.isatty():
        from softcal.calibration.search.search import Progress as Done

        with CalibrationLines() as lines:
            yield lambda what, of, done, failed: lines.show(what, Done(done, of, failed, None, None))
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(20), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bars:
        tasks: dict[str, TaskID] = {}

        def show(what: str, of: int, done: int, failed: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=of)
            text = f"{what}, {failed} failed" if failed else what
            bars.update(tasks[what], completed=done, description=text)

        yield show
