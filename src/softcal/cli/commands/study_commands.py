"""The commands `softcal intervals` and `softcal importance`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo, print_table
from softcal.cli.running import clock, executor_told
from softcal.cli.study import CalibrationName, StudyFolder, begin_study, end_study, study_folder
from softcal.cli.values import LOCAL, On, Source, Values, Workers


@register_command("judge", 4)
def intervals(  # noqa: PLR0913 (one argument for each option)
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a calibrated run.", show_default=False)],
    by: Annotated[
        str, typer.Option(metavar="METHOD", help="Method: profile, posterior, jackknife or bootstrap.")
    ] = "profile",
    over: Annotated[
        str,
        typer.Option(
            metavar="GROUPS",
            help="Groups for a jackknife or bootstrap: experiments, actuators, weights, markers, cycles or "
            "records (pieces of them).",
            show_default=False,
        ),
    ] = "",
    calibration: CalibrationName = "",
    samples: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Number of draws: 10,000 of a posterior, 2000 of a bootstrap.", show_default=False
        ),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the draws.")] = 1,
    workers: Workers = None,
    on: On = LOCAL,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="A folder that is new or empty; default: 'intervals-METHOD[-GROUPS]' in RUN.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """95 % intervals where the quadratic model may not do, beside the quick ones of `calibrate`.

    profile: fits with one parameter fixed, some eight trajectories a parameter. posterior: draws by emcee within the
    bounds, with a surrogate of the twin through some fifty trajectories, which is checked at others.
    jackknife: one group of measurements left out at a time, without a further trajectory. bootstrap: groups with random
    weights, the ends confirmed by some three trajectories each.
    """
    from rich.table import Table

    from softcal.units import format_quantity, plain
    from softcal.workflows.intervals import INTERVALS, check_method, default_folder, study_intervals
    from softcal.workflows.output import require_free_folder
    from softcal.workflows.study_source import run_source

    check_method(by, over)
    folder = out if out is not None else default_folder(run, by, over)
    require_free_folder(folder)
    source = run_source(run, calibration)
    with executor_told(on, workers) as executor, clock() as show:
        study = study_intervals(
            source,
            by,
            over=over,
            samples=samples,
            seed=seed,
            workers=executor,
            progress=lambda n: show(f"{n} evaluations"),
        )
    echo(f"95 % intervals of the calibration '{source.calibration}'")
    table = Table("parameter", "value", "quick", study.by, "difference")
    for label, interval in study.intervals.items():
        share = interval.difference
        bounds = ", ".join(
            f"{side} bound" for side, is_at in zip(("lower", "upper"), interval.at_bounds, strict=True) if is_at
        )
        table.add_row(
            label,
            format_quantity(interval.value, interval.unit),
            interval.text(interval.quick),
            interval.text(interval.found) + (f" ({bounds})" if bounds else ""),
            "" if share is None else f"{plain(100 * share, 2)} %",
        )
    print_table(table)
    counted = ", ".join(f"{plain(value, 4)} {name}" for name, value in study.facts.items())
    echo(f"{counted}; {plain(study.wall_s, 2)} s")
    end_study(INTERVALS, study, source, folder, study.notes, run)


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
