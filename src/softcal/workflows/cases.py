"""Cases to simulate: pulls of the user, or experiments with the robot's settings in each.

On the command line a pull is `front=40mm`, `cable6=2kgf` or `cable6.mass=2kg`; several together are one protocol.
`films` divides a protocol into even steps, for an animation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from softcal.errors import Fault, InputError, ParameterError, UnitError
from softcal.experiments.read import read_channels
from softcal.limits import LIMITS
from softcal.project.project import Project
from softcal.quantities import QUANTITIES
from softcal.sensing.channel import TIME
from softcal.twin.channels import channels_of, sensors_of
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Control, Robot
from softcal.units import readable_unit
from softcal.workflows.simulation import protocol_of, pull, robot_in

PULL, COMMANDS = "pull", "commands"
HANGING = ".mass"  # suffix of a cable's name: the value is a hanging mass
SAME = 1e-9  # of the furthest command


@dataclass(frozen=True)
class Case:
    """A robot and its protocol. experiment: name of the experiment, "" for a pull."""

    robot: Robot
    protocol: Protocol
    experiment: str = ""


def cases(
    project: Project, pulls: Sequence[str] = (), experiment: str = "", commands: Path | None = None
) -> dict[str, Case]:
    """Name -> case: the commands of a table, all pulls together, else the named experiment, else every experiment.

    Parameters
    ----------
    project
        The project.
    pulls
        Pulls as on the command line, `front=40mm`: one case of all.
    experiment
        Name of the only case; by default every experiment.
    commands
        A table with a column for each actuator, such as `front.tension [N]`, and one of the times, or none.

    Raises
    ------
    InputError
        For a text that is no pull, or an unknown experiment; if there is neither an experiment nor a pull.
    """
    if commands is not None:
        return {COMMANDS: Case(project.robot, commanded(project.robot, commands))}
    if pulls:
        return {PULL: Case(project.robot, parse_pulls(project.robot, pulls))}
    names = [experiment] if experiment else list(project.experiments) or [""]
    return {name: Case(robot_in(project, name), protocol_of(project, name), name) for name in names}


def commanded(robot: Robot, table: Path) -> Protocol:
    """The protocol of a table of commands.

    Raises
    ------
    InputError
        For a table that cannot be read, a column that is no command, or two of one actuator.
    """
    channels = [channel for channel in channels_of(sensors_of(robot)) if channel.kind.drives]
    read = read_channels(table, [str(channel) for channel in channels])
    given = [channel for channel in channels if str(channel) in read.channels]
    twice = {one.carrier for one in given if sum(other.carrier == one.carrier for other in given) > 1}
    parts = {part.name: part for part in robot.actuated}
    faults = [
        Fault(f"the {parts[name].kind} has two commands", str(table), name, " or ".join([*parts[name].controls][::-1]))
        for name in sorted(twice)
    ]
    if not given:
        faults.append(Fault("there is no command", str(table), allowed=", ".join(map(str, channels))))
    if faults:
        raise InputError(faults)
    named = {one.carrier: Command(one.kind.name, read.values(str(one))) for one in given}  # pyright: ignore[reportArgumentType]
    return Protocol(named, read.values(TIME.name) if TIME.name in read.channels else None)


def protocols_of(chosen: Mapping[str, Case]) -> dict[str, Protocol]:
    """Name -> protocol of each case."""
    return {name: case.protocol for name, case in chosen.items()}


def parse_pulls(robot: Robot, texts: Sequence[str], option: str = "--pull") -> Protocol:
    """Actuators driven together, each evenly from zero to its value: a coordinate, an effort, or a hanging mass.

    Parameters
    ----------
    robot
        The robot.
    texts
        One for each actuator, such as `front=40mm`.
    option
        The option that they are of.

    Raises
    ------
    InputError
        For a text that is no pull, an actuator that does not exist or is driven twice, a mass without gravity; all
        at once.
    """
    commands = dict(Protocol({}).commands)
    nouns = {part.name: part.kind for part in robot.actuated}
    faults: list[Fault] = []
    for text in texts:
        try:
            name, control, end = _parsed(robot, text, option)
            if name in commands:
                noun = nouns[name]
                raise InputError(Fault(f"the {noun} is pulled twice", option, f"'{text}'", f"one pull for each {noun}"))
            commands |= pull(robot, name, control, end).commands
        except InputError as error:
            faults.extend(fault if fault.where else replace(fault, where=option) for fault in error.faults)
    if faults:
        raise InputError(faults)
    return Protocol(commands)


def _parsed(robot: Robot, text: str, option: str) -> tuple[str, Control, float]:
    name, _, value = (part.strip() for part in text.partition("="))
    if name.endswith(HANGING):
        hung = next((part for part in robot.actuators if part.name == name.removesuffix(HANGING)), None)
        if hung is not None:
            what, allowed = f"a mass hangs from a cable, and this is a {hung.kind}", " or ".join([*hung.controls][::-1])
            raise InputError(Fault(what, option, f"'{text}'", allowed))
        mass = QUANTITIES["mass"].read(value, where=f"{option} {text}")
        gravity = float(np.linalg.norm(robot.gravity))
        if gravity == 0.0:
            what, allowed = "a hanging mass needs gravity", "gravity in the robot, or a force"
            instead = f"{text.partition(HANGING)[0]}={value.replace('kg', 'kgf')}" if "kg" in value else "a force in N"
            raise InputError(Fault(what, option, f"'{text}'", allowed, instead))
        return name.removesuffix(HANGING), "tension", mass * gravity
    every = {control: quantity for part in robot.actuated for control, quantity in part.controls.items()}
    every = {control: QUANTITIES[control] for control in ("shortening", "tension")} | every
    controls = next((part.controls for part in robot.actuated if part.name == name), every)
    for control, quantity in controls.items():
        try:
            return name, control, quantity.read(value)
        except UnitError:
            continue
    # One of each kind that the robot has, by the name of its first.
    examples: list[str] = []
    for noun, part in {part.kind: part for part in robot.commandable[::-1]}.items():
        coordinate, effort = part.channels
        if part in robot.cables:
            units, more = "length or force", f"=2kgf; a mass hangs by {part.name}{HANGING}=2kg"
            examples.insert(0, f"a {noun} and a {units}: {part.name}=40mm, {part.name}=8N, {part.name}{more}")
        else:
            units = f"{part.name}=1{effort.unit}, {part.name}=1{readable_unit(0.0, coordinate.unit)}"
            examples.append(f"a {noun} and a {effort.name} or {coordinate.name}: {units}")
    allowed = "; ".join(examples) or "an actuator, of which the robot has none"
    raise InputError(Fault("this is not a pull", option, f"'{text}'", allowed))


def films(protocols: Mapping[str, Protocol], n: int) -> dict[str, Protocol]:
    """Each protocol as n even steps from no pull to its furthest sample; one state if nothing is pulled.

    Raises
    ------
    InputError
        For too few steps or too many.
    ParameterError
        If no protocol drives an actuator; for samples whose commands are not proportional to each other.
    """
    LIMITS["shapes of a film"].check(n, where="--shapes")
    films_by_name: dict[str, Protocol] = {}
    faults: list[Fault] = []
    for name, protocol in protocols.items():
        commands = np.array([command.values for command in protocol.commands.values()])
        end = commands[:, int((commands**2).sum(axis=0).argmax())] if len(commands) else commands
        if not end.any():
            films_by_name[name] = Protocol({})
        elif np.abs(commands - np.outer(end, end @ commands / (end @ end))).max() > SAME * np.abs(end).max():
            problem = "the actuators' commands are not proportional: the samples are states, not one pull"
            faults.append(Fault(problem, name, attempt="--pull, or without --shapes, which writes every state"))
        else:
            share = np.linspace(0.0, 1.0, n)
            pulls = zip(protocol.commands.items(), end, strict=True)
            steps = {actuator: Command(command.control, value * share) for (actuator, command), value in pulls}
            films_by_name[name] = Protocol(steps)
    if not faults and not any(protocol.commands for protocol in films_by_name.values()):
        faults.append(Fault("nothing is pulled", "--shapes", attempt="--pull"))
    if faults:
        raise ParameterError(faults)
    return films_by_name
