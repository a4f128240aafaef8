"""What may stand in the `engines` section of a project file: how other programs compute the twin."""

from __future__ import annotations

import itertools
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from softcal.export.sofa_settings import Resting, SofaSettings
from softcal.project.section import Duration, Rate, Section, Speed, Time, at_most, counted, fault_error, listed

_SOFA = SofaSettings()
_RESTING = _SOFA.resting


def _falling(steps: tuple[float, ...]) -> tuple[float, ...]:
    for longer, shorter in itertools.pairwise(steps):
        if not shorter < longer:
            raise fault_error(
                "the next time step is tried where the one before did not settle",
                got=f"{shorter:g} s after {longer:g} s",
                allowed="each shorter than the one before",
            )
    return steps


TimeSteps = Annotated[
    tuple[Duration, ...],
    BeforeValidator(listed),
    Field(min_length=1),
    at_most("time steps to try"),
    AfterValidator(_falling),
]


class RestSection(Section):
    """When a state is at rest: nothing faster than `speed` for `hold`; it is given up after `longest`."""

    speed: Speed = _RESTING.speed
    hold: Duration = _RESTING.hold
    longest: Duration = _RESTING.longest

    @model_validator(mode="after")
    def _can_be_held(self) -> RestSection:
        if self.hold >= self.longest:
            raise fault_error(
                "the robot cannot be still for so long before it is given up",
                got=f"hold {self.hold:g} s, longest {self.longest:g} s",
                allowed="hold < longest",
            )
        return self


class SofaSection(Section):
    """How SOFA is run to rest from state to state, how many states one cable's pull has, and how long SOFA may take."""

    timeout: Duration = _SOFA.timeout
    states: Annotated[int, counted("states")] = _SOFA.states
    time_steps: TimeSteps = _RESTING.time_steps
    rayleigh_stiffness: Time = _RESTING.rayleigh_stiffness
    rayleigh_mass: Rate = _RESTING.rayleigh_mass
    ramp: Duration = _RESTING.ramp
    settle: RestSection = Field(default_factory=RestSection)

    @property
    def settings(self) -> SofaSettings:
        """As the engine takes them."""
        return SofaSettings(
            resting=Resting(
                time_steps=self.time_steps,
                rayleigh_stiffness=self.rayleigh_stiffness,
                rayleigh_mass=self.rayleigh_mass,
                ramp=self.ramp,
                speed=self.settle.speed,
                hold=self.settle.hold,
                longest=self.settle.longest,
            ),
            states=self.states,
            timeout=self.timeout,
        )


class EnginesSection(Section):
    """Settings of each engine that is not softcal's own."""

    sofa: SofaSection = Field(default_factory=SofaSection)
