"""How SOFA is run: to rest from state to state, how many states, and for how long at most."""

from __future__ import annotations

from dataclasses import dataclass, field

STATES = 12
TIMEOUT = 1800.0  # [s], of one simulation


@dataclass(frozen=True)
class Resting:
    """How run.py runs to rest.

    ramp [s] from state to state; a state is at rest when nothing has moved faster than `speed` [m/s] for `hold` [s],
    and is given up after `longest` [s], or as soon as the speed no longer falls. time_steps [s]: with the next one a
    state is begun again that did not settle with the one before. No damping by stiffness: SOFA's is the tangent's,
    which is negative in a body pulled beyond what it would bear without its cable, and so feeds the motion.
    """

    time_steps: tuple[float, ...] = (0.05, 0.01, 0.005, 0.002)
    rayleigh_stiffness: float = 0.0
    rayleigh_mass: float = 5.0
    ramp: float = 1.0
    speed: float = 1e-6
    hold: float = 0.1
    longest: float = 60.0


@dataclass(frozen=True)
class SofaSettings:
    """How SOFA is run: `resting` from state to state; states and timeout [s] as those of `SofaEngine`."""

    resting: Resting = field(default_factory=Resting)
    states: int = STATES
    timeout: float = TIMEOUT
