"""The command `softcal importance`."""

from __future__ import annotations

from typing import Annotated

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo, print_table
from softcal.cli.running import clock, executor_told
from softcal.cli.study import CalibrationName, StudyFolder, begin_study, end_study, study_folder
from softcal.cli.values import LOCAL, On, Source, Values, Workers


@register_command("judge", 5)
def importance(
    source: Source,
    calibration: CalibrationName = "",
    simulations: Annotated[int, typer.Option(metavar="N", help="Evaluations of the twin, at most.")] = 400,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the points.")] = 1,
    workers: Workers = None,
    on: On = LOCAL,
    values: Values = None,
    out: StudyFolder = None,
) -> None:
    """Which parameter decides the loss, the force, the pitch over the bounds of the search: Sobol indices.

    By SALib on a surrogate of the twin through some hundred trajectories, which is checked at others.
    """
    studied = begin_study(source, values, calibration)
    from rich.table import Table

    from softcal.analysis.importance_verdict import index_text
    from softcal.units import plain
    from softcal.workflows.importance import IMPORTANCE, study_importance

    folder = study_folder(IMPORTANCE, source, out)
    with executor_told(on, workers) as executor, clock() as show:
        study = study_importance(
            studied,
            simulations=simulations,
            seed=seed,
            workers=executor,
            progress=lambda n: show(f"{n} evaluations"),
        )
    for name, output in study.outputs.items():
        fanova = study.fanova if name == "loss" else {}
        table = Table(name, "alone", "with others", *["fANOVA"] * bool(fanova))
        for label, first in output.first.items():
            cells = [index_text(first), index_text(output.total[label])]
            table.add_row(label, *cells, *([f"{fanova[label]:.3f}"] if label in fanova else []))
        print_table(table)
    errors = ", ".join(f"{name} {100 * one.surrogate_error:.1g} %" for name, one in study.outputs.items())
    counted = ", ".join(f"{plain(value, 6)} {name}" for name, value in study.facts.items())
    echo(f"{counted}; {plain(study.wall_s, 2)} s. Error of the surrogate over the standard deviation: {errors}.")
    echo("± is half the 95 % interval.")
    end_study(IMPORTANCE, study, studied, folder, study.notes, source)
