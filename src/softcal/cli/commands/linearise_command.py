"""The command `softcal linearise`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo, print_table, print_warnings, shown_path
from softcal.cli.values import Source, Values, parsed_values


@register_command("plan", 4)
def linearise(
    source: Source,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ACTUATOR=VALUE",
            help="The commands: a tension (front=3N), an input of the system, or a shortening (front=4mm), which "
            "stays; repeat for several. Without: at rest.",
            show_default=False,
        ),
    ] = None,
    modes: Annotated[int, typer.Option(metavar="N", help="Number of modes.")] = 6,
    by: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARAMETER",
            help="A parameter of the robot by which the frequencies get derivatives, such as neck.youngs_modulus; "
            "repeat for several.",
            show_default=False,
        ),
    ] = None,
    values: Values = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="A folder, new or empty, for the system as NPZ and JSON.", show_default=False),
    ] = None,
) -> None:
    """The linear system of small motions about an equilibrium: frequencies, damping, and matrices for a controller.

    Of a project, or of a run at its calibrated values, with the damping of the project's dynamics.
    """
    from rich.table import Table

    from softcal.twin.parameters import robot_parameters
    from softcal.units import format_quantity
    from softcal.workflows.cases import parse_pulls
    from softcal.workflows.linearise import linear_sentences
    from softcal.workflows.linearise import linearise as find
    from softcal.workflows.study_source import load_calibrated

    project = load_calibrated(source, parsed_values(values))
    print_warnings(project.warnings if not source.is_dir() else ())
    given = parse_pulls(project.robot, at or (), "--at").commands
    commands = {name: float(command.values[-1]) for name, command in given.items()}
    controls = {name: command.control for name, command in given.items()}
    found = find(project, commands, controls=controls, modes=modes, parameters=by or (), out=out)
    known = robot_parameters(project.robot)
    changes, heads = list[float](), list[str]()
    for name in found.parameters:
        value, unit = known[name].value, known[name].quantity.unit
        changes.append(0.01 * value if value else 1.0)
        heads.append(f"by +1 % of {name}" if value else f"per {unit} of {name}")
    table = Table("mode", "frequency", "damping ratio", *heads)
    each = zip(found.frequencies, found.damping_ratios, found.frequency_rates * changes, strict=True)
    for k, (frequency, ratio, rates) in enumerate(each, start=1):
        shown = [format_quantity(rate, "Hz", digits=3) for rate in rates.tolist()]
        table.add_row(str(k), format_quantity(float(frequency), "Hz", digits=4), f"{ratio:.3g}", *shown)
    print_table(table)
    echo(f"Inputs: {', '.join(found.inputs)}." if found.inputs else "No inputs.")
    for sentence in linear_sentences(found):
        echo(sentence)
    if out is not None:
        echo(f"Wrote {shown_path(out)}")
