"""Mesh study of a calibration: the influence of the discretisation on the calibrated values.

Standard errors cover noise only. A coarse mesh is too stiff and linear tets lock; the calibrated parameters absorb
this error. The twin is simulated at the calibrated values with halved elements, and with higher-order elements on the
same tets. The residuals r there and their exact jacobian J give the estimate expected on that discretisation,

    dz = argmin loss(r(z) + J dz)   within the bounds,

a Gauss-Newton step in the variables of the search, with its local model (`LocalModel`: tensions as powers of E). The
same step on the original mesh is subtracted, so that a distance from the optimum does not count as a mesh error. With
two halvings the channels are extrapolated to zero element size (Richardson), if their order of convergence is
plausible.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from softcal.analysis.mesh_changes import Change, changes_between, grouped
from softcal.calibration.problem.loss import Block, rms, total
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.results.digits import shown, value_text, with_unit
from softcal.calibration.statistics.estimate import Estimate
from softcal.calibration.statistics.local_model import LocalModel, Point
from softcal.calibration.statistics.mesh_error import UNKNOWNS
from softcal.calibration.statistics.sensitivity import local_statistics
from softcal.checks import Floats
from softcal.display import displayed
from softcal.errors import MeshError, SimulationError
from softcal.executors.each import LostCall, each, executor_of
from softcal.executors.executor import Executor
from softcal.html_text import summary
from softcal.mechanics.elements import DEFAULT, ELEMENTS
from softcal.twin.finer import Size, elevated, halved, has_lower, size
from softcal.twin.parameters import robot_parameters
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

LIMIT = "limit"
TOLERANCE = 1e-5  # of the interpolation over a channel's largest value: well below the changes by the mesh
ORDERS = (0.5, 6.0)  # plausible orders of convergence
_OFF = 2e-3  # of the search range: a larger distance from the optimum is reported
# Called at the start and after each trajectory: the discretisation, trajectories done, and their total (None: unknown).
Observer = Callable[[str, int, int | None], None]


@displayed
@dataclass(frozen=True)
class Finer:
    """One finer discretisation and its results at the calibrated values, or why there are none.

    Attributes
    ----------
    name
        Short name, such as "h/2".
    what
        Description in words.
    size
        Numbers of tets, rod elements and unknowns; None for the extrapolated limit.
    failure
        Why it was not simulated, or "".
    loss
        Loss at the calibrated values.
    reachable
        Loss after the expected shifts, by the local model.
    changes
        Changes of the channels.
    values
        Label -> value expected from a calibration on it [SI].
    at_bound
        Labels of the expected values at a bound.
    n_factorisations
        Cost: matrix factorisations.
    seconds
        Cost: time [s].
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


