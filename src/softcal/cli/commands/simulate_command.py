"""The command `softcal simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from softcal.cli.command import ProjectFile, register_command
from softcal.cli.printing import echo, print_table, shown_path
from softcal.cli.running import clock, motion_bars
from softcal.cli.values import Engine, Values, parsed_values
from softcal.errors import Fault, InputError

if TYPE_CHECKING:
    from softcal.twin.response import Response


_ROUNDING = 1e-12  # of the largest value of a channel, and of its SI unit: less is the rounding of the solver


@register_command("start", 3)
def simulate(
    project: ProjectFile,
    out: Annotated[Path, typer.Option(metavar="DIR", help="A folder that is new or empty.", show_default=False)],
    values: Values = None,
    experiment: Annotated[
        str, typer.Option(metavar="NAME", help="Only this experiment; all of them by default.", show_default=False)
    ] = "",
    pull: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ACTUATOR=VALUE",
            help="Instead of experiments: pull a cable from zero to a shortening (front=40mm), a tension (front=8N, "
            "front=2kgf) or by a hanging mass (front.mass=2kg); a chamber (chamber=20kPa), a drive (motor=40deg); "
            "repeat for several.",
            show_default=False,
        ),
    ] = None,
    commands: Annotated[
        Path | None,
        typer.Option(
            metavar="TABLE",
            help="Instead of experiments: a table of commands, columns such as front.tension [N], as softcal reach "
            "writes it.",
            show_default=False,
        ),
    ] = None,
    in_time: Annotated[
        bool,
        typer.Option(
            "--in-time",
            help="Transient simulation until the robot is at rest: experiments by the times of their samples, a pull "
            "as a slow ramp; see dynamics in the project.",
        ),
    ] = False,
    engine: Engine = "softcal",
) -> None:
    """Simulate the twin: its response as CSV with units, and a picture at rest and where it is bent most."""
    from softcal.project.project import load

    loaded = load(project, values=parsed_values(values))
    from rich.table import Table

    from softcal.report.format import MANY
    from softcal.units import format_quantity, format_range
    from softcal.workflows.cases import cases
    from softcal.workflows.simulation_folder import simulate_to_folder

    given = {"--pull": pull, "--experiment": experiment, "--commands": commands}
    if len(both := [option for option, value in given.items() if value]) > 1:
        raise InputError(Fault(f"{' and '.join(both)} exclude each other"))
    if in_time and engine != "softcal":
        raise InputError(Fault("other engines compute states at rest only", "--in-time", f"--engine {engine}"))
    chosen = cases(loaded, pull or (), experiment, commands)
    if in_time:
        with motion_bars(keeps=True) as show:
            responses = simulate_to_folder(loaded, chosen, out, in_time=True, progress=show)
        for name, response in responses.items():
            _print_status(name, response)
    else:
        with clock(keeps=True) as show:

            def print_status(name: str, response: Response) -> None:
                show("")
                _print_status(name, response)

            responses = simulate_to_folder(loaded, chosen, out, engine=engine, stage=show, ready=print_status)
    shown = dict(list(responses.items())[:MANY])
    table = Table("", *shown)
    for channel, unit in {name: unit for one in shown.values() for name, unit in one.units.items()}.items():
        cells: list[str] = []
        for response in shown.values():
            seen = [float(value) for value in response.channels.get(channel, ())]
            least = _ROUNDING * max(1.0, *map(abs, seen))
            found = [value if abs(value) > least else 0.0 for value in seen]  # no "-0"
            low, high = min(found, default=0.0), max(found, default=0.0)
            text = format_range(low, high, unit, digits=4) if low < high else format_quantity(low, unit)
            cells.append(text if found else "")
        table.add_row(channel, *cells)
    if table.row_count:
        print_table(table)
    if len(responses) > len(shown):
        echo(f"The channels of {len(responses) - len(shown)} more are in the folder.")
    echo(f"Wrote {shown_path(out)}")
    for response in responses.values():
        if response.stopped_by is not None:
            raise response.stopped_by
    if not all(response.succeeded for response in responses.values()):
        raise typer.Exit(1)


def _print_status(name: str, response: Response) -> None:
    text = f"{name}: {response.status}"
    if response.stopped_by is None and not response.succeeded:
        text = f"Error: {text}"
    echo(text, err=not response.succeeded)
