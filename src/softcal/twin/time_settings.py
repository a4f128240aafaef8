"""Settings of the time integration: the `dynamics` of a project file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from softcal.declare import Declared
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.mechanics.damping import Damping, DampingKind, Scheme
from softcal.quantities import Duration, Rate, Speed, Time

MassMatrix = Literal["consistent", "lumped"]


@displayed
@dataclass(frozen=True)
class Settling(Declared):
    """Criterion of rest after the schedule: no speed above `speed` [m/s] for `hold` [s].

    Attributes
    ----------
    speed
        Largest speed at rest [m/s].
    hold
        Time for which it must not be exceeded [s].
    longest
        Time after the schedule at which to give up [s].
    on
        Plate or marker that is watched; "" watches every point.
    """

    speed: Speed = 1e-6
    hold: Time = 0.1
    longest: Duration = 60.0
    on: str = ""


@displayed
@dataclass(frozen=True)
class TimeSettings(Declared):
    """Settings of the time integration.

    Attributes
    ----------
    time_step
        [s].
    rayleigh_stiffness, rayleigh_mass
        Rayleigh damping [s], [1/s]; paper A's by default.
    scheme
        `converged` solves each step by Newton's method; `one-solve` takes its first iteration, as SOFA does.
    damping
        Of bodies: on the `strain`, or with the `tangent` of their forces, which is SOFA's and adds energy to a body
        compressed beyond its own buckling load; by default the first in converged steps, else the second.
    masses
        Mass matrix of bodies, `consistent` or `lumped` at the nodes.
    start
        At equilibrium under the dead loads, with the pretensions of cables that no tension drives, or at rest without
        both.
    ramp
        Duration of a project's ramps [s]; a `Schedule` has times of its own.
    hold
        Time after the schedule for which its last commands are kept [s].
    settle
        Criterion of rest that ends the motion instead; in a project file the default.
    """

    time_step: Duration = 0.01
    rayleigh_stiffness: Time = 0.2
    rayleigh_mass: Rate = 0.1
    scheme: Scheme = "converged"
    damping: DampingKind | None = None
    masses: MassMatrix = "consistent"
    start: Literal["equilibrium", "undeformed"] = "equilibrium"
    ramp: Duration = 1.0
    hold: Time | None = None
    settle: Settling | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hold is not None and self.settle is not None:
            fault = Fault("the end of the motion is specified twice", got="hold and settle", allowed="one of the two")
            raise InputError(fault)

    @property
    def rayleigh(self) -> Damping:
        """The damping."""
        kind = self.damping or ("tangent" if self.scheme == "one-solve" else "strain")
        return Damping(self.rayleigh_stiffness, self.rayleigh_mass, kind)
