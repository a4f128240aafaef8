"""What `softcal coupon` prints of laws, constants and tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from softcal.units import plain

if TYPE_CHECKING:
    from rich.table import Table

    from softcal.coupons.comparison import ComparedLaw, LawComparison
    from softcal.coupons.fitted_material import PredictedCoupon


def laws_table(found: LawComparison) -> Table:
    """A line for each law, the least error on tests held out first."""
    from rich.table import Table

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


def constants_table(one: ComparedLaw) -> Table:
    """The constants of a law with their 95 % intervals."""
    from rich.table import Table

    from softcal.calibration.digits import interval_text, value_text

    table = Table(", ".join([one.name, *one.fit.constants.parts]), "value", "95 %")
    for name, estimate in one.fit.estimates.items():
        interval = "at its bound" if estimate.at_bound else interval_text(estimate) or "none"
        table.add_row(name, value_text(estimate), interval)
    return table


def tests_table(law: str, fitted: Sequence[PredictedCoupon], predicted: Sequence[PredictedCoupon]) -> Table:
    """A line for each test: errors of the law, also after the factor that would fit this specimen best."""
    from rich.table import Table

    table = Table(
        f"tests by {law}",
        "",
        "error",
        "NMAD",
        "in the band",
        "factor of the stresses, that would fit best",
        "NMAD by it",
        caption="NMAD: mean |predicted - measured| over the larger of mean |measured| and mean |predicted|",
    )
    for used, tests in (("fitted", fitted), ("predicted", predicted)):
        for one in tests:
            cells = ["no stresses measured", "", "", "", ""]
            if one.is_measured:
                factor = plain(one.factor, 3) if math.isfinite(one.factor) else "none"
                cells = [_percent(one.error, 1), _percent(one.nmad, 2), _percent(one.inside, 0), factor]
                cells.append(_percent(one.nmad_by_factor, 2))
            table.add_row(one.coupon.name, used, *cells)
    return table


def _percent(share: float, digits: int) -> str:
    return f"{100 * share:.{digits}f} %" if math.isfinite(share) else "–"


def verdict(found: LawComparison) -> str:
    """Which law is recommended, and why."""
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
