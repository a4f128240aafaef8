"""The inverse problem: theta in, residuals and loss out. It knows no optimiser.

Experiments that drive the same actuators in the same way on a robot of the same parameters share one trajectory: the
twin is elastic, so the states of the 20, 40 and 60 mm tests are points of one curve, even when each test has its own
slack. A robot that remembers begins each experiment anew.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple, runtime_checkable
from typing import Protocol as TypingProtocol

import numpy as np

from softcal.calibration.problem.experiment import Experiment, rig_parameters
from softcal.calibration.problem.loss import Block, Loss, by_experiment, errors_by_point, gradient, require, rms, total
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.observation import Observation, commands, control_parameters, observe
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace, search_space
from softcal.calibration.problem.problem_faults import problem_faults
from softcal.calibration.problem.scope import ScopedParameter
from softcal.calibration.problem.trajectory import Member, Trajectory, shared_out
from softcal.calibration.problem.uncertain import UncertainParameter, uncertain_parameters
from softcal.checks import Floats
from softcal.declare import checked_arguments
from softcal.display import displayed
from softcal.errors import InputError, MeshError, ParameterError, SimulationError
from softcal.twin.parameters import MODULUS, ParameterInfo, robot_parameters
from softcal.twin.protocol import Protocol, command_faults
from softcal.twin.response import Derivatives, Response
from softcal.twin.robot import Robot

SOFTCAL = "softcal"  # the engine used where no other simulator is named
# Where the residuals' root mean square is above FAR of the largest value, the curve is interpolated within SHARE of it;
# in a first look within ROUGH of the largest value.
FAR, SHARE, ROUGH = 0.05, 0.02, 1e-2


@runtime_checkable
class Simulate(TypingProtocol):
    """The twin: `softcal.twin.simulate.simulate`, or a stand-in with its signature."""

    def __call__(
        self,
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response: ...


@dataclass(frozen=True)
class Evaluation:
    """The evaluation at one theta.

    Attributes
    ----------
    theta
        Label -> value of each free parameter [SI].
    loss
        Joint loss [the loss's unit]; None where the twin could not be simulated in every state: a loss over fewer
        states would be too low.
    failure
        Why it could not be, a sentence; "" where it could.
    blocks
        Residuals, and their jacobians where they were asked for, of the states that were solved, and of the priors.
    observations
        Experiment -> what was predicted for it; of experiments whose every state was solved.
    experiment_losses
        Experiment -> its loss taken alone [the loss's unit]; empty where there is no loss.
    gradient
        d loss / d theta (size of the search space,); None without jacobians.
    n_solves
        Number of simulated trajectories.
    n_factorisations
        Number of factorisations of the tangent.
    seconds
        Wall time [s].
    errors
        As those of a `Trial`: experiment -> marker, plate or channel -> root mean square of its distance [m] or error
        [SI]; of experiments whose every state was solved.
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
    errors: Mapping[str, Mapping[str, float]] = field(default_factory=dict[str, Mapping[str, float]])


class Contribution(NamedTuple):
    """The contribution of one trajectory to an evaluation.

    observations: experiment -> its predictions; failure: see `Evaluation`.
    """

    observations: Mapping[str, Observation]
    failure: str
    n_factorisations: int


@displayed
@dataclass(frozen=True)
class Problem:
    """A robot, its experiments, the free parameters, and the loss.

    Attributes
    ----------
    robot
        The robot at its present values.
    experiments
        What the bench saw.
    space
        The free parameters with their bounds.
    loss
        How the residuals are judged.
    simulate
        The engine; softcal's own twin where None.
    uncertain
        Parameters that are not fitted, whose standard deviations are carried into the intervals.
    left_out
        Sentence on what the engine leaves out of the robot, or "".

    Raises
    ------
    InputError
        For two experiments of one name, an actuator or plate that the robot does not have, a free parameter of no
        effect, a prior that the loss does not count, a parameter that is uncertain and free, or a channel that the loss
        cannot judge.
    """

    robot: Robot
    experiments: tuple[Experiment, ...]
    space: SearchSpace
    loss: Loss
    simulate: Simulate | None = None
    uncertain: tuple[UncertainParameter, ...] = ()
    left_out: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "experiments", tuple(self.experiments))
        object.__setattr__(self, "uncertain", tuple(self.uncertain))
        if faults := problem_faults(self.robot, self.experiments, self.space, self.loss, self.uncertain):
            raise InputError(faults)
        require(self.loss, self.experiments)

    @property
    def known(self) -> dict[str, ParameterInfo]:
        """Every parameter of the robot and the rig."""
        return {**robot_parameters(self.robot), **rig_parameters(self.experiments)}

    def alone(self, experiment: str) -> Problem:
        """The problem of one experiment alone."""
        return self.only([experiment])

    def only(self, experiments: Sequence[str]) -> Problem:
        """The problem of some of the experiments; a rig parameter that none of them has is no longer free."""
        chosen = tuple(e for e in self.experiments if e.name in experiments)
        known = {**robot_parameters(self.robot), **rig_parameters(chosen)}
        names = [e.name for e in chosen]
        space = self.space.restricted(*names).without(set(self.known) - set(known))
        uncertain = tuple(p for p in self.uncertain if p.serves(*names) and set(p.targets) <= set(known))
        return replace(self, experiments=chosen, space=space, uncertain=uncertain)

    @property
    def derived(self) -> tuple[str, ...]:
        """The parameters of the robot and the rig by which an evaluation with the jacobian is differentiated."""
        return tuple(dict.fromkeys([*self.space.targets, *(t for p in self.uncertain for t in p.targets)]))

    @property
    def path_parameters(self) -> tuple[str, ...]:
        """Labels of the free parameters by whose values load paths differ: those of the robot, other than moduli."""
        known = robot_parameters(self.robot)
        others = {name for name, info in known.items() if info.unit != MODULUS}
        return tuple(p.label for p in self.space.parameters if others.intersection(p.targets))

    def evaluate(self, theta: Mapping[str, float], *, jacobian: bool = False) -> Evaluation:
        """Simulate every experiment at theta [SI by label] and judge it. A failed simulation is a value, not an error.

        Raises
        ------
        InputError
            Where a value is outside what its parameter may be.
        """
        began = time.perf_counter()
        parts = [self.part(theta, group, jacobian=jacobian) for group in self.trajectories(theta)]
        return self.joined(theta, parts, time.perf_counter() - began)

    def part(self, theta: Mapping[str, float], group: Trajectory, *, jacobian: bool) -> Contribution:
        """The contribution of one trajectory to the evaluation at theta.

        With the jacobian, as in a search, it shares the load path of one actuator with others, and its curve is
        interpolated the less closely the further it is from the measurements.

        Parameters
        ----------
        theta, group
            Parameters [SI by label], and the trajectory.
        jacobian
            Whether derivatives are wanted.
        """
        driven = group.protocol().completed(self.robot).driven
        if not jacobian or self.simulate is not None or len(driven) != 1 or self.robot.remembers:
            return self._contribution(theta, group, jacobian=jacobian)
        rough = self._contribution(theta, group, jacobian=True, shared=True, curve_tolerance=ROUGH)
        blocks = self._blocks(rough.observations)
        misfit = min(
            (rms(b.residual) / max(float(np.abs(b.residual + b.measured).max()), 1e-300) for b in blocks), default=0.0
        )
        if rough.failure or SHARE * misfit >= ROUGH:
            return rough
        tolerance = {"curve_tolerance": SHARE * misfit} if misfit >= FAR else {}
        return self._contribution(theta, group, jacobian=True, shared=True, **tolerance)

    def _contribution(
        self, theta: Mapping[str, float], group: Trajectory, *, jacobian: bool, **options: Any
    ) -> Contribution:
        """See `part`; options: of the simulation."""
        simulate = self.simulate
        if simulate is None:
            from softcal.twin.simulate import simulate as of_twin

            simulate = partial(of_twin, crossings=False)  # looked for once, at what is found
        protocol, names = group.protocol(), self._derived_by(group) if jacobian else []
        try:
            response = simulate(self.robot, protocol, group.theta, sensitivities=names, **options)
        except (SimulationError, MeshError) as error:  # of a shape that the mesh of a body cannot have
            response = Response({}, {}, str(error), succeeded=False, n_factorisations=0)
        except ParameterError as error:
            # Where a free slack is what pulls a cable in too far, there are values of it that do not.
            moved = any(control_parameters(experiment) & set(self.derived) for experiment, _ in group.members)
            if not (moved and command_faults(self.robot, protocol)):
                raise
            response = Response({}, {}, str(error), succeeded=False, n_factorisations=0)
        observations: dict[str, Observation] = {}
        failure = group.failure(response)
        if response.channels:
            whole = response.over(protocol.n_samples)
            for experiment, samples in group.samples():
                # A robot that has no equilibrium at rest has no derivatives.
                names = self.derived if jacobian and (response.slopes or not failure) else ()
                rig = self._rig(experiment, theta)
                observations[experiment.name] = observe(experiment, rig, whole, samples, names)
        return Contribution(observations, failure, response.n_factorisations)

    def joined(self, theta: Mapping[str, float], parts: Sequence[Contribution], seconds: float) -> Evaluation:
        """The evaluation of what all trajectories contribute.

        Parameters
        ----------
        theta, parts
            Parameters [SI by label], and the contributions at these.
        seconds
            How long they took [s].
        """
        found = {name: seen for part in parts for name, seen in part.observations.items()}
        # In the order of the experiments, whatever they share.
        observations = {e.name: found[e.name] for e in self.experiments if e.name in found}
        n_factorisations = sum(part.n_factorisations for part in parts)
        if failures := [part.failure for part in parts if part.failure]:
            return self._failed(theta, " ".join(failures), observations, len(parts), n_factorisations, seconds)
        return self.judge(theta, observations, len(parts), n_factorisations, seconds)

    def failed(self, theta: Mapping[str, float], failure: str) -> Evaluation:
        """A failed evaluation at theta, with nothing but the reason of the failure."""
        return self._failed(theta, failure, {}, 0, 0, 0.0)

    def _failed(
        self,
        theta: Mapping[str, float],
        failure: str,
        observations: Mapping[str, Observation],
        n_solves: int,
        n_factorisations: int,
        seconds: float,
    ) -> Evaluation:
        """An evaluation without a loss, with the residuals of what was solved."""
        blocks = self._blocks(observations)
        whole = {n for n, seen in observations.items() if all(np.isfinite(v).all() for v in seen.predicted.values())}
        return Evaluation(
            theta=dict(theta),
            loss=None,
            failure=failure,
            blocks=tuple(blocks),
            observations={name: seen for name, seen in observations.items() if name in whole},
            experiment_losses={},
            gradient=None,
            n_solves=n_solves,
            n_factorisations=n_factorisations,
            seconds=seconds,
            errors=errors_by_point([block for block in blocks if block.experiment in whole]),
        )

    def judge(
        self,
        theta: Mapping[str, float],
        observations: Mapping[str, Observation],
        n_solves: int,
        n_factorisations: int,
        seconds: float,
    ) -> Evaluation:
        """The evaluation of observations.

        Parameters
        ----------
        theta, observations
            Parameters [SI by label], and experiment -> observation at these.
        n_solves, n_factorisations, seconds
            Trajectories, factorisations and time [s] that they took.
        """
        blocks = (*self._blocks(observations), *self.priors(theta))
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
            errors=errors_by_point(blocks),
        )

    def _rig(self, experiment: Experiment, theta: Mapping[str, float]) -> dict[str, float]:
        return {**experiment.rig_values(), **self.space.values_for(experiment.name, theta)}

    def trajectories(self, theta: Mapping[str, float]) -> list[Trajectory]:
        """The simulations of an evaluation at theta [SI by label], each with the experiments that it serves."""
        known = robot_parameters(self.robot)
        groups: dict[tuple[object, ...], list[Member]] = {}
        thetas: dict[tuple[object, ...], dict[str, float]] = {}
        for experiment in self.experiments:
            values = {**experiment.settings, **self.space.values_for(experiment.name, theta)}
            of_robot = {name: value for name, value in values.items() if name in known}
            told = commands(experiment, self._rig(experiment, theta))
            driven = sorted((name, command.control) for name, command in told.items())
            key = (*driven, tuple(sorted(of_robot.items())), experiment.name if self.robot.remembers else "")
            thetas[key] = of_robot
            groups.setdefault(key, []).append((experiment, told))
        held = (*(part.name for part in self.robot.pretensioned), *self.robot.led)
        robot = self.robot
        return [
            Trajectory(thetas[key], tuple(members), robot.remembers, held, robot.needs_time)
            for key, sharing in groups.items()
            for members in shared_out(sharing)
        ]

    def n_simulations(self, *, jacobian: bool = False) -> int:
        """Number of simulations of an evaluation by an engine without derivatives of its own: one for each trajectory,
        and with the jacobian one more for each parameter or command of a derivative.
        """
        groups = self.trajectories(self.space.start)
        return sum(1 + len(self._derived_by(group) if jacobian else ()) for group in groups)

    def first_trajectory(self) -> tuple[Protocol, dict[str, float]]:
        """The first simulation of an evaluation at the start values: what is driven, and the robot's values [SI]."""
        group = self.trajectories(self.space.start)[0]
        return group.protocol(), dict(group.theta)

    def _derived_by(self, group: Trajectory) -> list[str]:
        known = robot_parameters(self.robot)
        return [*(name for name in self.derived if name in known), *group.controls(set(self.derived))]

    def _blocks(self, observations: Mapping[str, Observation]) -> list[Block]:
        blocks, robot = list[Block](), robot_parameters(self.robot)
        for experiment in self.experiments:
            if experiment.name not in observations:
                continue
            seen = observations[experiment.name]
            judged = [p for p in (*self.space.parameters, *self.uncertain) if p.serves(experiment.name)]
            command = experiment.dataset.values(experiment.drives[0]) if len(experiment.drives) == 1 else None
            stated = {*robot, *experiment.settings, *(target for p in judged for target in p.targets)}
            for channel in experiment.compared:
                there = experiment.seen(channel) & np.isfinite(seen.predicted[channel])
                if not there.any():
                    continue
                values = experiment.dataset.values(channel)[there]
                jacobian = _columns(self.space.parameters, experiment.name, seen.derivatives, channel)
                systematic = _columns(self.uncertain, experiment.name, seen.derivatives, channel)
                drift = experiment.twin_channel(channel).drift
                errors = {} if jacobian is None else seen.instrument_errors(experiment, channel)
                blocks.append(
                    Block(
                        experiment.name,
                        channel,
                        values,
                        seen.predicted[channel][there] - values,
                        experiment.sigma(channel)[there],
                        None if jacobian is None else jacobian[there],
                        experiment.point_of(channel),
                        None if systematic is None else systematic[there] * [p.sd for p in self.uncertain],
                        experiment.set_up,
                        experiment.elapsed[there] if drift and drift not in stated else None,
                        {name: (shape[there], scale) for name, (shape, scale) in errors.items() if name not in stated},
                        None if command is None else command[there],
                    )
                )
        return blocks

    def priors(self, theta: Mapping[str, float]) -> list[Block]:
        """The priors as blocks."""
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


