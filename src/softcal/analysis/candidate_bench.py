"""Candidates beside the calibration's experiments, simulated together at the calibrated values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.analysis.candidate import Candidate, as_experiment, noise_like, own_parameters
from softcal.analysis.candidate_mesh import mesh_change, step_of_parameters
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.observation import protocol_told, slack_faults
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.problem.scope import P
from softcal.calibration.problem.uncertain import MESH_ERROR, UncertainParameter
from softcal.calibration.search.evaluator import evaluated
from softcal.calibration.statistics.added_test import AddedChannel, AddedTest
from softcal.checks import Floats
from softcal.errors import Fault, InputError, SimulationError, unknown
from softcal.executors.executor import Executor
from softcal.sensing.channel import ChannelName
from softcal.sensing.sensors.actuators import SHORTENING
from softcal.twin.actuated import faults_of_limits
from softcal.twin.parameters import robot_parameters, with_shape
from softcal.twin.protocol import command_faults

# A block, with its derivatives (n,) [SI] by the labels of the free parameters, and its changes (n,) [SI] by one
# standard deviation of each of a candidate's own uncertain parameters by theirs.
Row = tuple[Block, Mapping[str, Floats]]


NO_MESH = "The error of the mesh is not included, as in the calibration."


@dataclass(frozen=True)
class Plan:
    """A candidate as an experiment.

    own: label of the calibration -> the test's own parameter of that kind; errs: the same for uncertain parameters.
    """

    candidate: Candidate
    like: Experiment
    test: Experiment
    own: Mapping[str, FreeParameter]
    errs: Mapping[str, UncertainParameter]


@dataclass(frozen=True)
class Simulated:
    """Experiment or candidate -> its blocks; candidate -> sentence on why it has no blocks; number of trajectories.

    uncertain: the parameters of the blocks' `systematic`, with the error of the mesh where it is known. note: sentence
    on the assumption about that error, or "".
    """

    rows: Mapping[str, Sequence[Row]]
    failures: Mapping[str, str]
    n_solves: int
    uncertain: tuple[UncertainParameter, ...] = ()
    note: str = ""


def planned(problem: Problem, theta: Mapping[str, float], candidate: Candidate) -> Plan:
    """A candidate as an experiment, checked to be possible.

    Parameters
    ----------
    problem
        The calibration's problem.
    theta
        Values [SI] by label of the free parameters.
    candidate
        The candidate test.

    Raises
    ------
    InputError
        Where the robot cannot be tested so.
    """
    names = [experiment.name for experiment in problem.experiments]
    if candidate.name in names:
        raise InputError(Fault("an experiment has the name of the candidate", candidate.name))
    if candidate.like not in names:
        raise InputError(unknown("there is no experiment of this name", candidate.name, candidate.like, names))
    like = problem.experiments[names.index(candidate.like)]
    test = as_experiment(candidate, like)
    own = own_parameters(candidate, like, problem.space.parameters)
    plan = Plan(candidate, like, test, own, own_parameters(candidate, like, problem.uncertain))
    for channel in test.compared:
        if not _noise(problem, plan, channel):
            allowed = f"noise: {{{channel}: …}}"
            raise InputError(Fault(f"the noise of '{channel}' is not known", candidate.name, allowed=allowed))
    whole, values = joined(problem, theta, [plan])
    fixed = whole.space.values_for(test.name, values)
    rig = {name: fixed.get(name, value) for name, value in test.rig_values().items()}
    known = robot_parameters(whole.robot)
    robot = with_shape(whole.robot, {k: v for k, v in {**test.settings, **fixed}.items() if k in known})
    faults = command_faults(robot, protocol_told(robot, test, rig))
    if any(test.twin_channel(channel).kind == SHORTENING for channel in test.drives):
        faults += slack_faults(replace(test, settings={**test.settings, **rig}))
    if faults:
        raise InputError(faults)
    return plan


def joined(problem: Problem, theta: Mapping[str, float], plans: Sequence[Plan]) -> tuple[Problem, dict[str, float]]:
    """Problem with the candidates among its experiments, and theta with their own parameters.

    Its loss accepts every channel: only the derivatives are of interest.

    Parameters
    ----------
    problem
        The calibration's problem.
    theta
        Values [SI] by label of the free parameters.
    plans
        The candidates as experiments.
    """

    def shared(known: Sequence[P]) -> tuple[P, ...]:
        new = [(plan.like.name, plan.test.name) for plan in plans]
        return tuple(replace(p, members=(*p.members, *(b for a, b in new if a in p.members))) for p in known)

    experiments = (*problem.experiments, *(plan.test for plan in plans))
    own = {p.label: (p, theta[old]) for plan in plans for old, p in plan.own.items()}
    space = SearchSpace((*shared(problem.space.parameters), *(p for p, _ in own.values())))
    uncertain = (*shared(problem.uncertain), *(p for plan in plans for p in plan.errs.values()))
    loss = LikelihoodLoss({channel: 1.0 for experiment in experiments for channel in experiment.compared})
    whole = replace(problem, experiments=experiments, space=space, loss=loss, uncertain=uncertain)
    return whole, {**theta, **{label: value for label, (_, value) in own.items()}}


def simulated(
    problem: Problem,
    theta: Mapping[str, float],
    plans: Sequence[Plan],
    *,
    mesh_error: bool = True,
    workers: int | Executor = 1,
) -> Simulated:
    """Simulate the problem's experiments and all candidates, at once.

    Parameters
    ----------
    problem
        The calibration's problem.
    theta
        Values [SI] by label of the free parameters.
    plans
        The candidates as experiments.
    mesh_error
        Include the error of the mesh, by one more simulation on a finer mesh.
    workers
        Executor, or number of processes, which share the trajectories.

    Raises
    ------
    SimulationError
        Where the problem's experiments cannot be simulated.
    """
    failures: dict[str, str] = {}
    whole, values = joined(problem, theta, plans)
    found = evaluated(whole, values, workers=workers, jacobian=True)
    n_solves = found.n_solves
    if found.loss is None:
        done = set(found.observations)
        for plan in [plan for plan in plans if plan.test.name not in done]:
            alone = whole.only([plan.test.name]).evaluate(values)
            n_solves += alone.n_solves
            failures[plan.test.name] = (alone.failure or found.failure).removeprefix(f"{plan.test.name}: ")
        whole, values = joined(problem, theta, [plan for plan in plans if plan.test.name in done])
        found = evaluated(whole, values, workers=workers, jacobian=True)
        n_solves += found.n_solves
    if found.loss is None:
        raise SimulationError(f"The twin cannot be simulated at the values found. {found.failure}")
    plans = [plan for plan in plans if plan.test.name in found.observations]
    limits = whole.robot.limited
    beyond = {name: faults_of_limits(limits, one.response) for name, one in found.observations.items()}
    for plan in plans:
        # A limit that an experiment has exceeded does not bind the tests like it.
        exceeded = {fault.what for fault in beyond[plan.like.name]}
        if new := [fault for fault in beyond[plan.test.name] if fault.what not in exceeded]:
            failures[plan.test.name] = " ".join(map(str, new))
    plans = [plan for plan in plans if plan.test.name not in failures]
    rows = {name: held for name, held in _rows(problem, whole, found).items() if name not in failures}
    if not mesh_error:
        return Simulated(rows, failures, n_solves, problem.uncertain, NO_MESH)
    finer = mesh_change(whole, values, found, [plan.test.name for plan in plans])
    n_solves += finer.n_solves
    if finer.unknown:
        return Simulated(rows, failures, n_solves, problem.uncertain, finer.unknown)
    estimated = [plan.test.name for plan in plans if not any(name == plan.test.name for name, _ in finer.changes)]
    changes = {**finer.changes, **_estimated(problem, theta, rows, finer.changes, plans)}
    note = (
        ""
        if not estimated
        else (
            "The finer mesh was simulated along the load paths of the calibration alone. For "
            f"{', '.join(estimated)} the error of the mesh is estimated, by the change of the parameters that has its "
            "effect on the experiments."
        )
    )
    # The change on the finer mesh is the derivative by one more uncertain parameter.
    with_changes: dict[str, list[Row]] = {}
    for block, columns in (row for held in rows.values() for row in held):
        change = changes[block.experiment, block.channel][:, None]
        known = block.systematic if block.systematic is not None else change[:, :0]
        row = replace(block, systematic=np.hstack([known, change])), columns
        with_changes.setdefault(block.experiment, []).append(row)
    return Simulated(with_changes, failures, n_solves, (*problem.uncertain, MESH_ERROR), note)


def _rows(problem: Problem, whole: Problem, found: Evaluation) -> dict[str, list[Row]]:
    """Experiment or candidate -> its blocks, with the uncertain parameters of the calibration, and derivatives."""
    k = len(problem.uncertain)
    rows: dict[str, list[Row]] = {}
    for block in found.blocks:
        if block.experiment and block.jacobian is not None:
            columns = dict(zip(whole.space.labels, block.jacobian.T, strict=True))
            if block.systematic is not None:
                columns |= dict(zip((p.label for p in whole.uncertain[k:]), block.systematic.T[k:], strict=True))
            shared = None if block.systematic is None or not k else block.systematic[:, :k]
            rows.setdefault(block.experiment, []).append((replace(block, systematic=shared), columns))
    return rows


def _estimated(
    problem: Problem,
    theta: Mapping[str, float],
    rows: Mapping[str, Sequence[Row]],
    changes: Mapping[tuple[str, str], Floats],
    plans: Sequence[Plan],
) -> dict[tuple[str, str], Floats]:
    """The changes of the candidates that are not on the calibration's load paths."""
    space = problem.space
    blocks = [block for block in base_blocks(problem, theta, rows) if block.experiment]
    step = step_of_parameters(
        blocks,
        [problem.loss.square_weights(block, block.residual) for block in blocks],
        [changes[block.experiment, block.channel] for block in blocks],
        space.jacobian(np.clip(space.to_search(theta), 0.0, 1.0)),
    )
    by = dict(zip(space.labels, step, strict=True))
    return {
        key: np.sum([columns[plan.own[old].label if old in plan.own else old] * by[old] for old in by], axis=0)
        for plan in plans
        for block, columns in rows[plan.test.name]
        if (key := (block.experiment, block.channel)) not in changes
    }


