"""Paper B's manipulator: its sweep, one run with springs as rods and as solids, least squares over all loads."""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

import softcal
from benchmarks.section import Goal, Section, run_alone
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.losses.distance import DistanceLoss
from softcal.calibration.problem.parameters import FreeParameter, split
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.problem.rig import Rig
from softcal.calibration.run import calibrate
from softcal.calibration.sweep import sweep
from softcal.experiments.dataset import Channel, Dataset
from softcal.project.project import load
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

TEMPLATE = Path(softcal.__file__).parent / "templates" / "manipulator" / "project.yaml"
LENGTH = 0.425  # [m], paper B's
CABLES = tuple(f"cable{k + 1}" for k in range(6))
FORCES = (9.81, 14.715, 19.62)  # [N]: 1, 1.5 and 2 kgf
TRUE = {f"spring{k + 1}.youngs_modulus": E for k, E in enumerate((0.7e9, 0.85e9, 1.0e9, 0.75e9))}
NOISE = 5e-4  # [m], of each coordinate
E, NU = "springs.youngs_modulus", "springs.poissons_ratio"
AXES = {
    E: [1e9 * n for n in range(10, 0, -1)],
    NU: [0.4999, *(round(0.05 * n, 2) for n in range(9, 0, -1))],  # 0.5 itself is no ratio that can be computed with
}
FREE = (
    FreeParameter(E, "Pa", 0.2e9, 10e9, "log", start=1.6e9, of=("spring*.youngs_modulus",)),
    FreeParameter(NU, "1", 0.05, 0.4999, start=0.43, of=("spring*.poissons_ratio",)),
)
WORKERS = 2
SWEEP_LIMIT, FIT_LIMIT = 120.0, 30.0  # [s]


def measure(quick: bool) -> Section:
    robot = load(TEMPLATE).robot
    rows: list[list[str]] = []
    goals = [_sweep(robot, quick, rows)]
    _single_runs(robot, quick, rows)
    goals += _least_squares(robot, quick, rows)
    notes = [
        "The manipulator of `softcal init manipulator`. Data: its own markers with springs of 0.7 to 1.0 GPa, "
        f"{1e3 * NOISE:g} mm of noise on every coordinate. The sweep is paper B's, cable 6 at 19.62 N: E 10 to 1 GPa "
        "by 1 GPa, ν 0.4999 in the place of 0.5, then 0.45 to 0.05 by 0.05. Single runs are of cable 6 to 19.62 N at "
        "the nominal values, without building the twin; paper B's took 150 to 1200 s each in SOFA.",
    ]
    if quick:
        notes.append("**Quick**: nine cells (the time in them multiplied), solids of linear tets, three load cases.")
    return Section("Paper B's manipulator", ["", "measured"], rows, goals, notes)


