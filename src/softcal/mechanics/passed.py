"""A material with a history from one sample to the next: its memory, and rates through it.

The parts of the history change what an elastic law has at points, those of a solid or the elements of a rod. The memory
of a term is that of its points, one after the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from softcal.checks import Floats
from softcal.materials.inelastic import Constants, History, Left, PointRates, Stressed
from softcal.materials.stress_at import NO_TANGENT


class ElasticAt(Protocol):
    """An elastic law at points, at a sample."""

    def stressed(self, *, tangent: bool) -> Stressed:
        """The law alone."""
        ...

    def by_constant(self, name: str) -> tuple[Floats, Floats] | None:
        """Derivatives of energy (n,) and stress (n, 6) by one of its constants; None of what is no constant of it."""
        ...


Law = TypeVar("Law", bound=ElasticAt)


@dataclass(frozen=True)
class Passed(Generic[Law]):
    """A material with a history, from one sample to the next.

    Attributes
    ----------
    history
        The parts that change the law's stress.
    law
        The law at the points, at the sample.
    constants
        Those of the history, by name.
    memory
        What the sample before left (n_points * size,).
    elapsed
        Time since then [s]; infinity where it was long.
    """

    history: History
    law: Law
    constants: Constants
    memory: Floats
    elapsed: float

    def respond(self, *, tangent: bool) -> Left:
        """The material with its history."""
        at = self.law.stressed(tangent=tangent)
        return self.history.respond(at, self._by_point(self.memory), self.elapsed, self.constants)

    def rates(
        self, strain: Floats | None = None, memory: Floats | None = None, constant: str = ""
    ) -> tuple[Floats, Floats]:
        """The rates of the stress (n, 6), and of the memory that is left (n_points * size,).

        Parameters
        ----------
        strain
            Rates of the strains (n, 6); None: zero.
        memory
            Rates of the memory before; None: zero.
        constant
            Constant of the law or the history whose rate is one; "": none.
        """
        at = self.law.stressed(tangent=strain is not None)
        by = PointRates(np.zeros_like(at.E), np.zeros_like(at.W), np.zeros_like(at.S))
        if strain is not None:
            by = PointRates(strain, (at.S * strain).sum(axis=1), np.einsum("nab,nb->na", at.D, strain))
            at = at._replace(D=NO_TANGENT)
        changes: Mapping[str, float] = {constant: 1.0} if constant in self.constants else {}
        by_law = self.law.by_constant(constant)
        if by_law is not None:
            by = PointRates(by.E, by.W + by_law[0], by.S + by_law[1])
        own = self._by_point(self.memory)
        change = np.zeros_like(own) if memory is None else self._by_point(memory)
        after, left = self.history.rates(at, by, (own, change), self.elapsed, (self.constants, changes))
        return after.S, left.ravel()

    def _by_point(self, memory: Floats) -> Floats:
        return memory.reshape(-1, self.history.size)
