"""The commands of a quasi-static test: each actuator's effort or coordinate, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from softcal.arrays import Series
from softcal.checks import Floats, Ints
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import Fault, InputError, unknown
from softcal.limits import LIMITS
from softcal.sensing.channel import ChannelName, kinds
from softcal.twin.robot import Control, Robot

if TYPE_CHECKING:
    from softcal.mechanics.system import System
    from softcal.mechanics.term import Controls


@displayed
@dataclass(frozen=True)
class Command(Checked):
    """One actuator's prescribed effort or coordinate, shape (n_samples,).

    Of a cable `tension` [N, >= 0] or `shortening` [m, + = pulled], of a chamber `pressure` [Pa] or `volume` [m^3], of a
    drive `torque` [N m] or `angle` [rad].

    by: their derivatives (n_samples,) by parameters of the rig, such as a slack; where a robot remembers, a state
    depends on those of all samples before it.
    """

    control: Control
    values: Series
    by: Mapping[str, Series] = field(default_factory=dict[str, Floats])

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.values) == 0:
            raise InputError(Fault("the command has no sample", self.control, allowed="one value or more"))
        if fault := LIMITS["samples"].fault(len(self.values), self.control):
            raise InputError(fault)


@displayed
@dataclass(frozen=True)
class Protocol(Checked):
    """Commands by the actuators' names, all of one length. One that is not named has no effort: a cable is slack, a
    chamber is open. A cable that has a pretension stays at zero shortening, a drive of such cables at the angle zero.

    Samples are quasi-static states; where the robot is elastic, their order and repetition do not matter. Where a term
    has a memory (see `softcal.mechanics.memory`) they are a load path from rest, solved in their order. Along
    cables whose friction has no memory, each sample is the state reached by pulling from rest, without any release.

    At snap-through a single driven cable is assumed to be pulled monotonically; several cables follow the sample order.

    times: of the samples (n_samples,) [s], ascending, which materials need that relax or flow; before the first one the
    robot was at rest for long. None: each sample is held for long.
    """

    commands: Mapping[str, Command]
    times: Series | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.times is not None and (fault := times_fault(self.times, self.n_samples)):
            raise InputError(fault)
        lengths = {len(command.values) for command in self.commands.values()}
        if len(lengths) > 1:
            raise InputError(Fault("the commands of a protocol have different lengths", got=str(sorted(lengths))))

    @property
    def drives(self) -> dict[str, str]:
        """The name of each command as a channel, such as `front.tension`, and its actuator."""
        of = kinds()
        return {str(ChannelName(of[command.control], name)): name for name, command in self.commands.items()}

    @property
    def driven(self) -> list[str]:
        """The actuators whose commands do more than leave them without effort."""
        of = kinds()
        each = self.commands.items()
        return [n for n, one in each if of[one.control].drives == "coordinate" or np.any(one.values != 0.0)]

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters by which a command has derivatives."""
        return tuple(dict.fromkeys(name for command in self.commands.values() for name in command.by))

    def rates(self, i: int, actuators: Sequence[str], names: Sequence[str]) -> Floats:
        """Derivatives of the commands at a sample by parameters: (n_actuators, n_names).

        Parameters
        ----------
        i
            Number of the sample, from 0.
        actuators
            Names of the actuators.
        names
            Dotted names of the parameters.
        """
        none = Command("tension", np.zeros(1))
        own = [self.commands.get(name, none).by for name in actuators]
        return np.array([[by[name][i] if name in by else 0.0 for name in names] for by in own]).reshape(len(own), -1)

    @property
    def n_samples(self) -> int:
        return max((len(command.values) for command in self.commands.values()), default=1)

    def at(self, i: int) -> dict[str, float]:
        """The commands' values at a sample, counted from 0."""
        return {name: float(command.values[i]) for name, command in self.commands.items()}

    def take(self, rows: Ints) -> Protocol:
        """Some of its samples, by their numbers from 0."""
        return Protocol(
            {
                name: Command(one.control, one.values[rows], {key: rate[rows] for key, rate in one.by.items()})
                for name, one in self.commands.items()
            },
            None if self.times is None else self.times[rows],
        )

    def elapsed(self, i: int) -> float:
        """Time [s] from the sample before to this one, counted from 0; of the first as of the second."""
        if self.times is None or self.n_samples < 2:
            return np.inf
        return float(self.times[max(i, 1)] - self.times[max(i, 1) - 1])

    def completed(self, robot: Robot, n: int | None = None) -> Protocol:
        """The protocol with zero coordinates, as of cables, for actuators with a pretension and no command.

        n: the number of samples, where there are no commands to tell it.
        """
        none = np.zeros(n or self.n_samples)
        held = [part for part in robot.pretensioned if part.name not in self.commands]
        still = {part.name: Command(part.channels[0].name, none) for part in held}
        return replace(self, commands={**self.commands, **still}) if still else self

    def thinned(self, most: int) -> Protocol:
        """At most so many of its samples, evenly spaced, with the first and the last."""
        n = self.n_samples
        return self.take(np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int)))


