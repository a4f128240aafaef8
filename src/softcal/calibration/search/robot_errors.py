"""Errors in the description of the robot that would explain what the twin misses: weights, places of via points,
friction and constants that are not fitted, each by the twin's exact derivative.

An error of one size in all tests is mostly absorbed by the parameters: a cable that is attached 2 mm further out looks
like a stiffer robot. What is left shows which error it is (`statistics/misfit.py`), and by how much the parameters are
off with it. The interval then includes such an error, as large as it would be or smaller, as that of an uncertain
parameter.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.problem.experiment import rig_kind
from softcal.calibration.problem.loss import Block, rms
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.statistics.estimate import Remark
from softcal.calibration.statistics.misfit import COUNTS, RobotError, likelihoods, robot_errors
from softcal.calibration.statistics.noise import ANY_LESS, MISFIT
from softcal.calibration.statistics.residuals import SHOWN
from softcal.checks import Floats
from softcal.quantities import GRAVITY
from softcal.twin.parameter_name import parameter_name
from softcal.twin.parameters import ParameterInfo, robot_parameters
from softcal.twin.robot import Cable, Robot
from softcal.units import format_quantity

DESCRIPTION = (
    "By the derivatives, one error in the description of the robot would explain most of the squared residuals beyond "
    "the noise"
)
MAY_MISS = COUNTS - 1.0  # standard errors of the shape in one channel: of all channels together it may be more
MOST_VIA_POINTS = 12  # of all cables: of more, none is suspected by itself
_FAR = 0.05  # of a cable's length: a via point further off is no slip of a ruler
_LONGER = 0.1  # of a length: the same
_RATIO = 0.1  # of a Poisson's ratio: the same
_HEAVIEST = 12.0  # [m/s^2]; no gravity is larger
_LIKELY = 0.1  # of the likelihood of the clearest error: a less likely one does not count
_NAMED = 3
_SLIGHT = 1e-4  # of the range of a channel


@dataclass(frozen=True)
class Suspect:
    """A parameter of the robot that may be in error, with the changes (n,) of each block's residual by that error, and
    its likelihood over that of the clearest one.
    """

    info: ParameterInfo
    error: RobotError
    changes: tuple[Floats, ...]
    likelihood: float = 1.0


@dataclass(frozen=True)
class WithRobotErrors:
    """An evaluation whose blocks know how their residuals change by errors of the robot's description.

    Attributes
    ----------
    best
        The evaluation.
    errors
        The errors, of the robot with named points.
    notes
        A warning that names the errors; without any, none.
    """

    best: Evaluation
    errors: tuple[UncertainParameter, ...] = ()
    notes: tuple[Remark, ...] = ()


def with_robot_errors(problem: Problem, best: Evaluation, uncertain: tuple[UncertainParameter, ...]) -> WithRobotErrors:
    """The best evaluation of a problem, which misses more than noise, with the errors that would explain it.

    Parameters
    ----------
    problem, best
        The problem, and its best evaluation.
    uncertain
        The parameters of its blocks' `systematic`.
    """
    found = suspects(problem, best, uncertain)
    if not found:
        return WithRobotErrors(best)
    # As a shape of a usual cause they count in part from 3.5 standard errors, and in whole from 4.5.
    counts = ANY_LESS * np.sqrt(min(found[0].error.worth - COUNTS, 1.0))
    sizes = [counts * np.sqrt(one.likelihood) for one in found]
    blocks = tuple(
        replace(
            block,
            systematic=np.column_stack(
                [_changes(block, len(uncertain)), *(s * one.changes[k] for s, one in zip(sizes, found, strict=True))]
            ),
        )
        for k, block in enumerate(best.blocks)
    )
    best = replace(best, blocks=blocks)
    errors = tuple(
        UncertainParameter(one.info.name, one.info.unit, float(s * abs(one.error.size)), written=MISFIT)
        for s, one in zip(sizes, found, strict=True)
    )
    if found[0].error.worth <= SHOWN:
        return WithRobotErrors(best, errors)
    text = "; ".join(_text(problem.space, best, one) for one in found[:_NAMED])
    more = len(found) - _NAMED
    others = f"; {more} other{'s explain' if more > 1 else ' explains'} about as much" if more > 0 else ""
    note = Remark(f"{DESCRIPTION}: {text}{others}. Measure it, or make it free or uncertain.", "warning")
    return WithRobotErrors(best, errors, (note,))


def with_uncertain_errors(problem: Problem, errors: Mapping[str, float]) -> Problem:
    """A problem whose uncertain parameters include the errors that its calibration suspected, for its studies.

    Parameters
    ----------
    problem
        The problem.
    errors
        Parameter of the robot, with named points -> standard deviation [SI].
    """
    if not errors:
        return problem
    robot = with_named_points(problem.robot)
    units = {name: info.unit for name, info in robot_parameters(robot).items()}
    stated = ["" if p.experiment else p.targets[0] for p in problem.uncertain]
    own = (replace(p, sd=math.hypot(p.sd, errors.get(n, 0.0))) for n, p in zip(stated, problem.uncertain, strict=True))
    new = (UncertainParameter(n, units[n], sd, written=MISFIT) for n, sd in errors.items() if n not in stated)
    return replace(problem, robot=robot, uncertain=(*own, *new))


def suspects(problem: Problem, best: Evaluation, uncertain: Sequence[UncertainParameter]) -> list[Suspect]:
    """The errors that would each explain most of the residuals, those that explain most first; none without
    derivatives, where the twin meets the data within 1e-4 of their range, or where another engine simulates.

    Lengths of bodies count where they are uncertain: each derivative would take two more twins. Friction that is left
    out is a usual cause by its shape, and markers err by themselves (`statistics/between_markers.py`).

    Parameters
    ----------
    problem, best
        The problem, and its best evaluation.
    uncertain
        The parameters of its blocks' `systematic`.
    """
    measured = [block for block in best.blocks if block.experiment]
    if problem.simulate is not None or any(block.jacobian is None for block in best.blocks):
        return []
    if all(rms(block.residual) <= _SLIGHT * np.ptp(block.measured) for block in measured):
        return []
    robot = with_named_points(problem.robot)
    known, apart = robot_parameters(robot), {part.name for part in (*robot.bodies, *robot.markers)}
    smooth = (f"{cable.name}.friction_coefficient" for cable in robot.cables if cable.friction_coefficient == 0.0)
    stated = {*problem.derived, *smooth, *(name for one in problem.experiments for name in one.settings)}
    others = [i for n, i in known.items() if n not in stated and not (i.shapes and parameter_name(n).owner in apart)]
    errors = tuple(UncertainParameter(info.name, info.unit, 1.0) for info in others)
    derived = replace(problem, robot=robot, uncertain=errors).evaluate(best.theta, jacobian=True)
    if derived.loss is None:
        return []
    columns = [k for k, p in enumerate(uncertain) if not p.experiment and p.targets[0] in known]
    infos = [*(known[uncertain[k].targets[0]] for k in columns), *others]
    scales = np.array([1.0 / uncertain[k].sd for k in columns])
    changes = [
        np.column_stack([_changes(own, len(uncertain))[:, columns] * scales, _changes(other, len(others))])
        for own, other in zip(best.blocks, derived.blocks, strict=True)
    ]
    value = best.theta
    low, high = np.array([(p.lower - value[p.label], p.upper - value[p.label]) for p in problem.space.parameters]).T
    found = [
        Suspect(info, error, tuple(error.size * change[:, k] for change in changes))
        for k, (info, error) in enumerate(zip(infos, robot_errors(best.blocks, changes, (low, high)), strict=True))
        if error is not None and _is_possible(robot, info, error.size)
    ]
    each = zip(found, likelihoods([one.error.worth for one in found]), strict=True)
    found = [replace(one, likelihood=p) for one, p in each if p >= _LIKELY]
    return sorted(found, key=lambda one: -one.likelihood)


def _changes(block: Block, n: int) -> Floats:
    """Changes (n_samples, n) of a block's residual by n uncertain parameters; a prior has none."""
    return np.zeros((len(block.residual), n)) if block.systematic is None else block.systematic


