"""The inverse problem: theta in, residuals and loss out. It knows no optimiser.

Experiments that pull the same cable in the same way on a robot of the same parameters share one trajectory: the twin is
elastic, so the states of the 20, 40 and 60 mm tests are points of one curve, even when each test has its own slack.
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol as TypingProtocol

import numpy as np

from softcal.calibration.experiment import Experiment, Observation, command, observe, rig_parameters
from softcal.calibration.loss import Block, Loss, PapersLoss, by_experiment, gradient, require, total
from softcal.calibration.parameters import FreeParameter, SearchSpace, search_space
from softcal.checks import Floats
from softcal.errors import Fault, InputError, ParameterError, SimulationError
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot


class Simulate(TypingProtocol):
    """The twin: `softcal.twin.simulate.simulate`, or a stand-in with its signature."""

    def __call__(
        self, robot: Robot, protocol: Protocol, *, sensitivities: Sequence[str] = (), snapshots: bool = False
    ) -> Response: ...


@dataclass(frozen=True)
class Evaluation:
    """What came of one theta [SI by label].

    loss None and failure a sentence where the twin could not be simulated. blocks: residuals (and jacobians);
    observations by experiment; gradient: d loss / d theta, or None. n_solves: forward trajectories.
    """

    theta: Mapping[str, float]
    loss: float | None
    failure: str
    blocks: tuple[Block, ...]
    observations: Mapping[str, Observation]
    experiment_losses: Mapping[str, float]
    gradient: Floats | None
    n_solves: int
    n_factorisations: int
    seconds: float


@dataclass(frozen=True)
class Problem:
    """A robot, the experiments it was put through, what is free, and the loss.

    Raises
    ------
    InputError
        For two experiments of one name, a cable or plate that the robot does not have, a free parameter of no effect,
        a prior that the loss does not count, or a channel that the loss cannot judge.
    """

    robot: Robot
    experiments: tuple[Experiment, ...]
    space: SearchSpace
    loss: Loss
    simulate: Simulate | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "experiments", tuple(self.experiments))
        faults = [*_part_faults(self.robot, self.experiments), *self._space_faults()]
        if faults:
            raise InputError(faults)
        require(self.loss, self.experiments)

    def alone(self, experiment: str) -> Problem:
        """The problem of one experiment by itself."""
        chosen = tuple(e for e in self.experiments if e.name == experiment)
        return Problem(self.robot, chosen, self.space.restricted(experiment), self.loss, self.simulate)

    def evaluate(self, theta: Mapping[str, float], *, jacobian: bool = False) -> Evaluation:
        """Simulate every experiment at theta [SI by label] and judge it. A failed simulation is a value, not an error.

        Raises
        ------
        InputError
            Where a value is outside what its parameter may be.
        """
        began = time.perf_counter()
        observations: dict[str, Observation] = {}
        n_solves = n_factorisations = 0
        for group in self._trajectories(theta):
            response = self._simulate(group, jacobian)
            n_solves += 1
            n_factorisations += response.n_factorisations
            failure = _failure(response, group)
            if failure:
                seconds = time.perf_counter() - began
                return Evaluation(dict(theta), None, failure, (), {}, {}, None, n_solves, n_factorisations, seconds)
            for experiment, samples in group.samples():
                names = {p.name for p in self.space.parameters} if jacobian else ()
                rig = self._rig(experiment, theta)
                observations[experiment.name] = observe(experiment, rig, response, samples, names)
        return self.judge(theta, observations, n_solves, n_factorisations, time.perf_counter() - began)

    def judge(
        self,
        theta: Mapping[str, float],
        observations: Mapping[str, Observation],
        n_solves: int,
        n_factorisations: int,
        seconds: float,
    ) -> Evaluation:
        """The evaluation that follows from observations made at theta."""
        blocks = (*self._blocks(observations), *self._priors(theta))
        with_jacobian = all(block.jacobian is not None for block in blocks)
        return Evaluation(
            theta=dict(theta),
            loss=total(self.loss, blocks),
            failure="",
            blocks=blocks,
            observations=dict(observations),
            experiment_losses=by_experiment(self.loss, blocks),
            gradient=gradient(self.loss, blocks) if with_jacobian else None,
            n_solves=n_solves,
            n_factorisations=n_factorisations,
            seconds=seconds,
        )

    def _space_faults(self) -> list[Fault]:
        known = {**robot_parameters(self.robot), **rig_parameters(self.experiments)}
        names = {experiment.name for experiment in self.experiments}
        faults = [
            Fault("the parameter belongs to no experiment of the problem", p.label, allowed=", ".join(sorted(names)))
            for p in self.space.parameters
            if p.experiment and p.experiment not in names
        ]
        if not self.loss.uses_priors:
            faults += [
                Fault(
                    f"the loss '{self.loss.name}' counts no prior",
                    p.label,
                    attempt="the loss 'likelihood', or no prior",
                )
                for p in self.space.parameters
                if p.prior_sd is not None
            ]
        try:
            search_space(self.space.parameters, (), known)
        except ParameterError as error:
            faults += error.faults
        return faults

    def _rig(self, experiment: Experiment, theta: Mapping[str, float]) -> dict[str, float]:
        return {**experiment.rig_values(), **self.space.values_for(experiment.name, theta)}

    def _trajectories(self, theta: Mapping[str, float]) -> list[_Trajectory]:
        known = robot_parameters(self.robot)
        groups: dict[tuple[object, ...], list[tuple[Experiment, Command]]] = {}
        robots: dict[tuple[object, ...], dict[str, float]] = {}
        for experiment in self.experiments:
            values = self.space.values_for(experiment.name, theta)
            of_robot = {name: value for name, value in values.items() if name in known}
            key = (experiment.cable, experiment.drive, tuple(sorted(of_robot.items())))
            robots[key] = of_robot
            groups.setdefault(key, []).append((experiment, command(experiment, self._rig(experiment, theta))))
        return [
            _Trajectory(with_parameters(self.robot, robots[key]), tuple(members)) for key, members in groups.items()
        ]

    def _simulate(self, group: _Trajectory, jacobian: bool) -> Response:
        simulate = self.simulate or _real_simulate()
        known = robot_parameters(self.robot)
        names = list(dict.fromkeys(p.name for p in self.space.parameters if p.name in known)) if jacobian else []
        try:
            return simulate(group.robot, group.protocol(), sensitivities=names)
        except SimulationError as error:
            return Response({}, {}, str(error), succeeded=False, n_factorisations=0)

    def _blocks(self, observations: Mapping[str, Observation]) -> list[Block]:
        blocks: list[Block] = []
        for experiment in self.experiments:
            seen = observations[experiment.name]
            for channel in experiment.compared:
                held = experiment.dataset.channels[channel]
                blocks.append(
                    Block(
                        experiment.name,
                        channel,
                        held.values,
                        seen.predicted[channel] - held.values,
                        held.sigma,
                        self._columns(experiment.name, seen.derivatives.get(channel, {}), len(held.values)),
                    )
                )
        return blocks

    def _columns(self, experiment: str, derivatives: Mapping[str, Floats], n_samples: int) -> Floats | None:
        if not derivatives:
            return None
        zeros = np.zeros(n_samples)
        return np.column_stack(
            [
                derivatives.get(p.name, zeros) if p.experiment in ("", experiment) else zeros
                for p in self.space.parameters
            ]
        )

    def _priors(self, theta: Mapping[str, float]) -> list[Block]:
        return [
            Block(
                "",
                f"prior of {p.label}",
                np.array([p.prior_mean]),
                np.array([theta[p.label] - p.prior_mean]),
                p.prior_sd,
                np.eye(self.space.size)[i : i + 1],
            )
            for i, p in enumerate(self.space.parameters)
            if p.prior_mean is not None and p.prior_sd is not None
        ]


def make_problem(
    robot: Robot,
    experiments: Sequence[Experiment],
    parameters: Sequence[FreeParameter],
    loss: Loss | None = None,
    simulate: Simulate | None = None,
) -> Problem:
    """A problem from free parameters as a user gives them; the loss is the papers' unless given.

    Raises
    ------
    InputError
        As `search_space` and `Problem`.
    """
    known = {**robot_parameters(robot), **rig_parameters(experiments)}
    space = search_space(parameters, [experiment.name for experiment in experiments], known)
    return Problem(robot, tuple(experiments), space, loss or PapersLoss(), simulate)


@dataclass(frozen=True)
class _Trajectory:
    """One forward solve that serves several experiments."""

    robot: Robot
    members: tuple[tuple[Experiment, Command], ...]

    def protocol(self) -> Protocol:
        first = self.members[0]
        values = np.concatenate([told.values for _, told in self.members])
        return Protocol({first[0].cable: Command(first[0].drive, values)})

    def samples(self) -> list[tuple[Experiment, slice]]:
        ends = np.cumsum([0, *(len(told.values) for _, told in self.members)])
        return [(member[0], slice(int(a), int(b))) for member, a, b in zip(self.members, ends, ends[1:], strict=False)]


def _failure(response: Response, group: _Trajectory) -> str:
    """Why the response is of no use, as a sentence; "" where it is of use."""
    names = ", ".join(experiment.name for experiment, _ in group.members)
    if not response.succeeded:
        return f"{names}: {response.status}"
    for experiment, samples in group.samples():
        for channel in experiment.compared:
            values = response.channels.get(experiment.twin_channel(channel))
            if values is not None and not np.all(np.isfinite(values[samples])):
                return f"{names}: the twin's {experiment.twin_channel(channel)} is not finite. {response.status}"
    return ""


def _part_faults(robot: Robot, experiments: Sequence[Experiment]) -> list[Fault]:
    names = [experiment.name for experiment in experiments]
    cables = [cable.name for cable in robot.cables]
    plates = [plate.name for plate in robot.plates]
    faults = [Fault("two experiments share a name", got=name) for name in sorted(set(names)) if names.count(name) > 1]
    for name in sorted(name for name in names if not re.fullmatch(r"[\w.+-][\w.+ -]*", name)):
        faults.append(
            Fault(
                "the experiment's name cannot name a file",
                got=f"'{name}'",
                allowed="letters, digits, space and . _ + -",
            )
        )
    if not experiments:
        faults.append(Fault("there is no experiment to calibrate with", "experiments", allowed="at least one"))
    for experiment in experiments:
        if experiment.cable not in cables:
            faults.append(
                Fault("the robot has no such cable", experiment.name, got=experiment.cable, allowed=", ".join(cables))
            )
        if experiment.plate not in plates and any(c not in ("tension", "shortening") for c in experiment.compared):
            faults.append(
                Fault("the robot has no such plate", experiment.name, got=experiment.plate, allowed=", ".join(plates))
            )
    return faults


def _real_simulate() -> Simulate:
    from softcal.twin.simulate import simulate

    return simulate
