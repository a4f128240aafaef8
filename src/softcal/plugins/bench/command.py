"""The commands `softcal bench …`: public benchmark cases."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from softcal.cli.command import exit_on_error, register_command
from softcal.cli.printing import echo, print_table, shown_path
from softcal.cli.running import clock, executor_told, page_beside
from softcal.cli.values import LOCAL, On, WithPage, Workers

if TYPE_CHECKING:
    from softcal.plugins.bench.score import Error, Score

bench = typer.Typer(
    name="bench",
    help="Robots that others measured: compare what softcal, or any other program, predicts of them.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
register_command("other programs", 3)(bench)

CaseName = Annotated[str, typer.Argument(metavar="CASE", help="See `softcal bench list`.", show_default=False)]
Data = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Further samples of the same robot, in the layout of the case (see its README), to be predicted in the "
        "place of its own.",
        show_default=False,
    ),
]


@bench.command("list")
@exit_on_error
def list_cases() -> None:
    """List the cases, with their samples to fit and to predict, licence, and README."""
    from rich.table import Table

    from softcal.errors import StorageError
    from softcal.plugins.bench.case import CASES

    table = Table("case", "to fit", "to predict", "what it is")
    lines: list[str] = []
    for name, case in CASES.items():
        told = f"{name}: {case.source}. Licence: {case.licence}."
        try:
            record = case.record()
            lines.append(f"{told} README: {case.readme}")
        except StorageError as error:
            table.add_row(name, "–", "–", case.title)
            lines.append(f"{told} {error}")
            continue
        n_fit = int(record.is_fit.sum())
        table.add_row(name, str(n_fit), str(len(record.samples) - n_fit), case.title)
    print_table(table)
    for line in lines:
        echo(line)


@bench.command()
@exit_on_error
def run(
    case: CaseName,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="A folder that is new or empty; 'bench/CASE' by default.")
    ] = None,
    data: Data = None,
    workers: Workers = None,
    on: On = LOCAL,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the fit in the folder.")] = False,
    watch: WithPage = False,
) -> None:
    """Fit a case's samples with softcal, predict the others, and write and score the predictions."""
    from softcal.plugins.bench.case import CASES
    from softcal.plugins.bench.run import FIT, run_case

    CASES.named(case)
    folder = out or Path("bench", case)
    with page_beside(folder / FIT, wanted=watch), executor_told(on, workers) as executor, clock() as show:
        done = run_case(case, folder, data=data, workers=executor, resume=resume, progress=show)
    _print_score(done.score)
    echo(f"Predictions and score: {shown_path(done.folder)}")


@bench.command()
@exit_on_error
def score(
    case: CaseName,
    predictions: Annotated[
        Path, typer.Argument(metavar="PREDICTIONS", help="A table of predictions (CSV).", show_default=False)
    ],
    data: Data = None,
    method: Annotated[str, typer.Option(metavar="NAME", help="Name of the method, for the page.")] = "",
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the score here, for the page.", show_default=False)
    ] = None,
) -> None:
    """Score a table of predictions of a case, by whatever program."""
    from softcal.plugins.bench.run import score_file

    _print_score(score_file(case, predictions, data=data, method=method, out=out))


def _print_score(found: Score) -> None:
    from rich.table import Table

    from softcal.plugins.bench.case import CASES
    from softcal.units import format_quantity

    case = CASES.named(found.case)
    table = Table("split", "samples", "of", "RMS", "mean", "95 % below", "largest", "mean, % of length")
    units = case.record().units

    def line(split: str, n: int, of: str, error: Error, unit: str) -> None:
        cells = [format_quantity(x, unit, digits=3) for x in (error.rms, error.mean, error.most_95, error.largest)]
        share = f"{100 * error.mean / case.length:.2g} %" if unit == "m" else ""
        table.add_row(split, str(n), of, *cells, share)

    for split, one in found.splits.items():
        if one.all_points is not None:
            line(split, one.n_samples, "all points", one.all_points, "m")
        for point, error in one.points.items():
            line(split, one.n_samples, point, error, "m")
        for channel, error in one.channels.items():
            line(split, one.n_samples, channel, error, units[channel])
    print_table(table)
    if found.data:
        echo(f"The samples to predict are those of {found.data}, not the case's own.")
    for name, value in (found.parameters or {}).items():
        echo(f"{name} = {value}")
    for split, one in found.splits.items():
        if one.coverage is not None:
            echo(f"{100 * one.coverage:.0f} % of the values to {split} are in their 95 % bands.")
    cost = [] if found.evaluations is None else [f"{found.evaluations} evaluations"]
    cost += [] if found.wall_s is None else [f"{found.wall_s:.3g} s"]
    if cost:
        echo(f"Cost: {', '.join(cost)}.")
    for row in case.published:
        errors = zip(("all points", "tip"), row.predict, strict=True)
        texts = ", ".join(f"{of} {1e3 * error:.3g} mm" for of, error in errors if error is not None)
        echo(f"Beside it: {row.method}: {texts or row.note} ({row.source})")


@bench.command()
@exit_on_error
def page(
    runs: Annotated[
        Path, typer.Argument(metavar="RUNS", help="A folder with the runs and scores of cases.", show_default=False)
    ],
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="The page (Markdown); its pictures are written beside it.")
    ] = Path("bench.md"),
) -> None:
    """Write one page of all scores below a folder: a picture of each robot, and a row for every method."""
    from softcal.plugins.bench.page import write_page

    with clock() as show:
        show("Drawing the robots")
        files = write_page(runs, out)
    echo(f"Page: {shown_path(out)}, with {len(files) - 1} pictures")
