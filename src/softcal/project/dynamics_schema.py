"""What may stand in the `dynamics` section of a project file: how motion in time is computed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import model_validator

from softcal.limits import LIMITS
from softcal.project.section import Duration, Rate, Section, Speed, Time, fault_error

if TYPE_CHECKING:
    from softcal.twin.schedule import TimeSettings


class SettleSection(Section):
    """When the robot has come to rest, and what is watched: a plate, a marker, or every point."""

    speed: Speed = 1e-6
    hold: Time = 0.1
    longest: Duration = 60.0
    on: str = ""


class DynamicsSection(Section):
    """How motion is computed: a pull grows over `ramp`; then the robot settles, or `hold` more is computed."""

    time_step: Duration = 0.01
    rayleigh_stiffness: Time = 0.2
    rayleigh_mass: Rate = 0.1
    scheme: Literal["converged", "one-solve"] = "converged"
    damping: Literal["strain", "tangent"] | None = None
    masses: Literal["consistent", "lumped"] = "consistent"
    start: Literal["equilibrium", "undeformed"] = "equilibrium"
    ramp: Duration = 1.0
    hold: Time | None = None
    settle: SettleSection | None = None

    @model_validator(mode="after")
    def _one_end(self) -> DynamicsSection:
        if self.hold is not None and self.settle is not None:
            raise fault_error("it is said twice how the motion ends", got="hold and settle", allowed="one of the two")
        after = (self.settle or SettleSection()).longest if self.hold is None else self.hold
        if fault := LIMITS["time steps"].fault(1 + (self.ramp + after) / self.time_step):
            raise fault_error(fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
        return self

    @property
    def settings(self) -> TimeSettings:
        """As the twin takes them."""
        from softcal.twin.schedule import Settling, TimeSettings

        settle = None if self.hold is not None else self.settle or SettleSection()
        return TimeSettings(
            time_step=self.time_step,
            rayleigh_stiffness=self.rayleigh_stiffness,
            rayleigh_mass=self.rayleigh_mass,
            scheme=self.scheme,
            damping=self.damping,
            masses=self.masses,
            start=self.start,
            until_settled=None if settle is None else Settling(settle.speed, settle.hold, settle.longest, settle.on),
        )
