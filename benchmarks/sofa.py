"""Softcal and SOFA side by side on one mesh: a settled curve, paper A's pull in time, and a study of 1000 trials.

Needs SOFA_ROOT; where there is no SOFA the section says so and holds no numbers.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.neck_case import PITCH, PULL, TENSION, pull, standard_robot
from benchmarks.problems import known_problem
from benchmarks.section import Section, run_alone
from benchmarks.timing import interleaved
from softcal.calibration.problem.problem import Problem
from softcal.calibration.run import calibrate
from softcal.errors import InputError
from softcal.plugins.sofa.simulator import SofaEngine, sofa_engine
from softcal.plugins.sofa.writing import write_sofa
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

TITLE = "SOFA side by side"
HEADER = ["what", "SOFA", "softcal", "ratio", "how far apart"]
SAMPLES = 100
TRIALS, QUICK_TRIALS, STUDY = 3, 1, 1000
REPEATS = 5  # of softcal's; SOFA's take minutes
PULL_SECONDS = PULL / 2e-3  # [s], paper A's 2 mm/s
HERE = Path(__file__).resolve().parent


def measure(quick: bool) -> Section:
    try:
        engine = sofa_engine()
    except InputError as error:
        return Section(TITLE, HEADER, [], notes=[f"Not measured here: {error}"])
    robot = standard_robot("P1")
    samples = pull(np.linspace(0.0, PULL, SAMPLES))
    here = _median(lambda: simulate(robot, samples))
    n = QUICK_TRIALS if quick else TRIALS
    rows = [
        _curve(engine, robot, samples, here),
        *_pull_in_time(engine, robot, samples, here),
        _study(engine, robot, n),
    ]
    notes = [
        f"The P1 neck of {robot.bodies[0].mesh.n_tets:,} tets pulled to 40 mm, {SAMPLES} samples; one thread, one "
        f"process at a time; softcal's times are medians of {REPEATS}. *Settled curve*: in SOFA the engine's "
        f"{engine.settings.states} states run to rest, with what was begun again; the samples between by a spline. "
        "*Pull in time*: paper A's 2 mm/s with its step of 0.01 s and its damping, the exported scene and its "
        "controller as they are, without start and loading; beside it softcal's settled curve, which is how the papers "
        "read it. *Studies* of 1000 trials are **extrapolated**: the one from that pull times 1000; the other "
        f"from paper A's TPE within its bounds for E and ν on the twin's own tension and pitch, its first {n} in "
        f"both, times {STUDY / n:g}. The ratios are those of one machine and one build of SOFA; on another machine "
        "and build they were 570 to 690. Take them as hundreds."
    ]
    return Section(TITLE, HEADER, rows, notes=notes)


def _curve(engine: SofaEngine, robot: Robot, samples: Protocol, here: float) -> list[str]:
    start = time.perf_counter()
    theirs = engine(robot, samples)
    taken = time.perf_counter() - start
    ours = simulate(robot, samples, curve_tolerance=0.0)
    if not (theirs.succeeded and ours.succeeded):
        raise RuntimeError(f"{theirs.status} {ours.status}")
    apart = max(
        float(np.abs(theirs.channels[c] - ours.channels[c]).max() / np.abs(ours.channels[c]).max())
        for c in (TENSION, PITCH)
    )
    steps = f"settled curve, {theirs.n_factorisations:,} steps"
    return [steps, *_seconds(taken, here), f"{apart:.1e} of tension and pitch"]


def _median(run: Callable[[], Response]) -> float:
    """Wall time [s]; one run goes before, uncounted, where it compiles and builds."""
    return float(np.median(interleaved({"run": run}, repeats=REPEATS)["run"]))


def _pull_in_time(engine: SofaEngine, robot: Robot, samples: Protocol, here: float) -> list[list[str]]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_sofa(robot, samples, folder, "neck")
        shutil.copy(HERE / "sofa_pull.py", folder)
        done = subprocess.run(
            [engine.sofa.python, "sofa_pull.py", f"{PULL_SECONDS:g}"],
            cwd=folder, env=engine.sofa.environment(), stdout=subprocess.PIPE, text=True, check=True,
        )  # fmt: skip
    # SOFA's own messages are on the same stream.
    told = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{")))
    expected = simulate(robot, samples).channels[TENSION][-1]
    apart = f"{abs(told['tension'] / expected - 1.0):.1e} of the last tension"
    ratio = _seconds(told["seconds"], here)
    many = _seconds(STUDY * told["seconds"], STUDY * here)
    return [
        [f"pull in time, {told['steps']:,} steps", *ratio, apart],
        [f"{STUDY} such pulls (extrapolated)", *many, ""],
    ]


def _study(engine: SofaEngine, robot: Robot, n: int) -> list[str]:
    problem = known_problem(robot, noise=True)
    here, ours = _trials(problem, n)
    in_sofa, theirs = _trials(replace(problem, simulate=engine), n)
    apart = f"losses {_listed(theirs)} and {_listed(ours)}; {len(theirs)} and {len(ours)} of {n} succeeded"
    return [f"{STUDY} trials of TPE (extrapolated)", *_seconds(in_sofa * STUDY / n, here * STUDY / n), apart]


def _trials(problem: Problem, n: int) -> tuple[float, list[float]]:
    """Time [s] in a study's first n trials, and the losses of those that succeeded."""
    found = calibrate(problem, method="tpe", trials=n, workers=1, seed=1)
    return sum(trial.seconds for trial in found.trials), [
        trial.loss for trial in found.trials if trial.loss is not None
    ]


def _seconds(in_sofa: float, here: float) -> list[str]:
    return [_told(in_sofa), _told(here), f"{in_sofa / here:,.0f}"]


def _told(seconds: float) -> str:
    return f"{seconds / 3600:.3g} h" if seconds > 3600 else f"{seconds:.3g} s"


def _listed(losses: list[float]) -> str:
    return "/".join(f"{loss:.4g}" for loss in losses)


if __name__ == "__main__":
    run_alone(measure)
