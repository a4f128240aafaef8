"""The error of the mesh as one more uncertain parameter: how every prediction changes on a finer mesh.

The twin is simulated once more at the best values: with locking-free elements where its own are of lower order, else
with every element halved. The change of the predictions counts as one standard deviation of an error that all samples
have in common. What is left beyond a halving is a third of the change where the error falls with the square of the
element size, and as much as the change where it falls with the size itself: within two standard deviations in both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.loss import Block
from softcal.calibration.problem import Evaluation, Problem
from softcal.calibration.uncertain import MESH_ERROR, UncertainParameter
from softcal.errors import MeshError
from softcal.mechanics.elements import DEFAULT
from softcal.twin.finer import elevated, halved, has_lower, size
from softcal.twin.robot import Robot

UNKNOWNS = 150_000  # a minute or two per trajectory


@dataclass(frozen=True)
class WithMeshError:
    """An evaluation whose blocks know how they change on a finer mesh.

    Attributes
    ----------
    best
        The evaluation.
    uncertain
        The uncertain parameters of its blocks, the error of the mesh among them where it is known.
    unknown
        Why it is not, a sentence; "" where it is.
    n_solves
        Number of simulated trajectories.
    """

    best: Evaluation
    uncertain: tuple[UncertainParameter, ...]
    unknown: str
    n_solves: int = 0


def with_mesh_error(problem: Problem, best: Evaluation, *, max_unknowns: int = UNKNOWNS) -> WithMeshError:
    """The best evaluation of a problem with the change of its residuals on a finer mesh.

    max_unknowns: limit of the finer mesh; beyond it the error is not computed. Ctrl-C ends the computation alone.
    """
    try:
        finer = on_finer_mesh(problem, best.theta, max_unknowns=max_unknowns)
        reason = finer if isinstance(finer, str) else unknown(finer.failure)
    except KeyboardInterrupt:
        finer, reason = "", unknown("its computation was stopped by the user")
    if isinstance(finer, str) or finer.loss is None:
        return WithMeshError(best, problem.uncertain, reason)
    blocks = tuple(_changed(own, other, problem) for own, other in zip(best.blocks, finer.blocks, strict=True))
    return WithMeshError(replace(best, blocks=blocks), (*problem.uncertain, MESH_ERROR), "", finer.n_solves)


def on_finer_mesh(problem: Problem, theta: Mapping[str, float], *, max_unknowns: int = UNKNOWNS) -> Evaluation | str:
    """The evaluation of a problem at theta on a finer mesh, or a sentence why there is none."""
    if problem.simulate is not None:
        return unknown("the twin is another engine's")
    is_lower = has_lower(problem.robot, DEFAULT.name)
    raised = elevated(problem.robot, DEFAULT.name) if is_lower else problem.robot
    if (n := size(raised, 0 if is_lower else 1).unknowns) > max_unknowns:
        return unknown(f"a finer one would have {n:,} unknowns, more than the limit of {max_unknowns:,}")
    try:
        return replace(problem, robot=raised if is_lower else _halved(raised)).evaluate(theta)
    except MeshError as error:
        return unknown(str(error))


def _halved(robot: Robot) -> Robot:
    """The robot halved: one for all fits of it, so that its twin is built once."""
    if not (_LAST and _LAST[0][0] is robot):
        _LAST[:] = [(robot, halved(robot))]
    return _LAST[0][1]


_LAST: list[tuple[Robot, Robot]] = []  # the robot halved last, with the result


def unknown(reason: str) -> str:
    """The sentence that the error of the mesh is not known."""
    return f"The error of the mesh is not known: {reason.removesuffix('.')}."


def _changed(own: Block, finer: Block, problem: Problem) -> Block:
    """A block with the change of its residual beside that by the uncertain parameters."""
    if not own.experiment:
        return own
    known = own.systematic if own.systematic is not None else np.zeros((len(own.residual), len(problem.uncertain)))
    return replace(own, systematic=np.column_stack([known, finer.residual - own.residual]))
