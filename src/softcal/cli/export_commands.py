"""The commands `softcal export …`: a project, or a calibrated run, for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from softcal.cli.app import app, exit_on_error
from softcal.cli.printing import print_warnings
from softcal.cli.running import clock, motion_bars
from softcal.cli.values import Values, names, parsed_values

export = typer.Typer(
    help="Write a project, or the result of a calibration, for other programs.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
app.add_typer(export, name="export")

Source = Annotated[
    Path, typer.Argument(metavar="RUN_OR_PROJECT", help="A run folder, or a project file.", show_default=False)
]
Out = Annotated[Path, typer.Option(metavar="DIR", help="A folder that is new or empty.", show_default=False)]
Pull = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CABLE=VALUE",
        help="Instead of the experiments: pull a cable (front=40mm, front=8N); repeat for several cables.",
        show_default=False,
    ),
]


@export.command()
@exit_on_error
def vtk(
    source: Source,
    out: Out,
    pull: Pull = None,
    shapes: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="For an animation: N shapes in even steps of the pull; by default the solved load steps.",
            show_default=False,
        ),
    ] = None,
    in_time: Annotated[bool, typer.Option("--in-time", help="Shapes of the motion, as by simulate --in-time.")] = False,
    values: Values = None,
) -> None:
    """For ParaView: shapes over a pull as .vtu files, with displacement, stress, strain and the parameters."""
    from softcal.workflows.source import load_calibrated

    project = load_calibrated(source, parsed_values(values))
    from softcal.workflows.cases import cases
    from softcal.workflows.exporting import export_vtk

    chosen = cases(project, pull or ())
    crossings: list[str] = []  # printed after the progress display is removed
    if in_time:
        with motion_bars() as show:
            written = export_vtk(project, chosen, out, shapes, in_time=True, progress=show, tell=crossings.append)
    else:
        with clock() as show:
            written = export_vtk(project, chosen, out, shapes, tell=crossings.append, stage=show)
    print_warnings(crossings)
    typer.echo(f"Wrote {len(written)} files into {out}")


@export.command()
@exit_on_error
def calculix(source: Source, out: Out, pull: Pull = None, values: Values = None) -> None:
    """For CalculiX: a deck of the robot at the end of each experiment or pull, with the cables as springs."""
    from softcal.workflows.source import load_calibrated

    project = load_calibrated(source, parsed_values(values))
    from softcal.workflows.cases import cases
    from softcal.workflows.exporting import export_calculix

    crossings: list[str] = []
    with clock() as show:
        export_calculix(cases(project, pull or ()), out, tell=crossings.append, stage=show)
    print_warnings(crossings)
    typer.echo(f"Wrote {out}; run it there with: ccx -i robot")


@export.command()
@exit_on_error
def sofa(source: Source, out: Out, pull: Pull = None, values: Values = None) -> None:
    """For SOFA: a scene for SofaPython3 and SoftRobots, with meshes, parameters as JSON, keys and a schedule."""
    from softcal.workflows.source import load_calibrated

    project = load_calibrated(source, parsed_values(values))
    from softcal.twin.protocol import Protocol
    from softcal.workflows.cases import Case, cases
    from softcal.workflows.exporting import export_sofa

    has_pull = bool(pull) or bool(project.experiments)
    export_sofa(project, cases(project, pull or ()) if has_pull else {"": Case(project.robot, Protocol({}))}, out)
    typer.echo(f"Wrote {out}; run it with: runSofa -l SofaPython3 {out / 'scene.py'}")


@export.command()
@exit_on_error
def reduced(
    source: Source,
    out: Out,
    reach: Annotated[
        str,
        typer.Option(
            metavar="VALUE",
            help="Largest pull of the cables: 8N, or 40mm with one cable; or for each: front=8N,left=40mm.",
            show_default=False,
        ),
    ],
    cables: Annotated[
        str, typer.Option(metavar="NAMES", help="One to three cables, by default all: front,left.", show_default=False)
    ] = "",
    samples: Annotated[
        int | None, typer.Option(metavar="N", help="Nodes along each cable; by default 33, 9 or 7.", show_default=False)
    ] = None,
    values: Values = None,
) -> None:
    """For a controller: tensions to poses, shortenings and compliance, as JSON with a self-contained evaluator."""
    from softcal.workflows.source import load_calibrated

    project = load_calibrated(source, parsed_values(values))
    from softcal.workflows.exporting import export_reduced

    crossings: list[str] = []
    with clock() as show:
        show("Simulating the nodes of the model, and points between them")
        written = export_reduced(project, out, reach, names(cables), samples, tell=crossings.append)
    print_warnings(crossings)
    typer.echo(written[-1].read_text(encoding="utf-8"))
    typer.echo(f"Wrote {out}")