@displayed
@dataclass(frozen=True)
class MeshStudy:
    """Result of a mesh study.

    Attributes
    ----------
    parameters
        Label -> calibrated estimate, with standard error and interval from noise.
    of_robot
        Labels of the robot's parameters, without the rig's.
    loss, loss_name
        Loss on the original mesh, and its name.
    elements
        Element kinds of the robot's bodies.
    element
        Element kind to which they were raised.
    size
        Size of the original discretisation.
    finer
        The finer discretisations.
    reference
        Name of the discretisation to judge by; "" if none could be simulated.
    notes
        Remarks for the reader.
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

    def _repr_html_(self) -> str:
        from softcal.analysis.mesh_verdict import mesh_verdicts

        finer = [one for one in self.finer if not one.failure]
        rows = [
            [label, value_text(estimate), *(with_unit(estimate, shown(estimate, one.values[label])) for one in finer)]
            for label, estimate in self.parameters.items()
        ]
        header = ["parameter", "on its mesh", *(one.name for one in finer)]
        told = [*self.notes, *(one.text for one in mesh_verdicts(self))]
        return summary("What the mesh makes of the parameters", header, rows, told)

    @property
    def best(self) -> Finer | None:
        """The discretisation to judge by."""
        return next((one for one in self.finer if one.name == self.reference), None)


def mesh_study(
    problem: Problem,
    theta: Mapping[str, float],
    *,
    element: str = DEFAULT.name,
    halvings: int = 2,
    max_unknowns: int = UNKNOWNS,
    workers: int | Executor = 1,
    progress: Observer | None = None,
) -> MeshStudy:
    """Simulate a problem at theta [SI by label] on finer discretisations, and predict the shift of its estimates.

    Parameters
    ----------
    element
        Element to which bodies of lower order are raised, on the original tets and on those halved once.
    halvings
        Number of refinements by halving; each divides a tet into eight.
    max_unknowns
        Limit of unknowns; larger discretisations are skipped with a reason.
    workers
        An executor, or a number of processes: a discretisation for each.

    Raises
    ------
    SimulationError
        If the twin cannot be simulated at theta on its own mesh.
    InputError
        If a value is outside its parameter's range.
    """
    observer = progress or (lambda name, done, of: None)
    base = _evaluated(problem, problem.robot, theta, partial(observer, "original"), None)
    if base.loss is None:
        raise SimulationError(f"The twin cannot be simulated at the values to be studied. {base.failure}")
    model = _Model(problem, base)
    raised = elevated(problem.robot, element)
    is_lower = has_lower(problem.robot, element)
    plans = [(element, f"{element} elements on the same tets", raised, 0)] if is_lower else []
    plans += [(f"h/{2**n}", _halved_words(n), problem.robot, n) for n in range(1, halvings + 1)]
    if is_lower and halvings:
        plans.append((f"{element} h/2", f"{element} elements, {_halved_words(1)}", raised, 1))
    found: list[Finer] = []
    seen: dict[str, Evaluation] = {}
    with executor_of(workers) as executor:
        outcomes = _each_simulated(executor, _Plans(model, plans, theta, max_unknowns), observer)
    for (name, *_), (one, evaluation) in zip(plans, outcomes, strict=True):
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
    """Local model of the problem at the calibrated values, from the original mesh; predicts shifts by other blocks."""

    def __init__(self, problem: Problem, base: Evaluation) -> None:
        space = problem.space
        self.problem, self.base = problem, base
        self.z = np.clip(space.to_search(base.theta), 0.0, 1.0)
        # Step to the optimum on the original mesh: zero if the values are optimal.
        self.own_step = self._minimum(base.blocks)[0] - self.z
        statistics = local_statistics(space, problem.loss, base.theta, base.blocks, problem.uncertain)
        self.parameters = statistics.estimates(space, base.theta)

    @property
    def space(self) -> SearchSpace:
        return self.problem.space

    def judged(self, blocks: Sequence[Block], one: Finer, orders: Mapping[tuple[str, str], float]) -> Finer:
        """A discretisation with the changes and shifts by its blocks."""
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


@dataclass(frozen=True)
class _Plans:
    """Model common to all discretisations of a study, and the plan of each."""

    model: _Model
    plans: Sequence[_Plan]
    theta: Mapping[str, float]
    max_unknowns: int

    def simulated(
        self, k: int, observer: Callable[[int, int | None], None] = lambda done, of: None
    ) -> tuple[Finer, Evaluation | None]:
        """Simulate discretisation k."""
        plan = self.plans[k]
        name, what, robot, n = plan
        one = Finer(name, what, size(robot, n))
        if one.size is not None and one.size.unknowns > self.max_unknowns:
            failure = f"It would have {one.size.unknowns:,} unknowns, more than the limit of {self.max_unknowns:,}."
            return replace(one, failure=failure), None
        began = time.perf_counter()
        try:
            for _ in range(n):
                robot = halved(robot)
            found = _evaluated(self.model.problem, robot, self.theta, observer, self.model.base.n_solves)
        except MeshError as error:
            return replace(one, failure=str(error)), None
        cost = replace(one, n_factorisations=found.n_factorisations, seconds=time.perf_counter() - began)
        if found.loss is None:
            return replace(cost, failure=found.failure), None
        return self.model.judged(found.blocks, cost, {}), found


def _each_simulated(executor: Executor, plans: _Plans, observer: Observer) -> list[tuple[Finer, Evaluation | None]]:
    """Simulate every discretisation; the observer is called for each trajectory in this process, or for each
    discretisation with other workers.
    """
    names = [name for name, *_ in plans.plans]
    if executor.alone:
        return [plans.simulated(k, partial(observer, name)) for k, name in enumerate(names)]
    found: list[tuple[Finer, Evaluation | None]] = []
    for k, one in enumerate(each(executor, _Plans.simulated, plans, [(k,) for k in range(len(names))])):
        name, what, *_ = plans.plans[k]
        found.append((Finer(name, what, None, failure=one.why), None) if isinstance(one, LostCall) else one)
        observer(name, 1, 1)
    return found


def _evaluated(
    problem: Problem,
    robot: Robot,
    theta: Mapping[str, float],
    observer: Callable[[int, int | None], None],
    n_trajectories: int | None,
) -> Evaluation:
    done = 0
    solve = problem.simulate or partial(simulate, curve_tolerance=TOLERANCE)

    def counted(*given: Any, **options: Any) -> Response:
        nonlocal done
        response = solve(*given, **options)
        done += 1
        observer(done, n_trajectories)
        return response

    observer(done, n_trajectories)
    return replace(problem, robot=robot, simulate=counted).evaluate(theta, jacobian=True)


def _limit(model: _Model, once: Evaluation, twice: Evaluation) -> Finer | None:
    """Limit of zero element size, extrapolated from the original mesh, halved once and twice; None if impossible.

    A channel without a plausible order of convergence keeps its values of the finest mesh.
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
            # The last block plus a share of the last change; likewise its derivatives.
            before, after, share = once.blocks[i], blocks[i], left / (1.0 - left)
            jacobian = after.jacobian
            if jacobian is not None and before.jacobian is not None:
                jacobian = jacobian + share * (jacobian - before.jacobian)
            residual = after.residual + share * (after.residual - before.residual)
            blocks[i] = replace(after, residual=residual, jacobian=jacobian)
    if not orders:
        return None
    what = "extrapolated to zero element size"
    return model.judged(blocks, Finer(LIMIT, what, None), orders)


def _convergence(first: Floats, second: Floats, third: Floats) -> float | None:
    """Ratio of a channel's successive changes by halving; None if it gives no plausible order of convergence."""
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
            f"The studied values do not minimise the loss on the original mesh ({', '.join(off)}): shifts are those of "
            "the optimum, given from the studied values."
        )
    if reference.endswith("h/2"):
        notes.append(
            "The expected values do not include further halvings: about a third of the last change, if the error "
            "decreases with the square of the element size; more at notches and clamped edges."
        )
    elif reference in ELEMENTS:
        notes.append(f"The expected values do not include the error of {reference} elements on these tets.")
    return notes
