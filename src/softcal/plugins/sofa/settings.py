"""Settings of SOFA's runs, under `engines` of a project file: states, their rest, time steps and timeout."""

from __future__ import annotations

import itertools
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any

from softcal.declare import Declared, Reading, listed
from softcal.errors import Fault, InputError
from softcal.limits import LIMITS
from softcal.quantities import Duration, Rate, Speed, Time

TimeSteps = Annotated[tuple[Duration, ...], LIMITS["time steps to try"].entries, Reading(listed)]


@dataclass(frozen=True)
class Rest(Declared):
    """When a state is at rest: nothing has moved faster than `speed` [m/s] for `hold` [s]; it is given up after
    `longest` [s], or as soon as the speed no longer falls.
    """

    speed: Speed = 1e-6
    hold: Duration = 0.1
    longest: Duration = 60.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hold >= self.longest:
            raise InputError(
                Fault(
                    "the time at rest must be shorter than the longest simulated time",
                    got=f"hold {self.hold:g} s, longest {self.longest:g} s",
                    allowed="hold < longest",
                )
            )


@dataclass(frozen=True)
class SofaSettings(Declared):
    """Settings of SOFA's runs.

    timeout [s]: of one simulation. states: of one driven cable, at most that many shortenings or tensions are run to
    rest. ramp [s]: from state to state. time_steps [s]: with the next one a state is begun again that did not settle
    with the one before. No damping by stiffness: SOFA's is the tangent's, which is negative in a body pulled beyond
    what it would bear without its cable, and so feeds the motion.
    """

    timeout: Duration = 1800.0
    states: Annotated[int, LIMITS["states"]] = 12
    time_steps: TimeSteps = (0.05, 0.01, 0.005, 0.002)
    rayleigh_stiffness: Time = 0.0
    rayleigh_mass: Rate = 5.0
    ramp: Duration = 1.0
    settle: Rest = field(default_factory=Rest)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.time_steps:
            raise InputError(Fault("the list has the wrong length", "time_steps", "0", "at least 1"))
        for longer, shorter in itertools.pairwise(self.time_steps):
            if not shorter < longer:
                raise InputError(
                    Fault(
                        "time steps must decrease: each is tried where the previous one did not settle",
                        "time_steps",
                        got=f"{shorter:g} s after {longer:g} s",
                        allowed="each shorter than the previous one",
                    )
                )

    @property
    def rest(self) -> dict[str, Any]:
        """Settings of run.py for running to rest, as in parameters.json."""
        own = asdict(self)
        keys = ("time_steps", "rayleigh_stiffness", "rayleigh_mass", "ramp")
        return {**{key: own[key] for key in keys}, **own["settle"]}
