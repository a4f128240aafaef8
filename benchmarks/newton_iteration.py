"""One Newton iteration over the bare numeric factorisation of the same matrix."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.neck_case import PULL, standard_robot
from benchmarks.section import Goal, Section, run_alone
from benchmarks.timing import interleaved, milliseconds, mkl_threads
from softcal.checks import Floats, Ints
from softcal.mechanics import touched_pattern
from softcal.mechanics.linear_solve import Pardiso
from softcal.mechanics.node import Line, node_at
from softcal.mechanics.path import follow
from softcal.mechanics.solid import SolidTerm
from softcal.mechanics.state import State, moved, rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls
from softcal.twin.build import Twin, build_twin
from softcal.twin.parameters import parameter_values
from softcal.twin.robot import Robot

LIMIT = 1.8
ELEMENTS: tuple[str, ...] = ("P1", "P2P1")


@dataclass
class Watch:
    """Counts the seconds spent in an object's methods by name, and keeps the last arguments."""

    watched: Any
    seconds: dict[str, float] = field(default_factory=dict)
    arguments: dict[str, tuple[Any, ...]] = field(default_factory=dict)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.watched, name)
        if not callable(found):
            return found

        def timed(*arguments: Any) -> Any:
            start = time.perf_counter()
            try:
                return found(*arguments)
            finally:
                self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
                self.arguments[name] = arguments

        return timed


@dataclass(frozen=True)
class Midway:
    """A twin pulled to half way, and the controls of the next step: where an iteration has everything to do."""

    twin: Twin
    theta: dict[str, float]
    state: State
    controls: Controls

    def iterate(self, statics: Statics) -> tuple[float, float]:
        """What `Statics.equilibrium` does in one iteration; seconds of its linearisation, and of the whole."""
        start = time.perf_counter()
        at = statics.system.linearise(self.state, self.controls, self.theta)
        linearised = time.perf_counter()
        statics.norm(at)
        statics.factorise(at)
        moved(statics.system.layout, self.state, -statics.solve(at.reduced))
        return linearised - start, time.perf_counter() - start


def midway(element: str, robot: Robot | None = None) -> Midway:
    """Of the standard neck, or of another robot with its cable."""
    robot = standard_robot(element) if robot is None else robot
    twin = build_twin(robot)
    theta = parameter_values(robot)
    statics = Statics(twin.system, theta)
    line = Line(np.array([False]), np.zeros(1), np.zeros(1), np.zeros(1), np.ones(1))
    start = node_at(statics, line, 0.0, rest_state(twin.system.layout), ())
    path = follow(statics, line, start, 0.5 * PULL, first_step=0.25 * PULL)
    if not path.reached:
        raise RuntimeError(path.status)
    return Midway(twin, theta, path.nodes[-1].state, line.at(0.6 * PULL))


def measure(quick: bool) -> Section:
    repeats = {"P1": 30, "P2P1": 5} if quick else {"P1": 300, "P2P1": 40}
    header = ["element", "tets", "unknowns", "MKL threads", "assembly", "reduction", "factorisation", "solve", "rest",
              "iteration", "bare", "iteration / bare"]  # fmt: skip
    rows: list[list[str]] = []
    goals: list[Goal] = []
    for element in ELEMENTS:
        case = midway(element)
        for n_threads in (1, 2):
            with mkl_threads(n_threads):
                ratio, row = _measured(case, repeats[element])
            n_tets = sum(len(s.conn) for s in case.twin.system.of(SolidTerm))
            n = case.twin.system.layout.n_unknowns
            rows.append([element, f"{n_tets:,}", f"{n:,}", str(n_threads), *row])
            what = f"Newton iteration over bare factorisation, {element}, {n_threads} MKL thread(s)"
            goals.append(Goal(what, ratio, LIMIT))
    notes = [
        "Milliseconds. *Iteration*: residual and tangent, their reduction to the plate, the residual's norm, numeric "
        "factorisation, solve (the cable's border column and the step), update of the state, half way through the "
        "40 mm pull. *Bare*: MKL PARDISO's phase 22 on the very same values. The two are called in turn "
        f"({repeats['P1']} rounds P1, {repeats['P2P1']} P2P1) and their medians compared; the parts are timed in "
        "rounds of their own. Only tets that can deform are counted."
    ]
    return Section("One Newton iteration", header, rows, goals, notes)


def _measured(case: Midway, repeats: int) -> tuple[float, list[str]]:
    """The ratio, and a row of medians [ms]."""
    parts, values = _parts(case, max(3, repeats // 2))
    statics = Statics(case.twin.system, case.theta)
    bare = Pardiso(case.twin.system.pattern.indptr, case.twin.system.pattern.indices)
    times = interleaved(
        {"iteration": lambda: case.iterate(statics), "bare": lambda: bare.factorise(values)}, repeats=repeats
    )
    statics.release()
    bare.release()
    whole, floor = (float(np.median(times[name])) for name in ("iteration", "bare"))
    return whole / floor, [*(milliseconds(part) for part in (*parts, whole, floor)), f"{whole / floor:.2f}"]


def _parts(case: Midway, repeats: int) -> tuple[Floats, Floats]:
    """Median seconds of assembly, reduction, factorisation, solve and the rest; and the values that are factorised."""
    factors: list[Watch] = []
    motion = Watch(case.twin.system.motion)

    def watched(indptr: Ints, indices: Ints, *, single: bool) -> Watch:
        factors.append(Watch(Pardiso(indptr, indices, single=single)))
        return factors[-1]

    statics = Statics(replace(case.twin.system, motion=motion), case.theta)  # type: ignore[arg-type]
    with mock.patch.object(touched_pattern, "factorisation", watched):
        case.iterate(statics)
    rows: list[list[float]] = []
    for _ in range(repeats):
        motion.seconds.clear()
        factors[0].seconds.clear()
        linearised, whole = case.iterate(statics)
        reduction = sum(motion.seconds.values())
        factorise, solve = factors[0].seconds["factorise"], factors[0].seconds["solve"]
        rows.append([linearised - reduction, reduction, factorise, solve, whole - linearised - factorise - solve])
    (values,) = factors[0].arguments["factorise"]
    statics.release()
    return np.median(rows, axis=0), values


if __name__ == "__main__":
    run_alone(measure)
