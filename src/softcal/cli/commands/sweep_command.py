"""The command `softcal sweep`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from softcal.cli.calibration_bars import calibration_progress
from softcal.cli.command import ProjectFile, register_command, resumable
from softcal.cli.commands.calibrate_commands import report_run
from softcal.cli.printing import echo, print_table, print_warnings, shown_path
from softcal.cli.running import executor_told, page_beside
from softcal.cli.values import LOCAL, On, Values, WithPage, WithReport, Workers, names, parsed_pairs, parsed_values

OVER = "NAME=VALUES, such as springs.youngs_modulus=10GPa:1GPa:1GPa"


@register_command("judge", 2)
def sweep(  # noqa: PLR0913 (one argument for each option)
    project: ProjectFile,
    over: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUES",
            help="A parameter and its values: start:stop:step (springs.youngs_modulus=10GPa:1GPa:1GPa), a list "
            "(springs.poissons_ratio=0.43,0.4), or both; repeat for further ones. Default: as in the project.",
            show_default=False,
        ),
    ] = None,
    experiments: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Only these experiments (cable6_2, or cable6*).", show_default=False),
    ] = None,
    workers: Workers = None,
    on: On = LOCAL,
    values: Values = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Run folder; 'sweep' beside the project by default.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the sweep in the folder.")] = False,
    report: WithReport = True,
    watch: WithPage = False,
) -> None:
    """Simulate every cell of a grid of parameters; write each one's errors, the best cells, and a report."""
    from softcal.project.project import load

    axes = parsed_pairs(over, "--over", "this is not an axis", OVER)
    loaded = load(project, values=parsed_values(values))
    from softcal.workflows.sweep import sweep as sweep_project

    print_warnings(loaded.warnings)
    folder = out if out is not None else project.parent / "sweep"
    with page_beside(folder, wanted=watch):
        with resumable(folder, "Every cell", "the same command and --resume"):
            with executor_told(on, workers) as executor, calibration_progress() as bars:
                swept = sweep_project(
                    loaded,
                    over=axes or None,
                    experiments=None if experiments is None else names(experiments),
                    out=folder,
                    resume=resume,
                    workers=executor,
                    progress=bars.show,
                )
            from rich.table import Table

            from softcal.units import format_quantity

            result = swept.result
            table = Table("best for", *result.parameters, "error", "nominal", "reduced by")
            for best in swept.best:
                cells = [format_quantity(best.trial.theta[name], p.unit) for name, p in result.parameters.items()]
                gain = best.reduction
                errors = [*map(best.section.text, (best.error, best.nominal)), "" if gain is None else f"{gain:.0f} %"]
                table.add_row(best.section.name, *cells, *errors)
            print_table(table)
            echo(swept.result.status)
            if swept.nominal.loss is None:
                echo(f"Note: the nominal values could not be simulated: {swept.nominal.failure}")
            for note in swept.result.notes:
                echo(f"Note: {note}")
            if swept.stopped_by is not None:
                raise swept.stopped_by
        echo(f"Sweep: {shown_path(folder)}")
        if report:
            report_run(folder, None)
