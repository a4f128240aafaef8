"""The command `softcal coupon`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo, print_report_table, print_warnings, shown_path
from softcal.cli.running import clock
from softcal.errors import Fault, ParameterError

if TYPE_CHECKING:
    from softcal.plugins.coupons.fitted_material import PredictedCoupon


MOST_REACH = 100.0


@register_command("data", 1)
def coupon(  # noqa: PLR0913 (one argument for each option)
    data: Annotated[
        list[Path] | None,
        typer.Argument(metavar="DATA...", help="Tables of coupon tests, a file for each kind.", show_default=False),
    ] = None,
    test: Annotated[
        list[str] | None,
        typer.Option(
            "--test",
            metavar="KIND",
            help="Kind of test, once for all files or once for each, those of --predict last: uniaxial, planar, "
            "equibiaxial, biaxial or shear.",
            show_default=False,
        ),
    ] = None,
    law: Annotated[
        list[str] | None,
        typer.Option("--law", metavar="NAME", help="Law to fit; several; all by default.", show_default=False),
    ] = None,
    laws: Annotated[
        Path | None,
        typer.Option("--laws", metavar="FILE", help="File with laws of your own (a block laws:).", show_default=False),
    ] = None,
    history: Annotated[
        list[str] | None,
        typer.Option(
            "--history",
            metavar="PART",
            help="Parts of the material's history, beyond its law: softening, relaxation-N, maxwell-N, flow; several.",
            show_default=False,
        ),
    ] = None,
    predict: Annotated[
        list[Path] | None,
        typer.Option(
            "--predict",
            metavar="FILE",
            help="Test to predict, not fitted; stresses may be missing.",
            show_default=False,
        ),
    ] = None,
    stored: Annotated[
        Path | None,
        typer.Option(
            "--from", metavar="DIR", help="A folder of results: predict by its law, without a fit.", show_default=False
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
            metavar="DIR", help="A folder, new or empty, for a page, charts, tables and the block.", show_default=False
        ),
    ] = None,
) -> None:
    """Fit laws, alone or with a history, to coupon tests: intervals, errors held out, stability, a body's block."""
    from softcal.limits import part_name_fault
    from softcal.workflows.output import require_free_folder

    data, predict, test, law, history = data or [], predict or [], test or [], law or [], history or []
    faults: list[Fault] = []
    if stored is None and not data:
        faults.append(Fault("there is no test to fit", "DATA", "", "tables of coupon tests", "or --from DIR --predict"))
    if stored is not None and not predict:
        faults.append(Fault("there is no test to predict", "--from", str(stored), attempt="--predict FILE"))
    if stored is not None and (data or history):
        got = ", ".join([*map(str, data), *history])
        faults.append(Fault("a stored fit is not fitted again", "--from", got, "--predict FILE, --law, --laws, --out"))
    if stored is not None and len(law) > 1:
        faults.append(Fault("a prediction is by one law", "--law", ", ".join(law), "one"))
    if (data or predict) and not test:
        faults.append(
            Fault("the kind of test is missing", "--test", "", "uniaxial, planar, equibiaxial, biaxial, shear")
        )
    if faults:
        raise ParameterError(faults)
    if fault := part_name_fault(body):
        raise ParameterError(replace(fault, where="--body"))
    if out is not None:
        require_free_folder(out)
    from softcal.plugins.coupons.plausibility import implausible
    from softcal.plugins.coupons.workflow import all_coupons
    from softcal.project.own_law import read_laws
    from softcal.quantities import QUANTITIES

    nu = QUANTITIES["Poisson's ratio"].checked(poissons_ratio, where="--poissons-ratio")
    if reach is not None and not 1.0 < reach <= MOST_REACH:
        raise ParameterError(
            Fault("this stretch is out of range", "--reach", f"{reach:g}", f"above 1, to {MOST_REACH:g}")
        )
    if laws is not None:
        read_laws(laws)
    coupons, further = all_coupons(data, test, predict)
    print_warnings(implausible([*coupons, *further]))
    if stored is None:
        from softcal.materials.histories import history_of
        from softcal.plugins.coupons.comparison import compare_laws, require_times
        from softcal.plugins.coupons.material_block import material_block
        from softcal.plugins.coupons.sentences import moduli, verdict
        from softcal.plugins.coupons.tables import constants_table, laws_table, moduli_table, tests_table
        from softcal.plugins.coupons.workflow import write_comparison

        require_times(further, history_of(history, "--history"))
        with clock() as doing:
            found = compare_laws(coupons, law, history=history, poissons_ratio=nu, reach=reach, doing=doing)
        print_report_table(laws_table(found))
        print_report_table(moduli_table(found))
        for name, other in found.same_as.items():
            echo(f"{name}: in an incompressible body the same as {other}.")
        for name, why in found.left_out.items():
            echo(f"{name}: {why}.")
        shown, chosen = found.shown, found.recommended
        print_report_table(constants_table(shown))
        predicted = [shown.fit.material.predict(one) for one in further]
        if history or predicted:
            print_report_table(tests_table(shown.name, shown.fit.tests(found.coupons), predicted))
        echo(verdict(found))
        echo(moduli(shown))
        if chosen is not None:
            echo("\n" + material_block(chosen.fit, found, body))
        if out is not None:
            write_comparison(found, body, out, predicted, data)
            echo(f"Wrote {shown_path(out)}")
    else:
        from softcal.plugins.coupons.comparison import require_times
        from softcal.plugins.coupons.record import read_material
        from softcal.plugins.coupons.tables import tests_table
        from softcal.plugins.coupons.workflow import write_predictions

        material = read_material(stored, law[0] if law else None)
        require_times(further, material.constants.history)
        predicted: list[PredictedCoupon] = [material.predict(one) for one in further]
        name = material.constants.law.name
        print_report_table(tests_table(name, [], predicted))
        if out is not None:
            write_predictions(predicted, name, out)
            echo(f"Wrote {shown_path(out)}")
