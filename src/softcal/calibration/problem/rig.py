"""The rig between the robot and the instruments, at its nominal values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from softcal.calibration.problem.frame import Frame
from softcal.declare import Declared
from softcal.limits import LIMITS
from softcal.quantities import Angle, Clearance, Friction, Presliding, Size, Slack, TensionOffset, Wrap
from softcal.twin.cables import refuse_presliding_alone


@dataclass(frozen=True, kw_only=True)
class Pulleys(Declared):
    """The pulleys between the testing machine and the neck (Euler-Eytelwein).

    Attributes
    ----------
    count : Number of pulleys
    wrap : Angle [rad] that the cable wraps of each
    friction_coefficient : Coefficient by which the dataset's tension was brought to the neck's side [-]
    friction_memory : Whether the friction reverses with the cable: the dataset's tension then is the machine's, of both
        branches
    presliding : Travel [m] over which friction with a memory builds up; None: 0.1 mm
    """

    count: Annotated[int, LIMITS["pulleys"]] = 2
    wrap: Wrap
    friction_coefficient: Friction = 0.0
    friction_memory: bool = False
    presliding: Presliding | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_presliding_alone(self.presliding, has_memory=self.friction_memory)

    @property
    def slip(self) -> float:
        """The presliding displacement [m]."""
        return self.presliding or 1e-4

    @property
    def turning(self) -> float:
        """The angle [rad] through which the cable turns in all."""
        return self.count * self.wrap


@dataclass(frozen=True, kw_only=True)
class CommonRig(Declared):
    """Parameters of the rig that all experiments of a bench share.

    Attributes
    ----------
    pulleys : Pulleys between machine and neck; None: there are none
    length : Length [m] of which reports give distances in per cent; None: they do not
    """

    pulleys: Pulleys | None = None
    length: Size | None = None


@dataclass(frozen=True, kw_only=True)
class Rig(CommonRig):
    """Nominal values of the bench in one experiment.

    Attributes
    ----------
    slack, tension_offset : Of every cable [m], [N]
    backlash : Travel [m] that the drive of every cable needs to reverse; None: there is none
    angle_offsets : Channel -> offset of its angle [rad]
    frame : The frame that positions were measured in
    """

    slack: Slack = 0.0
    backlash: Clearance | None = None
    tension_offset: TensionOffset = 0.0
    angle_offsets: Mapping[str, Angle] = field(default_factory=dict[str, float])
    frame: Frame = field(default_factory=Frame)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "angle_offsets", dict(self.angle_offsets))
