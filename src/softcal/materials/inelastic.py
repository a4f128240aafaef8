"""Additions to an elastic law: stresses that depend on the history of the material.

A part takes energy, stress and tangent at points, as the law or the part before it leaves them, changes them, and
leaves numbers of its own at every point, its memory, to the next converged sample (`mechanics.memory`). Several follow
one another, each on the result of those before. All have exact rates, so that derivatives are carried through a
history.

Stress and tangent are those of an incremental potential: the tangent is symmetric.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats
from softcal.materials.components import ISOCHORIC
from softcal.materials.parameter import Parameter

Constants = Mapping[str, float]


class Stressed(NamedTuple):
    """A material at points of a solid, or in elements of a rod: six strains, and the energy by them.

    Attributes
    ----------
    E
        Of a solid the Green-Lagrange strain, its shears doubled (n, 6) [-]; of a rod the strains of its sections over
        the element (n, 6) [m, rad].
    W
        Energy (n,) [J/m^3].
    S
        dW/dE (n, 6): of a solid the second Piola-Kirchhoff stress [Pa].
    D
        dS/dE (n, 6, 6); empty where it is not wanted.
    isochoric
        That of an incompressible material of shear modulus one, but for its pressure (n or 1, 6, 6).
    """

    E: Floats
    W: Floats
    S: Floats
    D: Floats
    isochoric: Floats = ISOCHORIC


class PointRates(NamedTuple):
    """Rates of a material at points, of `Stressed.E`, `W` and `S`."""

    E: Floats
    W: Floats
    S: Floats


class Left(NamedTuple):
    """The material as a part changes it, and the memory (n, size) that this leaves."""

    at: Stressed
    memory: Floats


@dataclass(frozen=True)
class Inelastic(ABC):
    """One part of a material's behaviour beyond its elastic law."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Its constants."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Numbers in its memory of each point."""

    @property
    def needs_time(self) -> bool:
        """Whether it depends on the time between samples."""
        return False

    @property
    def of_sections(self) -> bool:
        """Whether it also applies to the sections of a rod: to any six strains with an energy."""
        return True

    @abstractmethod
    def respond(self, at: Stressed, memory: Floats, elapsed: float, constants: Constants) -> Left:
        """The response of the material with this part of its history, and the new memory.

        Parameters
        ----------
        at
            The material without this part of its history: energy, stress and tangent at points (n,).
        memory
            Memory of the previous sample (n, size).
        elapsed
            Time since the previous sample [s]; infinity: until nothing changes any more.
        constants
            Constants by name [SI].
        """

    @abstractmethod
    def rates(
        self,
        at: Stressed,
        by: PointRates,
        memory: tuple[Floats, Floats],
        elapsed: float,
        constants: tuple[Constants, Constants],
    ) -> tuple[PointRates, Floats]:
        """The rates of the energy, the stress and the memory that `respond` returns. A rate is one number, or one
        at each point (n,).

        Parameters
        ----------
        at
            The material without this part of its history: energy, stress and tangent at points (n,).
        by
            Rates of its strain, energy and stress.
        memory
            Memory of the previous sample (n, size), and its rates.
        elapsed
            Time since the previous sample [s]; infinity: until nothing changes any more.
        constants
            Constants by name [SI], and their rates; missing rates are zero.
        """

    def faults(self, constants: Constants) -> str:
        """The fault of the constants together; "" where there is none."""
        return ""


@dataclass(frozen=True)
class History:
    """The parts of a material's behaviour beyond its elastic law, one after the other."""

    parts: tuple[Inelastic, ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The constants of all parts."""
        return tuple(one for part in self.parts for one in part.parameters)

    def constants(self, given: Constants) -> Constants:
        """The constants of the parts, from all constants of a material."""
        return {one.name: given[one.name] for one in self.parameters}

    @property
    def size(self) -> int:
        """Numbers in the memory of each point, of all parts."""
        return sum(part.size for part in self.parts)

    def respond(self, at: Stressed, memory: Floats, elapsed: float, constants: Constants) -> Left:
        """See `Inelastic.respond`; for all parts together.

        Parameters
        ----------
        at
            The material without this part of its history: energy, stress and tangent at points (n,).
        memory
            Memory of the previous sample (n, size).
        elapsed
            Time since the previous sample [s]; infinity: until nothing changes any more.
        constants
            Constants by name [SI].
        """
        left: list[Floats] = []
        for part, own in zip(self.parts, self._split(memory), strict=True):
            at, kept = part.respond(at, own, elapsed, constants)
            left.append(kept)
        return Left(at, np.concatenate(left, axis=1))

    def rates(
        self,
        at: Stressed,
        by: PointRates,
        memory: tuple[Floats, Floats],
        elapsed: float,
        constants: tuple[Constants, Constants],
    ) -> tuple[PointRates, Floats]:
        """See `Inelastic.rates`; for all parts together.

        Parameters
        ----------
        at
            The material without this part of its history: energy, stress and tangent at points (n,).
        by
            Rates of its strain, energy and stress.
        memory
            Memory of the previous sample (n, size), and its rates.
        elapsed
            Time since the previous sample [s]; infinity: until nothing changes any more.
        constants
            Constants by name [SI], and their rates.
        """
        left: list[Floats] = []
        for part, own, rates in zip(self.parts, *(self._split(one) for one in memory), strict=True):
            by, kept = part.rates(at, by, (own, rates), elapsed, constants)
            left.append(kept)
            if len(left) < len(self.parts):  # the next part acts on what this one leaves
                at = part.respond(at, own, elapsed, constants[0]).at
        return by, np.concatenate(left, axis=1)

    def _split(self, memory: Floats) -> Sequence[Floats]:
        ends = np.cumsum([part.size for part in self.parts])[:-1].tolist()
        return np.split(memory, ends, axis=1)


# A material that is as its law says.
ELASTIC = History(())
