"""Commands that fit a project's parameters and tell what came of it: calibrate, report."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from softcal.cli.calibration_bars import calibration_progress
from softcal.cli.calibration_table import print_results, result_line
from softcal.cli.command import ProjectFile, Verbose, register_command, resumable
from softcal.cli.printing import echo, print_warnings, shown_path
from softcal.cli.running import clock, executor_told, page_beside, steps
from softcal.cli.values import (
    LOCAL,
    SOFTCAL,
    Engine,
    On,
    Values,
    WithPage,
    WithReport,
    Workers,
    as_typed,
    calibration_options,
    names,
    parsed_values,
)

if TYPE_CHECKING:
    from softcal.twin.response import Response


@register_command("start", 4)
def calibrate(  # noqa: PLR0913 (one argument for each option)
    project: ProjectFile,
    method: Annotated[
        str | None,
        typer.Option(
            help="least-squares, tpe, grid, or a registered one; default: as in the project.",
            show_default=False,
        ),
    ] = None,
    fit: Annotated[
        str | None, typer.Option(help="each, joint or both; default: as in the project.", show_default=False)
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(min=1, help="Limit of trials; least-squares: of each start.", show_default=False),
    ] = None,
    workers: Workers = None,
    on: On = LOCAL,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the random numbers.", show_default=False)] = None,
    hold_out: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Experiments (cable3,cable5) that are not fitted but predicted; default: as in the project.",
            show_default=False,
        ),
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE", help="An option of the method or the loss, such as starts=5; repeat for more."
        ),
    ] = None,
    split: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Untie these tied parameters: a value for each; repeat for more."),
    ] = None,
    values: Values = None,
    engine: Engine = "softcal",
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Run folder; 'run' beside the project by default.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the run in the folder.")] = False,
    storage: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Share the search (tpe) with other processes: journal:FILE, postgresql://… or mysql://…",
            show_default=False,
        ),
    ] = None,
    report: WithReport = True,
    watch: WithPage = False,
    mesh_error: Annotated[
        bool | None,
        typer.Option(
            help="Whether the intervals include the error of the mesh, by one more simulation on a finer one.",
            show_default=False,
        ),
    ] = None,
    verbose: Verbose = False,
) -> None:
    """Find the free parameters; keeps every trial, and writes tables, figures and a report into a run folder."""
    from softcal.project.project import load

    changes: dict[str, Any] = {
        "method": method,
        "fit": fit,
        "trials": trials,
        "seed": seed,
        "hold_out": hold_out,
        "split": split,
    }
    options = calibration_options(option, {**changes, "mesh_error": mesh_error})
    loaded = load(project, values=parsed_values(values))
    from softcal.calibration.search.storage_url import storage_url
    from softcal.report.format import duration
    from softcal.workflows.calibrated_shapes import furthest_responses
    from softcal.workflows.calibration import calibrate as calibrate_project
    from softcal.workflows.calibration import plan
    from softcal.workflows.expected_duration import expected_duration

    print_warnings(loaded.warnings)
    folder = out if out is not None else project.parent / "run"
    others = {
        "option": option,
        "set": values,
        "engine": None if engine == SOFTCAL else engine,
        "workers": workers,
        "on": None if on == LOCAL else on,
        "storage": None if storage is None else storage_url(storage).shown,
    }
    again = f"{shlex.quote(shown_path(project))} --out {shlex.quote(shown_path(folder))}"
    again += f"{as_typed({**changes, **others})}{' --no-mesh-error' * (mesh_error is False)} --resume"
    changes["mesh_error"] = mesh_error
    changes["hold_out"] = None if hold_out is None else names(hold_out)
    changes |= options
    with page_beside(folder, wanted=watch):
        with executor_told(on, workers) as executor, resumable(folder, "Everything", f"softcal calibrate {again}"):
            if engine != SOFTCAL and not resume:
                settings, problems = plan(loaded, engine, **changes)
                print_warnings(dict.fromkeys(problem.left_out for problem in problems.values() if problem.left_out))
                with clock() as show:
                    show(f"Timing one simulation by {engine}")
                    expected = expected_duration(problems, settings.search, executor.count)
                low, high = expected.duration
                span = duration(high) if duration(low) == duration(high) else f"{duration(low)} to {duration(high)}"
                count = " to ".join(dict.fromkeys(str(n) for n in expected.simulations))
                text = f"Expected: {span}, for {count} of the search"
                if expected.held_out[1]:
                    held_out_too = " to ".join(dict.fromkeys(str(n) for n in expected.held_out))
                    text += f" and {held_out_too} of the held-out predictions"
                one = f"One simulation by {engine} takes {duration(expected.seconds)}"
                echo(f"{one}. {text}, if all take as long.")
            with calibration_progress() as bars:
                calibrations = calibrate_project(
                    loaded,
                    out=folder,
                    resume=resume,
                    workers=executor,
                    engine=engine,
                    progress=bars.show,
                    ready=lambda label, result: bars.say(result_line(label, result)),
                    storage=storage,
                    **changes,
                )
            solved = {} if calibrations.stopped_by is not None else furthest_responses(loaded, calibrations.results)
            records = {name: record for name, record in loaded.corrected.items() if record is not None}
            data = {name: experiment.dataset for name, experiment in loaded.experiments.items()}
            print_results(calibrations.results, data, records, solved, verbose=verbose)
            if calibrations.stopped_by is not None:
                raise calibrations.stopped_by
        echo(f"Run: {shown_path(folder)}")
        if report:
            report_run(folder, None, solved)


@register_command("start", 5)
def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A folder that calibrate wrote.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the report; the run folder by default.")
    ] = None,
    figures: Annotated[
        str,
        typer.Option(metavar="NAMES", help="Only these figures (twin,overview); by default all.", show_default=False),
    ] = "",
) -> None:
    """Write the report of a run: one HTML page, figures as PNG and SVG, tables as CSV."""
    report_run(run, out, figures=names(figures))


def report_run(
    run: Path, out: Path | None, solved: Mapping[str, Response] | None = None, figures: Sequence[str] = ()
) -> None:
    """Write a run's report and say where it lies.

    Parameters
    ----------
    run
        A run folder.
    out
        Folder of the report; None: the run's.
    solved
        Label -> furthest response that need not be solved again.
    figures
        Names of the figures that are drawn; by default all.
    """
    from softcal.workflows.reporting import write_report

    with steps("Report") as show:
        paths = write_report(run, out, figures=figures, solved=solved, progress=show)
    for note in paths.notes:
        echo(f"Note: {note}", err=True)
    echo(f"Report: {shown_path(paths.page)}")
