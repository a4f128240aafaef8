"""The commands of a motion over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.arrays import Series
from softcal.declare import Checked, checked_arguments
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.quantities import Duration
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Control, Robot


@displayed
@dataclass(frozen=True)
class Schedule(Checked):
    """Commands by actuator over time: values at `times` (n,) [s], from 0 on and ascending; linear in between, then
    constant.

    An actuator that is not named has no effort, or stays at zero shortening where it has a pretension.
    """

    times: Series
    commands: Mapping[str, Command]

    def __post_init__(self) -> None:
        super().__post_init__()
        times = self.times
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

    def completed(self, robot: Robot) -> Schedule:
        """The schedule with zero shortening for cables that have a pretension and no command."""
        return Schedule(self.times, Protocol(self.commands).completed(robot, len(self.times)).commands)

    def held(self, duration: float) -> Schedule:
        """The schedule with its last commands kept for another time [s]."""
        held = {n: Command(c.control, np.append(c.values, c.values[-1])) for n, c in self.commands.items()}
        return Schedule(np.append(self.times, self.times[-1] + duration), held)


@checked_arguments
def ramp(targets: Mapping[str, tuple[Control, float]], duration: Duration) -> Schedule:
    """From zero to each actuator's target, such as {"front": ("tension", 5.0)}, at a constant rate [duration in s].

    Raises
    ------
    InputError
        For a control or number that makes no sense.
    """
    commands = {name: Command(control, np.array([0.0, value])) for name, (control, value) in targets.items()}
    return Schedule(np.array([0.0, duration]), commands)
