"""Coverage of the intervals by jackknife and bootstrap, where markers or cables err: the table of docs/intervals.md.

python -m benchmarks.resampling [--studies 60]

The studies are those of `benchmarks.coverage` on the manipulator with six cables and eight markers.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.coverage import CASES, SPRINGS, study
from benchmarks.section import table
from softcal.calibration.interval_studies.bootstrap import bootstrap
from softcal.calibration.interval_studies.resampling import jackknife
from softcal.calibration.run import calibrate

STUDIES = 60
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=STUDIES, help=f"of each case; {STUDIES} by default")
    studies = parser.parse_args().studies
    words = {case.name: case.words for case in CASES}
    rows: list[list[str]] = []
    for name, over in PAIRS:
        found = coverage(name, over, studies)
        rows.append(
            [words[name], over, *(" ".join(f"{100 * one:.0f}" for one in v.mean(axis=0)) for v in found.values())]
        )
        print(rows[-1], flush=True)
    print("\n".join(table(["Study", "`--over`", "`calibrate` [%]", "Jackknife [%]", "Bootstrap [%]"], rows)))


if __name__ == "__main__":
    main()
