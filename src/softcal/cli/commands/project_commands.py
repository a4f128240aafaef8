"""Commands that create and check a project: init, check."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from softcal.cli.command import ProjectFile, register_command
from softcal.cli.printing import echo, print_warnings, shown_path
from softcal.cli.running import clock
from softcal.errors import Fault, InputError

LEAST_WIDTH = len("under its loads")


@register_command("start", 1)
def init(
    template: Annotated[
        str,
        typer.Argument(
            help="What to start from: finger, neck, pneunet, bellows, servo, manipulator.", show_default=False
        ),
    ],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that is new or empty.", show_default=False)],
) -> None:
    """Write a project to start from, with data and comments."""
    from softcal.workflows.template import write_template

    path = write_template(template, folder)
    echo(f"Wrote {shown_path(path)}. Check it with: softcal check {shlex.quote(shown_path(path))}")


@register_command("start", 2)
def check(
    project: ProjectFile,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the pictures; 'check' beside the project by default.")
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Draw the robot, its solved states and the data.")] = True,
    solve: Annotated[
        bool, typer.Option(help="Solve the robot under its loads, and each experiment's end, at the start values.")
    ] = True,
) -> None:
    """Validate a project with its meshes and data, solve its states, and draw pictures for inspection."""
    from softcal.project.project import load

    if out is not None and not pictures:
        raise InputError(Fault("--out and --no-pictures exclude each other"))
    width = LEAST_WIDTH
    with clock(keeps=True) as show:

        def print_block(rows: Sequence[tuple[str, str]], warnings: Sequence[str]) -> None:
            nonlocal width
            show("")
            width = max(width, *(len(name) for name, _ in rows)) if rows else width
            for name, text in rows:
                echo(f"{name:<{width + 2}}{text}")
            print_warnings(warnings)

        show("Reading the project")
        loaded = load(project)
        width = max(width, *(len(f"free {one.name}") for one in loaded.space.parameters)) if loaded.space else width
        from softcal.workflows.checking import check as check_project

        folder = (out if out is not None else project.parent / "check") if pictures else None
        report = check_project(loaded, folder, solve=solve, progress=show, ready=print_block)
    for note in report.notes:
        echo(f"Note: {note}", err=True)
    if pictures:
        echo(f"Pictures: {', '.join(map(shown_path, report.pictures))}")
    echo("The project is in order." if not report.warnings else "The project can be used; see the warnings.")