def with_named_points(robot: Robot) -> Robot:
    """The robot with names for all via points that a cable states, where these are few, the cable has no axis, and none
    is in a body: in a bore it cannot move. One for all fits of a robot, so that its twin is built once.
    """
    if sum(via.share is None for cable in robot.cables for via in cable.via_points) > MOST_VIA_POINTS:
        return robot
    if not (_LAST and _LAST[0][0] is robot):
        bodies = {body.name for body in robot.bodies}
        _LAST[:] = [(robot, replace(robot, cables=tuple(_named(cable, bodies) for cable in robot.cables)))]
    return _LAST[0][1]


_LAST: list[tuple[Robot, Robot]] = []  # the last robot, and with names


def _named(cable: Cable, bodies: Collection[str]) -> Cable:
    if cable.routing_axis is not None or any(via.name or via.on in bodies for via in cable.via_points):
        return cable
    numbers = itertools.count(1)
    points = (replace(via, name=f"via{next(numbers)}") if via.share is None else via for via in cable.via_points)
    return replace(cable, via_points=tuple(points))


def _is_possible(robot: Robot, info: ParameterInfo, size: float) -> bool:
    """Whether the parameter may have such a value: no length or ratio is far off, and gravity is not too large."""
    value, part = info.value + size, parameter_name(info.name).part
    lengths = {cable.name: cable.length for cable in robot.cables}
    if info.name in GRAVITY and abs(value) > _HEAVIEST:
        return False
    if parameter_name(info.name).kind == "poissons_ratio" and abs(size) > _RATIO:
        return False
    if info.unit == "m" and abs(size) > (_FAR * lengths[part] if part in lengths else _LONGER * abs(info.value)):
        return False
    return info.quantity.allows(value)


def _text(space: SearchSpace, best: Evaluation, one: Suspect) -> str:
    """The error, its share, and the values of the robot's parameters with it."""
    value = format_quantity(one.error.size, one.info.unit, digits=1)
    at_bound = space.at_bound(best.theta)
    moved = [
        f"{p.label} {format_quantity(best.theta[p.label] + step, p.unit, digits=3)}"
        for p, step in zip(space.parameters, one.error.moved.tolist(), strict=True)
        if rig_kind(p.targets[0]) is None and not at_bound[p.label]
    ]
    return (
        f"{one.info.name} off by about {value} explains {100 * one.error.share:.0f} %"
        + f" (with it {', '.join(moved)})" * bool(moved)
    )
