"""What `softcal next-test` expects of a further test, against calibrations with that test; writes docs/next-test.md.

python -m benchmarks.next_test [--studies 60] [--cases NAME …] [--out FILE]

Every study draws new noise (and new moduli, where the tests differ), calibrates, ranks the candidates, then draws each
of them and calibrates with it among the data. The neck is read off a table of softcal's own answers
(`benchmarks.table_twins`).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.coverage import LIKELIHOOD, NOISE, PAPERS, REACH, SLACK, SPREAD, TRUE, neck
from benchmarks.neck_case import PITCH, TENSION, pull
from benchmarks.section import table
from benchmarks.table_twins import NU, E
from benchmarks.written_page import written_page
from softcal.analysis.candidate import Candidate
from softcal.analysis.next_test import next_tests
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.run import calibrate
from softcal.experiments.dataset import Channel, Dataset
from softcal.project.project import load
from softcal.twin.parameters import with_parameters
from softcal.workflows.calibration import calibrate as calibrate_project
from softcal.workflows.next_test import next_test

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "next-test.md"
EXAMPLES, TIMED, TEN = HERE.parent / "examples", ("neck", "neck-bench"), 10
STUDIES = 60
N = 60  # samples of a pull
LIKE = "pull1"  # to 34 mm
FARTHEST = 0.0445  # [m], beyond the pull of every candidate
CANDIDATES = (
    Candidate(name="the same again", like=LIKE),
    Candidate(name="twice", like=LIKE, repeats=2),
    Candidate(name="to 44 mm", like=LIKE, reach=0.044),
    Candidate(name="to 17 mm", like=LIKE, reach=0.017),
    Candidate(name="an IMU 5 times better", like=LIKE, noise={"pitch": NOISE["pitch"] / 5}),
    Candidate(name="5 times the samples", like=LIKE, samples=5 * N),
)


@dataclass(frozen=True)
class Case:
    """Pulls to the given reaches [m]; spread: standard deviation of ln E among all tests, the added ones too."""

    name: str
    words: str
    loss: Loss
    reaches: tuple[float, ...] = (REACH[1], 0.030)
    spread: float = 0.0


FOUR = (REACH[1], 0.030, 0.026, 0.034)
CASES = (
    Case("likelihood", "two pulls, `likelihood`", LIKELIHOOD),
    Case("papers", "two pulls, `papers`", PAPERS),
    Case(
        "likelihood-differ", f"four pulls whose E differs by {100 * SPREAD:g} %, `likelihood`", LIKELIHOOD, FOUR, SPREAD
    ),
    Case("papers-differ", "the same, `papers`", PAPERS, FOUR, SPREAD),
)


@dataclass(frozen=True)
class Cost:
    """Processor time [s] of a joint calibration of an example with least squares, and of a ranking of ten candidates.

    n_solves: trajectories that the ranking simulates.
    """

    example: str
    calibration: float
    ranking: float
    n_solves: int


def cost(example: str) -> Cost:
    """Calibrate an example, then rank ten candidates: those that softcal proposes, and more pulls."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        found = calibrate_project(load(EXAMPLES / example / "project.yaml"), out=Path(folder) / "run", fit="joint")
        calibrated = time.process_time()
        like = list(found.headline.experiments)[-1]
        reaches = (f"to {reach:g} mm" for reach in (12, 14, 16))
        more = [Candidate(name=name, like=like, reach=1e-3 * float(name.split()[1])) for name in reaches]
        ranked = next_test(Path(folder) / "run", candidates=more)
        ended = time.process_time()
    if len(ranked.outlooks) != TEN or any(one.failure for one in ranked.outlooks):
        raise RuntimeError(f"{example}: {len(ranked.outlooks)} candidates were ranked")
    return Cost(example, calibrated - began, ended - calibrated, ranked.n_solves)


@dataclass(frozen=True)
class Shrinkage:
    """Of one candidate in one case: mean half-length of E's interval over E, at present, expected, and found.

    rms: errors of ln E with the test, root mean square.
    """

    case: Case
    candidate: str
    present: float
    expected: float
    found: float
    rms: float

    @property
    def ratio(self) -> float:
        """Expected over found."""
        return self.expected / self.found