@checked_arguments
def make_problem(
    robot: Robot,
    experiments: Sequence[Experiment],
    parameters: Sequence[FreeParameter],
    loss: Loss | None = None,
    simulate: Simulate | None = None,
    uncertain: Sequence[UncertainParameter] = (),
) -> Problem:
    """A problem from free and uncertain parameters as a user states them.

    Parameters
    ----------
    robot, experiments
        The robot, and its experiments.
    parameters, uncertain
        What is free, and what is uncertain.
    loss
        By default the papers'.
    simulate
        What simulates the twin; by default softcal's own.

    Raises
    ------
    InputError
        As `search_space`, `uncertain_parameters` and `Problem`.
    """
    known = {**robot_parameters(robot), **rig_parameters(experiments)}
    own = {experiment.name: experiment.rig_values() for experiment in experiments}
    set_ups = {experiment.name: experiment.set_up for experiment in experiments}
    space = search_space(parameters, list(own), known, own, set_ups)
    considered = uncertain_parameters(uncertain, list(own), known, own, set_ups)
    return Problem(robot, tuple(experiments), space, loss or PapersLoss(), simulate, considered)


def _columns(
    parameters: Sequence[ScopedParameter], experiment: str, derivatives: Derivatives, channel: str
) -> Floats | None:
    """The derivatives (n_samples, len(parameters)) of a channel of an experiment; None where there are none."""
    if not derivatives.parameters or not parameters:
        return None
    targets = [p.targets if p.serves(experiment) else () for p in parameters]
    columns = [[k for k, name in enumerate(derivatives.parameters) if name in of_one] for of_one in targets]
    rates = derivatives.rates[:, derivatives.channels.index(channel)]
    return np.column_stack([rates[:, each].sum(axis=1) for each in columns])
