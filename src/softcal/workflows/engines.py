"""The engine that computes the twin: softcal itself, or another program through the same interface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from softcal.calibration.problem.problem import SOFTCAL, Simulate
from softcal.declare import Declared
from softcal.errors import ParameterError
from softcal.twin.robot import Robot

# How long one waits is a matter of the machine: a run goes on with another timeout.
OF_THE_MACHINE = ("timeout",)


def engine_for(name: str, robot: Robot, settings: Mapping[str, Declared]) -> Simulate | None:
    """The simulator of an engine for a robot; None is softcal's own.

    Parameters
    ----------
    name
        Name of the engine.
    robot
        The robot, or one that differs from it by values of parameters alone.
    settings
        Engine -> its settings, by the project's `engines`.

    Raises
    ------
    ParameterError
        For an engine that does not exist, or cannot have the robot.
    InputError
        Where it is not installed, or lacks what it needs.
    """
    if name == SOFTCAL:
        return None
    from softcal.export.engine import ENGINES, engine_settings

    simulators = {one: engine.simulator for one, engine in ENGINES.items() if engine.simulator is not None}
    if name not in simulators:
        raise ParameterError(ENGINES.unknown(name, "--engine", [SOFTCAL, *simulators]))
    return simulators[name](engine_settings(name, settings), robot)


def left_out_sentence(name: str, robot: Robot) -> str:
    """A sentence on contact of a robot that the engine leaves out, or ""."""
    if name == SOFTCAL:
        return ""
    from softcal.export.engine import ENGINES, left_out_by

    return left_out_by(name) if ENGINES[name].leaves_out_contact(robot) else ""


def engine_identity(name: str, settings: Mapping[str, Declared]) -> dict[str, str]:
    """Settings of the engine behind a run's results, by key of the project file, SI; empty for softcal itself."""
    if name == SOFTCAL:
        return {}
    from softcal.export.engine import engine_settings

    stated = engine_settings(name, settings)
    own = {} if stated is None else {key: v for key, v in asdict(stated).items() if key not in OF_THE_MACHINE}
    return {"engine": name, **_flat(f"engines.{name}", own)}


def _flat(prefix: str, values: Mapping[str, Any]) -> dict[str, str]:
    texts: dict[str, str] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            texts |= _flat(f"{prefix}.{key}", value)
        else:
            several = value if isinstance(value, tuple) else (value,)
            texts[f"{prefix}.{key}"] = ", ".join(f"{one:.12g}" for one in several)
    return texts
