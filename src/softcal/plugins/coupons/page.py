"""The page of coupon tests: what was tested, which law is recommended and why, and how far it can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from unicodedata import normalize

from softcal.calibration.results.digits import interval_text, value_text
from softcal.plugins.coupons.comparison import LawComparison
from softcal.plugins.coupons.fitted_material import PredictedCoupon
from softcal.plugins.coupons.law_fit import LawFit
from softcal.plugins.coupons.plausibility import implausible
from softcal.plugins.coupons.sentences import conclusions, verdict, warnings, with_history
from softcal.plugins.coupons.tables import coupons_table, laws_table, limit_texts, moduli_table, percent, tests_table
from softcal.report.figure import Picture
from softcal.report.format import joined
from softcal.report.page import KeyNumber, marks, render
from softcal.report.statement import ErrorSource, Statement, statement
from softcal.units import plain


@dataclass(frozen=True)
class CouponCharts:
    """The charts of the page: of the shown law, of several laws (or None), and of what was predicted (or None)."""

    shown: Picture
    several: Picture | None
    predicted: Picture | None


def render_coupon_page(
    found: LawComparison,
    charts: CouponCharts,
    *,
    block: str,
    predicted: Sequence[PredictedCoupon] = (),
    files: Sequence[str] = (),
    created: str = "",
) -> str:
    """The page as text.

    Parameters
    ----------
    block
        The recommended law as a block of a project file; "" where no law is recommended.
    predicted
        What the law that is shown predicts of further tests.
    files
        Names of the files of the tests that were fitted.
    created
        When the laws were fitted, in ISO 8601.
    """
    one, constants = found.shown, shown_constants(found.shown.fit)
    sources = list(dict.fromkeys(source for constant in constants for source, *_ in constant.shares))
    plausibility = implausible([*found.coupons, *(p.coupon for p in predicted)])
    doubts = [*plausibility, *warnings(found, predicted)]
    fitted = one.fit.tests(found.coupons)
    tests = [coupon.test for coupon in found.coupons]
    counted = joined(f"{tests.count(t)} {t} test{'s' * (tests.count(t) > 1)}" for t in dict.fromkeys(tests))
    rows = sum(len(coupon.strain) for coupon in found.coupons)
    source = f" from {joined(files)}" if files else ""
    n = len(found.laws)
    laws = f"{n} laws compared" if n > 1 else "one law fitted"
    history = f", each with {joined(found.history)}" if found.history and n > 1 else ""
    further = f"; {len(predicted)} further test{'s' * (len(predicted) > 1)} predicted" if predicted else ""
    stated = f"Poisson's ratio ({plain(found.poissons_ratio, 4)}) is stated, not measured."
    return render(
        Path(__file__).with_name("coupon.html.j2"),
        title=f"Recommended: {with_history(one)}" if found.recommended else "No law is recommended",
        subject=f"{counted}, {rows} rows{source}; {laws}{history}{further}. {stated}",
        law=with_history(one),
        recommended=found.recommended is not None,
        created=created,
        warnings=doubts,
        verdict=verdict(found),
        tone="warning" if doubts or found.recommended is None else "good",
        conclusions=conclusions(found, predicted),
        constants=constants,
        legend=sources,
        marks=marks(sources),
        key_numbers=key_numbers(found),
        charts=charts,
        across=len({(coupon.test, axis) for coupon in found.coupons for axis in coupon.kind.axes}) > 1,
        coupons=coupons_table(found.coupons, [p.coupon for p in predicted]),
        laws=laws_table(found),
        moduli=moduli_table(found),
        tests=tests_table(one.name, fitted, predicted) if found.history or predicted else None,
        same_as=found.same_as,
        left_out=found.left_out,
        block=block,
    )


def key_numbers(found: LawComparison) -> list[KeyNumber]:
    """Errors of the shown law, fitted and held out, and up to which stretch it is stable."""
    one = found.shown
    stability = one.fit.stability
    by_kind = joined(f"{100 * error:.1f} % {test}" for test, error in one.fit.errors.items())
    kinds = f": {by_kind}" if len(one.fit.errors) > 1 else ""
    least = min(stability.limits, key=lambda mode: stability.limits[mode] or stability.reach)
    looked = f"looked at up to {plain(stability.reach, 3)}"
    if any(end is not None for end in stability.limits.values()):
        looked = "; ".join([*(f"{mode} {text}" for mode, text in limit_texts(stability).items()), looked])
    if not stability.in_tests:
        looked += "; unstable in a measured state"
    worst = max(one.held_out, key=lambda name: one.held_out[name])
    held = f"{found.kept_out} by the others; most in {worst}: {percent(one.held_out[worst], 1)}"
    (fitted, _, unit), (missed, _, missed_unit) = (
        percent(share, 1).partition(" ") for share in (one.fit.error, one.held_out_error)
    )
    return [
        KeyNumber("Error, fitted", fitted, unit, f"of the root mean square of the stresses{kinds}"),
        KeyNumber("Error, held out", missed, missed_unit, held),
        KeyNumber(
            "Stable up to a stretch of",
            plain(stability.limits[least] or stability.reach, 3),
            "",
            looked,
        ),
    ]


@dataclass(frozen=True)
class ShownConstant:
    """A constant: what is known of it, and whether the tests determine it."""

    statement: Statement
    is_determined: bool

    @property
    def label(self) -> str:
        """Its key in project files, with its symbol where that is another one."""
        one = self.statement
        return one.name if normalize("NFKC", one.label) == one.name else f"{one.name}, {one.label}"

    @property
    def value(self) -> str:
        """Its value with its unit."""
        return value_text(self.statement.estimate)

    @property
    def interval(self) -> str:
        """The 95 % interval with its unit, "" where the tests do not determine the constant."""
        return interval_text(self.statement.estimate) if self.is_determined else ""

    @property
    def remark(self) -> str:
        """Why it is not determined, or ""."""
        if self.is_determined:
            return ""
        why = "at the bound of the search" if self.statement.estimate.at_bound else "without an interval"
        return f"not determined by the tests: {why}"

    @property
    def budget(self) -> bool:
        """Whether the sources of its error are shown."""
        return self.is_determined and bool(self.statement.budget)

    @property
    def budget_text(self) -> str:
        """The sources of its error in words."""
        return self.statement.budget_text

    @property
    def shares(self) -> Sequence[tuple[ErrorSource, float, str]]:
        """Each source of its error, with its share [-] and the share in words."""
        return self.statement.shares if self.budget else ()


def shown_constants(fit: LawFit) -> list[ShownConstant]:
    """The fitted constants of a law and its history."""
    return [
        ShownConstant(statement(p.name, p.label, e), e.interval is not None and not e.at_bound)
        for p in fit.constants.fitted
        for e in (fit.estimates[p.name],)
    ]
