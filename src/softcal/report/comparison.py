"""Nominal against tuned values: distance of every marker in every state, and the improvement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.analysis.sweep import ALL, BestCell, improvement, reduction
from softcal.calibration.results.result import ExperimentFit
from softcal.calibration.results.result_files import fits_of
from softcal.checks import Floats
from softcal.report.content import ReportContent
from softcal.report.format import Scale, channel_scale, estimate_scale, joined, number, parameter_label
from softcal.report.headline import headline
from softcal.report.surfaces import section_scale
from softcal.report.tables import Cell, Column, ReportTable
from softcal.sensing.channel import positions
from softcal.units import format_quantity


@dataclass(frozen=True)
class NominalComparison:
    """Distances of every marker or plate (rows) in every state (columns), nominal and tuned.

    Attributes
    ----------
    markers
        Names of the rows (n_markers).
    experiments, states
        Experiment and state of each column (n_columns).
    nominal, tuned
        Distances in `unit` (n_markers, n_columns); NaN where not measured.
    unit
        Unit of the distances.
    tuned_name
        Label of the tuned values: "calibrated" or "best cell".
    """

    markers: tuple[str, ...]
    experiments: tuple[str, ...]
    states: tuple[str, ...]
    nominal: Floats
    tuned: Floats
    unit: str
    tuned_name: str


def comparison(content: ReportContent) -> NominalComparison | None:
    """The headline's result against the nominal values; None if these are unknown or have no positions."""
    result, compared = content.headline_result, content.compared
    if compared is None or compared.nominal is None or compared.nominal.loss is None:
        return None
    known = compared.nominal.fits
    fits = {name: fit for name, fit in fits_of(result).items() if fit.distances and name in known}
    markers = list(dict.fromkeys(point for fit in fits.values() for point in fit.distances))
    if not markers:
        return None
    scale = Scale("mm", 1e-3) if compared.length is None else Scale("%", 0.01 * compared.length)
    experiments: list[str] = []
    states: list[str] = []
    columns: list[tuple[Floats, Floats]] = []
    for name, fit in sorted(fits.items()):
        pair = (state_distances(known[name], markers), state_distances(fit, markers))
        labels = _state_labels(content, name, pair[0].shape[1])
        experiments += [f"{name} (predicted)" if name in result.held_out else name] * len(labels)
        states += labels
        columns.append(pair)
    nominal, tuned = (np.concatenate([pair[k] for pair in columns], axis=1) / scale.factor for k in (0, 1))
    called = headline(content).tuned
    return NominalComparison(tuple(markers), tuple(experiments), tuple(states), nominal, tuned, scale.unit, called)


def state_distances(fit: ExperimentFit, markers: list[str]) -> Floats:
    """Distance [m] of each marker (rows) in each state (columns); NaN where not measured or not compared."""
    n = len(next(iter(fit.simulated.values())))
    distances = np.full((len(markers), n), np.nan)
    for row, marker in enumerate(markers):
        if marker not in fit.distances:
            continue
        names = [str(c) if str(c) in fit.simulated else c.kind.name for c in positions(marker)]
        distances[row] = np.sqrt(sum((fit.simulated[c] - fit.measured[c]) ** 2 for c in names))
    return distances


@dataclass(frozen=True)
class Improvement:
    """Error of a section in `unit`, at the nominal values (None if they could not be simulated) and tuned.

    best: for a sweep, the cell with the least error.
    """

    name: str
    nominal: float | None
    tuned: float
    unit: str
    best: BestCell | None = None

    @property
    def reduction(self) -> float | None:
        """Reduction of the error from the nominal one [%]; None if that is unknown or zero."""
        return None if not self.nominal else reduction(self.nominal, self.tuned)

    @property
    def improvement(self) -> float | None:
        """nominal / tuned - 1 [%]."""
        return None if self.nominal is None or not self.tuned > 0 else improvement(self.nominal, self.tuned)

    def error_text(self, error: float | None) -> str:
        """An error in words: "2.81 %"."""
        return "nothing" if error is None else f"{number(error)} {self.unit}".rstrip()


def improvements(content: ReportContent) -> list[Improvement]:
    """Improvement over all sections and in each; empty if the nominal values are unknown."""
    nominal = None if content.compared is None else content.compared.nominal
    rows: list[Improvement] = []
    for gain in () if nominal is None else headline(content).gains(nominal):
        scale = section_scale(gain.section)
        before = None if gain.nominal is None else gain.nominal / scale.factor
        name = "all sections" if gain.section.name == ALL else gain.section.name
        rows.append(Improvement(name, before, gain.tuned / scale.factor, scale.unit, gain.best))
    return rows


def improvement_table(content: ReportContent) -> ReportTable:
    """Error of each section at the nominal and tuned values, and the improvement; for a sweep with the best cells."""
    result, first, gains = content.headline_result, headline(content), improvements(content)
    by_cell = any(one.best is not None for one in gains)
    scales = {name: estimate_scale(e) for name, e in result.parameters.items()} if by_cell else {}
    columns = [Column("Section"), Column("Error, nominal"), Column(f"Error, {first.tuned}")]
    columns += [Column(""), Column("Error reduced by", "%"), Column("Nominal / tuned − 1", "%")]
    columns += [Column(parameter_label(n, scales), scale.unit, 4) for n, scale in scales.items()]
    columns += [Column("At the end of its range")] * by_cell
    rows: list[tuple[Cell, ...]] = []
    for one in gains:
        row: list[Cell] = [one.name, one.nominal, one.tuned, one.unit, one.reduction, one.improvement]
        if one.best is not None:
            row += [one.best.trial.theta[name] / scale.factor for name, scale in scales.items()]
            ends: list[str] = []
            for name, p in result.parameters.items():
                value = one.best.trial.theta[name]
                if value in (p.lower, p.upper):
                    side = "lowest" if value == p.lower else "highest"
                    ends.append(
                        f"{parameter_label(name, result.parameters)} at its {side}, {format_quantity(value, p.unit)}"
                    )
            row.append(joined(ends) or "none")
        rows.append(tuple(row))
    note = (
        "Errors are root mean squares over all states. An error that was halved is reduced by 50 %; nominal / tuned "
        "- 1, which is also called the improvement, is then 100 %."
    )
    return ReportTable("improvement", first.gains_title, tuple(columns), tuple(rows), note)


def _state_labels(content: ReportContent, name: str, n: int) -> list[str]:
    """Names of an experiment's states: their labels, else the value of the driving pull, "" for a single state."""
    experiment = content.experiments[name]
    data = experiment.prepared
    if data.n_samples == n and data.labels:
        short = [label.removeprefix(name).lstrip("_- ") for label in data.labels]
        return short if all(short) else list(data.labels)
    if data.n_samples == n and experiment.drive in data.channels:
        scale = channel_scale(data.channels[experiment.drive].unit)
        return [f"{number(value / scale.factor)} {scale.unit}" for value in data.values(experiment.drive)]
    return [str(k + 1) if n > 1 else "" for k in range(n)]
