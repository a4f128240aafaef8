"""The command `softcal validate`: cross-validation by left-out experiments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo, print_table, print_warnings, shown_path
from softcal.cli.running import executor_told
from softcal.cli.values import LOCAL, On, Values, Workers, names, parsed_values

if TYPE_CHECKING:
    from rich.table import Table

    from softcal.calibration.results.result import ExperimentFit


@register_command("judge", 1)
def validate(
    projects: Annotated[
        list[Path],
        typer.Argument(metavar="PROJECT...", help="One project, or several models of one robot.", show_default=False),
    ],
    hold_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAMES",
            help="Leave these experiments out together (load52_a,load52_b or load52*); repeat for further folds. "
            "By default each experiment in turn.",
            show_default=False,
        ),
    ] = None,
    split: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Also with these tied parameters untied: a value for each."),
    ] = None,
    workers: Workers = None,
    on: On = LOCAL,
    values: Values = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="A CSV file for all predictions.", show_default=False)
    ] = None,
) -> None:
    """Leave experiments out in turn, fit the others, and report the errors of the predictions."""
    from softcal.cli.calibration_bars import calibration_progress
    from softcal.project.project import load
    from softcal.workflows.output import require_free_file

    if out is not None:
        require_free_file(out)
    loaded = {str(path): load(path, values=parsed_values(values)) for path in projects}
    from rich.table import Table

    from softcal.cli.calibration_table import value_text
    from softcal.workflows.validation import validate as validate_projects
    from softcal.workflows.validation import write_validation

    for project in loaded.values():
        print_warnings(project.warnings)
    labels = {path: Path(path).stem for path in loaded}
    unique = len(set(labels.values())) == len(labels)
    with executor_told(on, workers) as executor, calibration_progress() as bars:
        validation = validate_projects(
            {labels[path] if unique else path: project for path, project in loaded.items()},
            hold_out=[names(fold) for fold in hold_out or []],
            split=split or [],
            workers=executor,
            progress=lambda model, fold, state: bars.show(f"{model} without {fold}", state),
        )
    table = Table("", *validation.models)
    folds = [prediction.left_out for prediction in next(iter(validation.models.values()))]
    for i, fold in enumerate(folds):
        fits = {model: folded[i] for model, folded in validation.models.items() if i < len(folded)}
        shared = [n for fit in fits.values() for n in fit.result.parameters if "[" not in n and "frame." not in n]
        for name in dict.fromkeys(shared):
            estimates = (fits[m].result.parameters.get(name) if m in fits else None for m in validation.models)
            cells = ("" if estimate is None else value_text(estimate) for estimate in estimates)
            table.add_row(f"{name}, without {', '.join(fold)}", *cells)
        for experiment in fold:
            tests = {m: [fit.held_out[experiment].fit] for m, fit in fits.items() if experiment in fit.held_out}
            _add_errors(table, f"predicted: {experiment}", [tests.get(model, []) for model in validation.models])
        table.add_section()
    pooled = [[h.fit for fit in fits for h in fit.held_out.values()] for fits in validation.models.values()]
    _add_errors(table, "all predictions", pooled)
    print_table(table)
    for model, predictions in validation.models.items():
        for prediction in predictions:
            for note in prediction.result.notes:
                if "held out" in note.text or "bound" in note.text:
                    echo(f"Note ({model} without {', '.join(prediction.left_out)}): {note}")
    if out is not None:
        write_validation(validation, out)
        echo(f"Wrote {shown_path(out)}")


def _add_errors(table: Table, what: str, held: Sequence[Sequence[ExperimentFit]]) -> None:
    """A line for the RMS error of each channel, or of the distance; held: the predictions of each model."""
    from softcal.analysis.validation import pooled_errors
    from softcal.units import format_quantity

    errors: list[dict[str, str]] = []  # with their units, "0.94 mm (0.22 %)"
    for fits in held:
        texts: dict[str, str] = {}
        units = {name: unit for fit in fits for name, unit in fit.units.items()}  # each test has its own channels
        for name, error in pooled_errors(fits).items():
            if name == "distance":
                lengths = {fit.length for fit in fits}
                length = lengths.pop() if len(lengths) == 1 else None
                share = "" if length is None else f" ({100 * error / length:.3g} %)"
                texts[name] = f"{1e3 * error:.3g} mm{share}"
            else:
                texts[name] = format_quantity(error, units[name], digits=3)
        errors.append(texts)
    names = dict.fromkeys(name for one in errors for name in one)
    for name in names:
        table.add_row(f"{what}, {name} (RMS)", *(one.get(name, "" if one else "not predicted") for one in errors))
    if not names:
        table.add_row(what, *("not predicted" for _ in held))
