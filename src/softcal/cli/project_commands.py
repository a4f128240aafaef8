"""Commands that make and look over a project: init, check."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from softcal.cli.app import ProjectFile, app, told
from softcal.cli.printing import print_warnings


@app.command()
@told
def init(
    template: Annotated[str, typer.Argument(help="What to start from: neck, manipulator.", show_default=False)],
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
    print_warnings(report.warnings)
    for note in report.notes:
        typer.echo(f"Note: {note}", err=True)
    typer.echo(f"Pictures: {', '.join(str(path) for path in report.pictures)}")
    typer.echo("The project is in order." if not report.warnings else "The project can be used; see the warnings.")


def _print_pairs(rows: tuple[tuple[str, str], ...]) -> None:
    width = max(len(name) for name, _ in rows) + 2
    for name, text in rows:
        typer.echo(f"{name:<{width}}{text}")
