"""Evaluation of a grid sweep: error of every section in every cell, best cells, and improvement.

A section is a marker or plate whose position is compared (paper B's S1 to S4), or any other channel. Its error is the
root mean square over all states of all experiments; for a single state it is paper B's d_k.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.analysis.nominal import Nominal
from softcal.calibration.problem.loss import LOSSES
from softcal.calibration.results.result import SearchResult, SweepResult, Trial
from softcal.calibration.search.outcome import bound_note
from softcal.display import displayed
from softcal.units import format_quantity

ALL = "all"
# Relative difference up to which errors are equal: rounding changes the last digits of an error that a parameter does
# not affect.
_ROUNDING = 1e-9
Counts = Mapping[tuple[str, str], int]


@dataclass(frozen=True)
class ErrorSection:
    """A section of a sweep.

    Attributes
    ----------
    name
        Marker, plate or channel; ALL for all together, whose error is the loss.
    unit
        SI unit of its error; for ALL that of the loss, "%" or "1".
    length
        Length [m] of 100 %, or None.
    """

    name: str
    unit: str
    length: float | None = None

    @property
    def shown_unit(self) -> str:
        """Display unit of the error: "%" of the length if there is one."""
        return "%" if self.length is not None else self.unit

    def shown(self, error: float) -> float:
        """An error [unit] in the display unit."""
        return error if self.length is None else 100 * error / self.length

    def text(self, error: float | None) -> str:
        """An error [unit] as text; "" without an error."""
        if error is None:
            return ""
        shown = self.shown(error)
        return f"{shown:.3g} %" if self.shown_unit == "%" else format_quantity(shown, self.shown_unit, digits=3)


@displayed
@dataclass(frozen=True)
class BestCell:
    """The cell of the grid with the least error of a section.

    Attributes
    ----------
    section
        The section.
    trial
        The cell.
    error
        Its error [the section's unit].
    nominal
        Error at the nominal values [the section's unit]; None if they could not be simulated.
    notes
        Sentences on parameters at the end of their range.
    """

    section: ErrorSection
    trial: Trial
    error: float
    nominal: float | None
    notes: tuple[str, ...]

    @property
    def reduction(self) -> float | None:
        """Reduction of the error from the nominal one [%]; None if the nominal error is unknown or zero."""
        return None if not self.nominal else reduction(self.nominal, self.error)

    @property
    def improvement(self) -> float | None:
        """Nominal / best - 1 [%], called a reduction in paper B: 100 % for a halved error."""
        if self.nominal is None or not self.error > 0:
            return None
        return improvement(self.nominal, self.error)


def reduction(nominal: float, tuned: float) -> float:
    """1 - tuned / nominal [%]: 50 % for a halved error, negative for a larger one."""
    return 100 * (1 - tuned / nominal)


def improvement(nominal: float, tuned: float) -> float:
    """nominal / tuned - 1 [%]: 100 % for a halved error, negative for a larger one."""
    return 100 * (nominal / tuned - 1)


def sections(result: SearchResult) -> tuple[ErrorSection, ...]:
    """All compared markers, plates and other channels of the result's experiments, in their order."""
    found: dict[str, ErrorSection] = {}
    for fit in result.experiments.values():
        for point in fit.distances:
            found.setdefault(point, ErrorSection(point, "m", fit.length))
        for channel in fit.alone:
            found.setdefault(channel, ErrorSection(channel, fit.units[channel]))
    return tuple(found.values())


def section_errors(result: SearchResult, errors: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Error [SI] of every section over all experiments, from those of each (`Trial.errors`)."""
    squares: dict[str, float] = {}
    totals: dict[str, int] = {}
    for experiment, by_section in errors.items():
        fit = result.experiments[experiment]
        for name, error in by_section.items():
            distance = fit.distances.get(name)
            n = int(np.isfinite(fit.measured[name]).sum()) if distance is None else distance.n
            squares[name] = squares.get(name, 0.0) + n * error**2
            totals[name] = totals.get(name, 0) + n
    return {name: math.sqrt(squares[name] / totals[name]) for name in squares}


def best_cells(result: SweepResult, nominal: Nominal) -> tuple[BestCell, ...]:
    """The best cell of all sections together, whose error is the loss, then that of each section.

    Empty if no cell could be simulated. Among equal cells the first is taken.
    """
    done = [trial for trial in result.trials if trial.loss is not None]
    if not done:
        return ()
    known = section_errors(result, nominal.errors)
    by_cell = {trial.number: section_errors(result, trial.errors) for trial in done}
    whole = ErrorSection(ALL, LOSSES.named(result.loss_name).unit)
    best, error = least_cell(done, [float(trial.loss or 0.0) for trial in done])
    found = [BestCell(whole, best, error, nominal.loss, _at_ends(result, best))]
    for section in sections(result):
        best, error = least_cell(done, [by_cell[trial.number][section.name] for trial in done])
        found.append(BestCell(section, best, error, known.get(section.name), _at_ends(result, best)))
    return tuple(found)


def least_cell(cells: Sequence[Trial], errors: Sequence[float]) -> tuple[Trial, float]:
    """The first cell whose error equals the least one up to rounding, and its error."""
    limit = min(errors) * (1 + _ROUNDING)
    return next((cell, error) for cell, error in zip(cells, errors, strict=True) if error <= limit)


def _at_ends(result: SweepResult, trial: Trial) -> tuple[str, ...]:
    """Sentences on the parameters of a cell at the smallest or largest value of the sweep."""
    return tuple(
        bound_note(name, replace(p, value=trial.theta[name], beyond=None)).text
        for name, p in result.parameters.items()
        if trial.theta[name] in (p.lower, p.upper)
    )
