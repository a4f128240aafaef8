"""Error of every section over a grid of one or two parameters: the data of paper B's Fig. 3."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.analysis.sweep import ALL, ErrorSection, least_cell, section_errors, sections
from softcal.calibration.problem.loss import LOSSES
from softcal.calibration.results.result import SearchResult, SweepResult, Trial
from softcal.checks import Floats
from softcal.report.format import Scale, find_parameter, scale_of


@dataclass(frozen=True)
class ErrorSurface:
    """Error of a section over two parameters.

    Attributes
    ----------
    section
        Name of the section.
    unit
        Unit of the error.
    x, y
        Values of the parameters [SI], ascending.
    error
        Error (len(y), len(x)) in `unit`; NaN where there is no cell or it could not be simulated.
    failed
        x and y (k, 2) of the cells that could not be simulated.
    best
        x, y and error of the cell with the least error.
    """

    section: str
    unit: str
    x: Floats
    y: Floats
    error: Floats
    failed: Floats
    best: tuple[float, float, float]


@dataclass(frozen=True)
class ErrorCurve:
    """Error of a section over one parameter [SI, ascending], in `unit`; NaN where it could not be simulated."""

    section: str
    unit: str
    x: Floats
    error: Floats


def searched_pair(result: SearchResult) -> tuple[str, str] | None:
    """The modulus and Poisson's ratio of a result, or the first two parameters; None if there is only one."""
    modulus = find_parameter(result.parameters, "youngs_modulus")
    ratio = find_parameter(result.parameters, "poissons_ratio")
    rest = [name for name in result.parameters if name not in (modulus, ratio)]
    names = [name for name in (modulus, ratio) if name is not None] + rest
    return (names[0], names[1]) if len(names) >= 2 else None


def error_surfaces(result: SweepResult) -> list[ErrorSurface]:
    """A surface of each section, preceded by that of all together if there are several; empty for one parameter.

    With more than two parameters, the others have their values of the best cell.
    """
    pair = searched_pair(result)
    if pair is None:
        return []
    best = {name: estimate.value for name, estimate in result.parameters.items()}
    trials = [t for t in result.trials if all(t.theta[n] == best[n] for n in best if n not in pair)]
    x, y = (np.unique([trial.theta[name] for trial in trials]) for name in pair)
    failed = np.array([[t.theta[name] for name in pair] for t in trials if t.loss is None], dtype=np.float64)
    found: list[ErrorSurface] = []
    for name, unit, errors in _errors_by_section(result, trials):
        error = np.full((len(y), len(x)), np.nan)
        for trial in trials:
            value = errors.get(trial.number, np.nan)
            error[np.searchsorted(y, trial.theta[pair[1]]), np.searchsorted(x, trial.theta[pair[0]])] = value
        known = [trial for trial in trials if trial.number in errors]
        least, value = least_cell(known, [errors[trial.number] for trial in known])
        best_at = (least.theta[pair[0]], least.theta[pair[1]], value)
        found.append(ErrorSurface(name, unit, x, y, error, failed.reshape(-1, 2), best_at))
    return found


def error_curves(result: SweepResult) -> list[ErrorCurve]:
    """Error of every section over the only parameter of a sweep; empty if it has several."""
    if len(result.parameters) != 1:
        return []
    (name,) = result.parameters
    trials = sorted(result.trials, key=lambda trial: trial.theta[name])
    x = np.array([trial.theta[name] for trial in trials])
    return [
        ErrorCurve(section, unit, x, np.array([errors.get(trial.number, np.nan) for trial in trials]))
        for section, unit, errors in _errors_by_section(result, trials)
    ]


def section_scale(section: ErrorSection) -> Scale:
    """Display scale of a section's error: in % of the length if there is one, else in its display unit."""
    if section.length is not None:
        return Scale("%", 0.01 * section.length)
    return Scale("%", 1.0) if section.unit == "%" else scale_of(section.unit)


def _errors_by_section(result: SweepResult, trials: Sequence[Trial]) -> list[tuple[str, str, Mapping[int, float]]]:
    """(section, unit, error by cell number): all sections together first if there are several."""
    done = [trial for trial in trials if trial.loss is not None]
    if not done:
        return []
    by_cell = {trial.number: section_errors(result, trial.errors) for trial in done}
    listed = sections(result)
    found: list[tuple[str, str, Mapping[int, float]]] = []
    if len(listed) > 1:
        unit = LOSSES.named(result.loss_name).unit.replace("1", "")
        found.append((ALL, unit, {trial.number: trial.loss for trial in done if trial.loss is not None}))
    for section in listed:
        scale = section_scale(section)
        errors = {n: held[section.name] / scale.factor for n, held in by_cell.items() if section.name in held}
        found.append((section.name, scale.unit, errors))
    return found
