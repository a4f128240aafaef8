"""The command `softcal mesh-study`."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from softcal.cli.app import app, told
from softcal.cli.export_commands import Source
from softcal.cli.printing import print_table, print_warnings
from softcal.cli.values import Values, parsed_values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from softcal.analysis.mesh_changes import Change
    from softcal.analysis.mesh_study import Finer, MeshStudy, Observer
    from softcal.calibration.result import Estimate


@app.command("mesh-study")
@told
def mesh_study(
    source: Source,
    calibration: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Which of a run's calibrations; the joint one by default.", show_default=False
        ),
    ] = "",
    element: Annotated[str, typer.Option(metavar="KIND", help="What bodies of lower elements are raised to.")] = "P2P1",
    halvings: Annotated[int, typer.Option(metavar="N", help="How often elements are halved (a tet in eight).")] = 2,
    unknowns: Annotated[int, typer.Option(metavar="N", help="Leave out what has more unknowns.")] = 150_000,
    values: Values = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="A folder that is new or empty; of a run 'mesh-study' in it by default, where its report finds it.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """What the mesh contributes: the twin once more on finer ones, and what parameters would make up for it.

    No mesher is needed: every tet is cut in eight, linear tets are made quadratic, elements of rods are halved.
    """
    from softcal.analysis.mesh_verdict import mesh_verdicts
    from softcal.project.mesh_study import default_folder, study, study_source, write_study
    from softcal.project.output import require_free_folder

    folder = out if out is not None else default_folder(source)
    if folder is not None:
        require_free_folder(folder)
    studied = study_source(source, parsed_values(values), calibration)
    print_warnings(studied.project.warnings if not source.is_dir() else ())
    with _bars() as show:
        found = study(studied, element=element, halvings=halvings, max_unknowns=unknowns, progress=show)
    if studied.calibration:
        typer.echo(f"What the mesh contributes to the calibration '{studied.calibration}'")
    print_table(_table(found))
    for one in found.finer:
        if one.failure:
            typer.echo(f"Not simulated, {one.name} ({one.what}): {one.failure}")
    for note in found.notes:
        typer.echo(f"Note: {note}")
    for verdict in mesh_verdicts(found):
        typer.echo(verdict.text)
    if folder is not None:
        write_study(found, studied, folder)
        typer.echo(f"Wrote {folder}")
        if folder == default_folder(source):
            typer.echo(f"Into the report with: softcal report {source}")


@contextmanager
def _bars() -> Generator[Observer]:
    """On the terminal, a bar for each discretisation with its trajectories and its time; else nothing."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        SpinnerColumn,
        TaskID,
        TextColumn,
        TimeElapsedColumn,
    )

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(20),
        MofNCompleteColumn(),
        TextColumn("curves"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty()) as bars:
        tasks: dict[str, TaskID] = {}

        def show(name: str, done: int, of: int | None) -> None:
            if name not in tasks:
                tasks[name] = bars.add_task(name, total=of)
            bars.update(tasks[name], completed=done, total=of)

        yield show


def _table(found: MeshStudy) -> Table:
    """A column for each discretisation: its size, what it changes, what would be found on it."""
    from rich.table import Table

    from softcal.cli.calibration_table import value_text
    from softcal.units import format_quantity, readable_unit

    finer = [one for one in found.finer if not one.failure]
    table = Table("", "as it is", *(one.name for one in finer))
    sizes = [found.size, *(one.size for one in finer)]
    for what, key in (("tets", "tets"), ("elements of rods", "rod_elements"), ("unknowns", "unknowns")):
        if getattr(found.size, key):
            table.add_row(what, *("" if size is None else f"{getattr(size, key):,}" for size in sizes))
    table.add_row("loss", f"{found.loss:.4g}", *(_number(one.loss) for one in finer))
    table.add_row("loss after the shifts", "", *(_number(one.reachable) for one in finer))
    table.add_section()
    _add_changes(table, finer)
    table.add_section()
    for label, estimate in found.parameters.items():
        unit = readable_unit(estimate.value, estimate.unit)
        there = [format_quantity(one.values[label], estimate.unit, unit) for one in finer]
        table.add_row(label.replace("[", r"\["), value_text(estimate), *there)
        table.add_row("  shift", "", *(_shift(estimate, one, label) for one in finer))
    return table


def _add_changes(table: Table, finer: Sequence[Finer]) -> None:
    """Lines for what happens to each channel, over all experiments, and how that stands beside noise and residual."""
    from softcal.analysis.mesh_changes import pooled

    changes = [pooled(one.changes) for one in finer]
    for name in dict.fromkeys(name for held in changes for name in held):
        own = [held[name] for held in changes]
        table.add_row(f"{name}, change", "", *(_change(c) for c in own))
        table.add_row("  over its RMSE", "", *(_number(c.rms / c.residual if c.residual else None) for c in own))
        if any(c.noise for c in own):
            table.add_row("  over its noise", "", *(_number(c.rms / c.noise if c.noise else None) for c in own))
        if any(c.order for c in own):
            table.add_row("  order", "", *("" if c.order is None else f"{c.order:.1f}" for c in own))


def _change(change: Change) -> str:
    from softcal.units import format_quantity

    if change.share is not None:
        return f"{100 * change.share:+.2g} %"
    return format_quantity(change.rms, change.unit, digits=3)


def _shift(estimate: Estimate, one: Finer, label: str) -> str:
    from softcal.analysis.mesh_verdict import shift_text

    return shift_text(estimate, one.values[label]) + (" at bound" if label in one.at_bound else "")


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"
