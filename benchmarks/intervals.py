"""Profiles, posterior, jackknife and bootstrap on the shipped neck, and the coverage of the last two where markers or
cables err; writes docs/intervals.md.

python -m benchmarks.intervals [--studies 40] [--out FILE]

The studies are those of `benchmarks.coverage` on the manipulator with six cables and eight markers.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.coverage import CASES, SPRINGS, study
from benchmarks.section import table
from benchmarks.written_page import written_page
from softcal.calibration.interval_studies.bootstrap import bootstrap
from softcal.calibration.interval_studies.resampling import jackknife
from softcal.calibration.run import calibrate
from softcal.project.project import load
from softcal.workflows.calibration import calibrate as calibrate_project
from softcal.workflows.intervals import intervals

HERE = Path(__file__).resolve().parent
PAGE, NECK = HERE.parent / "docs" / "intervals.md", HERE.parent / "examples" / "neck" / "project.yaml"
STUDIES = 40
# Method -> the kind of group that it leaves out or weighs.
OF_NECK = {"profile": "", "posterior": "", "jackknife": "experiments", "bootstrap": "experiments"}
METHODS = {"jackknife": jackknife, "bootstrap": bootstrap}
PAIRS = (("six", "actuators"), ("six", "markers"), ("six-off", "markers"), ("six-pulled", "actuators"))


def coverage(name: str, over: str, studies: int) -> dict[str, np.ndarray]:
    """Whether the intervals of each method contain the true moduli, (studies, 4), of one case."""
    case = next(one for one in CASES if one.name == name)
    held: dict[str, list[list[bool]]] = {"calibrate": [], **{method: [] for method in METHODS}}
    for seed in range(studies):
        problem = study(case, seed)
        result = calibrate(problem, starts=1)
        theta = {label: estimate.value for label, estimate in result.parameters.items()}
        held["calibrate"].append([_contains(result.parameters[p].interval, true) for p, true in SPRINGS.items()])
        for method, run in METHODS.items():
            found = run(problem, theta, over=over).intervals
            held[method].append([_contains(found[p].found, true) for p, true in SPRINGS.items()])
    return {method: np.array(rows) for method, rows in held.items()}


def _contains(interval: tuple[float, float] | None, value: float) -> bool:
    return interval is not None and interval[0] <= value <= interval[1]


def methods_on_the_neck() -> list[list[str]]:
    """A row for each method on the joint calibration of the shipped neck: by how much the ends of the intervals move,
    over half the quick interval, and where most.
    """
    rows: list[list[str]] = []
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        calibrate_project(load(NECK), out=run, fit="joint")
        for by, over in OF_NECK.items():
            began = time.process_time()
            found = intervals(run, by=by, over=over)
            seconds = time.process_time() - began
            apart = {label: one.difference for label, one in found.intervals.items() if one.difference is not None}
            (modulus,) = (value for label, value in apart.items() if label.endswith("youngs_modulus"))
            most = max(apart, key=lambda label: apart[label])
            name = f"{by}, over {over}" if over else by
            trajectories = str(int(found.facts["trajectories"]))
            rows.append(
                [
                    name,
                    trajectories,
                    f"{seconds:.0f} s",
                    f"{100 * modulus:.0f} %",
                    f"{100 * apart[most]:.0f} % (`{most}`)",
                ]
            )
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=STUDIES, help=f"of each case; {STUDIES} by default")
    parser.add_argument("--out", type=Path, default=PAGE, help="where the page goes; docs/intervals.md by default")
    arguments = parser.parse_args()
    methods = methods_on_the_neck()
    words = {case.name: case.words for case in CASES}
    rows: list[list[str]] = []
    for name, over in PAIRS:
        found = coverage(name, over, arguments.studies)
        shares = (" ".join(f"{100 * one:.0f}" for one in v.mean(axis=0)) for v in found.values())
        rows.append([words[name], over, *shares])
        print(rows[-1], flush=True)
    of_methods = ["Method", "Trajectories", "Processor time", "An end of E moves by", "An end of any parameter by"]
    of_studies = ["Study", "`--over`", "`calibrate` [%]", "Jackknife [%]", "Bootstrap [%]"]
    values = {
        "methods": "\n".join(table(of_methods, methods)),
        "studies": str(arguments.studies),
        "coverage": "\n".join(table(of_studies, rows)),
    }
    arguments.out.write_text(written_page(PAGE, values), encoding="utf-8")


if __name__ == "__main__":
    main()
