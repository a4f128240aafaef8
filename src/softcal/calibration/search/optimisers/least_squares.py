"""The search by exact sensitivities, from several starts."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from softcal.calibration.problem.loss import Loss, rms
from softcal.calibration.problem.option import Option
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.search.descent import Descent, counted
from softcal.calibration.search.optimiser import Optimiser, Proposal, register_optimiser
from softcal.calibration.search.settings import SearchSettings
from softcal.checks import Floats
from softcal.limits import LIMITS

# A start above this share of the range below a ceiling may lie where elements lock.
_NEAR_CEILING = 0.75
# A search predicted to end within this distance (of the search range) of a known minimum ends at that one.
_SAME_MINIMUM = 0.02
# Of the loss: a minimum that is lower by less is not worth a search; the noise of 200 samples moves it by more.
_WORTH = 0.01
# RMSE over the root mean square of the measurement, in every channel: below it further starts are skipped.
_MET = 1e-6


@register_optimiser
class LeastSquaresOptimiser(Optimiser):
    """Trust-region descents with exact jacobians; `trials` limits the evaluations of each start.

    The first start is the parameters' own (the middle of the range where there is none); the others are a Latin
    hypercube by `seed`. The first descent runs alone, then the others together. Once a descent has converged, the
    models of the others predict their minima; a descent is abandoned when that is the same minimum or none that is
    lower by a hundredth. So a start costs one evaluation where there is one minimum, and none where the first has
    fitted the measurements exactly.

    `starts`: local searches, in case the first ends in a minimum that is not the lowest.

    Where elements lock, close to Poisson's ratio 0.5, a search ends in the nearest local minimum. So a first start near
    such a ceiling is preceded by one with that parameter in the middle of its range; the two share their budget.
    """

    name = "least-squares"
    title = "least squares with exact derivatives"
    default_trials = 40
    needs_jacobian = True
    statistics = "sensitivity"
    options = (Option("starts", LIMITS["starts"], 3),)
    expected = (4, 12)
    in_parallel = False  # the first descent runs alone, and most often there is no other

    @classmethod
    def begin(cls, problem: Problem, settings: SearchSettings) -> LeastSquaresOptimiser:
        trials, starts = settings.trials or 0, int(settings.options["starts"])
        paths = problem.path_parameters
        return cls(problem.space, problem.loss, trials=trials, seed=settings.seed, starts=starts, of_paths=paths)

    def __init__(
        self,
        space: SearchSpace,
        loss: Loss,
        *,
        trials: int,
        seed: int,
        starts: int = 1,
        of_paths: Collection[str] = (),
    ) -> None:
        self._space, self._loss = space, loss
        self._trials = trials
        numbers = [j for j, label in enumerate(space.labels) if label in of_paths]
        own, *others = (Descent(space, loss, z, trials, numbers) for z in _starts(space, starts, seed))
        self._descents = [own, *others]
        self._waves = [[own], others]
        below = np.array([np.isfinite(p.ceiling) for p in space.parameters])
        locked = below & (own.start > _NEAR_CEILING)
        self._in_the_middle = [label for label, is_locked in zip(space.labels, locked, strict=True) if is_locked]
        if locked.any():
            self._waves.insert(0, [Descent(space, loss, np.where(locked, 0.5, own.start), trials)])
        self._asked: dict[int, Descent] = {}
        self._number = 0

    def ask(self) -> tuple[Proposal, ...]:
        for wave in self._waves:
            for descent in wave:
                self._leave_if_known(descent)
            running = [(descent, descent.next) for descent in wave if descent.next is not None]
            if running:
                proposals = [Proposal(n, self._space.to_model(z)) for n, (_, z) in enumerate(running, self._number)]
                self._asked |= {proposal.number: d for proposal, (d, _) in zip(proposals, running, strict=True)}
                self._number += len(proposals)
                return tuple(proposals)
        return ()

    def tell(self, proposal: Proposal, evaluation: Evaluation) -> None:
        descent, own = self._asked.pop(proposal.number), self._descents[0]
        descent.tell(evaluation)
        if descent not in self._descents:
            own.budget -= 1

    @property
    def total(self) -> int:
        return self._trials * len(self._descents)

    @property
    def status(self) -> str:
        begun = [descent for wave in self._waves for descent in wave if descent.evaluations]
        status, n = self._best.status, sum(descent.evaluations for descent in begun)
        if not all(descent in self._descents for descent in begun):
            named = " and ".join(self._in_the_middle)
            status += (
                f" {counted(n)} in all, including those of an additional first start with {named} in the middle of "
            )
            status += "the range, where elements do not lock."
        elif n > self._best.evaluations:
            status += f" {counted(n)} in all."
        n_starts = len(self._descents)
        if n_starts == 1:
            return status
        n_spared = sum(descent.left for descent in self._descents[1:])
        if not n_spared:
            return f"{status} {sum(descent.converged for descent in self._descents)} of {n_starts} starts converged."
        return f"{status} {n_spared} of {n_starts} starts were abandoned: no lower minimum was predicted from them."

    @property
    def converged(self) -> bool:
        return self._best.converged

    @property
    def _best(self) -> Descent:
        begun = [descent for wave in self._waves for descent in wave if descent.best is not None]
        return min(begun, key=_value) if begun else self._descents[0]

    def _leave_if_known(self, descent: Descent) -> None:
        found = [other for wave in self._waves for other in wave if other.converged]
        if descent.next is not None and descent.evaluations >= descent.budget:
            descent.leave("Abandoned: the allowed number of trials is reached.")
        if descent.next is None or not found:
            return
        known = min(found, key=_value)
        if known.best is None:
            raise RuntimeError("a search has converged nowhere")
        if all(rms(block.residual) <= _MET * rms(block.measured) for block in known.best.blocks):
            descent.leave("Abandoned: another start already fits the measurements exactly.")
        elif descent.best is not None:
            z, loss = descent.forecast()
            if float(np.abs(z - known.z).max()) < _SAME_MINIMUM or loss >= (1 - _WORTH) * _value(known):
                descent.leave("Abandoned: no lower minimum than that of an earlier start is predicted.")


def _value(descent: Descent) -> float:
    if descent.best is None or descent.best.loss is None:
        raise RuntimeError("the descent has no loss")
    return descent.best.loss


def _starts(space: SearchSpace, count: int, seed: int) -> list[Floats]:
    """The parameters' own start, and a Latin hypercube. A parameter's values in it follow from its label: load paths
    that separate fits have solved from there serve the joint one.
    """
    n = max(count - 1, 0)
    others = np.zeros((n, space.size))
    for j, label in enumerate(space.labels):
        random = np.random.default_rng([seed, *label.encode()])
        others[:, j] = (random.permutation(n) + random.random(n)) / max(n, 1)
    return [np.clip(space.to_search(space.start), 0.0, 1.0), *others]
