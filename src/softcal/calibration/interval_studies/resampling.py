"""Intervals by what groups of measurements show, beside the quick ones.

The quick intervals follow a model of the noise. These follow how much the estimates scatter when a group
(`statistics/groups.py`) is left out at a time: the jackknife; a bootstrap is in `bootstrap.py`. Errors that no group
shows, of priors and of uncertain parameters, are those of the quick intervals.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.interval_studies.adjusted_likelihood import Calibrated, calibrated
from softcal.calibration.interval_studies.checked_interval import CheckedInterval, IntervalStudy
from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.problem import Problem
from softcal.calibration.statistics.groups import groups_of
from softcal.calibration.statistics.intervals import box_intervals
from softcal.calibration.statistics.jackknife import DeleteOne, delete_one
from softcal.calibration.statistics.reweighted import FEWEST, Reweighted, reweighted
from softcal.checks import Floats
from softcal.errors import Fault, InputError


@dataclass(frozen=True)
class Resampled:
    """A calibrated problem with its groups of measurements.

    groups: the group of each sample of each block; parts: what the groups have in the minimum; without: each left out.
    """

    held: Calibrated
    kind: str
    groups: Sequence[np.ndarray]
    parts: Reweighted
    without: DeleteOne

    @property
    def labels(self) -> tuple[str, ...]:
        return self.held.problem.space.labels

    @property
    def root(self) -> Floats:
        """`root.T @ root` is the covariance by the groups."""
        return self.without.root(self.held.found)

    def at(self, z: Floats, blocks: Sequence[Block]) -> Reweighted:
        """The groups at another simulated point."""
        problem = self.held.problem
        return reweighted(problem.loss, z, problem.space.jacobian(z), blocks, self.groups, self.held.found)

    def study(
        self,
        by: str,
        ends: Mapping[int, tuple[float, float]],
        notes: Sequence[str],
        facts: Mapping[str, float],
        began: float,
        points: Mapping[str, tuple[float, ...]],
    ) -> IntervalStudy:
        """The study with these ends.

        Parameters
        ----------
        by, notes, facts
            As of `IntervalStudy`; the facts without the number of groups.
        ends
            Number of the parameter -> ends in the unit box.
        began
            When the study began, as of `time.perf_counter` [s].
        points
            Label -> values [SI] without each group, or of each draw.
        """
        held, chances = self.held, self.without.chances(self.held.found)
        intervals: dict[str, CheckedInterval] = {}
        for j, (label, e) in enumerate(held.estimates.items()):
            found = None
            if j in ends:
                low, high = (self.held.problem.space.parameters[j].value_at(float(end)) for end in ends[j])
                found = (min(low, e.value), max(high, e.value))
            chance = float(chances[j]) if j in ends else None
            if self.without.ratios(self.held.found)[j] > 1.0:
                reason = f"the {self.kind} differ by more than the noise that the quick one assumes"
            else:
                reason = f"the quick one includes errors that do not show between {self.kind}"
            intervals[label] = CheckedInterval(
                e.value, e.unit, e.lower, e.upper, e.scale, e.interval, found, reason, chance
            )
        counted = {self.kind: float(len(self.parts.names)), **facts}
        return IntervalStudy(by, intervals, (*self._notes(), *notes), counted, time.perf_counter() - began, points)

    def _notes(self) -> tuple[str, ...]:
        own = [label for label, is_own in zip(self.labels, self.parts.own, strict=True) if is_own]
        found: list[str] = []
        if self.kind in ("cycles", "records") and any(one.effects.differs for one in self.held.found.between):
            found.append(f"The tests differ, which {self.kind} cannot show: the quick intervals include it.")
        if own:
            found.append(f"{_listed(own)}: fewer than three of the {self.kind} depend on it, so there is no interval.")
        for name, determined in zip(self.parts.names, self.parts.without[1], strict=True):
            lost = [label for j, label in enumerate(self.labels) if not (determined[j] or self.parts.own[j])]
            if lost:
                found.append(f"{_listed(lost)}: not determined without '{name}', so there is no interval.")
        return tuple(found)


def default_groups(problem: Problem) -> str:
    """The kind of group unless one is named: experiments, of three or more; else pieces of records."""
    return "experiments" if len(problem.experiments) >= FEWEST else "records"


def resampled(problem: Problem, theta: Mapping[str, float], over: str = "") -> Resampled:
    """The groups of measurements at the minimum of the loss.

    Parameters
    ----------
    problem, theta
        The calibrated problem, and its minimum [SI by label].
    over
        The kind of group, see `groups.KINDS`; by default as `default_groups`.

    Raises
    ------
    InputError
        Where theta is no minimum of the loss, the noise cannot be estimated, there is no such kind of group, or fewer
        than three groups.
    SimulationError
        Where the twin cannot be simulated at theta.
    """
    kind = over or default_groups(problem)
    held = calibrated(problem, theta)
    groups = groups_of(problem, held.evaluation.blocks, kind)
    slopes = problem.space.jacobian(held.z)
    parts = reweighted(problem.loss, held.z, slopes, held.evaluation.blocks, groups, held.found, problem.uncertain)
    without = delete_one(parts)
    if not without.determined.any():
        raise InputError(
            Fault(f"no parameter is determined without each of the {kind}", "--over", kind, attempt="another kind")
        )
    return Resampled(held, kind, groups, parts, without)


def jackknife(problem: Problem, theta: Mapping[str, float], *, over: str = "") -> IntervalStudy:
    """95 % intervals by leaving out one group of measurements at a time. From the jacobians: the twin is simulated
    once.

    Parameters
    ----------
    problem, theta
        The calibrated problem, and its minimum [SI by label].
    over
        The kind of group, see `groups.KINDS`; by default as `default_groups`.

    Raises
    ------
    InputError, SimulationError
        See `resampled`.
    """
    began = time.perf_counter()
    found = resampled(problem, theta, over)
    minimum = found.parts.minimum
    ends, _ = box_intervals(found.held.z, minimum, found.root, found.without.total_dof)
    given = {int(j): (float(ends[j, 0]), float(ends[j, 1])) for j in np.flatnonzero(found.without.determined)}
    steps = np.clip(minimum + found.without.steps, 0.0, 1.0)
    facts = {"trajectories": float(found.held.evaluation.n_solves)}
    return found.study("jackknife", given, (), facts, began, model_values(problem, steps))


def model_values(problem: Problem, z: Floats) -> dict[str, tuple[float, ...]]:
    """Label -> values [SI] at points z (n, size)."""
    thetas = [problem.space.to_model(one) for one in z]
    return {label: tuple(one[label] for one in thetas) for label in problem.space.labels}


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
