"""What computes the twin: softcal itself, or another program through the same door."""

from __future__ import annotations

from softcal.calibration.problem import Simulate
from softcal.errors import Fault, ParameterError
from softcal.twin.robot import Robot

SOFTCAL, SOFA = "softcal", "sofa"
ENGINES = (SOFTCAL, SOFA)


def engine_for(name: str, robot: Robot) -> Simulate | None:
    """The simulator of an engine by its name, for a robot and others that differ from it by parameters alone; None is
    softcal's own.

    Raises
    ------
    ParameterError
        For an engine that does not exist, or cannot have the robot.
    InputError
        Where it is not installed, or lacks what it needs.
    """
    if name == SOFTCAL:
        return None
    if name == SOFA:
        from softcal.export.sofa_engine import sofa_engine

        engine = sofa_engine()
        engine.require(robot)
        return engine
    raise ParameterError(Fault("there is no such engine", "--engine", f"'{name}'", ", ".join(ENGINES)))
