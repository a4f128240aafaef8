"""Pulls on the command line: `front=40mm`, `cable6=2kgf`, `cable6.mass=2kg`; several together are one protocol."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softcal.errors import Fault, InputError, UnitError
from softcal.quantities import QUANTITIES
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Control, Robot
from softcal.workflows.simulation import pull

HANGING = ".mass"  # suffix of a cable's name: the value is a hanging mass


def parse_pulls(robot: Robot, texts: Sequence[str]) -> Protocol:
    """Cables pulled together, each evenly from zero to its value: a shortening, a tension, or a hanging mass.

    Raises
    ------
    InputError
        For a text that is no pull, a cable that does not exist or is pulled twice, a mass without gravity; all at once.
    """
    commands = dict(Protocol({}).commands)
    faults: list[Fault] = []
    for text in texts:
        try:
            cable, control, end = _parsed(robot, text)
            if cable in commands:
                raise InputError(Fault("the cable is pulled twice", "--pull", f"'{text}'", "one pull for each cable"))
            commands |= pull(robot, cable, control, end).commands
        except InputError as error:
            faults.extend(fault if fault.where else replace(fault, where="--pull") for fault in error.faults)
    if faults:
        raise InputError(faults)
    return Protocol(commands)


def _parsed(robot: Robot, text: str) -> tuple[str, Control, float]:
    name, _, value = (part.strip() for part in text.partition("="))
    if name.endswith(HANGING):
        return name.removesuffix(HANGING), "tension", _weight(robot, text, value)
    try:
        return name, "shortening", QUANTITIES["shortening"].read(value)
    except UnitError:
        pass
    try:
        return name, "tension", QUANTITIES["tension"].read(value)
    except UnitError as error:
        allowed = f"a cable and a length or force: front=40mm, front=8N, front=2kgf; a mass hangs by front{HANGING}=2kg"
        raise InputError(Fault("this is not a pull", "--pull", f"'{text}'", allowed)) from error


def _weight(robot: Robot, text: str, value: str) -> float:
    """Weight [N] of a mass under the robot's gravity."""
    mass = QUANTITIES["mass"].read(value, where=f"--pull {text}")
    gravity = float(np.linalg.norm(robot.gravity))
    if gravity == 0.0:
        raise InputError(
            Fault(
                "a hanging mass needs gravity",
                "--pull",
                f"'{text}'",
                "gravity in the robot, or a force",
                f"{text.partition(HANGING)[0]}={value.replace('kg', 'kgf')}" if "kg" in value else "a force in N",
            )
        )
    return mass * gravity
