"""Paper B's search: every point of a grid over the bounds."""

from __future__ import annotations

import itertools

import numpy as np

from softcal.calibration.optimiser import Optimiser, Proposal
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.problem import Evaluation
from softcal.errors import Fault, ParameterError

# Small enough that an interrupted run has told nearly all it found, large enough to keep many workers busy.
_GENERATION = 32


class GridOptimiser(Optimiser):
    """A full grid, bounds included, equally spaced on each parameter's scale; at most `trials` points.

    Raises
    ------
    ParameterError
        Where `trials` does not suffice for two points along every parameter.
    """

    name = "grid"
    needs_jacobian = False

    def __init__(self, space: SearchSpace, *, trials: int) -> None:
        per_axis = int(trials ** (1.0 / space.size) + 1e-9)
        if per_axis < 2:
            raise ParameterError(
                Fault(
                    f"a grid over {space.size} parameters needs more trials",
                    "trials",
                    got=str(trials),
                    allowed=f"at least {2**space.size}",
                )
            )
        axis = np.linspace(0.0, 1.0, per_axis)
        points = itertools.product(axis, repeat=space.size)
        self._proposals = [Proposal(number, space.to_model(z)) for number, z in enumerate(points)]
        self._asked = 0
        self._shape = " x ".join([str(per_axis)] * space.size)

    def ask(self) -> tuple[Proposal, ...]:
        generation = tuple(self._proposals[self._asked : self._asked + _GENERATION])
        self._asked += len(generation)
        return generation

    def tell(self, proposal: Proposal, evaluation: Evaluation) -> None:
        """A grid does not learn."""

    @property
    def total(self) -> int:
        return len(self._proposals)

    @property
    def status(self) -> str:
        if self._asked < self.total:
            return f"The grid of {self._shape} points is not finished."
        return f"All {self.total} points of the grid ({self._shape}) were evaluated."
