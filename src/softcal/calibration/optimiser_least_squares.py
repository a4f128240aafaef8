"""The search by exact sensitivities, from several starts."""

from __future__ import annotations

import numpy as np

from softcal.calibration.descent import Descent
from softcal.calibration.local_model import Point
from softcal.calibration.loss import Loss, rms
from softcal.calibration.optimiser import Optimiser, Proposal
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.problem import Evaluation
from softcal.checks import Floats

# A search that is seen to end this near (of the search range) to a minimum already found ends at it.
_SAME_MINIMUM = 0.02
# Of the loss: a minimum that is lower by less is not worth a search; the noise of 200 samples moves it by more.
_WORTH = 0.01
# RMSE over the root mean square of the measurement, in every channel: no other minimum is lower to speak of.
_MET = 1e-6


class LeastSquaresOptimiser(Optimiser):
    """Trust-region descents with exact jacobians; `trials` limits the trajectories of each start.

    The first start is the parameters' own (the middle of the range where there is none); the others are a Latin
    hypercube by `seed`. The first descent runs alone, then the others together. After each trajectory a model that
    meets both what a descent has seen and the best minimum found so far says where the descent would end; it is left
    when that is the same minimum or none that is lower by a hundredth. So a start costs one trajectory where there is
    one minimum, and none where the first has met the measurements exactly.

    A first start in a layer where elements lock is looked at, then first searched from outside the layer; what its
    model promises in the layer decides whether the search there goes on.
    """

    name = "least-squares"
    needs_jacobian = True

    def __init__(self, space: SearchSpace, loss: Loss, *, trials: int, seed: int, starts: int = 1) -> None:
        self._space, self._loss = space, loss
        self._trials = trials
        self._descents = [Descent(space, loss, z, trials) for z in _starts(space, starts, seed)]
        self._outside: Descent | None = None
        self._asked: dict[int, Descent] = {}
        self._number = 0

    def ask(self) -> tuple[Proposal, ...]:
        first, *others = self._descents
        for wave in ([] if self._outside is None else [self._outside], [first], others):
            for descent in wave:
                self._leave_if_known(descent)
            running = [(descent, descent.next) for descent in wave if descent.next is not None]
            if running:
                return tuple(self._proposal(descent, z) for descent, z in running)
        return ()

    def tell(self, proposal: Proposal, evaluation: Evaluation) -> None:
        descent = self._asked.pop(proposal.number)
        descent.tell(evaluation)
        first = self._descents[0]
        if descent is self._outside:
            first.spend(1)
        elif descent is first and self._outside is None:
            start = first.way_out()
            if start is not None:
                self._outside = Descent(self._space, self._loss, start, self._trials - first.evaluations)

    @property
    def total(self) -> int:
        return self._trials * len(self._descents)

    @property
    def status(self) -> str:
        begun = [descent for descent in self._all() if descent.best is not None and descent.best.loss is not None]
        if not begun:
            return self._descents[0].status
        sentence = min(begun, key=_value).status
        n_starts = len(self._descents)
        if n_starts == 1:
            return sentence
        n_spared = sum(descent.left for descent in self._descents[1:])
        if not n_spared:
            return f"{sentence} {sum(descent.converged for descent in self._descents)} of {n_starts} starts converged."
        return f"{sentence} {n_spared} of {n_starts} starts were left, for nothing better was in sight from them."

    @property
    def converged(self) -> bool:
        begun = [descent for descent in self._all() if descent.best is not None and descent.best.loss is not None]
        return bool(begun) and min(begun, key=_value).converged

    def _all(self) -> list[Descent]:
        return self._descents if self._outside is None else [*self._descents, self._outside]

    def _proposal(self, descent: Descent, z: Floats) -> Proposal:
        proposal = Proposal(self._number, self._space.to_model(z))
        self._asked[self._number] = descent
        self._number += 1
        return proposal

    def _leave_if_known(self, descent: Descent) -> None:
        found = [other for other in self._all() if other.converged]
        if descent.next is None or not found:
            return
        known = min(found, key=_value)
        if known.best is None:
            raise RuntimeError("a search has converged nowhere")
        if all(rms(block.residual) <= _MET * rms(block.measured) for block in known.best.blocks):
            descent.leave("Left: the measurements are met already.")
        elif descent.best is not None and descent.best.loss is not None:
            end = descent.forecast(Point(known.z, known.best.blocks))
            if float(np.abs(end.z - known.z).max()) < _SAME_MINIMUM or end.loss >= (1 - _WORTH) * _value(known):
                descent.leave("Left: it is not seen to end lower than a search before it.")


def _value(descent: Descent) -> float:
    if descent.best is None or descent.best.loss is None:
        raise RuntimeError("the descent has no loss")
    return descent.best.loss


def _starts(space: SearchSpace, count: int, seed: int) -> list[Floats]:
    from scipy.stats import qmc

    middle = space.to_model(np.full(space.size, 0.5))
    first = {p.label: middle[p.label] if p.start is None else p.start for p in space.parameters}
    others = qmc.LatinHypercube(space.size, rng=np.random.default_rng(seed)).random(max(count - 1, 0))
    return [np.clip(space.to_search(first), 0.0, 1.0), *others]
