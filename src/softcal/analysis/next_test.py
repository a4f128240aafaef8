"""The next test: candidates ranked by how much each would shrink the interval of one parameter.

Every candidate is simulated at the calibrated values, with exact derivatives, beside the calibration's experiments:
candidates that drive the same actuator in the same way share one trajectory. What is then expected of the estimates is
linear algebra (`softcal.calibration.statistics.added_test`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.analysis.candidate import Candidate
from softcal.analysis.candidate_bench import Plan, Simulated, added_test, base_blocks, counts, planned, simulated
from softcal.calibration.problem.experiment import rig_kind
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem
from softcal.calibration.results.digits import format_interval
from softcal.calibration.statistics.added_test import ExpectedEstimates, with_added_test
from softcal.calibration.statistics.estimator import Estimator, estimator, unseen_parameters
from softcal.calibration.statistics.intervals import box_intervals, student
from softcal.checks import Floats
from softcal.display import displayed
from softcal.errors import CalibrationError, InputError, ParameterError, unknown
from softcal.executors.executor import Executor
from softcal.html_text import summary
from softcal.units import format_quantity, plain

_ALIKE = 1.02  # of the shortest expected length: longer ones are worth a difference
_LITTLE = 0.95  # of the present length: a shorter interval is worth a sentence


@displayed
@dataclass(frozen=True)
class Outlook:
    """Expected effect of a candidate test on the estimates.

    Attributes
    ----------
    candidate
        The test.
    interval
        Expected 95 % interval of the parameter [SI], around its present value; None where it would still have none.
    share
        Its length over that of the present one [-], both without the bounds of the parameter; None where one of the two
        does not exist.
    joint
        Standard errors of the robot's parameters over the present ones [-]: the geometric mean over the axes of their
        joint region, the (2 p)th root of the ratio of determinants for p parameters (D-optimal); None where the present
        region is not finite.
    failure
        Why the test cannot be simulated, a sentence, or "".
    """

    candidate: Candidate
    interval: tuple[float, float] | None = None
    share: float | None = None
    joint: float | None = None
    failure: str = ""


@displayed
@dataclass(frozen=True)
class NextTests:
    """Candidates in the order of the expected interval of one parameter, shortest first (c-optimal).

    Attributes
    ----------
    parameter, unit, value, interval
        Label, SI unit, estimate, and present 95 % interval (None: it has none).
    outlooks
        Expected effect of each candidate; candidates that cannot be simulated come last.
    notes
        Assumptions of the intervals.
    n_solves
        Number of simulated trajectories.
    """

    parameter: str
    unit: str
    value: float
    interval: tuple[float, float] | None
    outlooks: tuple[Outlook, ...]
    notes: tuple[str, ...] = ()
    n_solves: int = 0

    def _repr_html_(self) -> str:
        def cells(interval: tuple[float, float] | None, share: float | None) -> list[str]:
            return [format_interval(interval, self.unit) if interval else "–", "–" if share is None else f"{share:.2f}"]

        rows = [["(at present)", *cells(self.interval, 1.0)]]
        rows += [[one.candidate.name, *cells(one.interval, one.share)] for one in self.outlooks if not one.failure]
        header = ["candidate", f"{self.parameter}, 95 %", "length of the interval"]
        return summary("Tests that could be made next", header, rows, [verdict(self), *self.notes])

    @property
    def best(self) -> Outlook | None:
        """The first candidate, where it has an interval."""
        return next((one for one in self.outlooks if one.interval is not None), None)


def next_tests(
    problem: Problem,
    theta: Mapping[str, float],
    candidates: Sequence[Candidate],
    parameter: str = "",
    *,
    mesh_error: bool = True,
    workers: int | Executor = 1,
) -> NextTests:
    """Rank candidates for a problem at its minimum theta.

    Parameters
    ----------
    problem
        The calibration's problem.
    theta
        Values [SI] by label of the free parameters.
    candidates
        The candidate tests.
    parameter
        Label of the parameter whose interval counts; by default the first parameter of the robot.
    mesh_error
        Include the error of the mesh, by one more simulation on a finer mesh.
    workers
        Executor, or number of processes, which share the trajectories.

    Raises
    ------
    ParameterError
        For an unknown parameter.
    CalibrationError
        Where the noise cannot be estimated from the experiments.
    SimulationError
        Where the twin cannot be simulated at theta.
    """
    labels = problem.space.labels
    label = parameter or default_parameter(problem)
    if label not in labels:
        raise ParameterError(unknown("there is no such free parameter", "--for", label, labels))
    plans: dict[str, Plan] = {}
    failures: dict[str, str] = {}
    for candidate in candidates:
        try:
            plans[candidate.name] = planned(problem, theta, candidate)
        except InputError as error:
            failures[candidate.name] = str(error)
    seen = simulated(problem, theta, list(plans.values()), mesh_error=mesh_error, workers=workers)
    failures |= seen.failures
    present = _Present(problem, theta, seen, labels.index(label))
    found = [
        (Outlook(one, failure=failures[one.name]), np.inf) if one.name in failures else present.outlook(plans[one.name])
        for one in candidates
    ]
    ranked = sorted(found, key=lambda one: (bool(one[0].failure), one[1]))
    return NextTests(
        parameter=label,
        unit=problem.space.parameters[labels.index(label)].unit,
        value=theta[label],
        interval=present.interval,
        outlooks=tuple(one for one, _ in ranked),
        notes=tuple(present.notes([plan for name, plan in plans.items() if name not in failures])),
        n_solves=seen.n_solves,
    )


def default_parameter(problem: Problem) -> str:
    """The first free parameter of the robot, else the first of all."""
    return next((p.label for p in problem.space.parameters if _is_of_robot(p)), problem.space.labels[0])


def _is_of_robot(parameter: FreeParameter) -> bool:
    return not parameter.experiment and all(rig_kind(target) is None for target in parameter.targets)


class _Present:
    """The present calibration, in the unit box, with the parameter in column j."""

    def __init__(self, problem: Problem, theta: Mapping[str, float], seen: Simulated, j: int) -> None:
        space = problem.space
        self._problem, self._theta, self._rows, self._j = problem, theta, seen.rows, j
        self._uncertain, self._note = seen.uncertain, seen.note
        self._z = np.clip(space.to_search(theta), 0.0, 1.0)
        self._slopes = space.jacobian(self._z)
        self._blocks = base_blocks(problem, theta, seen.rows)
        self._serves = space.serving(e.name for e in problem.experiments)
        self._found = estimator(problem.loss, self._z, self._slopes, self._blocks, self._serves, seen.uncertain)
        if self._found.spent:
            raise CalibrationError(
                f"The noise of {' and of '.join(self._found.spent)} cannot be estimated: there are as many parameters "
                "as measurements, so that the effect of another test is not known."
            )
        self.interval, self._length = self._reach(self._found, self._found.minimum)

    def outlook(self, plan: Plan) -> tuple[Outlook, float]:
        """Expected effect of a candidate, and the length of its interval in the unit box."""
        added = added_test(self._problem, self._slopes, plan, self._rows[plan.test.name])
        after = with_added_test(
            self._problem.loss, self._blocks, self._slopes, self._serves, self._found, added, self._uncertain
        )
        interval, length = self._reach(after, self._z + after.step)
        share = length / self._length if np.isfinite(length) and np.isfinite(self._length) else None
        known = ~(_mixed(self._found) | _mixed(after))
        columns = [j for j, p in enumerate(self._problem.space.parameters) if _is_of_robot(p) and known[j]]
        if not columns:
            return Outlook(plan.candidate, interval, share), length
        # Expected standard errors of all the robot's parameters over the present ones.
        sizes = [np.log(np.abs(np.diag(np.linalg.qr(one.root[:, columns])[1]))).mean() for one in (after, self._found)]
        return Outlook(plan.candidate, interval, share, float(np.exp(sizes[0] - sizes[1]))), length

    def notes(self, plans: Sequence[Plan]) -> Iterable[str]:
        """Assumptions of the intervals."""
        parameter = self._problem.space.parameters[self._j]
        between = next((one for one in self._found.between if one.column == self._j), None)
        if len(self._problem.experiments) == 1:
            yield (
                "There is one experiment: by how much tests of this robot differ is not known, nor included. A second "
                "and a third test are the way to know it."
            )
        elif between is not None and between.effects.differs:
            spread = format_quantity(between.effects.spread * abs(self._slopes[self._j]), parameter.unit, digits=2)
            yield (
                f"The {between.kind} differ in {parameter.label}, with a standard deviation of {spread}: the intervals "
                f"are those of the mean over such {between.kind}, and each candidate is one more of them, with the "
                "same spread."
            )
            if not between.has_interval:
                yield f"Two {between.kind} do not give this spread an interval: the present one leaves it out."
        names = dict.fromkeys(one.name.partition(" in ")[0] for one in self._found.sources if one.process is not None)
        if names:
            yield (
                f"The residuals of {' and of '.join(names)} are correlated along the record, as the candidates' are "
                "assumed to be: more samples, or a better sensor, bring little. A channel that was not measured so far "
                "is assumed to have none of this misfit, so that its gain is an upper limit."
            )
        if self._note:
            yield self._note
        loss = self._problem.loss
        new = [(plan, c) for plan in plans for c in plan.test.compared]
        strange = dict.fromkeys(c for plan, c in new if not counts(self._problem, plan, c))
        if strange:
            yield (
                f"The loss '{loss.name}' does not count {', '.join(strange)}: at the same noise they are given the "
                "mean weight of the channels that it counts."
            )

    def _reach(self, one: Estimator | ExpectedEstimates, minimum: Floats) -> tuple[tuple[float, float] | None, float]:
        """The interval [SI] and its length without the parameter's bounds, in the unit box; infinite without one."""
        known = np.flatnonzero(~_mixed(one))
        if self._j not in known:
            return None, np.inf
        at = int(np.flatnonzero(known == self._j)[0])
        z = self._z[known]
        ends, errors = box_intervals(z, minimum[known], one.root[:, known], one.dof[known])
        parameter = self._problem.space.parameters[self._j]
        value, (low, high) = self._theta[parameter.label], (parameter.value_at(float(end)) for end in ends[at])
        interval = min(low, value), max(high, value)
        return interval, float(2.0 * student(one.dof[known])[at] * errors[at])


