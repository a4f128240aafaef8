"""Importance of parameters over the search box: Sobol indices of the loss and of every kind of channel.

The parameters are independent and uniform within their bounds, on the scale of the search, as they are for fANOVA
(`fanova_importance`), which explains the losses of the trials. The twin is evaluated by its surrogate
over the box.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from softcal.analysis.box_surrogate import checked_box
from softcal.analysis.sobol import Index, box_points, sobol_indices
from softcal.calibration.interval_studies.likelihood_points import Observer
from softcal.calibration.problem.parameters import Scale
from softcal.calibration.problem.problem import Problem
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.executors.executor import Executor
from softcal.html_text import summary
from softcal.limits import require_at_least
from softcal.units import format_quantity

SIMULATIONS = 400
"""Evaluations of the twin, at most."""


@displayed
@dataclass(frozen=True)
class Range:
    """The bounds of a parameter [unit], and the scale on which it is uniform between them."""

    lower: float
    upper: float
    unit: str
    scale: Scale


@dataclass(frozen=True)
class Pair:
    """The Sobol index of two parameters together, beyond that of each."""

    labels: tuple[str, str]
    index: Index


@displayed
@dataclass(frozen=True)
class OutputImportance:
    """The Sobol indices of one output.

    Attributes
    ----------
    first, total
        Label -> index.
    pairs
        Every pair of parameters.
    surrogate_error
        Root mean square of the surrogate's error at points that it has not seen, over the standard deviation there.
    """

    first: Mapping[str, Index]
    total: Mapping[str, Index]
    pairs: tuple[Pair, ...]
    surrogate_error: float


@displayed
@dataclass(frozen=True)
class ImportanceStudy:
    """Sobol indices over a search box.

    Attributes
    ----------
    outputs
        "loss" or kind of channel -> indices.
    ranges
        Label -> bounds.
    notes
        Remarks, sentences.
    facts
        Counts, by name.
    wall_s
        Wall time [s].
    fanova
        Label -> fANOVA's importance by the trials of the studied calibration; empty without such trials.
    """

    outputs: Mapping[str, OutputImportance]
    ranges: Mapping[str, Range]
    notes: tuple[str, ...]
    facts: Mapping[str, float]
    wall_s: float
    fanova: Mapping[str, float] = field(default_factory=dict[str, float])

    def _repr_html_(self) -> str:
        from softcal.analysis.importance_verdict import importance_sentences, index_text

        rows = [
            [name, label, index_text(first), index_text(output.total[label])]
            for name, output in self.outputs.items()
            for label, first in output.first.items()
        ]
        header = ["of", "parameter", "alone", "with others"]
        return summary("Importance of the parameters", header, rows, [*self.notes, *importance_sentences(self)])


def importance_study(
    problem: Problem,
    *,
    seed: int = 1,
    simulations: int = SIMULATIONS,
    workers: int | Executor = 1,
    progress: Observer | None = None,
) -> ImportanceStudy:
    """Sobol indices of a problem over its search box.

    Parameters
    ----------
    problem
        The problem.
    seed
        Seed of the points; the same seed gives the same indices.
    simulations
        Evaluations of the twin, at most.
    workers
        An executor, or a number of processes that simulate.
    progress
        Called after every evaluation of the twin with their number.

    Raises
    ------
    InputError
        For a single free parameter.
    ParameterError
        For a number out of range.
    SimulationError
        Where the twin cannot be simulated in more than a tenth of the box.
    CalibrationError
        Where the surrogate does not become accurate.
    """
    began = time.perf_counter()
    space = problem.space
    require_at_least(simulations=(simulations, 1), seed=(seed, 0))
    if space.size < 2:
        got = ", ".join(space.labels)
        raise InputError(Fault("one parameter explains everything", "free parameters", got, "two or more"))
    box = checked_box(problem, simulations=simulations, seed=seed, workers=workers, progress=progress)
    outputs: dict[str, OutputImportance] = {}
    points = box_points(space.size, seed)
    notes: list[str] = []
    for name, values in box.surrogate.turned_outputs(points).items():
        if not box.surrogate.varies(name, values):
            notes.append(f"The {name} does not change with any of the parameters.")
            continue
        found = sobol_indices(values, space.size, box.error[name])
        pairs = tuple(Pair((space.labels[i], space.labels[j]), index) for i, j, index in found.pairs)
        first, total = (dict(zip(space.labels, held, strict=True)) for held in (found.first, found.total))
        outputs[name] = OutputImportance(first, total, pairs, box.error[name])
    ranges = {p.label: Range(p.lower, p.upper, p.unit, p.scale) for p in space.parameters}
    if box.failures:
        theta, reason = box.failures[0]
        at = ", ".join(f"{label} {format_quantity(value, ranges[label].unit)}" for label, value in theta.items())
        notes.append(
            f"The twin cannot be simulated at {len(box.failures)} of {box.facts['evaluations']:.0f} points within the "
            f"bounds, where its surrogate is extrapolated. The first is {at}: {reason}"
        )
    facts = {**box.facts, "points of the surrogate": float(len(points))}
    return ImportanceStudy(outputs, ranges, tuple(notes), facts, time.perf_counter() - began)
