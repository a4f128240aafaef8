"""Identification of equivalent Young's moduli and Poisson's ratios for linear tets in SOFA.

SOFA has only linear tetrahedra, which are too stiff, in particular as Poisson's ratio approaches 0.5. Bodies of other
elements or laws are therefore calibrated again as linear tets in SOFA's law, to the twin's response over the exported
pull. The result is not a property of the material but of the exported mesh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import make_problem
from softcal.calibration.run import calibrate
from softcal.errors import Fault, ParameterError, SimulationError
from softcal.experiments.dataset import Channel, Dataset
from softcal.plugins.sofa.robot import LinearRobot, is_its_own
from softcal.quantities import QUANTITIES
from softcal.sensing.channel import channel_name, positions
from softcal.twin.parameter_name import parameter_name
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate
from softcal.units import format_quantity

SAMPLES = 15
TRIALS = 30
NOISE = 1e-3  # of the largest change of any channel of one unit
ENOUGH = 2e-2  # of it: above this difference Poisson's ratio is identified too
LARGEST_RATIO, STARTING_RATIO = 0.49, 0.45
EXPERIMENT = "twin"
UNITS = {
    "m": (1e3, "mm"),
    "N": (1.0, "N"),
    "rad": (1.0, "rad"),
    "Pa": (1e-3, "kPa"),
    "m^3": (1e6, "ml"),
    "N*m": (1e3, "N*mm"),
}


@dataclass(frozen=True)
class Identified:
    """The robot with its bodies' parameters for linear tets; parameter -> value in the twin and in SOFA.

    differences: channel -> largest remaining difference [SI], its unit, and the channel's largest value.
    """

    linear: LinearRobot
    values: Mapping[str, tuple[float, float]]
    differences: Mapping[str, tuple[float, str, float]]

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences on the identification; empty if none was needed."""
        if not self.values:
            return ()
        names = sorted({parameter_name(name).owner for name in self.values})
        found = ", ".join(
            f"{name} {_shown(name, new)} (twin: {_shown(name, old)})" for name, (old, new) in self.values.items()
        )
        shown = {name: (value, largest, *UNITS[unit]) for name, (value, unit, largest) in self.differences.items()}
        left = ", ".join(
            f"{name} {factor * value:.3g} {unit} of {factor * largest:.4g}"
            for name, (value, largest, factor, unit) in shown.items()
        )
        return (
            f"{', '.join(names)}: SOFA has no element or law like the twin's. Exported as linear tetrahedra (P1) with "
            f"parameters re-identified on this mesh and pull: {found}. They hold for nothing else.",
            f"Largest remaining difference between the exported model and the twin: {left}.",
        )


def identify(robot: Robot, linear: LinearRobot, protocol: Protocol) -> Identified:
    """Identify the parameters of the bodies that SOFA does not support; the other bodies are unchanged.

    Parameters
    ----------
    robot
        The robot with its own laws.
    linear
        The robot with those that SOFA has.
    protocol
        Commands over which the two are compared.

    Raises
    ------
    ParameterError
        If the protocol does not move the robot.
    SimulationError
        If the protocol has no solution for either robot.
    """
    foreign = [body for body in robot.bodies if not is_its_own(body)]
    if not foreign:
        return Identified(linear, {}, {})
    thinned = protocol.thinned(SAMPLES)
    target = _simulated(robot, thinned)
    # The twin's response as a dataset: all channels that change, with noise proportional to the change.
    drives = tuple(thinned.drives)
    idle = {part.name for part in robot.actuated} - set(thinned.commands)
    places = {plate.name: plate.reference for plate in robot.plates}
    places |= {marker.name: marker.place for marker in robot.markers}
    rest = {str(part): float(x) for name, at in places.items() for part, x in zip(positions(name), at, strict=True)}
    change = {
        channel: float(np.abs(values - rest.get(channel, 0.0)).max())
        for channel, values in target.channels.items()
        if channel not in drives and channel_name(channel).carrier not in idle
    }
    largest = {unit: max((change[c] for c in change if target.units[c] == unit), default=0.0) for unit in UNITS}
    moved = {unit for unit, size in largest.items() if NOISE * size > QUANTITIES["noise"].lower}  # more than rounding
    compared = tuple(c for c in change if target.units[c] in moved and change[c] > 1e-6 * largest[target.units[c]])
    if not compared:
        raise ParameterError(
            Fault(
                "nothing moves, so the parameters for SOFA's linear tets cannot be identified",
                attempt="--pull, or element: P1 in the project",
            )
        )
    channels = {
        name: Channel(target.channels[name], target.units[name], NOISE * largest[target.units[name]])
        for name in (*compared, *drives)
    }
    experiment = Experiment(EXPERIMENT, Dataset(EXPERIMENT, channels), drive=drives, compared=compared)
    E = {body.name: body.parameters["youngs_modulus"] for body in foreign}
    moduli = [FreeParameter(f"{name}.youngs_modulus", "Pa", at / 100.0, 10.0 * at, "log") for name, at in E.items()]
    ratios = [FreeParameter(f"{body.name}.poissons_ratio", "1", 0.0, LARGEST_RATIO) for body in foreign]
    start = {f"{body.name}.poissons_ratio": min(body.parameters["poissons_ratio"], STARTING_RATIO) for body in foreign}
    there = _fitted(replace(linear, robot=with_parameters(linear.robot, start)), experiment, moduli)
    left = _differences(there, thinned, target, experiment)
    # If the modulus suffices, Poisson's ratio is kept: a single pull hardly determines it.
    worst = max(value / experiment.dataset.channels[channel].sigma for channel, (value, _, _) in left.items())
    if NOISE * worst > ENOUGH:
        there = _fitted(there, experiment, [*moduli, *ratios])
        left = _differences(there, thinned, target, experiment)
    new = {body.name: body.parameters for body in there.robot.bodies}
    values = {
        f"{body.name}.{key}": (value, float(new[body.name][key]))
        for body in foreign
        for key, value in body.parameters.items()
    }
    return Identified(there, values, left)


def _shown(name: str, value: float) -> str:
    return format_quantity(value, "Pa" if name.endswith(".youngs_modulus") else "1", digits=5)


def _fitted(linear: LinearRobot, experiment: Experiment, free: Sequence[FreeParameter]) -> LinearRobot:
    problem = make_problem(linear.robot, [experiment], free, LikelihoodLoss())
    result = calibrate(problem, method="least-squares", trials=TRIALS, starts=1)
    found = {name: estimate.value for name, estimate in result.parameters.items()}
    return replace(linear, robot=with_parameters(linear.robot, found))


def _differences(
    linear: LinearRobot, protocol: Protocol, target: Response, experiment: Experiment
) -> dict[str, tuple[float, str, float]]:
    answer = _simulated(linear.robot, protocol)
    return {
        channel: (
            float(np.abs(answer.channels[channel] - target.channels[channel]).max()),
            target.units[channel],
            float(np.abs(target.channels[channel]).max()),
        )
        for channel in experiment.compared
    }


def _simulated(robot: Robot, protocol: Protocol) -> Response:
    response = simulate(robot, protocol)
    if not response.succeeded:
        raise SimulationError(f"The parameters for SOFA cannot be identified: {response.status}")
    return response
