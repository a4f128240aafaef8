"""Rayleigh damping, and the time step in which it acts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from softcal.checks import Floats

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
    """A step of backward Euler.

    Attributes
    ----------
    layout
        Numbering of points, frames and unknowns.
    length
        Length of the step [s].
    damping
        The damping.
    effort_rates
        Rates of the actuators' efforts at its start (n_actuators,) [1/s], of a pulley those of its angle.
    """

    layout: Layout
    length: float
    damping: Damping
    effort_rates: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def mass_rate(self) -> float:
        """k = (1 + h r_m) / h^2 [1/s^2], by which mass is a spring."""
        return (1.0 + self.length * self.damping.mass) / self.length**2

    @property
    def share(self) -> float:
        """r_s / h: damping's factor on the strain's change in the step."""
        return self.damping.stiffness / self.length