def shrinkages(case: Case, studies: int = STUDIES) -> list[Shrinkage]:
    """Run the studies of a case."""
    present: list[float] = []
    expected: dict[str, list[float]] = {one.name: [] for one in CANDIDATES}
    found: dict[str, list[float]] = {one.name: [] for one in CANDIDATES}
    errors: dict[str, list[float]] = {one.name: [] for one in CANDIDATES}
    for seed in range(studies):
        chance = np.random.default_rng([seed, 1122])
        tests = [drawn(f"pull{k + 1}", reach, case, chance) for k, reach in enumerate(case.reaches)]
        problem = study(case, tests)
        result = calibrate(problem, starts=1)
        interval = result.parameters[E].interval
        ranked = next_tests(problem, {name: one.value for name, one in result.parameters.items()}, CANDIDATES, E)
        outlooks = {one.candidate.name: one for one in ranked.outlooks}
        if interval is None or any(one.interval is None for one in outlooks.values()):
            continue
        present.append(half_length(interval))
        for candidate in CANDIDATES:
            added = [
                drawn(f"next{k}", candidate.reach or REACH[1], case, chance, candidate.noise, candidate.samples or N)
                for k in range(candidate.repeats)
            ]
            after = calibrate(study(case, [*tests, *added]), starts=1).parameters[E]
            if after.interval is not None:
                expected[candidate.name].append(half_length(outlooks[candidate.name].interval or (1.0, 1.0)))
                found[candidate.name].append(half_length(after.interval))
                errors[candidate.name].append(float(np.log(after.value / TRUE[E])))
    return [
        Shrinkage(
            case,
            name,
            float(np.mean(present)),
            float(np.mean(expected[name])),
            float(np.mean(found[name])),
            float(np.sqrt(np.mean(np.square(errors[name])))),
        )
        for name in expected
    ]


def half_length(interval: tuple[float, float]) -> float:
    """Of the interval of a modulus, over its middle."""
    return float(np.log(interval[1] / interval[0])) / 2


def study(case: Case, tests: Sequence[Experiment]) -> Problem:
    """The calibration of some tests."""
    robot, twin = neck(FARTHEST)
    free = [
        FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=TRUE[E]),
        FreeParameter(NU, "1", 0.30, 0.4999, start=TRUE[NU]),
        FreeParameter(SLACK, "m", 0.0, 6e-3, start=TRUE[SLACK], per_experiment=True),
    ]
    return make_problem(robot, tests, free, case.loss, twin)


def drawn(
    name: str,
    reach: float,
    case: Case,
    chance: np.random.Generator,
    noise: Mapping[str, float] | None = None,
    n: int = N,
) -> Experiment:
    """One pull with new noise, and a new modulus where the tests differ."""
    robot, twin = neck(FARTHEST)
    modulus = TRUE[E] * np.exp(case.spread * chance.standard_normal())
    shortening = np.linspace(REACH[0] * reach / REACH[1], reach, n)
    seen = twin(with_parameters(robot, {E: modulus, NU: TRUE[NU]}), pull(shortening - TRUE[SLACK]))
    sigmas = {**NOISE, **(noise or {})}
    channels = {"shortening": Channel(shortening, "m")}
    for kind, unit, channel in (("tension", "N", TENSION), ("pitch", "rad", PITCH)):
        values = seen.channels[channel] + sigmas[kind] * chance.standard_normal(n)
        channels[kind] = Channel(values, unit, sigmas[kind])
    return Experiment(name, Dataset(name, channels), cable="front", plate="plate")


def page(found: Sequence[Shrinkage], studies: int, costs: Sequence[Cost]) -> str:
    """docs/next-test.md with the tables of what was found."""
    head = ["Study", "Candidate", "At present", "Expected", "Found", "Expected over found", "1.96 rms error"]
    rows = [
        [
            one.case.words,
            one.candidate,
            *(f"± {100 * value:.2g} %" for value in (one.present, one.expected, one.found)),
            f"{one.ratio:.2f}",
            f"{196 * one.rms:.2g} %",
        ]
        for one in found
    ]
    seconds = [
        [
            f"`examples/{one.example}`",
            f"{one.calibration:.0f} s",
            f"{one.ranking:.0f} s",
            f"{one.ranking / one.calibration:.2f}",
            str(one.n_solves),
        ]
        for one in costs
    ]
    of_costs = ["Example", "One calibration", "Ten candidates", "Ratio", "Trajectories of the ranking"]
    return written_page(
        PAGE,
        {
            "table": "\n".join(table(head, rows)),
            "studies": str(studies),
            "cost": "\n".join(table(of_costs, seconds)),
        },
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=STUDIES, help=f"of each case; {STUDIES} by default")
    names = [case.name for case in CASES]
    parser.add_argument("--cases", nargs="+", metavar="NAME", choices=names, default=names, help=", ".join(names))
    parser.add_argument("--out", type=Path, default=PAGE, help="where the page goes; docs/next-test.md by default")
    arguments = parser.parse_args()
    costs = [cost(example) for example in TIMED]
    for one in costs:
        print(f"{one.example}: calibration {one.calibration:.1f} s, ranking {one.ranking:.1f} s", flush=True)
    found: list[Shrinkage] = []
    for case in CASES:
        if case.name not in arguments.cases:
            continue
        began = time.perf_counter()
        rows = shrinkages(case, arguments.studies)
        print(f"{case.name}: {time.perf_counter() - began:.0f} s", flush=True)
        for one in rows:
            print(f"  {one.candidate}: expected {one.expected:.5f}, found {one.found:.5f}, ratio {one.ratio:.3f}")
        found += rows
    arguments.out.write_text(page(found, arguments.studies, costs), encoding="utf-8")


if __name__ == "__main__":
    main()
