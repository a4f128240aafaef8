"""The fitted constants of a law as a page shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from unicodedata import normalize

from softcal.calibration.results.digits import interval_text, value_text
from softcal.plugins.coupons.law_fit import LawFit
from softcal.report.statement import ErrorSource, Statement, statement


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
