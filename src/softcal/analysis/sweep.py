"""What a sweep over a grid found: the error of every section in every cell, the best cells, and what was gained.

A section is a marker or plate whose position is compared (paper B's S1 to S4), or any other channel. Its error is the
root mean square over all states of all experiments; with one state it is paper B's d_k itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.analysis.nominal import Nominal
from softcal.calibration.outcome import bound_note
from softcal.calibration.result import CalibrationResult, ExperimentFit, Trial

ALL = "all"
# Errors that differ by less of themselves are equal: what does not depend on a parameter differs in the last digits.
_ROUNDING = 1e-9
Counts = Mapping[tuple[str, str], int]


@dataclass(frozen=True)
class ErrorSection:
    """What is told apart in a sweep: its name, the unit [SI] of its error, and the length [m] that is 100 %, or None.

    ALL stands for everything together, whose error is the loss; its unit is "%" for the loss `distance`, else "1".
    """

    name: str
    unit: str
    length: float | None = None

    @property
    def shown_unit(self) -> str:
        """The unit that the error is told in: "%" of the length where there is one."""
        return "%" if self.length is not None else self.unit

    def shown(self, error: float) -> float:
        """An error [unit] in the unit that it is told in."""
        return error if self.length is None else 100 * error / self.length


@dataclass(frozen=True)
class BestCell:
    """The cell of the grid in which a section's error is least.

    error, nominal [the section's unit]: there, and at the nominal values (None where they could not be simulated).
    notes: parameters that stand at the end of their range, in words.
    """

    section: ErrorSection
    trial: Trial
    error: float
    nominal: float | None
    notes: tuple[str, ...]

    @property
    def reduction(self) -> float | None:
        """By how much the error is below the nominal one [%]; None where that is not known or zero."""
        return None if not self.nominal else reduction(self.nominal, self.error)

    @property
    def improvement(self) -> float | None:
        """Nominal / best - 1 [%], which paper B calls a reduction: 100 % where the error was halved."""
        if self.nominal is None or not self.error > 0:
            return None
        return improvement(self.nominal, self.error)


def reduction(nominal: float, tuned: float) -> float:
    """1 - tuned / nominal [%]: 50 % where the error was halved, below zero where it grew."""
    return 100 * (1 - tuned / nominal)


def improvement(nominal: float, tuned: float) -> float:
    """nominal / tuned - 1 [%]: 100 % where the error was halved, below zero where it grew."""
    return 100 * (nominal / tuned - 1)


def sections(result: CalibrationResult) -> tuple[ErrorSection, ...]:
    """Every marker, plate and other channel that the result's experiments compare, in their order."""
    found: dict[str, ErrorSection] = {}
    for fit in result.experiments.values():
        for point in fit.distances:
            found.setdefault(point, ErrorSection(point, "m", fit.length))
        for channel in fit.rmse:
            if channel.rpartition(".")[0] not in fit.distances:
                found.setdefault(channel, ErrorSection(channel, fit.units[channel]))
    return tuple(found.values())


def section_errors(result: CalibrationResult, errors: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """The error [SI] of every section over all experiments, from that of each (`Trial.errors`)."""
    counts = {(e, name): n for e, fit in result.experiments.items() for name, n in _counts(fit).items()}
    squares: dict[str, float] = {}
    totals: dict[str, int] = {}
    for experiment, held in errors.items():
        for name, error in held.items():
            n = counts[experiment, name]
            squares[name] = squares.get(name, 0.0) + n * error**2
            totals[name] = totals.get(name, 0) + n
    return {name: math.sqrt(squares[name] / totals[name]) for name in squares}


def best_cells(result: CalibrationResult, nominal: Nominal) -> tuple[BestCell, ...]:
    """The best cell of every section, and before them that of all together, whose error is the loss.

    Empty where no cell could be simulated. Of equal cells the first is taken.
    """
    done = [trial for trial in result.trials if trial.loss is not None]
    if not done:
        return ()
    known = section_errors(result, nominal.errors)
    by_cell = {trial.number: section_errors(result, trial.errors) for trial in done}
    whole = ErrorSection(ALL, "%" if result.loss_name == "distance" else "1")
    best, error = least_cell(done, [float(trial.loss or 0.0) for trial in done])
    found = [BestCell(whole, best, error, nominal.loss, _at_ends(result, best))]
    for section in sections(result):
        best, error = least_cell(done, [by_cell[trial.number][section.name] for trial in done])
        found.append(BestCell(section, best, error, known.get(section.name), _at_ends(result, best)))
    return tuple(found)


def least_cell(cells: Sequence[Trial], errors: Sequence[float]) -> tuple[Trial, float]:
    """The first of the cells whose errors are the least but for rounding, and that error."""
    limit = min(errors) * (1 + _ROUNDING)
    return next((cell, error) for cell, error in zip(cells, errors, strict=True) if error <= limit)


def _counts(fit: ExperimentFit) -> dict[str, int]:
    points = {point: distance.n for point, distance in fit.distances.items()}
    return {**{c: int(np.isfinite(fit.measured[c]).sum()) for c in fit.rmse}, **points}


def _at_ends(result: CalibrationResult, trial: Trial) -> tuple[str, ...]:
    """The parameters of a cell that stand at the least or the largest value of the sweep, in words."""
    return tuple(
        bound_note(name, replace(p, value=trial.theta[name], beyond=None))
        for name, p in result.parameters.items()
        if trial.theta[name] in (p.lower, p.upper)
    )
