"""1000 trials of paper A's search on the P1 neck with two workers."""

from __future__ import annotations

import time

from benchmarks.neck_case import YOUNGS_MODULUS, standard_robot
from benchmarks.problems import NU, E, known_problem
from benchmarks.section import Goal, Section, run_alone
from softcal.calibration.run import calibrate

TRIALS, QUICK_TRIALS = 1000, 100
WORKERS = 2
LIMIT = 300.0  # [s]


def measure(quick: bool) -> Section:
    n = QUICK_TRIALS if quick else TRIALS
    problem = known_problem(standard_robot("P1"), noise=True)
    start = time.perf_counter()
    found = calibrate(problem, method="tpe", trials=n, workers=WORKERS, seed=1)
    whole = time.perf_counter() - start
    solving = sum(trial.seconds for trial in found.trials)
    E_found = found.parameters[E].value
    rows = [
        ["wall time", f"{whole:.1f} s"],
        ["of which fANOVA and closing", f"{whole - found.wall_s:.1f} s"],
        ["time in the trials, both workers together", f"{solving:.1f} s"],
        ["factorisations per trial", f"{found.n_factorisations / n:.1f}"],
        ["failed trials", str(found.n_failed_trials)],
        ["E found", f"{E_found / 1e6:.4g} MPa ({100 * (E_found / YOUNGS_MODULUS - 1):+.2f} %)"],
        ["ν found", f"{found.parameters[NU].value:.4g}"],
    ]
    notes = [
        "Paper A's settings (independent sampling, 10 random trials first, 24 candidates), its bounds, its loss, its "
        "1000 trials; data: the twin's own tension and pitch at 100 samples over 40 mm with noise; E on a log scale."
    ]
    scaled = whole * TRIALS / n
    what = f"{TRIALS} TPE trials of the P1 neck, {WORKERS} workers"
    if quick:
        notes.append(f"**Extrapolated**: {n} trials were run and their time multiplied by {TRIALS / n:g}.")
        what += f" (extrapolated from {n})"
    return Section(f"TPE, {n} trials", ["", "measured"], rows, [Goal(what, scaled, LIMIT, "s")], notes)


if __name__ == "__main__":
    run_alone(measure)
