"""The command line: reads the arguments, calls the library, prints. Heavy libraries are imported by the commands."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ParamSpec

import typer

from softcal.errors import Fault, InputError, SoftcalError

if TYPE_CHECKING:
    from rich.table import Table

    from softcal.calibration.result import CalibrationResult, Estimate
    from softcal.project.project import Project
    from softcal.twin.protocol import Protocol

P = ParamSpec("P")

BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130

app = typer.Typer(
    name="softcal",
    help="From bench measurements of a printed, cable-driven soft robot to a calibrated finite-element twin.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

ProjectFile = Annotated[Path, typer.Argument(metavar="PROJECT", help="The project file.", show_default=False)]
Values = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="NAME=VALUE", help="Hold a parameter at a value, such as neck.youngs_modulus=2.3MPa."
    ),
]


def main(argv: list[str] | None = None) -> None:
    """Run the command line and leave with its exit code: 0, 1 failed, 2 bad input, 130 stopped by Ctrl-C."""
    app(args=argv)


def told(command: Callable[P, None]) -> Callable[P, None]:
    """A command whose errors on purpose end as a message and an exit code, without a traceback."""

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except InputError as error:
            n = len(error.faults)
            heading = f"Error: {n} faults:\n" if n > 1 else "Error: "
            typer.echo(heading + str(error), err=True)
            raise typer.Exit(BAD_INPUT) from None
        except SoftcalError as error:
            typer.echo(f"Error: {error}", err=True)
            raise typer.Exit(FAILED) from None
        except KeyboardInterrupt:
            typer.echo("Stopped.", err=True)
            raise typer.Exit(INTERRUPTED) from None

    return run


@app.command()
@told
def init(
    template: Annotated[str, typer.Argument(help="What to start from: neck.", show_default=False)],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that is new or empty.", show_default=False)],
) -> None:
    """Write a project to start from, with data and comments."""
    from softcal.project.template import write_template

    path = write_template(template, folder)
    typer.echo(f"Wrote {path}. Look it over with: softcal check {path}")


@app.command()
@told
def check(
    project: ProjectFile,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where the pictures go; 'check' beside the project by default.")
    ] = None,
) -> None:
    """Validate a project with its meshes and data, and draw them to look at."""
    from softcal.project.checking import check as check_project
    from softcal.project.project import load

    report = check_project(load(project), out if out is not None else project.parent / "check")
    _print_pairs(report.rows)
    for warning in report.warnings:
        typer.echo(f"Warning: {warning}", err=True)
    for note in report.notes:
        typer.echo(f"Note: {note}", err=True)
    typer.echo(f"Pictures: {', '.join(str(path) for path in report.pictures)}")
    typer.echo("The project is in order." if not report.warnings else "The project can be used; see the warnings.")


@app.command()
@told
def simulate(
    project: ProjectFile,
    out: Annotated[Path, typer.Option(metavar="DIR", help="A folder that is new or empty.", show_default=False)],
    values: Values = None,
    experiment: Annotated[
        str, typer.Option(metavar="NAME", help="Only this experiment; all of them by default.", show_default=False)
    ] = "",
    pull: Annotated[
        str,
        typer.Option(
            metavar="CABLE=VALUE",
            help="Instead of experiments: pull a cable from zero to a shortening (front=40mm) or tension (front=8N).",
            show_default=False,
        ),
    ] = "",
) -> None:
    """Simulate the twin: its response as CSV with units, and a picture at rest and at the largest pitch."""
    from softcal.project.project import load
    from softcal.project.simulation import protocol_of
    from softcal.project.simulation_folder import simulate_to_folder

    loaded = load(project, values=_values(values))
    if pull and experiment:
        raise InputError(Fault("--pull and --experiment exclude each other"))
    if pull:
        protocols = {"pull": _pull(loaded, pull)}
    else:
        names = [experiment] if experiment else list(loaded.experiments) or [""]
        protocols = {name: protocol_of(loaded, name) for name in names}
    for name, response in simulate_to_folder(loaded, protocols, out).items():
        typer.echo(f"{name}: {response.status}")
    typer.echo(f"Wrote {out}")


@app.command()
@told
def calibrate(  # noqa: PLR0913 (one argument for each option)
    project: ProjectFile,
    method: Annotated[
        str | None, typer.Option(help="least-squares, tpe or grid; as the project says by default.", show_default=False)
    ] = None,
    fit: Annotated[
        str | None, typer.Option(help="each, joint or both; as the project says by default.", show_default=False)
    ] = None,
    trials: Annotated[
        int | None, typer.Option(min=1, help="Budget of trials, or trajectories of each start.", show_default=False)
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    seed: Annotated[int | None, typer.Option(min=0, help="Of all chance in the search.", show_default=False)] = None,
    values: Values = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Run folder; 'run' beside the project by default.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the run in the folder.")] = False,
    report: Annotated[bool, typer.Option(help="Write the report at the end.")] = True,
) -> None:
    """Find the free parameters; keeps every trial, and writes tables, figures and a report into a run folder."""
    from softcal.project.calibration import calibrate as calibrate_project
    from softcal.project.project import load

    loaded = load(project, values=_values(values))
    for warning in loaded.warnings:
        typer.echo(f"Warning: {warning}", err=True)
    folder = out if out is not None else project.parent / "run"
    with _Bars() as bars:
        found = calibrate_project(
            loaded,
            out=folder,
            resume=resume,
            method=method,
            fit=fit,
            trials=trials,
            seed=seed,
            workers=workers,
            progress=bars.show,
        )
    _print_results(found.results)
    if found.interrupted:
        held = "".join(f" --set {value}" for value in values or [])
        typer.echo(
            f"Stopped. Everything so far is kept in {folder}. "
            f"Go on with: softcal calibrate {project} --out {folder}{held} --resume",
            err=True,
        )
        raise typer.Exit(INTERRUPTED)
    typer.echo(f"Run: {folder}")
    if report:
        _report(folder, None)


@app.command()
@told
def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A folder that calibrate wrote.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where it goes; into the run folder by default.")
    ] = None,
) -> None:
    """Write the report of a run: one HTML page, figures as PNG and SVG, tables as CSV."""
    _report(run, out)


def _report(run: Path, out: Path | None) -> None:
    from softcal.project.reporting import write_report

    paths = write_report(run, out)
    for note in paths.notes:
        typer.echo(f"Note: {note}", err=True)
    typer.echo(f"Report: {paths.page}")


def _values(given: list[str] | None) -> dict[str, str]:
    pairs = [text.partition("=") for text in given or []]
    faults = [
        Fault(
            "this sets no parameter",
            "--set",
            f"'{name}{sign}{value}'",
            "NAME=VALUE, such as neck.youngs_modulus=2.3MPa",
        )
        for name, sign, value in pairs
        if not (name.strip() and value.strip())
    ]
    if faults:
        raise InputError(faults)
    return {name.strip(): value.strip() for name, _, value in pairs}


def _pull(project: Project, text: str) -> Protocol:
    from softcal.errors import UnitError
    from softcal.project.simulation import pull
    from softcal.units import parse_quantity

    cable, _, value = text.partition("=")
    try:
        return pull(project.robot, cable.strip(), "shortening", parse_quantity(value.strip(), "m"))
    except UnitError:
        pass
    try:
        return pull(project.robot, cable.strip(), "tension", parse_quantity(value.strip(), "N"))
    except UnitError as error:
        raise InputError(
            Fault("this is no pull", "--pull", f"'{text}'", "a cable and a length or force: front=40mm, front=8N")
        ) from error


class _Bars:
    """A progress bar for each calibration, with the best loss so far."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[best]}"),
            TimeElapsedColumn(),
            console=Console(stderr=True),
        )
        self._tasks: dict[str, object] = {}

    def __enter__(self) -> _Bars:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._tasks:
            self._progress.stop()

    def show(self, label: str, state: object) -> None:
        """Move the bar of a calibration."""
        from rich.progress import TaskID

        from softcal.calibration.run import Progress

        if not isinstance(state, Progress):
            raise TypeError(type(state))
        self._progress.start()
        if label not in self._tasks:
            self._tasks[label] = self._progress.add_task(label, total=state.total, best="")
        best = "" if state.best_loss is None else f"best loss {state.best_loss:.6g}"
        failed = f", {state.failed} failed" if state.failed else ""
        task = self._tasks[label]
        self._progress.update(TaskID(int(str(task))), completed=state.done, total=state.total, best=best + failed)


