"""The typer application of all commands, and the conversion of errors to a message and an exit code."""

from __future__ import annotations

import functools
import inspect
import os
import re
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, ParamSpec

import typer

from softcal.calibration.interrupts import exit_code
from softcal.cli.printing import shown_path
from softcal.errors import Fault, InputError, SoftcalError

P = ParamSpec("P")

BAD_INPUT, FAILED = 2, 1
VERBOSE = "verbose"
Verbose = Annotated[
    bool, typer.Option("--verbose", help="Print every remark; with an unknown name, list all that there are.")
]

app = typer.Typer(
    name="softcal",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _tell_version(wanted: bool) -> None:
    if wanted:
        import softcal

        typer.echo(f"softcal {softcal.__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", callback=_tell_version, is_eager=True)
    ] = False,
) -> None:
    """From bench measurements of a printed, cable-driven soft robot to a calibrated finite-element twin."""


ProjectFile = Annotated[Path, typer.Argument(metavar="PROJECT", help="The project file.", show_default=False)]


def exit_on_error(command: Callable[P, None]) -> Callable[P, None]:
    """Decorator of commands: softcal's errors end with a message and an exit code, without a traceback. Every command
    has the option `--verbose`, also one without such an argument.
    """
    signature = inspect.signature(command, eval_str=True)
    has_own = VERBOSE in signature.parameters

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        verbose = bool(kwargs.get(VERBOSE, False) if has_own else kwargs.pop(VERBOSE, False))
        try:
            _require_settings_of_numba()
            _require_paths(kwargs.values())
            command(*args, **kwargs)
        except InputError as error:
            n = len(error.faults)
            heading = f"Error: {n} faults:\n" if n > 1 else "Error: "
            typer.echo(heading + error.told(verbose=verbose), err=True)
            raise typer.Exit(BAD_INPUT) from None
        except SoftcalError as error:
            typer.echo(f"Error: {error}", err=True)
            raise typer.Exit(FAILED) from None
        except KeyboardInterrupt as stop:
            typer.echo("Stopped.", err=True)
            raise typer.Exit(exit_code(stop)) from None

    option = inspect.Parameter(VERBOSE, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Verbose)
    parameters = [*signature.parameters.values(), *[option] * (not has_own)]  # Typer reads them from here
    run.__dict__["__signature__"] = signature.replace(parameters=parameters)
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    return run


def _require_settings_of_numba() -> None:
    """Check the settings that Numba takes from its surroundings: none from a file in the present folder, which may be a
    stranger's project and name where compiled code is taken from, and a number of threads that is one.

    Raises
    ------
    InputError
        Where the file is there, or the number is none.
    """
    name, threads = ".numba_config.yaml", os.environ.get("NUMBA_NUM_THREADS", "1")
    if os.path.lexists(name):
        what = "Numba would take its settings from this file, and run the compiled code that it names"
        raise InputError(Fault(what, name, attempt="another present folder, or remove the file"))
    if not re.fullmatch("0*[1-9][0-9]{0,5}", threads, re.ASCII):
        what, where = "this is no number of threads", "NUMBA_NUM_THREADS in the environment"
        raise InputError(Fault(what, where, repr(threads[:40]), "1 or more, or not set"))


def _require_paths(options: Iterable[object]) -> None:
    """Check that the system accepts every given path; the command itself checks what it refers to.

    Raises
    ------
    InputError
        For an impossible path: longer than the system allows, or a loop of links.
    """
    faults: list[Fault] = []
    for path in (one for value in options for one in (value if isinstance(value, list) else [value])):
        if not isinstance(path, Path):
            continue
        try:
            path.exists()
        except OSError as error:
            got = f"'{str(path)[:40]}…' ({len(str(path))} characters)"
            faults.append(Fault("this cannot be a path", got=f"{got}: {(error.strerror or str(error)).lower()}"))
    if faults:
        raise InputError(faults)


@contextmanager
def resumable(folder: Path, kept: str, again: str, record: str = "run.json") -> Generator[None]:
    """Context of a run: if it is stopped, report what is kept, in which folder, and how to resume; record: the file
    that is there from the beginning on.
    """
    try:
        yield
    except KeyboardInterrupt as stop:
        if not (folder / record).is_file():
            raise
        typer.echo(f"Stopped. {kept} so far is kept in {shown_path(folder)}. Continue with: {again}", err=True)
        raise typer.Exit(exit_code(stop)) from None
