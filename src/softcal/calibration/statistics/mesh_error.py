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

from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.problem.uncertain import MESH_ERROR, UncertainParameter
from softcal.errors import MeshError
from softcal.geometry.refine import corners_in_parents
from softcal.mechanics.elements import DEFAULT
from softcal.twin.finer import elevated, halved, has_lower, size
from softcal.twin.mesh_change import FinerTwin
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
    """The best evaluation of a problem with the change of its residuals on a finer mesh. Ctrl-C ends the computation
    alone.

    Parameters
    ----------
    problem, best
        The problem, and its best evaluation.
    max_unknowns
        Limit of the finer mesh; beyond it the error is not computed.
    """
    try:
        finer = on_finer_mesh(problem, best.theta, max_unknowns=max_unknowns)
        reason = finer if isinstance(finer, str) else unknown(finer.failure)
    except KeyboardInterrupt:
        finer, reason = "", unknown("its computation was stopped by the user")
    if isinstance(finer, str) or finer.loss is None:
        return WithMeshError(best, problem.uncertain, reason)
    # The change of each residual stands beside that by the uncertain parameters.
    blocks: list[Block] = []
    for own, other in zip(best.blocks, finer.blocks, strict=True):
        if own.experiment:
            n = len(own.residual)
            known = own.systematic if own.systematic is not None else np.zeros((n, len(problem.uncertain)))
            own = replace(own, systematic=np.column_stack([known, other.residual - own.residual]))
        blocks.append(own)
    return WithMeshError(replace(best, blocks=tuple(blocks)), (*problem.uncertain, MESH_ERROR), "", finer.n_solves)


def on_finer_mesh(problem: Problem, theta: Mapping[str, float], *, max_unknowns: int = UNKNOWNS) -> Evaluation | str:
    """The evaluation of a problem at theta on a finer mesh, or a sentence why there is none.

    Parameters
    ----------
    problem, theta
        The problem, and its parameters [SI by label].
    max_unknowns
        Limit of the finer mesh.
    """
    if problem.simulate is not None:
        return unknown("the twin is another engine's")
    robot = problem.robot
    is_lower = has_lower(robot, DEFAULT.name)
    elements = elevated(robot, DEFAULT.name) if is_lower else robot
    if (n := size(elements, 0 if is_lower else 1).unknowns) > max_unknowns:
        more = f"a finer one would have {n:,} unknowns, more than the limit of {max_unknowns:,}"
        return unknown(f"{more}. Try a coarser mesh, or softcal mesh-study RUN --unknowns {n}")
    try:
        return replace(problem, simulate=finer_twin(robot)).evaluate(theta)
    except MeshError as error:
        return unknown(str(error))


def finer_twin(robot: Robot) -> FinerTwin:
    """The robot's finer twin: one for all fits of it, so that it is built once."""
    if not (_LAST and _LAST[0][0] is robot):
        if has_lower(robot, DEFAULT.name):
            same = {body.name: np.tile(np.eye(4), (body.mesh.n_tets, 1, 1)) for body in robot.bodies}
            finer = FinerTwin(elevated(robot, DEFAULT.name), same)
        else:
            finer = FinerTwin(halved(robot), {body.name: corners_in_parents(body.mesh) for body in robot.bodies})
        _LAST[:] = [(robot, finer)]
    return _LAST[0][1]


_LAST: list[tuple[Robot, FinerTwin]] = []  # the last robot, with its finer twin


def unknown(reason: str) -> str:
    """The sentence that the error of the mesh is not known."""
    return f"The error of the mesh is not known: {reason.removesuffix('.')}."
