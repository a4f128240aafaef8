"""Check that the twin can follow the bench: with the values of the project file, and with those fixed from outside."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.friction import friction_faults
from softcal.calibration.problem.observation import protocol_told, slack_faults
from softcal.errors import Fault
from softcal.project.document import Findings, dotted
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import command_faults
from softcal.twin.robot import Robot


def check_test(
    robot: Robot, experiment: Experiment, free: Collection[str], held: Mapping[str, float], findings: Findings
) -> list[Fault]:
    """Check that the twin can follow the commands of a test. Faults of the file's values go to `findings`, those of
    fixed values are returned.

    Parameters
    ----------
    robot
        The robot.
    experiment
        The experiment.
    free
        Parameters that are fitted to the test.
    held
        Fixed values [SI] by parameter; they replace the file's, and so may be at fault themselves.
    findings
        Collects the faults and warnings.
    """
    place = ("experiments", experiment.name)
    written, of_fixed = _faults(robot, experiment, free, {}), list[Fault]()
    for key, fault in _faults(robot, experiment, free, held).items():
        part = "" if fault.where == experiment.name else f": {fault.where}"
        if key in written:
            where = findings.document.where(place) + part
            unit = experiment.dataset.unit_read(experiment.drives)
            attempt = fault.attempt or f"check {unit}, the units of the via points, and the slack"
            findings.faults.append(replace(fault, where=where, attempt=attempt))
            continue
        others = {name: {n: v for n, v in held.items() if n != name} for name in held}
        guilty = [name for name in held if key not in _faults(robot, experiment, free, others[name])] or list(held)
        where = f"{', '.join(guilty)}: {dotted(place)}{part}"
        of_fixed.append(replace(fault, where=where, attempt=fault.attempt or "another value, or unit"))
    return of_fixed


def held_robot(robot: Robot, held: Mapping[str, float]) -> Robot:
    """The robot with fixed values of parameters in place of its own values."""
    of_robot = robot_parameters(robot)
    return with_parameters(robot, {name: value for name, value in held.items() if name in of_robot})


def held_rig(experiment: Experiment, held: Mapping[str, float]) -> Experiment:
    """The experiment with fixed values of the rig in place of its own."""
    own = {name: held[name] for name in experiment.rig_values() if name in held}
    return replace(experiment, settings={**experiment.settings, **own})


def _faults(
    robot: Robot, experiment: Experiment, free: Collection[str], held: Mapping[str, float]
) -> dict[tuple[str, str], Fault]:
    """Faults of the commands under the fixed values, by their text and place."""
    robot, experiment = held_robot(robot, held), held_rig(experiment, held)
    faults = friction_faults(robot, experiment, free)
    if not faults:  # commands may depend on the friction
        protocol = protocol_told(robot, experiment, experiment.rig_values())
        faults = [*slack_faults(experiment), *command_faults(robot, protocol)]
    return {(fault.what, fault.where): fault for fault in faults}
