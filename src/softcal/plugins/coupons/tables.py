"""Coupon tests, the laws that were compared on them, constants and predictions as tables."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from softcal.calibration.results.digits import interval_text, value_text
from softcal.plugins.coupons.comparison import ComparedLaw, LawComparison
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.fitted_material import PredictedCoupon
from softcal.plugins.coupons.law_fit import SmallStrain
from softcal.plugins.coupons.stability import Stability
from softcal.report.tables import Cell, Column, ReportTable
from softcal.units import digits_that_tell, format_quantity, format_range, plain


def coupons_table(fitted: Sequence[Coupon], predicted: Sequence[Coupon] = ()) -> ReportTable:
    """A row for each test: what was measured, and how it was strained."""
    has_times = any(one.time is not None for one in (*fitted, *predicted))
    columns = ["Specimen", "Kind of test", "Use", "Rows", "Strain", *["Typical rate", "Duration"] * has_times]
    rows: list[tuple[Cell, ...]] = []
    for used, tests in (("fitted", fitted), ("predicted", predicted)):
        for one in tests:
            row: list[Cell] = [one.name, one.test, used, len(one.strain), strains_text(one)]
            if has_times:
                rate = typical_rate(one)
                row.append(None if rate is None else f"{plain(rate, 2)} 1/s")
                row.append(None if one.time is None else format_quantity(float(one.time[-1]), "s", digits=3))
            rows.append(tuple(row))
    note = "Typical rate: half of the way in strain was made faster, half slower." if has_times else ""
    return ReportTable("coupons", "The tests", tuple(Column(label) for label in columns), tuple(rows), note)


def strains_text(coupon: Coupon) -> str:
    """The range of the strains of a test: "stretch 1.03 to 7.63"."""
    word = "amount of shear" if coupon.test == "shear" else "stretch"
    names = [word] if coupon.strain.shape[1] == 1 else [f"{word} {k + 1}" for k in range(coupon.strain.shape[1])]
    ends = zip(coupon.strain.min(axis=0), coupon.strain.max(axis=0), strict=True)
    return ", ".join(
        f"{name} {plain(low, 3)} to {plain(high, 3)}" for name, (low, high) in zip(names, ends, strict=True)
    )


def typical_rate(coupon: Coupon) -> float | None:
    """The median rate [1/s] over the way in strain, from rest on, so that holds do not count; None without times."""
    if coupon.time is None:
        return None
    strain = np.vstack([np.full_like(coupon.strain[:1], coupon.kind.at_rest), coupon.strain])
    way, lasted = np.linalg.norm(np.diff(strain, axis=0), axis=1), np.diff(coupon.time, prepend=0.0)
    moved = (way > 0.0) & (lasted > 0.0)
    if not moved.any():
        return None
    rates = way[moved] / lasted[moved]
    order = np.argsort(rates)
    made = np.cumsum(way[moved][order])
    return float(rates[order][np.searchsorted(made, 0.5 * made[-1])])


def laws_table(found: LawComparison) -> ReportTable:
    """A row for each law, the least error on tests held out first."""
    modes = list(found.laws[0].fit.stability.limits)
    labels = ["law", "constants", "error", "held out", "AICc", *(f"stable, {mode}" for mode in modes), "doubts"]
    least = min(one.fit.aic for one in found.laws)
    rows: list[tuple[Cell, ...]] = []
    for one in found.laws:
        fit = one.fit
        aic = f"{fit.aic - least:.0f}" if math.isfinite(fit.aic) else "none"
        errors = percent(fit.error, 1), percent(one.held_out_error, 1)
        limits = limit_texts(fit.stability).values()
        rows.append((one.name, str(len(fit.values)), *errors, aic, *limits, ", ".join(one.doubts)))
    note = (
        "Error: root mean square over that of the stresses. Held out: that of tests, or blocks of rows, that were not "
        "fitted. AICc: less the least one. Stable: up to the largest stretch that was looked at, or below the one from "
        "which the law gives way."
    )
    return ReportTable("laws", "All laws", tuple(Column(label) for label in labels), tuple(rows), note)


def moduli_table(found: LawComparison) -> ReportTable:
    """A row for each law: its moduli at small strain, and what its constants have to do with them."""
    rows: list[tuple[Cell, ...]] = []
    for one in found.laws:
        at = one.fit.small_strain
        E, ends = modulus_texts(at)
        G = format_quantity(at.shear_modulus, "Pa", digits=3)
        rows.append((one.name, E, ends or "none", plain(at.poissons_ratio, 4), G, at.formula))
    labels = ("law", "E", "95 %", "ν, stated", "G", "G by the constants")
    note = "At small strain" + ("; after a long time, without what the history adds." if found.history else ".")
    return ReportTable("moduli", "Moduli at small strain", tuple(map(Column, labels)), tuple(rows), note)


def modulus_texts(at: SmallStrain) -> tuple[str, str]:
    """Young's modulus and its 95 % interval in words, "" without a modulus."""
    if at.interval is None:
        return format_quantity(at.youngs_modulus, "Pa", digits=3), ""
    digits = digits_that_tell(*at.interval)
    return (
        format_quantity(at.youngs_modulus, "Pa", digits=digits),
        format_range(*at.interval, "Pa", digits=digits),
    )


def limit_texts(stability: Stability) -> dict[str, str]:
    """Mode -> up to which stretch the law is stable."""

    def text(end: float | None) -> str:
        if end is None:
            return f"to {plain(stability.reach, 3)}"
        return f"below {plain(end, 3)}" if end > 1.0 else "nowhere"

    return {mode: text(end) for mode, end in stability.limits.items()}


def constants_table(one: ComparedLaw) -> ReportTable:
    """The constants of a law with their 95 % intervals."""
    rows: list[tuple[Cell, ...]] = []
    for name, estimate in one.fit.estimates.items():
        interval = "at its bound" if estimate.at_bound else interval_text(estimate) or "none"
        rows.append((name, value_text(estimate), interval))
    labels = (", ".join([one.name, *one.fit.constants.parts]), "value", "95 %")
    return ReportTable("constants", "Constants", tuple(Column(label) for label in labels), tuple(rows))


def tests_table(law: str, fitted: Sequence[PredictedCoupon], predicted: Sequence[PredictedCoupon]) -> ReportTable:
    """A row for each test: errors of the law, also after the factor that would fit this specimen best.

    Parameters
    ----------
    law
        Name of the law.
    fitted
        The fitted tests as the law predicts them.
    predicted
        Tests that were not fitted.
    """
    labels = [f"tests by {law}", "use", "error", "NMAD", "in the band"]
    labels += ["factor of the stresses, that would fit best", "NMAD by it"]
    rows: list[tuple[Cell, ...]] = []
    for used, tests in (("fitted", fitted), ("predicted", predicted)):
        for one in tests:
            cells: list[Cell] = ["no stresses measured", None, None, None, None]
            if one.is_measured:
                factor = plain(one.factor, 3) if math.isfinite(one.factor) else "none"
                cells = [percent(one.error, 1), percent(one.nmad, 2), percent(one.inside, 0), factor]
                cells.append(percent(one.nmad_by_factor, 2))
            rows.append((one.coupon.name, used, *cells))
    title = "Fitted and predicted tests" if predicted else "Fitted tests"
    note = "NMAD: mean |predicted - measured| over the larger of mean |measured| and mean |predicted|"
    return ReportTable("tests", title, tuple(map(Column, labels)), tuple(rows), note)


def percent(share: float, digits: int) -> str:
    """A share in per cent; an en dash where there is no number."""
    return f"{100 * share:.{digits}f} %" if math.isfinite(share) else "–"