def _print_pairs(rows: tuple[tuple[str, str], ...]) -> None:
    width = max(len(name) for name, _ in rows) + 2
    for name, text in rows:
        typer.echo(f"{name:<{width}}{text}")


def _print_results(results: Mapping[str, CalibrationResult]) -> None:
    from rich.console import Console

    if not results:
        return
    console = Console()
    if not console.is_terminal:
        console = Console(width=160)  # a log does not wrap
    console.print(_result_table(results))
    for label, result in results.items():
        typer.echo(f"{label}: {result.status}")
    notes: dict[str, list[str]] = {}
    for label, result in results.items():
        for note in result.notes:
            notes.setdefault(note, []).append(label)
    for note, labels in notes.items():
        typer.echo(f"Note ({', '.join(labels)}): {note}")


def _result_table(results: Mapping[str, CalibrationResult]) -> Table:
    """A column for each calibration; a line for each parameter, and for each experiment's errors."""
    from rich.table import Table

    table = Table("", *results)
    parameters = dict.fromkeys(name for result in results.values() for name in result.parameters)
    for name in parameters:
        found = [result.parameters.get(name) for result in results.values()]
        table.add_row(name.replace("[", r"\["), *("" if estimate is None else _value(estimate) for estimate in found))
    table.add_section()
    fits = [(name, channel) for r in results.values() for name, fit in r.experiments.items() for channel in fit.rmse]
    for name, channel in dict.fromkeys(fits):
        table.add_row(f"RMSE of {channel}, {name}", *(_error(result, name, channel) for result in results.values()))
    table.add_section()
    table.add_row("loss", *(f"{result.loss:.4g}" for result in results.values()))
    table.add_row("trials", *(_count(result) for result in results.values()))
    return table


def _error(result: CalibrationResult, experiment: str, channel: str) -> str:
    fit = result.experiments.get(experiment)
    return "" if fit is None or channel not in fit.rmse else f"{fit.rmse[channel]:.3g} {fit.units[channel]}"


def _count(result: CalibrationResult) -> str:
    failed = f", {result.n_failed_trials} failed" if result.n_failed_trials else ""
    return f"{len(result.trials)}{failed}"


def _value(estimate: Estimate) -> str:
    from softcal.units import format_quantity, readable_unit

    unit = readable_unit(estimate.value, estimate.unit)
    text = format_quantity(estimate.value, estimate.unit, unit)
    if estimate.standard_error is not None:
        text += f" ± {format_quantity(estimate.standard_error, estimate.unit, unit, digits=2)}"
    return text + (" (at a bound)" if estimate.at_bound else "")


if __name__ == "__main__":
    main()
