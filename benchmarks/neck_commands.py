"""CPU seconds of the commands that a user of the shipped neck waits for, and the share of the finer mesh in them.

python -m benchmarks.neck_commands

Takes two minutes, on one thread.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.section import Goal, Section, run_alone

PROJECT = Path(__file__).resolve().parents[1] / "examples" / "neck" / "project.yaml"
ONE_THREAD = {**os.environ, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
# The command as it is, with a clock about the one function that evaluates the fit on the finer mesh.
TIMED = """
import sys, time
from softcal.calibration.statistics import mesh_error
from softcal.cli import main
evaluate = mesh_error.on_finer_mesh
spent = 0.0
def clocked(*arguments, **options):
    global spent
    start = time.process_time()
    try:
        return evaluate(*arguments, **options)
    finally:
        spent += time.process_time() - start
mesh_error.on_finer_mesh = clocked
try:
    main(sys.argv[1:])
finally:
    print(f"finer {spent:.3f}", file=sys.stderr)
"""


def cpu_seconds(*words: str) -> tuple[float, str]:
    """CPU seconds of a Python with these arguments and of all that it starts, and what it prints as errors."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, *words], env=ONE_THREAD, capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stderr


def measure(quick: bool) -> Section:
    with tempfile.TemporaryDirectory() as folder:
        run, at = f"{folder}/run", str(PROJECT)
        check, _ = cpu_seconds("-m", "softcal", "check", at, "--out", f"{folder}/check")
        unseen, _ = cpu_seconds("-m", "softcal", "check", at, "--no-pictures")
        calibrate, errors = cpu_seconds("-c", TIMED, "calibrate", at, "--out", run)
        report, _ = cpu_seconds("-m", "softcal", "report", run)
    finer = float(errors.rpartition("finer ")[2])
    rows = [
        ["check", f"{check:.1f}", f"pictures {check - unseen:.1f}"],
        ["calibrate, with its report", f"{calibrate:.1f}", f"on the finer mesh {finer:.1f}"],
        ["report", f"{report:.1f}", ""],
    ]
    goals = [
        Goal("softcal calibrate of examples/neck, with its report", calibrate, 60.0, "s"),
        Goal("share of the finer mesh in it", finer / calibrate, 0.2),
        Goal("softcal report of it", report, 10.0, "s"),
        Goal("softcal check of it", check, 5.0, "s"),
    ]
    return Section("Commands of the neck", ["command", "CPU seconds", "of them"], rows, goals, ["On one thread."])


if __name__ == "__main__":
    run_alone(measure)
