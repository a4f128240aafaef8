"""Paper B's search: every point of a grid, over the bounds or over values that are given."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.search.optimiser import Optimiser, Proposal, register_optimiser
from softcal.calibration.search.settings import SearchSettings
from softcal.errors import Fault, ParameterError

# Small enough that an interrupted run has recorded nearly all its evaluations, large enough for many workers.
_GENERATION = 32


@register_optimiser
class GridOptimiser(Optimiser):
    """A full grid, the last parameter fastest: equally spaced between the bounds, or `over` given values.

    Between the bounds, which are included, the points are equally spaced on each parameter's scale, and there are at
    most `trials` of them.
    """

    name = "grid"
    title = "grid sweep"
    default_trials = 400
    grows = False

    @classmethod
    def begin(cls, problem: Problem, settings: SearchSettings) -> GridOptimiser:
        """The grid with as many trials, at most, as the settings allow.

        Raises
        ------
        ParameterError
            Where these are fewer than two for each parameter.
        """
        space = problem.space
        trials = settings.trials or 0
        count = int(trials ** (1.0 / space.size) + 1e-9)
        if count < 2:
            allowed = f"at least {2**space.size}"
            raise ParameterError(
                Fault(f"a grid over {space.size} parameters needs more trials", "trials", str(trials), allowed)
            )
        per_axis = np.linspace(0.0, 1.0, count)
        points = (space.to_model(z) for z in itertools.product(per_axis, repeat=space.size))
        return cls(points, [len(per_axis)] * space.size)

    @classmethod
    def over(cls, space: SearchSpace, axes: Mapping[str, Sequence[float]]) -> GridOptimiser:
        """The grid over values [SI] of every parameter by label, in the order in which it is walked through.

        Raises
        ------
        ParameterError
            Where the axes are not those of the space, or a value lies outside its bounds.
        """
        faults: list[Fault] = []
        if set(axes) != set(space.labels):
            faults.append(
                Fault("the grid's axes are not the free parameters", "axes", ", ".join(axes), ", ".join(space.labels))
            )
        for p in space.parameters:
            outside = [value for value in axes.get(p.label, ()) if not p.lower <= value <= p.upper]
            if outside:
                allowed = f"{p.lower:.6g} to {p.upper:.6g} {p.unit}"
                faults.append(Fault("a value of the grid is outside the bounds", p.label, f"{outside[0]:.6g}", allowed))
            if p.label in axes and not len(axes[p.label]):
                faults.append(Fault("an axis of the grid holds no value", p.label))
        if faults:
            raise ParameterError(faults)
        points = (dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values()))
        return cls(points, [len(values) for values in axes.values()])

    def __init__(self, points: Iterable[Mapping[str, float]], shape: Sequence[int]) -> None:
        self._proposals = [Proposal(number, theta) for number, theta in enumerate(points)]
        self._shape = " x ".join(map(str, shape))
        self._asked = 0

    def ask(self) -> tuple[Proposal, ...]:
        generation = tuple(self._proposals[self._asked : self._asked + _GENERATION])
        self._asked += len(generation)
        return generation

    def tell(self, proposal: Proposal, evaluation: Evaluation) -> None:
        """Nothing to do: the points of a grid do not depend on evaluations."""

    @property
    def total(self) -> int:
        return len(self._proposals)

    @property
    def status(self) -> str:
        if self._asked < self.total:
            return f"The grid of {self._shape} points is not finished."
        return f"All {self.total} points of the grid ({self._shape}) were evaluated."