def base_blocks(problem: Problem, theta: Mapping[str, float], rows: Mapping[str, Sequence[Row]]) -> list[Block]:
    """Blocks of the problem's own experiments and priors, with their jacobians.

    Parameters
    ----------
    problem
        The calibration's problem.
    theta
        Values [SI] by label of the free parameters.
    rows
        Blocks and derivatives of each experiment and candidate.
    """
    labels = problem.space.labels
    found = [
        replace(block, jacobian=np.column_stack([by[label] for label in labels]))
        for experiment in problem.experiments
        for block, by in rows[experiment.name]
    ]
    return [*found, *problem.priors(theta)] if problem.loss.uses_priors else found


def added_test(problem: Problem, slopes: Floats, plan: Plan, rows: Sequence[Row]) -> AddedTest:
    """A simulated candidate in the unit box of the search.

    Parameters
    ----------
    problem
        The calibration's problem.
    slopes
        d theta / dz (size,) of the parameters by the unit box.
    plan
        The candidate as an experiment.
    rows
        Blocks and derivatives of the candidate.
    """
    space, own = problem.space, plan.own
    per = dict(zip(space.labels, slopes, strict=True))
    # A parameter without an effect, such as the offset of an angle that is not measured, is none of the test.
    held = [old for old, p in own.items() if any(np.any(by[p.label]) for _, by in rows)]
    own_errs = list(plan.errs.values())
    channels: list[AddedChannel] = []
    for block, by in rows:
        zeros = np.zeros(len(block.residual))
        known, sigma = _noise(problem, plan, block.channel) or (None, None)
        channels.append(
            AddedChannel(
                name=block.channel,
                answer=np.column_stack([by.get(label, zeros) * slope for label, slope in per.items()]),
                own=np.column_stack([zeros, *(by[own[old].label] * per[old] for old in held)])[:, 1:],
                like=known,
                sigma=sigma,
                better=plan.candidate.better.get(block.channel, 1.0),
                counted=counts(problem, plan, block.channel),
                systematic=block.systematic,
                own_systematic=np.column_stack([zeros, *(by[p.label] for p in own_errs)])[:, 1:],
                drift=block.drift,
            )
        )
    priors = [
        per[old] / sd * np.eye(len(held))[k] for k, old in enumerate(held) if (sd := own[old].prior_sd) is not None
    ]
    serves = np.array([p.serves(plan.like.name) and p.label not in own for p in space.parameters])
    rows_of_priors = np.array(priors).reshape(len(priors), len(held))
    return AddedTest(plan.test.name, tuple(channels), serves, rows_of_priors, plan.candidate.repeats, tuple(own_errs))


