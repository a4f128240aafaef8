"""The search by exact sensitivities, from several starts."""

from __future__ import annotations

import numpy as np

from softcal.calibration.descent import Descent
from softcal.calibration.loss import Loss
from softcal.calibration.optimiser import Optimiser, Proposal
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.problem import Evaluation
from softcal.checks import Floats

# A search that is about to step this near (of the search range) to a minimum already found has found it too.
_SAME_MINIMUM = 0.02


class LeastSquaresOptimiser(Optimiser):
    """Trust-region descents with exact jacobians; `trials` limits the trajectories of each.

    The first start is the parameters' own (the middle of the range where there is none); the others are a Latin
    hypercube by `seed`. The first descent runs alone. The others follow together and end as soon as they are about
    to step to the minimum it found, which costs them one or two trajectories each when there is only one minimum.
    """

    name = "least-squares"
    needs_jacobian = True

    def __init__(self, space: SearchSpace, loss: Loss, *, trials: int, seed: int, starts: int = 1) -> None:
        self._space = space
        self._trials = trials
        self._descents = [Descent(space, loss, z, trials) for z in _starts(space, starts, seed)]
        self._asked: dict[int, Descent] = {}
        self._number = 0

    def ask(self) -> tuple[Proposal, ...]:
        first, *others = self._descents
        proposals: list[Proposal] = []
        for descent in [first] if first.next is not None else others:
            self._leave_if_known(descent)
            if descent.next is None:
                continue
            proposals.append(Proposal(self._number, self._space.to_model(descent.next)))
            self._asked[self._number] = descent
            self._number += 1
        return tuple(proposals)

    def tell(self, proposal: Proposal, evaluation: Evaluation) -> None:
        self._asked.pop(proposal.number).tell(evaluation)

    @property
    def total(self) -> int:
        return self._trials * len(self._descents)

    @property
    def status(self) -> str:
        begun = [descent for descent in self._descents if descent.best is not None and descent.best.loss is not None]
        if not begun:
            return self._descents[0].status
        best = min(begun, key=_loss)
        if len(self._descents) == 1:
            return best.status
        n_converged = sum(descent.converged for descent in self._descents)
        return f"{best.status} {n_converged} of {len(self._descents)} starts converged."

    def _leave_if_known(self, descent: Descent) -> None:
        first = self._descents[0]
        if descent is first or descent.next is None or descent.best is None or not first.converged:
            return
        if float(np.abs(descent.next - first.z).max()) < _SAME_MINIMUM:
            descent.abandon("Left: its next step leads to the minimum of the first start.")


def _loss(descent: Descent) -> float:
    if descent.best is None or descent.best.loss is None:
        raise RuntimeError("the descent has no loss")
    return descent.best.loss


def _starts(space: SearchSpace, count: int, seed: int) -> list[Floats]:
    from scipy.stats import qmc

    middle = space.to_model(np.full(space.size, 0.5))
    first = {p.label: middle[p.label] if p.start is None else p.start for p in space.parameters}
    others = qmc.LatinHypercube(space.size, rng=np.random.default_rng(seed)).random(max(count - 1, 0))
    return [np.clip(space.to_search(first), 0.0, 1.0), *others]
