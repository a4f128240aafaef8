"""The family of commands, what they have in common, and the conversion of errors to a message and an exit code."""

from __future__ import annotations

import functools
import inspect
import os
import re
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, ParamSpec, TypeVar, get_args

import typer

from softcal.calibration.search.interrupts import exit_code
from softcal.catalogue import Catalogue, FunctionMember
from softcal.cli.printing import echo, shown_path
from softcal.declare import checked_arguments
from softcal.errors import Fault, InputError, SoftcalError, unknown

P = ParamSpec("P")
C = TypeVar("C")

BAD_INPUT, FAILED = 2, 1
VERBOSE = "verbose"
Verbose = Annotated[
    bool, typer.Option("--verbose", help="Print every remark; with an unknown name, list all that there are.")
]
ProjectFile = Annotated[Path, typer.Argument(metavar="PROJECT", help="The project file.", show_default=False)]

Part = Literal["start", "judge", "plan", "data", "other programs"]
PARTS: tuple[Part, ...] = get_args(Part)
LAST = 100  # of the commands of its part: one of a plugin


@dataclass(frozen=True)
class ConsoleCommand(FunctionMember):
    """A command of `softcal`.

    Attributes
    ----------
    name : str
        By which it is called: that of the function or the group, with hyphens.
    function : callable or typer.Typer
        The command, or a group of commands. The function's signature is that of a command of Typer; its docstring is
        the help.
    part : str
        The part of `softcal --help` that lists it.
    place : int
        Its place in this part, from the lowest to the highest.
    """

    part: Part
    place: int = LAST

    @property
    def summary(self) -> str:
        """The first paragraph of its help."""
        group = self.function
        told = group.info.help if isinstance(group, typer.Typer) else inspect.getdoc(group) or super().summary
        return " ".join((told or "").partition("\n\n")[0].split())

    @property
    def module(self) -> str:
        """Where the function is defined, or the first command of the group."""
        group = self.function
        if not isinstance(group, typer.Typer):
            return super().module
        functions = [one.callback for one in group.registered_commands if one.callback is not None]
        return functions[0].__module__ if functions else ""

    def built(self) -> Any:
        """The command as Typer runs it: softcal's errors end with a message and an exit code."""
        if isinstance(self.function, typer.Typer):
            group = typer.main.get_group(self.function)
            group.name = self.name
            return group
        alone = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
        alone.command(self.name)(exit_on_error(self.function))
        return typer.main.get_command(alone)


def _faults(command: ConsoleCommand, _: Mapping[str, ConsoleCommand]) -> list[Fault]:
    """Faults of a command that is to be registered."""
    if not isinstance(command, ConsoleCommand):  # pyright: ignore[reportUnnecessaryIsInstance] (an entry point may be anything)
        allowed = "what softcal.register_command returns for a function"
        return [Fault("this is not a command", "command", repr(command)[:60], allowed)]
    where = f"command {command.name}"
    faults = [] if command.summary else [Fault("the command has no description", where, attempt="a docstring")]
    if command.part not in PARTS:
        faults.append(unknown("softcal --help has no such part", where, command.part, PARTS))
    return faults


COMMANDS: Catalogue[ConsoleCommand] = Catalogue("command", "softcal.commands", _faults, home="softcal.cli.commands")


@checked_arguments
def register_command(part: Part, place: int = LAST) -> Callable[[C], C]:
    """Add a command to `softcal`: a function as Typer takes it, or a group of commands (`typer.Typer` with a name).

    A package does the same for every process by an entry point of the group `softcal.commands` that names the function.

    Parameters
    ----------
    part
        The part of `softcal --help` that lists it: start, judge, plan, data or other programs.
    place
        Its place in this part, from the lowest to the highest; softcal's own have 1 to 9.

    Returns
    -------
    callable
        The decorator of the function or the group, which stays as it is. The function's name, with hyphens, is the
        command's; its docstring is the help; an error of softcal that it raises ends it with a message and an exit
        code.

    Raises
    ------
    InputError
        Where it is written without its brackets.
    ParameterError
        Where another command has the name, there is no such part, or the function has no docstring.
    """

    def member(function: Any) -> ConsoleCommand:
        name = function.info.name if isinstance(function, typer.Typer) else function.__name__
        return ConsoleCommand(str(name).replace("_", "-"), function, part, place)

    return COMMANDS.decorator(member)


def exit_on_error(command: Callable[P, None]) -> Callable[P, None]:
    """Decorator of commands: softcal's errors end with a message and an exit code, without a traceback. Every command
    has the option `--verbose`, even if its function has no such argument.
    """
    signature = inspect.signature(command, eval_str=True)
    has_own = VERBOSE in signature.parameters

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        verbose = bool(kwargs.get(VERBOSE, False) if has_own else kwargs.pop(VERBOSE, False))
        try:
            # Numba's file in the present folder may be a stranger's project and name where compiled code is taken from.
            name, threads = ".numba_config.yaml", os.environ.get("NUMBA_NUM_THREADS", "1")
            if os.path.lexists(name):
                what = "Numba would take its settings from this file, and run the compiled code that it names"
                raise InputError(Fault(what, name, attempt="another present folder, or remove the file"))
            if not re.fullmatch("0*[1-9][0-9]{0,5}", threads, re.ASCII):
                what, where = "this is no number of threads", "NUMBA_NUM_THREADS in the environment"
                raise InputError(Fault(what, where, repr(threads[:40]), "1 or more, or not set"))
            # The system accepts every given path; the command itself checks what it refers to.
            faults: list[Fault] = []
            for path in (one for value in kwargs.values() for one in (value if isinstance(value, list) else [value])):
                if not isinstance(path, Path):
                    continue
                try:
                    path.exists()
                except OSError as error:
                    got = f"'{str(path)[:40]}…' ({len(str(path))} characters): {(error.strerror or str(error)).lower()}"
                    faults.append(Fault("this cannot be a path", got=got))
            if faults:
                raise InputError(faults)
            command(*args, **kwargs)
        except InputError as error:
            n = len(error.faults)
            heading = f"Error: {n} faults:\n" if n > 1 else "Error: "
            echo(heading + error.told(verbose=verbose), err=True)
            raise typer.Exit(BAD_INPUT) from None
        except SoftcalError as error:
            echo(f"Error: {error}", err=True)
            raise typer.Exit(FAILED) from None
        except KeyboardInterrupt as stop:
            echo("Stopped.", err=True)
            raise typer.Exit(exit_code(stop)) from None

    option = inspect.Parameter(VERBOSE, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Verbose)
    parameters = [*signature.parameters.values(), *[option] * (not has_own)]  # Typer reads them from here
    run.__dict__["__signature__"] = signature.replace(parameters=parameters)
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    return run


@contextmanager
def resumable(folder: Path, kept: str, again: str, record: str = "run.json") -> Generator[None]:
    """Context of a run: if it is stopped, report what is kept, in which folder, and how to resume.

    Parameters
    ----------
    folder
        Folder of the run.
    kept
        Noun at the beginning of the message, such as "Every cell".
    again
        The command that resumes the run.
    record
        File that the folder has as soon as a run can be resumed.
    """
    try:
        yield
    except KeyboardInterrupt as stop:
        if not (folder / record).is_file():
            raise
        echo(f"Stopped. {kept} so far is kept in {shown_path(folder)}. Continue with: {again}", err=True)
        raise typer.Exit(exit_code(stop)) from None
