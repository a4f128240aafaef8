"""Least-squares calibrations: forward trajectories and wall time."""

from __future__ import annotations

import itertools
import time
from pathlib import Path

from benchmarks.neck_case import POISSONS_RATIO, YOUNGS_MODULUS, standard_robot
from benchmarks.problems import BOUNDS, N_SAMPLES, NU, SIGMA_PITCH, SIGMA_TENSION, E, known_problem
from benchmarks.section import Goal, Section, run_alone
from softcal.calibration.problem.option import options_of
from softcal.calibration.problem.problem import Problem
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.sensitivity import local_statistics
from softcal.project.project import load
from softcal.workflows.calibration import make_problem

LIMIT = 12
EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "neck" / "project.yaml"
BENCH = EXAMPLE.parents[1] / "neck-bench" / "project.yaml"
STATISTICS = 0.5  # [s]
MIDDLE = (2.0e6, 0.45)
DEFAULT_STARTS = int(options_of()["starts"].default)


HEADER = ["data", "start (E in MPa, ν)", "starts", "free", "trajectories", "factorisations", "seconds", "E in MPa", "ν"]


def measure(quick: bool) -> Section:
    corners = list(itertools.product(*BOUNDS))
    rows: list[list[str]] = []
    one: list[int] = []
    default: list[int] = []
    for element, noise in (("P1", True), ("P1", False), ("P2P1", True), ("P2P1", False)):
        robot = standard_robot(element)
        data = f"{element} twin, {'with noise' if noise else 'no noise'}"
        for start in [MIDDLE, *corners][: 2 if quick else None]:
            problem = known_problem(robot, noise=noise, start=start)
            one.append(_calibrated(problem, data, start, 1, rows))
            default.append(_calibrated(problem, data, start, DEFAULT_STARTS, rows))
    example = load(EXAMPLE)
    starts = int(example.calibration.options["starts"])
    joint = make_problem(example)
    problems = {e.name: joint.alone(e.name) for e in joint.experiments[: 1 if quick else None]} | {"jointly": joint}
    shipped = [_calibrated(problem, f"examples/neck, {name}", None, starts, rows) for name, problem in problems.items()]
    goals = [
        Goal("trajectories of a least-squares calibration of E and ν, one start, the worst", max(one), LIMIT),
        Goal(f"the same with the {DEFAULT_STARTS} starts of the default, the worst", max(default), LIMIT),
        Goal(
            f"the same for examples/neck with {starts} starts, slacks free too, the worst",
            max(shipped),
            LIMIT,
        ),
        Goal("statistics of examples/neck-bench, four tests jointly", _statistics(), STATISTICS, "s"),
    ]
    notes = [
        f"The twin's own data are of {YOUNGS_MODULUS / 1e6:g} MPa and {POISSONS_RATIO:g}: tension and pitch at "
        f"{N_SAMPLES} samples over 40 mm, noise {SIGMA_TENSION:g} N and {1e3 * SIGMA_PITCH:g} mrad. One process. "
        "Bounds as in paper A: E 0.1 to 40 MPa, ν 0.4 to 0.4999. *Trajectories* are forward solves with derivatives, "
        "of all starts together; the three tests of examples/neck share one. No pitch was published with "
        "examples/neck, so its E and ν cannot be told apart, and its ν means nothing."
    ]
    return Section("Least squares", HEADER, rows, goals, notes)


def _statistics() -> float:
    """Processor time [s] of standard errors, intervals, budget and comparison of the tests, from the jacobians."""
    problem = make_problem(load(BENCH))
    found = calibrate(problem, method="least-squares", starts=1)
    theta = {label: estimate.value for label, estimate in found.parameters.items()}
    blocks = problem.evaluate(theta, jacobian=True).blocks
    began = time.process_time()
    local_statistics(problem.space, problem.loss, theta, blocks, problem.uncertain)
    return time.process_time() - began


def _calibrated(
    problem: Problem, data: str, start: tuple[float, float] | None, starts: int, rows: list[list[str]]
) -> int:
    """The number of trajectories; adds a row."""
    began = time.perf_counter()
    found = calibrate(problem, method="least-squares", starts=starts)
    seconds = time.perf_counter() - began
    values = found.parameters
    E_found, nu_found = values[E].value, values[NU].value
    rows.append(
        [data, "as shipped" if start is None else f"{start[0] / 1e6:g}, {start[1]:g}", str(starts), str(len(values)),
         str(found.n_solves), str(found.n_factorisations), f"{seconds:.2f}", f"{E_found / 1e6:.6g}", f"{nu_found:.6g}"]
    )  # fmt: skip
    return found.n_solves


if __name__ == "__main__":
    run_alone(measure)
