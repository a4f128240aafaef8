"""Rayleigh damping, and the time step in which it acts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from softcal.mechanics.layout import Layout

# Solution of a step: by Newton's method, or by its first iteration.
Scheme = Literal["converged", "one-solve"]
# Of bodies: on strains, which never adds energy; or with the tangent of their forces, as in SOFA.
DampingKind = Literal["strain", "tangent"]


@dataclass(frozen=True)
class Damping:
    """Rayleigh's coefficients: stiffness [s] and mass [1/s], C = stiffness K + mass M; kind: choice of K for bodies."""

    stiffness: float = 0.0
    mass: float = 0.0
    kind: DampingKind = "strain"


@dataclass(frozen=True)
class TimeStep:
    """A step of backward Euler, length [s]."""

    layout: Layout
    length: float
    damping: Damping

    @property
    def share(self) -> float:
        """r_s / h: damping's factor on the strain's change in the step."""
        return self.damping.stiffness / self.length
