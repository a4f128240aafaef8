"""Softcal and SOFA side by side on one mesh: a settled curve, paper A's pull in time, and a study of 1000 trials.

Needs SOFA_ROOT; where there is no SOFA the section says so and holds no numbers.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.neck_case import PITCH, PULL, TENSION, pull, standard_robot
from benchmarks.problems import known_problem
from benchmarks.section import Section, run_alone
from softcal.calibration.problem import Problem, Simulate
from softcal.calibration.run import calibrate
from softcal.errors import InputError
from softcal.export.sofa_engine import SofaEngine, sofa_engine
from softcal.export.sofa_export import write_sofa
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

TITLE = "SOFA side by side"
HEADER = ["what", "SOFA", "softcal", "ratio", "how far apart"]
STATES = 12
TRIALS, QUICK_TRIALS, STUDY = 8, 2, 1000
PULL_SECONDS = PULL / 2e-3  # [s], paper A's 2 mm/s
HERE = Path(__file__).resolve().parent


def measure(quick: bool) -> Section:
    try:
        engine = sofa_engine()
    except InputError as error:
        return Section(TITLE, HEADER, [], notes=[f"Not measured here: {error}"])
    robot = standard_robot("P1")
    repeats = 1 if quick else 3
    rows = [_curve(engine, robot, repeats), _pull_in_time(engine, robot, repeats), _study(engine, robot, quick)]
    n = QUICK_TRIALS if quick else TRIALS
    notes = [
        f"The P1 neck of {robot.bodies[0].mesh.n_tets:,} tets, one thread, one process at a time. *Settled curve*: "
        f"{STATES} shortenings up to 40 mm, each run to rest in SOFA (no node faster than 1e-6 m/s for 0.1 s), each "
        f"solved to equilibrium by softcal; medians of {repeats}. *Pull in time*: paper A's 2 mm/s with its step of "
        "0.01 s and its damping, the exported scene and controller as they are, against softcal's settled curve, since "
        "both papers read the pull as quasi-static. *Study*: paper A's TPE within its bounds for E and ν on the twin's "
        f"own tension and pitch, the same {n} trials in both. **Extrapolated**: their time multiplied by "
        f"{STUDY / n:g}; SOFA's include the start of a process for each, and those that never come to rest."
    ]
    return Section(TITLE, HEADER, rows, notes=notes)


def _curve(engine: SofaEngine, robot: Robot, repeats: int) -> list[str]:
    samples = pull(np.linspace(0.0, PULL, STATES + 1)[1:])
    in_sofa, theirs = _timed(engine, robot, samples, repeats)
    here, ours = _timed(_every_sample, robot, samples, repeats)
    apart = max(
        float(np.abs(theirs.channels[c] - ours.channels[c]).max() / np.abs(ours.channels[c]).max())
        for c in (TENSION, PITCH)
    )
    return [f"settled curve, {STATES} states", *_seconds(in_sofa, here), f"{apart:.1e} of tension and pitch"]


def _every_sample(robot: Robot, protocol: Protocol) -> Response:
    return simulate(robot, protocol, curve_tolerance=0.0)


def _timed(run: Simulate, robot: Robot, protocol: Protocol, repeats: int) -> tuple[float, Response]:
    """Median wall time [s], and what was found; one run goes before, uncounted, where it compiles or probes."""
    run(robot, Protocol({name: type(c)(c.control, c.values[:1]) for name, c in protocol.commands.items()}))
    taken: list[float] = []
    for _ in range(repeats):
        start = time.perf_counter()
        found = run(robot, protocol)
        taken.append(time.perf_counter() - start)
        if not found.succeeded:
            raise RuntimeError(found.status)
    return float(np.median(taken)), found


def _pull_in_time(engine: SofaEngine, robot: Robot, repeats: int) -> list[str]:
    samples = pull(np.linspace(0.0, PULL, 100))
    taken: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_sofa(robot, samples, folder, "neck")
        shutil.copy(HERE / "sofa_pull.py", folder)
        for _ in range(repeats):
            done = subprocess.run(
                [engine.sofa.python, "sofa_pull.py", f"{PULL_SECONDS:g}"],
                cwd=folder, env=engine.sofa.environment(), stdout=subprocess.PIPE, text=True, check=True,
            )  # fmt: skip
            # SOFA's own messages are on the same stream.
            told = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{")))
            taken.append(told["seconds"])
    here, ours = _timed(simulate, robot, samples, repeats)
    apart = abs(told["tension"] / ours.channels[TENSION][-1] - 1.0)
    what = f"pull in time, {told['steps']} steps"
    return [what, *_seconds(float(np.median(taken)), here), f"{apart:.1e} of tension at 40 mm"]


def _study(engine: SofaEngine, robot: Robot, quick: bool) -> list[str]:
    n = QUICK_TRIALS if quick else TRIALS
    problem = known_problem(robot, noise=True)
    here, ours = _trials(problem, n)
    in_sofa, theirs = _trials(replace(problem, simulate=engine), n)
    best = [min(objectives) for objectives in (theirs, ours)]
    apart = f"loss {best[0]:.5g} and {best[1]:.5g}, {len(theirs)} and {len(ours)} of {n} succeeded"
    return [f"{STUDY} trials of TPE (extrapolated)", *_seconds(in_sofa * STUDY / n, here * STUDY / n), apart]


def _trials(problem: Problem, n: int) -> tuple[float, list[float]]:
    """Wall time [s] of a study's first n trials, and the losses of those that succeeded."""
    start = time.perf_counter()
    found = calibrate(problem, method="tpe", trials=n, workers=1, seed=1)
    taken = time.perf_counter() - start
    return taken, [trial.loss for trial in found.trials if trial.loss is not None]


def _seconds(in_sofa: float, here: float) -> list[str]:
    return [f"{in_sofa:.3g} s", f"{here:.3g} s", f"{in_sofa / here:.3g}"]


if __name__ == "__main__":
    run_alone(measure)
