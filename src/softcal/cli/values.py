"""Options and arguments shared by the commands: `--set NAME=VALUE`, `--engine`, lists of names."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from softcal.errors import Fault, InputError
from softcal.limits import LIMITS

Values = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Fix a parameter at a value, such as neck.youngs_modulus=2.3MPa."),
]

Source = Annotated[
    Path, typer.Argument(metavar="RUN_OR_PROJECT", help="A run folder, or a project file.", show_default=False)
]
Pull = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ACTUATOR=VALUE",
        help="Instead of the experiments: drive an actuator (front=40mm, front=8N); repeat for several.",
        show_default=False,
    ),
]

SOFTCAL = "softcal"  # the default engine
Engine = Annotated[
    str,
    typer.Option(metavar="NAME", help="Engine of the twin: softcal, or sofa (found by SOFA_ROOT; linear tets)."),
]


Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=LIMITS["workers"].most,
        help="Number of processes, 1 by default; for slurm of jobs.",
        show_default=False,
    ),
]
LOCAL = "local"  # the default of --on
On = Annotated[
    str,
    typer.Option(
        "--on",
        metavar="WHERE",
        help="Where the twin is simulated: local, dask:ADDRESS of a Dask scheduler, or slurm[:QUEUE].",
    ),
]
WithPage = Annotated[bool, typer.Option("--watch", help="Show the run on a local page, as softcal watch does.")]
WithReport = Annotated[bool, typer.Option(help="Write the report at the end.")]


def parsed_values(given: list[str] | None) -> dict[str, str]:
    """Parameter -> value as written, from the arguments of `--set`.

    Raises
    ------
    InputError
        If a text is no NAME=VALUE.
    """
    return parsed_pairs(given, "--set", "not an assignment", "NAME=VALUE, such as neck.youngs_modulus=2.3MPa")


def parsed_pairs(given: list[str] | None, option: str, what: str, allowed: str) -> dict[str, str]:
    """Name -> text from the arguments of an option NAME=TEXT.

    Parameters
    ----------
    given
        The texts.
    option
        The option, such as `--set`.
    what
        The fault of a text that is no pair.
    allowed
        What is allowed in its place.

    Raises
    ------
    InputError
        If a text is no NAME=TEXT, or a name is given twice.
    """
    pairs = [text.partition("=") for text in given or []]
    faults = [
        Fault(what, option, f"'{name}{sign}{value}'", allowed)
        for name, sign, value in pairs
        if not (name.strip() and value.strip())
    ]
    values: dict[str, str] = {}
    for name, text in ((name.strip(), text.strip()) for name, _, text in pairs):
        if name in values:
            got = f"'{name}={values[name]}' and '{name}={text}'"
            faults.append(Fault("the name is given twice", option, got, "each name once"))
        values[name] = text
    if faults:
        raise InputError(faults)
    return values


def calibration_options(given: list[str] | None, typed: Mapping[str, object]) -> dict[str, int | float | str]:
    """The settings of a calibration from the arguments of `--option NAME=VALUE`.

    typed: values of the settings that have an option of their own, None where this option is not used.

    Raises
    ------
    InputError
        As `parsed_pairs`; for a name that is no setting, or is also set by an option of its own.
    """
    options = parsed_pairs(given, "--option", "this sets no option", "NAME=VALUE, such as starts=5")
    faults: list[Fault] = []
    for name, value in ((name, typed[name]) for name in options if typed.get(name) is not None):
        dashed = name.replace("_", "-")
        flag = f"--{'' if value else 'no-'}{dashed}" if isinstance(value, bool) else f"--{dashed} {value}"
        got = f"'{flag}' and '--option {name}={options[name]}'"
        faults.append(Fault("the name is given twice", "--option", got, "each name once"))
    if faults:
        raise InputError(faults)
    if options:
        from softcal.workflows.calibration import require_options

        require_options(options)
    return {name: scalar(text) for name, text in options.items()}


def scalar(text: str) -> int | float | str:
    """A text as a project file would read it: a number where it is one."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def as_typed(options: Mapping[str, str | int | list[str] | None]) -> str:
    """The given options (by their Python names) in command-line syntax, each preceded by a blank."""
    pairs = [(name, one) for name, given in options.items() for one in (given if isinstance(given, list) else [given])]
    typed = [(name.replace("_", "-"), str(one)) for name, one in pairs if one is not None]
    return "".join(f" --{name} {shlex.quote(one)}" for name, one in typed)


def names(text: str) -> list[str]:
    """The names in a text such as "cable3,cable5"."""
    return [name.strip() for name in text.split(",") if name.strip()]
