"""What is done to the robot over time, and how its motion is computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from softcal.checks import Floats, frozen_floats
from softcal.errors import Fault, InputError
from softcal.mechanics.damping import Damping, DampingKind
from softcal.mechanics.dynamics import Scheme
from softcal.twin.masses import MassMatrix
from softcal.twin.protocol import Command
from softcal.twin.robot import Control


@dataclass(frozen=True)
class Schedule:
    """Commands by cable over time: values at `times` (n,) [s], from 0 on and ascending; straight between, then held.

    A cable that is not named is slack.
    """

    times: Floats
    commands: Mapping[str, Command]

    def __post_init__(self) -> None:
        times = frozen_floats(self.times, name="times", shape=(None,))
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "commands", dict(self.commands))
        faults: list[Fault] = []
        if len(times) == 0 or times[0] != 0.0 or not (np.diff(times) > 0.0).all():
            shown = ", ".join(f"{t:.6g}" for t in times[:6]) + (" …" if len(times) > 6 else "")
            faults.append(Fault("the times of a schedule do not ascend from 0", got=shown or "none"))
        faults += [
            Fault("a command has not one value per time", name, str(len(command.values)), str(len(times)))
            for name, command in self.commands.items()
            if len(command.values) != len(times)
        ]
        if faults:
            raise InputError(faults)

    def at(self, time: float) -> dict[str, float]:
        """The commands' values at a time."""
        return {name: float(np.interp(time, self.times, c.values)) for name, c in self.commands.items()}


def ramp(targets: Mapping[str, tuple[Control, float]], duration: float) -> Schedule:
    """From nothing to each cable's target, such as {"front": ("tension", 5.0)}, at a constant rate [duration in s]."""
    commands = {name: Command(control, np.array([0.0, value])) for name, (control, value) in targets.items()}
    return Schedule(np.array([0.0, duration]), commands)


@dataclass(frozen=True)
class Settling:
    """When a robot has come to rest, after its schedule: nothing faster than `speed` [m/s] for `hold` [s].

    on: the plate or marker that is watched; "" watches every point. longest: time [s] after the schedule to give up.
    """

    speed: float = 1e-6
    hold: float = 0.1
    longest: float = 60.0
    on: str = ""

    def __post_init__(self) -> None:
        _check_positive("settling", {"speed": self.speed, "longest": self.longest})


@dataclass(frozen=True)
class TimeSettings:
    """How motion is computed.

    time_step [s]; rayleigh_stiffness [s] and rayleigh_mass [1/s]: damping, paper A's by default.
    scheme: `converged` solves each step by Newton's method; `one-solve` takes its first iteration, as SOFA does.
    damping of bodies: on the `strain`, or with the `tangent` of their forces, which is SOFA's and gives energy to a
    body that is pressed beyond its own buckling load; by default the first in converged steps, else the second.
    masses: `consistent` or `lumped`, of bodies. start: at equilibrium under the dead loads, or at rest without them.
    until_settled: go on after the schedule until nothing moves.
    """

    time_step: float = 0.01
    rayleigh_stiffness: float = 0.2
    rayleigh_mass: float = 0.1
    scheme: Scheme = "converged"
    damping: DampingKind | None = None
    masses: MassMatrix = "consistent"
    start: Literal["equilibrium", "undeformed"] = "equilibrium"
    until_settled: Settling | None = None

    def __post_init__(self) -> None:
        _check_positive("time settings", {"time_step": self.time_step})
        for key in ("rayleigh_stiffness", "rayleigh_mass"):
            if not 0.0 <= getattr(self, key) < np.inf:
                raise InputError(Fault("damping is out of range", key, f"{getattr(self, key):g}", ">= 0"))

    @property
    def rayleigh(self) -> Damping:
        """The damping."""
        kind = self.damping or ("tangent" if self.scheme == "one-solve" else "strain")
        return Damping(self.rayleigh_stiffness, self.rayleigh_mass, kind)


def _check_positive(where: str, values: Mapping[str, float]) -> None:
    faults = [
        Fault(f"{key} must be positive", where, f"{value:g}", "> 0")
        for key, value in values.items()
        if not 0.0 < value < np.inf
    ]
    if faults:
        raise InputError(faults)
