"""A drive: a motor whose pulley pulls cables in and pays others out, commanded by its angle or by its torque."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np

from softcal.checks import Floats
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.quantities import QUANTITIES, Angle, Factor, Quantity, Size, SpringRate, Tension
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensors.actuators import ANGLE, TORQUE
from softcal.twin.actuated import Actuator, Numbering, register_actuator

if TYPE_CHECKING:
    from softcal.mechanics.drive import DriveTerm


@displayed
@register_actuator
@dataclass(frozen=True)
class Drive(Actuator):
    """A motor that winds cables of the robot on its pulley; they have no commands of their own then.

    Attributes
    ----------
    cables : Cable -> its radius on the pulley over `radius`; negative: a positive angle pays it out
    radius : Radius of the pulley, from its axis to the middle of the line [m]
    gear_ratio : Turns of the motor for one of the pulley; negative where they turn against each other
    spring_rate : Spring rate of a spring between the pulley and each cable [N/m]; None: none
    pretension : Tension [N] of each cable at the pulley's angle zero, by the springs; None: just taut
    gear_backlash : Angle of the pulley [rad] by which it turns freely while the motor stands; None: none
    zero : Angle of the motor [rad] at which the pulley's is zero; None: zero too
    rotor_inertia : Moment of inertia of the motor's rotor about its axis [kg m^2], in motion in time; None: none
    """

    cables: Mapping[str, Factor]
    radius: Size
    gear_ratio: Factor = 1.0
    spring_rate: SpringRate | None = None
    pretension: Tension | None = None
    gear_backlash: Annotated[float, QUANTITIES["backlash"]] | None = None
    zero: Angle | None = None
    rotor_inertia: Annotated[float, QUANTITIES["rotor inertia"]] | None = None

    name: ClassVar[str] = "drive"
    channels: ClassVar[tuple[ChannelKind, ChannelKind]] = (ANGLE, TORQUE)
    ranges: ClassVar[tuple[Quantity, Quantity]] = (QUANTITIES["angle"], QUANTITIES["moment"])
    quantities: ClassVar[Mapping[str, Quantity]] = {
        "radius": QUANTITIES["size"],
        "spring_rate": QUANTITIES["spring rate"],
        "pretension": QUANTITIES["tension"],
        "gear_backlash": QUANTITIES["backlash"],
        "zero": QUANTITIES["angle"],
        "rotor_inertia": QUANTITIES["rotor inertia"],
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.cables:
            raise InputError(Fault("the drive has no cable", "cables", allowed="cable: 1, or -1 where it is paid out"))
        if self.pretension and self.spring_rate is None:
            what, attempt = "without springs a drive has no pretension", "spring_rate, or the pretension of the cables"
            raise InputError(Fault(what, "pretension", f"{self.pretension:.6g} N", attempt=attempt))

        if self.rotor_inertia and self.gear_backlash:
            what, got = "a rotor before a backlash has a motion of its own, which the drive has not", "both"
            raise InputError(Fault(what, "rotor_inertia, gear_backlash", got, "one of the two"))

    @property
    def driven(self) -> tuple[str, ...]:
        return tuple(self.cables)

    @property
    def has_pretension(self) -> bool:
        return self.pretension is not None

    def shortenings(self, angles: Floats) -> dict[str, Floats]:
        """Length (n,) [m] of each cable taken up at angles of the motor (n,) [rad], without springs and backlash."""
        turned = (angles - (self.zero or 0.0)) / self.gear_ratio
        return {cable: share * self.radius * turned for cable, share in self.cables.items()}

    def torque(self, tensions: Mapping[str, float]) -> float:
        """Torque of the motor [N m] that balances tensions [N] of its cables."""
        return sum(share * self.radius * tensions[name] for name, share in self.cables.items()) / self.gear_ratio

    def term(self, name: str, places: Numbering) -> DriveTerm:
        """Its term.

        Raises
        ------
        MeshError
            For a cable that the robot does not have.
        """
        from softcal.mechanics.drive import DriveTerm

        return DriveTerm(
            name=name,
            cables=np.array([places.cable(cable, f"{name}.cables") for cable in self.cables], dtype=np.int64),
            shares=np.array([*self.cables.values()], dtype=np.float64),
            gear_ratio=self.gear_ratio,
            stated=tuple(key for key in self.quantities if getattr(self, key) is not None),
        )
