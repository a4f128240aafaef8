"""Commands for random poses: how many are reached, how fast, beside SciPy's SLSQP and least_squares on the same twin.

python -m benchmarks.reach --targets 10000 --compared 200 --unreachable 1000
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.machine import load, machine
from benchmarks.neck_case import P1_TETS
from benchmarks.section import Goal, Section, table
from benchmarks.timing import mkl_threads
from benchmarks.written_page import written_page
from softcal.analysis.reach import TOLERANCES, ReachStep, reach_targets
from softcal.checks import Floats
from softcal.geometry.neck import Neck
from softcal.geometry.obstacle import HalfSpace, SphereObstacle
from softcal.geometry.primitives import box_mesh
from softcal.twin.cables import CableLine
from softcal.twin.live import LiveState, LiveTwin
from softcal.twin.manipulator import Manipulator, Springs, manipulator
from softcal.twin.robot import Body, Cable, Control, Plate, Robot, ViaPoint
from softcal.workflows.reach import asked, reach

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reach.md"
SEED = 1
AROUND, CLOSER = (1e-2, 1e-3), 1e-3  # sizes of steps around an end, of its largest command; of the error
SAME = 1e-4  # of the distance, by which the nearest state may be further than that of a brute search


@dataclass(frozen=True)
class Case:
    """A robot, the channels that are wanted, and the tensions from which targets are made and within which they are
    sought [N].
    """

    name: str
    robot: Robot
    channels: tuple[str, ...]
    drawn: float
    most: float
    control: Control = "tension"


def neck(n_cables: int) -> Robot:
    """The published neck with linear tets, under cables around it at 50 mm."""
    shape = Neck(tets=P1_TETS, order=1)
    mesh = shape.mesh()
    material = {"youngs_modulus": 2.3e6, "poissons_ratio": 0.43}
    body = Body("neck", mesh, mesh.node_sets["socket"], material, element="P1")
    plate = Plate("plate", {"neck": mesh.node_sets["collar"]}, np.array([0.0, 0.0, shape.height]))
    cables: list[Cable] = []
    for k in range(n_cables):
        x, y = 0.05 * np.cos(2 * np.pi * k / n_cables), 0.05 * np.sin(2 * np.pi * k / n_cables)
        ends = ViaPoint((x, y, shape.height), "plate"), ViaPoint((x, y, shape.clamp_depth))
        cables.append(Cable(f"cable{k + 1}", ends))
    return Robot((body,), (plate,), tuple(cables))


def tentacle() -> Robot:
    """Of silicone, hanging, with three tendons whose friction reverses."""
    width, length = 0.018, 0.12
    mesh = box_mesh((width, width, length), (2, 2, 6), origin=(-width / 2, -width / 2, -length))
    material = {"youngs_modulus": 140e3, "poissons_ratio": 0.49}
    body = Body("tentacle", mesh, mesh.node_sets["z1"], material, element="P1", density=1070.0)
    tip = Plate("tip", {"tentacle": mesh.node_sets["z0"]}, (0.0, 0.0, -length), mass=0.004)
    cables: list[Cable] = []
    for k, name in enumerate(("front", "left", "right")):
        x, y = 0.006 * np.cos(2 * np.pi * k / 3 + 0.3), 0.006 * np.sin(2 * np.pi * k / 3 + 0.3)
        inside = [ViaPoint((x, y, z), "tentacle") for z in (-0.02, -0.045, -0.07, -0.095)]
        via = (ViaPoint((x, y, 0.005)), *inside, ViaPoint((x, y, -length), "tip"))
        line = CableLine(friction_memory=True)
        cables.append(Cable(name, via, pulled_end="first", friction_coefficient=0.1, line=line))
    return Robot((body,), (tip,), tuple(cables), gravity=np.array([0.0, 0.0, -9.81]))


def draw(path: Path) -> None:
    """The tentacle beside a ball that is in the way of its target, over a table, as the page shows it."""
    around = {
        "ball": SphereObstacle(np.array([0.04, 0.0, -0.112]), 0.012),
        "table": HalfSpace(np.array([0.0, 0.0, -0.13]), np.array([0.0, 0.0, 1.0])),
    }
    path.unlink(missing_ok=True)
    limits = {"tension": (0.0, 1.0)}
    reach(tentacle(), {"tip.x": 0.035, "tip.z": -0.11}, limits=limits, obstacles=around, picture=path)


def cases() -> list[Case]:
    springs, discs = Springs(youngs_modulus=1.6e9, poissons_ratio=0.43), ("S4.x", "S4.y", "S4.z", "S2.x", "S2.y")
    return [
        Case("neck, 1 cable", neck(1), ("plate.pitch",), 8.0, 10.0),
        Case("neck, 3 cables", neck(3), ("plate.pitch", "plate.roll", "plate.z"), 6.0, 8.0),
        Case("neck, 3 cables by shortening", neck(3), ("plate.pitch", "plate.roll"), 6.0, 8.0, "shortening"),
        Case("manipulator, 6 cables", manipulator(Manipulator(springs=springs)), discs, 8.0, 12.0),
        Case("tentacle, reversing friction", tentacle(), ("tip.x", "tip.y"), 0.8, 2.0),
    ]


def drawn(case: Case, n: int) -> list[dict[str, float]]:
    """Channels at random tensions, each a state from rest; of a robot that remembers one after the other."""
    random, live = np.random.default_rng(SEED), LiveTwin(case.robot, "tension")
    targets: list[dict[str, float]] = []
    while len(targets) < n:
        if not live.remembers:
            live.reset()
        tensions = random.uniform(0.0, case.drawn, len(live.actuators)).tolist()
        state = live.at({one.name: tension for one, tension in zip(live.actuators, tensions, strict=True)})
        if state.succeeded and not state.snaps:
            targets.append({name: state.channels[name] for name in case.channels})
    return targets


def found(case: Case, targets: Sequence[Mapping[str, float]]) -> tuple[list[ReachStep], list[float], int]:
    """The commands for each target from rest, of a robot that remembers one after the other; the time of each on the
    processor [s]; and how many targets are neither reached nor answered with a reason that holds.
    """
    live = LiveTwin(case.robot, case.control)
    wanted = {name: [one[name] for one in targets] for name in case.channels}
    task, each = asked(live, wanted, limits={"tension": (0.0, case.most)})
    steps, seconds, unanswered = list[ReachStep](), list[float](), 0
    every = reach_targets(live, task, each) if live.remembers else None
    for target in each:
        before, began = live.state if every and steps else live.reset(), time.process_time()
        steps.append(next(every or reach_targets(live, task, [target])))
        seconds.append(time.process_time() - began)
        here = live.state
        if steps[-1].outcome != "reached" and not holds(case, live, before, steps[-1]):
            unanswered += 1
            print(f"# {case.name}: {steps[-1].status}", file=sys.stderr, flush=True)
        live.return_to(here)
    return steps, seconds, unanswered


def holds(case: Case, live: LiveTwin, before: LiveState, step: ReachStep) -> bool:
    """Whether a target that is not reached is answered rightly: of random commands around those of the answer, none
    that are safe and within the limits come closer.
    """
    random, commands = np.random.default_rng(SEED), np.array(list(step.commands.values()))
    tolerance = np.array([TOLERANCES[live.units[name]] for name in step.wanted])
    own = float(np.linalg.norm(np.array(list(step.misses.values())) / tolerance))
    names = [one.name for one in live.actuators]
    for size in AROUND:
        for way in random.normal(size=(4 * len(names), len(names))):
            live.return_to(before)
            end = np.maximum(commands + size * max(np.abs(commands).max(), 1e-3) * way / np.linalg.norm(way), 0.0)
            state = live.at(dict(zip(names, end.tolist(), strict=True)))
            is_safe = state.succeeded and not state.snaps and not state.crossed
            error = np.array([state.channels[name] - value for name, value in step.wanted.items()])
            within = max(state.channels[f"{name}.tension"] for name in names) <= case.most
            if is_safe and within and np.linalg.norm(error / tolerance) < own * (1.0 - CLOSER) - 0.1:
                return False
    return True


@dataclass
class Posed:
    """A target as SciPy's functions take it: errors in tolerances and their derivatives by tensions, of the same twin;
    where it remembers, each from the same state before.
    """

    live: LiveTwin
    target: Mapping[str, float]
    tolerance: Floats
    begin: LiveState

    def at(self, tensions: Floats) -> tuple[Floats, Floats]:
        names = [one.name for one in self.live.actuators]
        if self.live.remembers:
            self.live.return_to(self.begin)
        state = self.live.at(dict(zip(names, np.maximum(tensions, 0.0).tolist(), strict=True)))
        if not state.succeeded:
            raise ArithmeticError(state.status)
        found = state.by_commands()
        rates = found.of(list(self.target))[:, [found.names.index(f"{name}.tension") for name in names]]
        error = np.array([state.channels[name] - value for name, value in self.target.items()])
        return error / self.tolerance, rates / self.tolerance[:, None]

    def improved(self, start: Floats, most: float, *, accuracy: float = 1e-12) -> Floats:
        """The tensions at which least_squares ends."""
        from scipy.optimize import least_squares

        end = least_squares(
            lambda T: self.at(T)[0],
            start,
            jac=lambda T: self.at(T)[1],
            bounds=(0.0, most),
            x_scale="jac",
            max_nfev=60,
            ftol=accuracy,
            xtol=1e-11,
        )
        return end.x

    def least(self, start: Floats, most: float) -> Floats:
        """The tensions of least effort at which SLSQP ends."""
        from scipy.optimize import minimize

        at = lru_cache(maxsize=4)(lambda T: self.at(np.frombuffer(T)))
        error, rates = (lambda T, k=k: 1e-3 * at(T.tobytes())[k] for k in range(2))
        end = minimize(
            lambda T: float(T @ T),
            start,
            jac=lambda T: 2.0 * T,
            method="SLSQP",
            bounds=[(0.0, most)] * len(start),
            constraints=[{"type": "eq", "fun": error, "jac": rates}],
            options={"maxiter": 100, "ftol": 1e-10},
        )
        return end.x


def posed(case: Case, live: LiveTwin, target: Mapping[str, float]) -> Posed:
    """A target from rest, or from the present state of a robot that remembers."""
    if not live.remembers:
        live.reset()
    tolerance = np.array([TOLERANCES[live.units[name]] for name in case.channels])
    return Posed(live, target, tolerance, live.state)


def by_scipy(
    case: Case, targets: Sequence[Mapping[str, float]], method: Callable[[Posed, Floats, float], Floats]
) -> list[str]:
    """Share of the targets reached, p50 and p99 [ms], by a function of SciPy from a tenth of the largest tension."""
    live, seconds, reached = LiveTwin(case.robot, "tension"), list[float](), list[bool]()
    for target in targets:
        problem, began = posed(case, live, target), time.process_time()
        try:
            end = method(problem, np.full(len(live.actuators), 0.1 * case.most), case.most)
            reached.append(bool(np.abs(problem.at(end)[0]).max() <= 1.0))
        except ArithmeticError:
            reached.append(False)
        seconds.append(time.process_time() - began)
    return [_share(reached), f"{1e3 * np.median(seconds):.0f}", f"{1e3 * np.quantile(seconds, 0.99):.0f}"]


def against_brute(case: Case, targets: Sequence[Mapping[str, float]], n_states: int) -> list[str]:
    """How many targets far outside are answered by a state as near as that of a brute search, the best of many within
    the limits improved by least_squares; and how many of the others are refused with a reason.
    """
    from scipy.stats import qmc

    random, live = np.random.default_rng(SEED + 1), LiveTwin(case.robot, "tension")
    tolerance = np.array([TOLERANCES[live.units[name]] for name in case.channels])
    rest = np.array([live.state.channels[name] for name in case.channels])
    points = qmc.Sobol(len(live.actuators), seed=SEED).random(n_states) * case.most
    points = np.concatenate([points, np.where(points > 0.5 * case.most, case.most, 0.0)])
    seen: list[tuple[Floats, Floats]] = []
    for point in points:
        live.reset()
        state = live.at({one.name: float(t) for one, t in zip(live.actuators, point, strict=True)})
        if state.succeeded and not state.snaps:
            seen.append((point, np.array([state.channels[name] for name in case.channels])))
    values = np.array([value for _, value in seen])
    goals = [rest + random.uniform(1.5, 3.0) * (np.array(list(target.values())) - rest) for target in targets]
    far = [dict(zip(case.channels, goal.tolist(), strict=True)) for goal in goals]
    near = refused = 0
    for goal, target, step in zip(goals, far, found(case, far)[0], strict=True):
        distance = np.linalg.norm((values - goal) / tolerance, axis=1)
        best = float(distance.min())
        for k in np.argsort(distance)[:3]:
            problem = posed(case, live, target)
            try:
                end = problem.improved(np.clip(seen[k][0], 1e-6, case.most - 1e-6), case.most, accuracy=1e-14)
                best = min(best, float(np.linalg.norm(problem.at(end)[0])))
            except ArithmeticError:
                continue
        own = float(np.linalg.norm(np.array(list(step.misses.values())) / tolerance))
        is_near = own <= best * (1.0 + SAME) + 1.0
        near += is_near
        refused += not is_near and step.outcome == "refused"
        if not is_near:
            print(f"# {case.name}: {own:.6g} against {best:.6g}; {step.status}", file=sys.stderr, flush=True)
    return [f"{near} of {len(far)}", str(refused)]


def measure(quick: bool, targets: int = 200, compared: int = 20, unreachable: int = 20) -> Section:
    n, few, far = (10, 5, 5) if quick else (targets, compared, unreachable)
    header = ["robot", "targets", "reached", "nearest or refused", "p50 [ms]", "p99 [ms]", "states", "compared",
              "SLSQP: reached", "p50 [ms]", "p99 [ms]", "least_squares: reached", "p50 [ms]", "p99 [ms]",
              "unreachable: nearest", "refused"]  # fmt: skip
    rows: list[list[str]] = []
    goals: list[Goal] = []
    with mkl_threads(1):
        for case in cases():
            wanted = drawn(case, max(n, few, far))
            found(case, wanted[:1])  # compiled
            steps, seconds, unanswered = found(case, wanted[:n])
            took = 1e3 * np.array(seconds)
            reached = [step.outcome == "reached" for step in steps]
            row = [case.name, str(n), _share(reached), str(n - sum(reached)), f"{np.median(took):.0f}",
                   f"{np.quantile(took, 0.99):.0f}", f"{np.mean([step.n_states for step in steps]):.1f}"]  # fmt: skip
            print(f"# {row}", file=sys.stderr, flush=True)
            row += [str(few), *by_scipy(case, wanted[:few], Posed.least), *by_scipy(case, wanted[:few], Posed.improved)]
            is_brute = not LiveTwin(case.robot).remembers
            rows.append([*row, *(against_brute(case, wanted[:far], 64 if quick else 256) if is_brute else ["", ""])])
            goals.append(Goal(f"Reach, {case.name}: not reached for no reason that holds", unanswered, 0))
            print(f"# {rows[-1]}", file=sys.stderr, flush=True)
    notes = [
        "Targets are the channels at random tensions, within the limits of the search; each is sought from rest, those "
        "of the tentacle one after the other. Reached: within 10 µm and 0.01 deg. Of the others, random commands "
        "around the answer are tried: none that are safe and within the limits come closer. Times are those on the "
        "processor, of one core. SciPy's functions have the same twin and exact derivatives, and start at a tenth of "
        "the largest "
        "tension. Unreachable targets are 1.5 to 3 times as far; nearest: as near, up to "
        f"{SAME:g}, as the best of many states improved by least_squares."
    ]
    return Section("Commands for wanted poses", header, rows, goals, notes)


def _share(these: Sequence[bool]) -> str:
    return f"{100.0 * np.mean(these):.4g} %"


def page(section: Section) -> str:
    """docs/reach.md with the figures of a section."""
    lines = [*table(section.header, section.rows), "", *section.notes]
    return written_page(PAGE, {"figures": "\n".join(lines), "load": load(), "processor": dict(machine())["processor"]})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="ten targets each, printed and not written")
    for name, default in (("targets", 200), ("compared", 20), ("unreachable", 20)):
        parser.add_argument(f"--{name}", type=int, default=default, help=f"of each robot; {default} by default")
    parser.add_argument("--out", type=Path, default=PAGE, help="where the page goes; docs/reach.md by default")
    given = parser.parse_args()
    section = measure(given.quick, given.targets, given.compared, given.unreachable)
    print(section.markdown())
    if not given.quick:
        given.out.write_text(page(section), encoding="utf-8")
        draw(given.out.with_suffix(".png"))


if __name__ == "__main__":
    main()