def counts(problem: Problem, plan: Plan, channel: str) -> bool:
    """True if the loss has a weight for a channel; a position counts together with the other coordinates of its point.

    Parameters
    ----------
    problem
        The calibration's problem.
    plan
        The candidate as an experiment.
    channel
        Channel of the candidate.
    """
    test = plan.test
    point = test.point_of(channel)
    return not problem.loss.faults([replace(test, compared=test.parts_of(point) if point else (channel,))])


def _noise(problem: Problem, plan: Plan, channel: str) -> tuple[tuple[str, str] | None, float | None] | None:
    """Experiment and channel with the same instrument, and the stated noise [SI] if it differs from theirs; None if
    neither is known.
    """
    sigma = plan.candidate.noise.get(channel)
    own = noise_like(plan.candidate, plan.like, channel)
    if own:
        return (plan.like.name, own), sigma
    twin: ChannelName = plan.test.twin_channel(channel)
    measured = [(e, c) for e in problem.experiments for c in e.compared if e.twin_channel(c).kind == twin.kind]
    measured.sort(key=lambda one: one[0].twin_channel(one[1]) != twin)
    if measured:
        experiment, other = measured[0]
        return (experiment.name, other), sigma
    stated = [c.sigma for name, c in plan.like.dataset.channels.items() if plan.like.twin_channel(name) == twin]
    sigma = sigma or max(stated, default=0.0) or twin.kind.noise
    return (None, sigma) if sigma else None