def times_fault(times: Floats, n: int) -> Fault | None:
    """The fault of the times [s] of n samples, which ascend; or None."""
    if len(times) != n:
        got, allowed = f"{len(times)} times", f"{n}, one for each sample"
        return Fault("the times of a protocol are not those of its samples", "times", got, allowed)
    if not (np.diff(times) >= 0.0).all():
        k = int(np.argmax(np.diff(times) < 0.0))
        got = f"{times[k + 1]:.6g} s after {times[k]:.6g} s"
        return Fault("the times of a protocol do not ascend", "times", got)
    return None


def controls_at(
    system: System, commands: Mapping[str, Command], values: Mapping[str, float], coordinate: Floats
) -> Controls:
    """The controls at values of the commands, by actuator. An actuator without a command has no effort.

    Parameters
    ----------
    system
        The discretised robot.
    commands
        Actuator -> its command.
    values
        Actuator -> the value of its command [SI].
    coordinate
        Coordinates (n_actuators,) of those that are not commanded by it, each in its own unit.
    """
    from softcal.mechanics.term import Controls

    is_held, effort, coordinate = np.ones(len(coordinate), dtype=bool), np.zeros_like(coordinate), coordinate.copy()
    for k, actuator in enumerate(system.actuators):
        if actuator.name not in commands:
            continue
        if commands[actuator.name].control == actuator.coordinate:
            is_held[k], coordinate[k] = False, values[actuator.name]
        else:
            effort[k] = values[actuator.name]
        if (led := system.followers.get(actuator.name)) is not None:
            is_held[led], coordinate[led] = False, 0.0
    return Controls(is_held, effort, coordinate)


def furthest_state(protocol: Protocol) -> Protocol:
    """The one sample of a protocol whose commands are furthest from none, each measured by its own largest."""
    pulls = np.zeros(protocol.n_samples)
    for command in protocol.commands.values():
        pulls += np.abs(command.values) / max(float(np.abs(command.values).max()), 1e-300)
    return protocol.take(np.array([np.argmax(pulls)]))


LET_GO = 0.02  # of the range: a smaller decrease is noise of a machine that pulls


def lets_go(values: Floats) -> bool:
    """Whether a command that increases, sample by sample, is reduced again."""
    return bool(np.max(np.maximum.accumulate(values) - values) > LET_GO * np.ptp(values))


def let_go_faults(robot: Robot, protocol: Protocol) -> list[Fault]:
    """The fault of a single driven cable with friction that is pulled and released again: its friction would reverse.

    The samples of several driven cables are independent states, each reached from rest.
    """
    driven = {name: command for name, command in protocol.commands.items() if np.any(command.values != 0.0)}
    rough = {c.name for c in robot.cables if c.friction_coefficient > 0.0 and not c.line.friction_memory}
    if len(driven) != 1:
        return []
    return [
        let_go_fault("", name, f"a {command.control} that rises and falls")
        for name, command in driven.items()
        if name in rough and lets_go(command.values)
    ]


def let_go_fault(where: str, cable: str, got: str) -> Fault:
    """The fault of a test that releases a cable with friction.

    Parameters
    ----------
    where
        The test.
    cable
        Name of the cable.
    got
        What the test has.
    """
    return Fault(
        f"the friction of {cable} is modelled for a cable that is pulled in: it reverses where the cable is released",
        where=where,
        got=got,
        allowed="the loading branch only",
        attempt=f"take_branch: loading, or {cable}.friction_coefficient: 0",
    )


def command_faults(robot: Robot, protocol: Protocol) -> list[Fault]:
    """Commands that no actuator of the robot can follow: an unknown name, a push of a cable, a value out of range."""
    parts, faults = {part.name: part for part in robot.actuated}, list[Fault]()
    what = f"there is no such {robot.actuator_word}"
    for name, command in protocol.commands.items():
        if name not in parts:
            faults.append(unknown(what, name, name, parts, got=""))
        elif name in robot.led:
            what_to, by = f"command {robot.led[name]}", f"{robot.led[name]} drives it"
            faults.append(Fault("this cable has no command of its own", name, by, attempt=what_to))
        elif fault := parts[name].command_fault(command.control, command.values):
            faults.append(fault)
    return faults