def _mixed(one: Estimator | ExpectedEstimates) -> np.ndarray:
    return unseen_parameters(one.unseen)


def verdict(found: NextTests) -> str:
    """The best candidate and its expected interval, as a sentence."""
    best = found.best
    if best is None:
        return f"No candidate would give {found.parameter} an interval."
    expected = format_interval(best.interval, found.unit) if best.interval else ""
    if found.interval is None:
        return (
            f"{found.parameter} has no interval: the data do not determine it. With '{best.candidate.name}' one of "
            f"{expected} is expected."
        )
    now = f"The 95 % interval of {found.parameter} is {format_interval(found.interval, found.unit)}."
    if best.share is None or best.share > _LITTLE:
        return f"{now} No candidate would shorten it by more than {100 * (1 - _LITTLE):.0f} %."
    alike = [one for one in found.outlooks if one.share is not None and one.share < _ALIKE * best.share]
    if len(alike) > 2:
        most = max(one.share for one in alike if one.share is not None)
        shares = " to ".join(dict.fromkeys(plain(share, 2) for share in (best.share, most)))
        return (
            f"{now} {len(alike)} candidates are expected to shorten it alike, to {shares} of its length: "
            f"{expected} with '{best.candidate.name}'."
        )
    return (
        f"{now} '{best.candidate.name}' is expected to shorten it most, to {plain(best.share, 2)} of its length: "
        f"{expected}."
    )
