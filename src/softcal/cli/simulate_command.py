"""The command `softcal simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from softcal.cli.app import ProjectFile, app, told
from softcal.cli.values import Values, parsed_values
from softcal.errors import Fault, InputError

if TYPE_CHECKING:
    from softcal.project.project import Project
    from softcal.twin.protocol import Protocol


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

    loaded = load(project, values=parsed_values(values))
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
