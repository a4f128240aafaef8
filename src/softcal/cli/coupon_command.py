"""The command `softcal coupon`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from softcal.cli.app import app, exit_on_error
from softcal.cli.printing import print_table, print_warnings
from softcal.cli.running import clock
from softcal.errors import Fault, ParameterError

if TYPE_CHECKING:
    from rich.table import Table

    from softcal.coupons.comparison import ComparedLaw, LawComparison


MOST_REACH = 100.0


@app.command("coupon")
@exit_on_error
def coupon(
    data: Annotated[
        list[Path],
        typer.Argument(metavar="DATA...", help="Tables of coupon tests, a file for each kind.", show_default=False),
    ],
    test: Annotated[
        list[str],
        typer.Option(
            "--test",
            metavar="KIND",
            help="Kind of test, once for all files or once for each: uniaxial, planar, equibiaxial, biaxial or shear.",
            show_default=False,
        ),
    ],
    law: Annotated[
        list[str] | None,
        typer.Option("--law", metavar="NAME", help="Law to fit; several; all by default.", show_default=False),
    ] = None,
    history: Annotated[
        list[str] | None,
        typer.Option(
            "--history",
            metavar="PART",
            help="What the material does beyond the law: softening, relaxation-N, maxwell-N, flow; several.",
            show_default=False,
        ),
    ] = None,
    poissons_ratio: Annotated[
        float, typer.Option(metavar="NUMBER", help="Poisson's ratio of the body, which coupons do not determine.")
    ] = 0.499,
    reach: Annotated[
        float | None,
        typer.Option(
            metavar="STRETCH",
            help="Stretch up to which to look at stability; 1.5 times the largest by default.",
            show_default=False,
        ),
    ] = None,
    body: Annotated[str, typer.Option(metavar="NAME", help="The body's name in the block of a project file.")] = "body",
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="A folder, new or empty, for charts, tables and the block.", show_default=False
        ),
    ] = None,
) -> None:
    """Fit laws, alone or with a history, to coupon tests: intervals, errors held out, stability, a body's block."""
    from softcal.workflows.output import require_free_folder

    if out is not None:
        require_free_folder(out)
    from softcal.coupons.comparison import compare_laws
    from softcal.coupons.plausibility import implausible
    from softcal.project.material_block import material_block
    from softcal.quantities import QUANTITIES
    from softcal.workflows.coupon import all_coupons, write_comparison

    nu = QUANTITIES["Poisson's ratio"].checked(poissons_ratio, where="--poissons-ratio")
    if reach is not None and not 1.0 < reach <= MOST_REACH:
        raise ParameterError(
            Fault("this is no stretch to look at", "--reach", f"{reach:g}", f"above 1, to {MOST_REACH:g}")
        )
    coupons = all_coupons(data, test)
    print_warnings(implausible(coupons))
    with clock() as doing:
        found = compare_laws(coupons, law or (), history=history or (), poissons_ratio=nu, reach=reach, doing=doing)
    print_table(_laws(found))
    for name, other in found.same_as.items():
        typer.echo(f"{name}: in an incompressible body the same as {other}.")
    for name, why in found.left_out.items():
        typer.echo(f"{name}: {why}.")
    chosen = found.recommended
    shown = found.laws[0] if chosen is None else chosen
    print_table(_constants(shown))
    typer.echo(_verdict(found))
    if chosen is not None:
        typer.echo("\n" + material_block(chosen.fit, found, body))
    if out is not None:
        write_comparison(found, body, out)
        typer.echo(f"Wrote {out}")


def _laws(found: LawComparison) -> Table:
    """A line for each law, the least error on tests held out first."""
    from rich.table import Table

    from softcal.units import plain

    modes = list(found.laws[0].fit.stability.limits)
    table = Table("law", "constants", "error", "held out", "AICc", *(f"stable, {mode}" for mode in modes), "")
    least = min(one.fit.aic for one in found.laws)
    for one in found.laws:
        fit = one.fit
        limits = [
            f"to {plain(fit.stability.reach, 3)}"
            if end is None
            else f"below {plain(end, 3)}"
            if end > 1.0
            else "nowhere"
            for end in fit.stability.limits.values()
        ]
        held_out = f"{100 * one.held_out_error:.1f} %" if math.isfinite(one.held_out_error) else "none"
        aic = f"{fit.aic - least:.0f}" if math.isfinite(fit.aic) else "none"
        marks = [] if fit.stability.is_stable else ["unstable"]
        mark = ", ".join([*marks, *([] if fit.is_determined else ["not determined"])])
        table.add_row(one.name, str(len(fit.values)), f"{100 * fit.error:.1f} %", held_out, aic, *limits, mark)
    return table


def _constants(one: ComparedLaw) -> Table:
    """The constants of a law with their 95 % intervals."""
    from rich.table import Table

    from softcal.calibration.digits import interval_text, value_text

    table = Table(one.name, "value", "95 %")
    for name, estimate in one.fit.estimates.items():
        interval = "at its bound" if estimate.at_bound else interval_text(estimate) or "none"
        table.add_row(name, value_text(estimate), interval)
    return table


def _verdict(found: LawComparison) -> str:
    """Which law is recommended, and why."""
    from softcal.units import plain

    chosen = found.recommended
    sizes = ", ".join(f"{plain(size, 3)} {mode}" for mode, size in found.laws[0].fit.stability.measured.items())
    up_to = f"up to strains of the size measured (stretches of {sizes})"
    if chosen is None:
        return f"No law is recommended: none is stable {up_to}, with constants that the tests determine."
    return (
        f"Recommended: {chosen.name}, stable {up_to}. Where {found.kept_out} is predicted by the others its error is "
        f"{100 * chosen.held_out_error:.1f} %, nearly the least of the stable laws with constants that the tests "
        "determine, and it has the fewest constants of those."
    )
