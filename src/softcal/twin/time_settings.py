"""How motion in time is computed: the `dynamics` of a project file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from softcal.declare import Declared
from softcal.errors import Fault, InputError
from softcal.mechanics.damping import Damping, DampingKind, Scheme
from softcal.quantities import Duration, Rate, Speed, Time

MassMatrix = Literal["consistent", "lumped"]


@dataclass(frozen=True)
class Settling(Declared):
    """When a robot has come to rest, after its schedule: nothing faster than `speed` [m/s] for `hold` [s].

    on: the plate or marker that is watched; "" watches every point. longest: time [s] after the schedule to give up.
    """

    speed: Speed = 1e-6
    hold: Time = 0.1
    longest: Duration = 60.0
    on: str = ""


@dataclass(frozen=True)
class TimeSettings(Declared):
    """How motion is computed.

    time_step [s]; rayleigh_stiffness [s] and rayleigh_mass [1/s]: damping, paper A's by default.
    scheme: `converged` solves each step by Newton's method; `one-solve` takes its first iteration, as SOFA does.
    damping of bodies: on the `strain`, or with the `tangent` of their forces, which is SOFA's and gives energy to a
    body that is pressed beyond its own buckling load; by default the first in converged steps, else the second.
    masses: `consistent` or `lumped`, of bodies. start: at equilibrium under the dead loads, or at rest without them.
    ramp [s]: how long a project's pulls grow; a `Schedule` has times of its own. After the schedule, its last commands
    are held for `hold` [s], or until nothing moves as `settle` says; in a project file that is so by default.
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
            fault = Fault("it is said twice how the motion ends", got="hold and settle", allowed="one of the two")
            raise InputError(fault)

    @property
    def rayleigh(self) -> Damping:
        """The damping."""
        kind = self.damping or ("tangent" if self.scheme == "one-solve" else "strain")
        return Damping(self.rayleigh_stiffness, self.rayleigh_mass, kind)
