"""Run every benchmark, each in a process of its own, and write RESULTS.md.

python -m benchmarks.run [--quick] [--only NAME ...] [--out FILE]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.machine import load, machine
from benchmarks.section import Goal, Section, table

HERE = Path(__file__).resolve().parent
BENCHMARKS = (
    "newton_iteration",
    "laws",
    "curve",
    "growth",
    "mirror",
    "live",
    "least_squares",
    "tpe",
    "manipulator",
    "assembly",
    "sofa",
    "start_up",
    "neck_commands",
)
LIMIT = 1200.0  # [s] for one benchmark


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer repetitions, 100 TPE trials instead of 1000")
    parser.add_argument("--only", nargs="+", choices=BENCHMARKS, default=BENCHMARKS, metavar="NAME")
    parser.add_argument("--out", type=Path, default=HERE / "RESULTS.md")
    arguments = parser.parse_args()
    before = load()
    sections: list[Section] = []
    failures: list[str] = []
    took: list[list[str]] = []
    for name in arguments.only:
        print(f"{name} …", end=" ", flush=True)
        start = time.perf_counter()
        found = _measured(name, arguments.quick)
        seconds = time.perf_counter() - start
        print(f"{seconds:.0f} s", flush=True)
        took.append([name, f"{seconds:.0f}"])
        if isinstance(found, Section):
            sections.append(found)
        else:
            failures.append(f"`{name}` failed: {found}")
    goals = [goal for section in sections for goal in section.goals]
    arguments.out.write_text(_page(sections, goals, failures, took, before, arguments.quick), encoding="utf-8")
    for line in _goal_rows(goals):
        print("  ".join(line))
    for failure in failures:
        print(failure)
    print(f"Written: {arguments.out}")
    return 1 if failures else 0


def _measured(name: str, quick: bool) -> Section | str:
    """What a benchmark found, or why it failed."""
    command = [sys.executable, "-m", f"benchmarks.{name}", "--json", *(["--quick"] if quick else [])]
    try:
        done = subprocess.run(command, cwd=HERE.parent, stdout=subprocess.PIPE, text=True, timeout=LIMIT, check=False)
    except subprocess.TimeoutExpired:
        return f"it took more than {LIMIT:g} s"
    if done.returncode:
        return f"exit code {done.returncode}; what it said is above"
    return Section.from_json(done.stdout.splitlines()[-1])


def _goal_rows(goals: list[Goal]) -> list[list[str]]:
    return [
        [
            goal.what,
            f"{goal.measured:.3g} {goal.unit}".strip(),
            f"≤ {goal.limit:g} {goal.unit}".strip(),
            "met" if goal.met else "**missed**",
        ]
        for goal in goals
    ]


def _page(
    sections: list[Section], goals: list[Goal], failures: list[str], took: list[list[str]], before: str, quick: bool
) -> str:
    lines = [
        "# Benchmarks",
        "",
        "Written by `make bench`; every ratio is of times taken in one run, in turn. The neck is the published one "
        "(outer diameter 38 mm, E 2.3 MPa, ν 0.43, cable at 50 mm); P1 on some 3.7k tets, P2P1 on some 1.7k curved "
        "ones.",
        "",
    ]
    if quick:
        lines += ["**A quick run: few repetitions, and TPE extrapolated. Not to be quoted.**", ""]
    lines += [f"**{failure}**\n" for failure in failures]
    lines += ["## Goals", "", *table(["what", "measured", "goal", ""], _goal_rows(goals)), ""]
    rows = [*machine(), ["load before", f"{before} (a quiet machine has 0 to 0.5)"]]
    lines += ["## Machine", "", *table(["", ""], rows), ""]
    lines += [section.markdown() for section in sections]
    lines += ["## Time taken", "", *table(["benchmark", "seconds"], took), ""]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
