"""The budget of errors of the estimates: what each source of error contributes to the variance of each.

The sources are independent, so that the covariance C of the minimum is the sum of theirs. The bounds of the search are
knowledge too: a parameter of which the data say little lies within them. Where the other parameters k have the variance
1/12 of a uniform distribution over the unit box, the estimate of j answers to the sources by the row

    e_j^T (I + C W)^-1,    W = 12 I but zero at j

and what is left over is the share of the bounds. Without it, the error of E by a nu that force does not tell would
count in full, although nu cannot leave its bounds. The degrees of freedom (Satterthwaite) are those of these variances.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softcal.calibration.statistics.correlation import triangle
from softcal.calibration.statistics.noise import Source
from softcal.checks import Floats

BOUNDS = "bounds"
_UNIFORM = 12.0  # one over the variance of a uniform distribution over the unit box
_ROUNDING = 1e-12  # of the search range: no standard error is smaller


@dataclass(frozen=True)
class Budget:
    """Sources of error, with the responses (m, size) of the minimum to the records of each, in the unit box."""

    sources: Sequence[Source]
    responses: Sequence[Sequence[Floats]]
    size: int

    def times(self, factor: float) -> Budget:
        """The budget with all errors multiplied by a factor."""
        return replace(self, sources=[source.times(factor) for source in self.sources])

    def joined(self, other: Budget) -> Budget:
        """The budget of the errors of this one and another."""
        return replace(self, sources=[*self.sources, *other.sources], responses=[*self.responses, *other.responses])

    def part(self, *kinds: str) -> Budget:
        """The budget of the sources of some kinds."""
        held = [pair for pair in zip(self.sources, self.responses, strict=True) if pair[0].kind in kinds]
        return replace(self, sources=[source for source, _ in held], responses=[own for _, own in held])

    @cached_property
    def root(self) -> Floats:
        """`root.T @ root` is the covariance, shape (size, size)."""
        rows = [_ROUNDING * np.eye(self.size)]
        for source, responses in zip(self.sources, self.responses, strict=True):
            rows += source.rows(responses)
        return triangle(np.concatenate(rows))

    @cached_property
    def variances(self) -> Mapping[str, Floats]:
        """Kind of source -> its part of each variance, shape (size,), with the other parameters within their bounds."""
        answers = self._answers
        found: dict[str, Floats] = {}
        for source, responses in zip(self.sources, self.responses, strict=True):
            part = source.variances([one @ answers for one in responses])
            found[source.kind] = found.get(source.kind, 0.0) + part
        left = np.eye(self.size) - answers
        np.fill_diagonal(left, 0.0)
        found[BOUNDS] = np.sum(left**2, axis=0) / _UNIFORM
        return found

    @cached_property
    def dof(self) -> Floats:
        """Degrees of freedom of each parameter's variance, shape (size,), infinite where all noise is known."""
        answers, scatter = self._answers, np.zeros(self.size)
        for source, responses in zip(self.sources, self.responses, strict=True):
            scatter = scatter + source.scatter([one @ answers for one in responses])
        total: Floats = np.sum(list(self.variances.values()), axis=0)
        found = np.full(self.size, np.inf)
        found[scatter > 0] = 2 * total[scatter > 0] ** 2 / scatter[scatter > 0]
        return found

    @cached_property
    def within_bounds(self) -> Floats:
        """The covariance (size, size) of all parameters where each lies within its bounds."""
        covariance = self.root.T @ self.root
        return np.asarray(np.linalg.solve(np.eye(self.size) + _UNIFORM * covariance, covariance), dtype=np.float64)

    @cached_property
    def _answers(self) -> Floats:
        """Columns: response of each parameter's estimate to steps of all parameters, the others within their bounds."""
        covariance = self.root.T @ self.root
        columns: list[Floats] = []
        for j in range(self.size):
            weights = np.where(np.arange(self.size) == j, 0.0, _UNIFORM)
            columns.append(np.linalg.solve(np.eye(self.size) + weights[:, None] * covariance, np.eye(self.size)[j]))
        return np.column_stack(columns)
