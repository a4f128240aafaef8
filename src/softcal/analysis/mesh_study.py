"""What the mesh contributes to a calibration: the twin at its optimum once more on better discretisations.

Standard errors hold for noise alone. A coarse mesh is too stiff, linear tets lock, and what is identified absorbs it.
Here the twin is simulated at the values found with its elements halved, and with higher elements on the same tets. From
the residuals r there and their exact jacobian J follows what a calibration on the better discretisation would find,

    dz = argmin loss(r(z) + J dz)   within the bounds,

Gauss-Newton's step in the search's own variables by the model that the search itself goes by (`LocalModel`: tensions as
powers of E). The same step on the mesh as it is is taken off, so that values that are not at the optimum, and what the
search left, do not count as the mesh's. With two halvings the channels are extrapolated to elements of no size, where
they go there at a sensible order (Richardson).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from softcal.analysis.mesh_changes import Change, changes_between, grouped
from softcal.calibration.local_model import LocalModel, Point
from softcal.calibration.loss import Block, rms, total
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.problem import Evaluation, Problem
from softcal.calibration.result import Estimate
from softcal.calibration.sensitivity import local_statistics
from softcal.checks import Floats
from softcal.errors import MeshError, SimulationError
from softcal.twin.finer import ELEMENT_RANK, Size, elevated, halved, size
from softcal.twin.parameters import robot_parameters
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import ElementKind, Robot
from softcal.twin.simulate import simulate

LIMIT = "limit"
UNKNOWNS = 150_000  # a minute or two for a curve
TOLERANCE = 1e-5  # of a curve between its nodes, over a channel's largest value: what the mesh changes must stand out
ORDERS = (0.5, 6.0)  # of convergence, that are believed
_OFF = 2e-3  # of the search range: values that far from the optimum are not at it
# Told at the beginning and after each trajectory: the discretisation, and how many of how many (None: not known yet).
Observer = Callable[[str, int, int | None], None]


@dataclass(frozen=True)
class Finer:
    """A better discretisation: what it is, and what came of it at the values that were found; or why nothing did.

    size: None of the limit. loss: there; reachable: after what a calibration on it would change, by the model; values:
    what it would find [SI by label]; at_bound: labels of those that then stand at a bound.
    """

    name: str
    what: str
    size: Size | None
    failure: str = ""
    loss: float | None = None
    reachable: float | None = None
    changes: tuple[Change, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict[str, float])
    at_bound: tuple[str, ...] = ()
    n_factorisations: int = 0
    seconds: float = 0.0


@dataclass(frozen=True)
class MeshStudy:
    """What the mesh contributes.

    parameters: what was found, with the noise's standard errors and intervals; of_robot: labels of those that are the
    robot's own, not the rig's. elements: in the robot's bodies; element: what they were raised to. reference: name of
    the discretisation to judge by, "" where none could be simulated.
    """

    parameters: Mapping[str, Estimate]
    of_robot: tuple[str, ...]
    loss: float
    loss_name: str
    elements: tuple[str, ...]
    element: str
    size: Size
    finer: tuple[Finer, ...]
    reference: str
    notes: tuple[str, ...] = ()

    @property
    def best(self) -> Finer | None:
        """The discretisation to judge by."""
        return next((one for one in self.finer if one.name == self.reference), None)


def mesh_study(
    problem: Problem,
    theta: Mapping[str, float],
    *,
    element: ElementKind = "P2P1",
    halvings: int = 2,
    max_unknowns: int = UNKNOWNS,
    progress: Observer | None = None,
) -> MeshStudy:
    """Simulate a problem at theta [SI by label] on better discretisations, and tell what they would change.

    Parameters
    ----------
    element
        What bodies of lower elements are raised to, on the tets as they are and on those halved once.
    halvings
        How often elements are halved, each tet then being eight.
    max_unknowns
        Larger discretisations are left out, and say so.

    Raises
    ------
    SimulationError
        Where the twin cannot be simulated at theta as it is.
    InputError
        Where a value is outside what its parameter may be.
    """
    told = progress or (lambda name, done, of: None)
    base = _evaluated(problem, problem.robot, theta, partial(told, "as it is"), None)
    if base.loss is None:
        raise SimulationError(f"The twin cannot be simulated at the values to be studied. {base.failure}")
    model = _Model(problem, base)
    raised = elevated(problem.robot, element)
    is_lower = any(ELEMENT_RANK[body.element] < ELEMENT_RANK[element] for body in problem.robot.bodies)
    plans = [(element, f"{element} elements on the same tets", raised, 0)] if is_lower else []
    plans += [(f"h/{2**n}", _halved_words(n), problem.robot, n) for n in range(1, halvings + 1)]
    if is_lower and halvings:
        plans.append((f"{element} h/2", f"{element} elements, {_halved_words(1)}", raised, 1))
    found: list[Finer] = []
    seen: dict[str, Evaluation] = {}
    for name, what, robot, n in plans:
        one, evaluation = _simulated(model, (name, what, robot, n), theta, max_unknowns, partial(told, name))
        found.append(one)
        if evaluation is not None:
            seen[name] = evaluation
    if "h/2" in seen and "h/4" in seen and (limit := _limit(model, seen["h/2"], seen["h/4"])) is not None:
        found.append(limit)
    of_robot = robot_parameters(problem.robot)
    labels = [p.label for p in problem.space.parameters if any(target in of_robot for target in p.targets)]
    higher = [f"{element} h/2", element] if is_lower else []
    done = {one.name for one in found if not one.failure}
    reference = next((name for name in (*higher, LIMIT, "h/4", "h/2") if name in done), "")
    return MeshStudy(
        parameters=model.parameters,
        of_robot=tuple(labels),
        loss=base.loss,
        loss_name=problem.loss.name,
        elements=tuple(dict.fromkeys(body.element for body in problem.robot.bodies)),
        element=element,
        size=size(problem.robot),
        finer=tuple(found),
        reference=reference,
        notes=tuple(_notes(model, reference)),
    )


class _Model:
    """The problem around the values found: what its own mesh gives there, and what other blocks would shift."""

    def __init__(self, problem: Problem, base: Evaluation) -> None:
        space = problem.space
        self.problem, self.base = problem, base
        self.z = np.clip(space.to_search(base.theta), 0.0, 1.0)
        # What is left to gain on the mesh as it is: nothing, where the values are the optimum.
        self.own_step = self._minimum(base.blocks)[0] - self.z
        statistics = local_statistics(space, problem.loss, base.theta, base.blocks)
        self.parameters = statistics.estimates(space, base.theta)

    @property
    def space(self) -> SearchSpace:
        return self.problem.space

    def judged(self, blocks: Sequence[Block], one: Finer, orders: Mapping[tuple[str, str], float]) -> Finer:
        """A discretisation with what its blocks change and would shift."""
        z, reachable = self._minimum(blocks)
        values = self.space.to_model(np.clip(z - self.own_step, 0.0, 1.0))
        bound = self.space.at_bound(values)
        return replace(
            one,
            loss=total(self.problem.loss, blocks),
            reachable=reachable,
            changes=changes_between(self.problem, self.base.blocks, blocks, orders),
            values=values,
            at_bound=tuple(label for label, is_at in bound.items() if is_at),
        )

    def _minimum(self, blocks: Sequence[Block]) -> tuple[Floats, float]:
        model = LocalModel(self.space, self.problem.loss, Point(self.z, blocks))
        z = model.minimise(np.zeros(self.space.size), np.ones(self.space.size))
        return z, model.loss(z)


_Plan = tuple[str, str, Robot, int]


def _simulated(
    model: _Model, plan: _Plan, theta: Mapping[str, float], max_unknowns: int, told: Callable[[int, int | None], None]
) -> tuple[Finer, Evaluation | None]:
    name, what, robot, n = plan
    one = Finer(name, what, size(robot, n))
    if one.size is not None and one.size.unknowns > max_unknowns:
        failure = f"It would have {one.size.unknowns:,} unknowns, more than the limit of {max_unknowns:,}."
        return replace(one, failure=failure), None
    began = time.perf_counter()
    try:
        for _ in range(n):
            robot = halved(robot)
        found = _evaluated(model.problem, robot, theta, told, model.base.n_solves)
    except MeshError as error:
        return replace(one, failure=str(error)), None
    cost = replace(one, n_factorisations=found.n_factorisations, seconds=time.perf_counter() - began)
    if found.loss is None:
        return replace(cost, failure=found.failure), None
    return model.judged(found.blocks, cost, {}), found


def _evaluated(
    problem: Problem,
    robot: Robot,
    theta: Mapping[str, float],
    told: Callable[[int, int | None], None],
    n_trajectories: int | None,
) -> Evaluation:
    done = 0
    solve = problem.simulate or partial(simulate, curve_tolerance=TOLERANCE)

    def counted(
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response:
        nonlocal done
        response = solve(robot, protocol, theta, sensitivities=sensitivities, snapshots=snapshots)
        done += 1
        told(done, n_trajectories)
        return response

    told(done, n_trajectories)
    return replace(problem, robot=robot, simulate=counted).evaluate(theta, jacobian=True)


def _limit(model: _Model, once: Evaluation, twice: Evaluation) -> Finer | None:
    """Elements of no size, extrapolated from the twin as it is and halved once and twice; None where nothing can be.

    A channel that does not go there at a sensible order stays as it is on the finest mesh.
    """
    groups = grouped(model.base.blocks)
    blocks = list(twice.blocks)
    orders: dict[tuple[str, str], float] = {}
    for key, members in groups.items():
        first, second, third = (
            np.concatenate([found[i].measured + found[i].residual for i in members])
            for found in (model.base.blocks, once.blocks, twice.blocks)
        )
        left = _convergence(first, second, third)
        if left is None:
            continue
        orders[key] = -math.log2(left)
        for i in members:
            blocks[i] = _extrapolated(once.blocks[i], blocks[i], left / (1.0 - left))
    if not orders:
        return None
    what = "extrapolated to elements of no size"
    return model.judged(blocks, Finer(LIMIT, what, None), orders)


def _extrapolated(before: Block, after: Block, share: float) -> Block:
    """A block that goes on from the last by a share of the last change, and its derivatives with it."""
    jacobian = after.jacobian
    if jacobian is not None and before.jacobian is not None:
        jacobian = jacobian + share * (jacobian - before.jacobian)
    return replace(after, residual=after.residual + share * (after.residual - before.residual), jacobian=jacobian)


def _convergence(first: Floats, second: Floats, third: Floats) -> float | None:
    """What a halving leaves of a channel's change by the one before it; None where that gives no sensible order."""
    before, after = second - first, third - second
    if rms(after) <= 2.0 * TOLERANCE * float(np.abs(third).max(initial=0.0)):
        return None
    left = float(before @ after) / max(float(before @ before), 1e-300)
    if not 2.0 ** -ORDERS[1] <= left <= 2.0 ** -ORDERS[0]:
        return None
    return left if float(np.linalg.norm(after - left * before)) <= 0.5 * float(np.linalg.norm(after)) else None


def _halved_words(n: int) -> str:
    return "every element halved" if n == 1 else f"every element halved {'twice' if n == 2 else f'{n} times'}"


def _notes(model: _Model, reference: str) -> list[str]:
    notes: list[str] = []
    own = model.space.to_model(np.clip(model.z + model.own_step, 0.0, 1.0))
    off = [
        label
        for (label, e), step in zip(model.parameters.items(), np.abs(model.own_step), strict=True)
        if step > (_OFF if e.standard_error else 10.0 * _OFF)
        and not e.at_bound
        and abs(own[label] - e.value) > (e.standard_error or 0.0)
    ]
    if off:
        notes.append(
            f"The values studied are not those of least loss on the mesh as it is ({', '.join(off)}): shifts are those "
            "of the optimum, told from the values studied."
        )
    if reference.endswith("h/2"):
        notes.append(
            "What further halvings would change is not in what is expected: some third of what the last one did, where "
            "the error falls with the square of the elements' size; more at notches and clamped edges."
        )
    elif reference in ELEMENT_RANK:
        notes.append(f"The error of {reference} elements themselves on these tets is not in what is expected.")
    return notes
