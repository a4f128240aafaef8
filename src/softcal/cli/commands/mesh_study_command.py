"""The command `softcal mesh-study`."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo, print_table
from softcal.cli.running import executor_told
from softcal.cli.study import CalibrationName, StudyFolder, begin_study, end_study, study_folder
from softcal.cli.values import LOCAL, On, Source, Values, Workers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from softcal.analysis.mesh_study import Finer, MeshStudy, Observer


@register_command("judge", 3)
def mesh_study(  # noqa: PLR0913 (one argument for each option)
    source: Source,
    calibration: CalibrationName = "",
    element: Annotated[str, typer.Option(metavar="KIND", help="Element that replaces those of lower order.")] = "P2P1",
    halvings: Annotated[int, typer.Option(metavar="N", help="Number of halvings (a tet into eight).")] = 2,
    unknowns: Annotated[int, typer.Option(metavar="N", help="Skip meshes with more unknowns.")] = 150_000,
    workers: Workers = None,
    on: On = LOCAL,
    values: Values = None,
    out: StudyFolder = None,
) -> None:
    """Influence of the mesh: simulate the twin on finer meshes, and predict the shift of its parameters.

    No mesher is needed: every tet is divided into eight, linear tets become quadratic, rod elements are halved.
    """
    studied = begin_study(source, values, calibration)
    from rich.table import Table

    from softcal.workflows.mesh_study import MESH_STUDY, study

    folder = study_folder(MESH_STUDY, source, out)
    with executor_told(on, workers) as executor, _bars() as show:
        result = study(
            studied, element=element, halvings=halvings, max_unknowns=unknowns, workers=executor, progress=show
        )
    if studied.calibration:
        echo(f"Contribution of the mesh to the calibration '{studied.calibration}'")
    finer = [mesh for mesh in result.finer if not mesh.failure]
    keys = {"tets": "tets", "elements of rods": "rod_elements", "unknowns": "unknowns"}
    shown = {what: key for what, key in keys.items() if getattr(result.size, key)}
    sizes = Table("", *shown, "loss", "loss after shifts")
    for name, size, loss, after in [
        ("original", result.size, result.loss, None),
        *((mesh.name, mesh.size, mesh.loss, mesh.reachable) for mesh in finer),
    ]:
        cells = ("" if size is None else f"{getattr(size, key):,}" for key in shown.values())
        sizes.add_row(name, *cells, _number(loss, 4), _number(after, 4))
    print_table(sizes)
    if finer:
        print_table(_changes(finer))
        print_table(_parameters(result, finer))
    for mesh in result.finer:
        if mesh.failure:
            echo(f"Not simulated, {mesh.name} ({mesh.what}): {mesh.failure}")
    end_study(MESH_STUDY, result, studied, folder, result.notes, source)


@contextmanager
def _bars() -> Generator[Observer]:
    """On a terminal, a progress bar for each discretisation; else nothing."""
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
                for task in bars.tasks:  # earlier discretisations are complete
                    bars.update(task.id, total=task.completed)
                tasks[name] = bars.add_task(name, total=of)
            bars.update(tasks[name], completed=done, total=of)

        yield show


def _changes(finer: Sequence[Finer]) -> Table:
    """A line per channel and discretisation: the change over all experiments, over residual and noise."""
    from rich.table import Table

    from softcal.analysis.mesh_changes import pooled
    from softcal.units import format_quantity

    changes = {mesh.name: pooled(mesh.changes) for mesh in finer}
    is_noisy = any(c.noise for channels in changes.values() for c in channels.values())
    has_order = any(c.order for mesh in finer for c in mesh.changes)
    heads = ["over its RMSE", *["over its noise"] * is_noisy, *["order"] * has_order]
    table = Table("channel", "on", "change", *heads)
    for name in dict.fromkeys(name for channels in changes.values() for name in channels):
        for on, channels in changes.items():
            c = channels[name]
            cells = [_number(c.rms / c.residual if c.residual else None)]
            cells += [_number(c.rms / c.noise if c.noise else None)] * is_noisy
            cells += [_number(c.order, 2)] * has_order
            change = f"{100 * c.share:+.2g} %" if c.share is not None else format_quantity(c.rms, c.unit, digits=3)
            table.add_row(name, on, change, *cells)
        if len(finer) > 1:
            table.add_section()
    return table


def _parameters(study: MeshStudy, finer: Sequence[Finer]) -> Table:
    """Lines per parameter: calibrated value, and values expected on finer meshes; one line per rig parameter."""
    from rich.table import Table

    from softcal.analysis.mesh_verdict import shift_text
    from softcal.calibration.results.digits import shown, with_unit
    from softcal.cli.calibration_table import value_text

    table = Table("parameter", "on", "value", "shift")
    for label, estimate in study.parameters.items():
        name = label
        if label in study.of_robot:
            table.add_row(label, "original", value_text(estimate), "")
            name = ""
        for mesh in finer:
            if label in study.of_robot or mesh.name == study.reference:
                there = with_unit(estimate, shown(estimate, mesh.values[label]))
                bound = " (at a bound)" if label in mesh.at_bound else ""
                table.add_row(name, mesh.name, there + bound, shift_text(estimate, mesh.values[label]))
        if label in study.of_robot:
            table.add_section()
    return table


def _number(value: float | None, digits: int = 3) -> str:
    return "" if value is None else f"{value:.{digits}g}"