def _sweep(robot: Robot, quick: bool, rows: list[list[str]]) -> Goal:
    axes = {name: values[:: len(values) // 2 - 1] if quick else values for name, values in AXES.items()}
    n, whole = (int(np.prod([len(values) for values in grid.values()])) for grid in (axes, AXES))
    problem = _problem(robot, {"cable6": FORCES[-1:]}, FREE)
    began = time.perf_counter()
    found = sweep(problem, axes, workers=WORKERS)
    seconds = time.perf_counter() - began
    cells = [trial.seconds for trial in found.trials]
    solving = sum(cells) / WORKERS
    rows += [
        [f"sweep of {n} cells, {WORKERS} workers", f"{seconds:.1f} s"],
        ["of which a cell, median and longest", f"{np.median(cells):.2f} and {max(cells):.2f} s"],
        ["cells that could not be simulated", str(found.n_failed_trials)],
        [
            "best cell",
            f"E {found.parameters[E].value / 1e9:g} GPa, ν {found.parameters[NU].value:g}: {found.loss:.1f} %",
        ],
    ]
    expected = seconds - solving + solving * whole / n
    return Goal(f"paper B's sweep, {whole} cells, {WORKERS} workers", expected, SWEEP_LIMIT, "s")


def _single_runs(robot: Robot, quick: bool, rows: list[list[str]]) -> None:
    """One run of cable 6 to 19.62 N at the nominal values, rods and solids side by side."""
    element: str = "P1" if quick else "P2P1"
    solid = _with_solid_springs(element)
    n_tets = sum(len(body.mesh.tets) for body in solid.bodies)
    runs = {"rods": robot, f"solids, {n_tets} {element} tets": solid}
    for one in runs.values():
        _pull(one, 0.1)  # builds and compiles
    tips: list[np.ndarray] = []
    for name, one in runs.items():
        began = time.perf_counter()
        seen = _pull(one)
        seconds = time.perf_counter() - began
        tips.append(np.array([seen.channels[f"marker4.{axis}"][-1] for axis in "xyz"]))
        rows.append([f"one run, {name}", f"{seconds:.2f} s, {seen.n_factorisations} factorisations"])
    rows.append(["the two apart at marker4", f"{100 * np.linalg.norm(tips[1] - tips[0]) / LENGTH:.2f} % of the length"])


def _with_solid_springs(element: str) -> Robot:
    text = TEMPLATE.read_text(encoding="utf-8")
    rods, solids = "    springs:\n", f"    springs:\n      model: solid\n      element: {element}\n"
    if text.count(rods) != 1:
        raise RuntimeError(f"{TEMPLATE} is not written as this benchmark expects")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(shutil.copytree(TEMPLATE.parent, folder, dirs_exist_ok=True)) / TEMPLATE.name
        # A spring of solids has no elements along its wire.
        kept = [line for line in text.splitlines(keepends=True) if "elements_per_turn" not in line]
        path.write_text("".join(kept).replace(rods, solids), encoding="utf-8")
        return load(path).robot


def _least_squares(robot: Robot, quick: bool, rows: list[list[str]]) -> list[Goal]:
    cables = CABLES[::6] if quick else CABLES
    tied = _problem(robot, dict.fromkeys(cables, FORCES), FREE[:1])
    each = Problem(tied.robot, tied.experiments, split(tied.space, E, tied.known), tied.loss)
    goals: list[Goal] = []
    for what, problem in (("one modulus", tied), ("a modulus for each spring", each)):
        began = time.perf_counter()
        found = calibrate(problem, method="least-squares")
        seconds = time.perf_counter() - began
        n = len(cables) * len(FORCES)
        values = ", ".join(f"{estimate.value / 1e9:.4g}" for estimate in found.parameters.values())
        told = f"{seconds:.1f} s, {len(found.trials)} trajectories of all cables: E {values} GPa, {found.loss:.2f} %"
        rows.append([f"least squares, {n} load cases, {what}", told])
        goals.append(Goal(f"least squares over {n} load cases, {what}", seconds, FIT_LIMIT, "s"))
    return goals


def _problem(robot: Robot, pulls: dict[str, tuple[float, ...]], free: tuple[FreeParameter, ...]) -> Problem:
    """The markers at each force on each cable, as the robot with the true springs has them, with noise."""
    chance = np.random.default_rng(0)
    experiments: list[Experiment] = []
    for cable, forces in pulls.items():
        seen = simulate(robot, _tension(cable, forces), TRUE, curve_tolerance=0.0)
        if not seen.succeeded:
            raise RuntimeError(seen.status)
        channels = {f"{cable}.tension": Channel(np.array(forces), "N")}
        for marker in (f"marker{k + 1}" for k in range(4)):
            for name in (f"{marker}.{axis}" for axis in "xyz"):
                values = seen.channels[name] + NOISE * chance.standard_normal(len(forces))
                channels[name] = Channel(values, "m", NOISE)
        data = Dataset(cable, channels)
        experiments.append(Experiment(cable, data, drive=(f"{cable}.tension",), rig=Rig(length=LENGTH)))
    return make_problem(robot, experiments, free, DistanceLoss(LENGTH))


def _pull(robot: Robot, force: float = FORCES[-1]) -> Response:
    seen = simulate(robot, _tension("cable6", (force,)))
    if not seen.succeeded:
        raise RuntimeError(seen.status)
    return seen


def _tension(cable: str, forces: tuple[float, ...]) -> Protocol:
    return Protocol({cable: Command("tension", np.array(forces))})


if __name__ == "__main__":
    run_alone(measure)
