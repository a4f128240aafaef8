"""Whether two checkouts find the same numbers: every example calibrated, and the manipulator swept, by each of them.

    python -m benchmarks.same_numbers ../another-checkout

Each checkout runs with its own environment (`.venv`, or `--python` for the other's). What is compared is every number
of every `result.json`, but for times and counts of the machine; the largest relative difference of each run is printed,
with where it is. The exit code is 1 where one is above the limit.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[1]
CALIBRATIONS = ("neck", "neck-bench", "manipulator", "finger", "beam")
SWEPT = "manipulator"
OVER = ("--over", "springs.youngs_modulus=0.6GPa:1.2GPa:0.2GPa", "--over", "springs.poissons_ratio=0.3,0.4")
# Settings, times, counts, and fANOVA's shares: a random forest, whose splits turn on the last digit of a loss.
NOT_COMPARED = {
    "wall_s",
    "seconds",
    "versions",
    "hashes",
    "n_solves",
    "n_factorisations",
    "settings",
    "importance",
}
OPTIONAL = "extra"  # the axes of a sweep, and options of the search, of which a checkout may know more than another
LIMIT = 1e-9
FLAT = 1e-6  # where a search ends in a flat valley
SMALLEST = 1e-12  # [SI]: below this a number is rounding


def numbers(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Every number of a JSON document with its place."""
    if isinstance(value, dict):
        for key, part in value.items():
            if key not in NOT_COMPARED:
                yield from numbers(part, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for i, part in enumerate(value):
            yield from numbers(part, f"{path}[{i}]")
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield path, float(value)


def difference(one: dict[str, float], other: dict[str, float]) -> tuple[float, str]:
    """The largest relative difference of two documents' numbers, and where it is; infinite where one has more.

    Numbers that are `OPTIONAL` are compared where both have them.
    """
    missing = sorted(place for place in set(one) ^ set(other) if OPTIONAL not in re.split(r"[. ]", place))
    if missing:
        return float("inf"), f"{missing[0]} is in one alone"
    worst, where = 0.0, ""
    for place, value in ((place, value) for place, value in one.items() if place in other):
        size = max(abs(value), abs(other[place]), SMALLEST)
        if (part := abs(value - other[place]) / size) > worst:
            worst, where = part, f"{place}: {value:.12g} and {other[place]:.12g}"
    return worst, where


def run(checkout: Path, python: str, arguments: list[str], out: Path) -> dict[str, float]:
    """The numbers that a checkout's softcal writes."""
    environment = {**os.environ, "PYTHONPATH": str(checkout / "src"), "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    command = [python, "-m", "softcal", *arguments, "--out", str(out), "--no-report"]
    ended = subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise SystemExit(f"{' '.join(command)} ended with {ended.returncode}:\n{ended.stderr}")
    found: dict[str, float] = {}
    for path in sorted(out.rglob("result.json")):
        document = json.loads(path.read_text(encoding="utf-8"))
        found |= {f"{path.relative_to(out)} {place}": value for place, value in numbers(document)}
    return found


def main() -> None:
    """Compare this checkout with another one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path, help="the other checkout")
    parser.add_argument("--python", help="the other's interpreter; by default its .venv/bin/python")
    parser.add_argument("--only", nargs="*", default=[], help="some of the runs")
    given = parser.parse_args()
    other = given.other.resolve()
    python = given.python or str(other / ".venv" / "bin" / "python")
    runs = {name: ["calibrate", f"examples/{name}/project.yaml"] for name in CALIBRATIONS}
    runs["sweep"] = ["sweep", f"examples/{SWEPT}/project.yaml", *OVER]
    failed = False
    for name in given.only or runs:
        with tempfile.TemporaryDirectory() as folder:
            mine = run(HERE, sys.executable, runs[name], Path(folder) / "mine")
            its = run(other, python, runs[name], Path(folder) / "its")
        worst, where = difference(mine, its)
        failed |= worst > FLAT
        verdict = "same" if worst <= LIMIT else "same in a flat valley" if worst <= FLAT else "differs"
        print(f"{name}: {len(mine)} numbers, {verdict}, at most {worst:.1e} ({where})", flush=True)
    sys.exit(int(failed))


if __name__ == "__main__":
    main()
