"""Evaluations by an executor's workers, or in this process; results in the order of the proposals."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from itertools import islice

from softcal.calibration.problem.problem import Contribution, Evaluation, Problem
from softcal.calibration.search.optimiser import Proposal
from softcal.errors import CalibrationError
from softcal.executors.each import LostCall, each, executor_of, here
from softcal.executors.executor import Executor, ExecutorLost

_WORTH = 2.0  # [s]: an evaluation by itself that takes less is not worth the start of processes
_HOPELESS = 5  # evaluations that end their workers, with none that does not


class Evaluator:
    """Evaluates a problem at many points.

    An evaluation that ends its worker each time that it is tried is a failed one, with a sentence.

    Parameters
    ----------
    problem
        What is evaluated.
    workers
        An executor, which stays open; or a number of processes of this machine.
    jacobian
        Whether with derivatives.
    long
        Whether it is known that an evaluation is worth the start of processes.

    Raises
    ------
    ParameterError
        For less than one worker.
    """

    def __init__(self, problem: Problem, *, workers: int | Executor, jacobian: bool, long: bool = False) -> None:
        self._problem, self._jacobian = problem, jacobian
        self._stack = contextlib.ExitStack()
        self._executor = self._stack.enter_context(executor_of(workers))
        self._seconds = 0.0  # of the last evaluation by itself
        self._begun, self._succeeded = long, False
        self._lost = 0

    def __enter__(self) -> Evaluator:
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def evaluate(self, proposals: Sequence[Proposal]) -> Iterator[tuple[Proposal, Evaluation]]:
        """Each proposal with its evaluation, in order, as soon as it is there.

        Raises
        ------
        CalibrationError
            Where workers end at whatever they evaluate, give another result than was asked for, or no more can be had.
        """
        short = len(proposals) == 1 and not self._begun and self._seconds < _WORTH
        if self._executor.alone or (self._executor.here and short):
            for proposal in proposals:
                evaluation = here(_evaluate, self._problem, dict(proposal.theta), self._jacobian)
                if isinstance(evaluation, LostCall):
                    evaluation = self._problem.failed(proposal.theta, evaluation.why)
                self._seconds = evaluation.seconds
                yield proposal, evaluation
            return
        if not proposals:
            return
        self._begun = True
        thetas = [dict(p.theta) for p in proposals]
        if len(proposals) < self._executor.count:  # these share the trajectories of each
            found = self._shared(thetas)
        else:
            found = each(self._executor, _evaluate, self._problem, [(theta, self._jacobian) for theta in thetas])
        for proposal, evaluation in zip(proposals, found, strict=True):
            if isinstance(evaluation, LostCall):
                self._lost += 1
                if self._lost >= _HOPELESS and not self._succeeded:
                    raise CalibrationError(
                        f"The first {self._lost} evaluations ended their workers, trial {proposal.number} the last of "
                        f"them. {evaluation.why} The trials so far are kept. Try: fewer workers than "
                        f"{self._executor.count}, and resume."
                    )
                yield proposal, self._problem.failed(proposal.theta, evaluation.why)
            else:
                self._require_of(proposal, evaluation)
                self._succeeded = True
                yield proposal, evaluation

    def _require_of(self, proposal: Proposal, evaluation: object) -> None:
        """Raise unless an evaluation is that of a proposal: one of another would be a silent wrong number.

        Raises
        ------
        ExecutorLost
            As said.
        """
        size = len(self._problem.space.parameters)
        if not isinstance(evaluation, Evaluation):
            why = f"it is a {type(evaluation).__name__}"
        elif dict(evaluation.theta) != dict(proposal.theta):
            why = "it is that of other parameters"
        elif evaluation.loss is not None and math.isnan(evaluation.loss):
            why = "its loss is not a number"
        elif (
            self._jacobian
            and evaluation.loss is not None
            and (evaluation.gradient is None or evaluation.gradient.shape != (size,))
        ):
            why = f"its gradient is not by {size} parameters"
        else:
            return
        raise ExecutorLost(
            f"{self._executor.told} gave for trial {proposal.number} what is no evaluation of it: {why}. What was told "
            "so far is kept. Try: another --on, and resume."
        )

    def _shared(self, thetas: Sequence[dict[str, float]]) -> Generator[Evaluation | LostCall]:
        began = time.perf_counter()
        counts = [len(self._problem.trajectories(theta)) for theta in thetas]
        calls = [(t, k, self._jacobian) for t, n in zip(thetas, counts, strict=True) for k in range(n)]
        parts = each(self._executor, _part, self._problem, calls)
        for theta, count in zip(thetas, counts, strict=True):
            done: list[Contribution | LostCall] = list(islice(parts, count))
            told = [part for part in done if isinstance(part, Contribution)]
            others = [part for part in done if not isinstance(part, Contribution)]  # lost, or refused where it is used
            yield others[0] if others else self._problem.joined(theta, told, time.perf_counter() - began)


def evaluated(
    problem: Problem, theta: Mapping[str, float], *, workers: int | Executor = 1, jacobian: bool = False
) -> Evaluation:
    """One evaluation, its trajectories shared by the workers.

    Parameters
    ----------
    problem, theta
        The problem, and its parameters [SI by label].
    workers
        An executor, or a number of processes.
    jacobian
        Whether derivatives are wanted.

    Raises
    ------
    CalibrationError
        Where no more workers can be had.
    """
    with Evaluator(problem, workers=workers, jacobian=jacobian, long=True) as evaluator:
        return next(iter(evaluator.evaluate([Proposal(0, theta)])))[1]


def _evaluate(problem: Problem, theta: dict[str, float], jacobian: bool) -> Evaluation:
    return problem.evaluate(theta, jacobian=jacobian)


def _part(problem: Problem, theta: Mapping[str, float], number: int, jacobian: bool) -> Contribution:
    return problem.part(theta, problem.trajectories(theta)[number], jacobian=jacobian)
