"""Four tests of one twin, calibrated by paper A's procedure and by softcal's: all that `benchmarks.table_one` shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.neck_case import PITCH, TENSION, neck_robot, pull
from benchmarks.table_twins import NU, E, NeckTable, neck_table
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.run import calibrate
from softcal.checks import Floats
from softcal.experiments.dataset import Channel, Dataset
from softcal.geometry.neck import Neck
from softcal.twin.barrier import Contact
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

HERE = Path(__file__).resolve().parent
CURVE = HERE / "table_one.csv"
TRUE = {E: 3.3e6, NU: 0.45}
REACH = 35e-3  # [m]
FINE = Neck(tets=37000, waist_refinement=16.0, sectors=12)
HALF_AS_FINE = Neck(tets=4584, waist_refinement=16.0, sectors=6)
PAPERS_MESH = Neck(tets=4000, order=1)
DEFAULT_MESH = Neck(tets=2000, waist_refinement=12.0, sectors=6)
RATIOS = (0.4, 0.4999)  # the paper's bounds
SAMPLES, SEED, TRIALS, REPEATS = 200, 1, 1000, 50
SEEDS = range(1, 7)  # of TPE: one for each test, all for the first
NOISE = {"tension": 0.02, "pitch": np.deg2rad(0.03)}  # [N], [rad]
LARGEST_SLACK, IMU_ZERO = 0.25e-3, np.deg2rad(0.3)  # [m], uniform from 0; [rad], standard deviation
SLACK, OFFSET = "front.slack", "plate.pitch_offset"
SHOWN = (0.40, 0.431, 0.446, 0.46, 0.488, 0.497, 0.499)  # ratios in the table of the line, the paper's among them
LINE = 0.5 - np.geomspace(0.1, 1.01e-4, 31)  # ratios of the figure


@dataclass(frozen=True)
class Test:
    """A row of Table I: largest displacement [m], speed; E [Pa], nu and the importance of nu that the paper gives."""

    name: str
    reach: float
    modulus: float
    ratio: float
    importance: float


TESTS = (
    Test("20mm_2mms", 20e-3, 1.2e6, 0.497, 0.028),
    Test("20mm_5mms", 20e-3, 1.9e6, 0.446, 0.074),
    Test("35mm_2mms", 35e-3, 2.3e6, 0.431, 0.0006),
    Test("35mm_5mms", 35e-3, 1.7e6, 0.488, 0.028),
)


@dataclass(frozen=True)
class Curve:
    """The truth: tension [N] and pitch [rad] over shortening [m] at `TRUE`, and the tets that it was solved on."""

    n_tets: int
    shortening: Floats
    tension: Floats
    pitch: Floats

    def at(self, shortening: Floats) -> tuple[Floats, Floats]:
        """Tension and pitch; the cable is slack below 0."""
        d = np.maximum(shortening, 0.0)
        return CubicSpline(self.shortening, self.tension)(d), CubicSpline(self.shortening, self.pitch)(d)


@dataclass(frozen=True)
class Bench:
    """Four tests, and what is not the neck's in them: slack [m] and zero of the IMU [rad] by test."""

    experiments: tuple[Experiment, ...]
    slack: tuple[float, ...]
    zero: tuple[float, ...]


@dataclass(frozen=True)
class Fits:
    """All that the page needs.

    linear, linear_freed: P1 test by test, E and nu alone, and the zeros free too. trials: E and nu alone by TPE, each
    test with a seed of its own; one_seed: all with the first; seeds: the first test with each. default, freed: P2P1, as
    linear and linear_freed. joint, with_mesh: P2P1, the four together, without and with the error of the mesh; control:
    without, tests of the same mesh. lines: element -> fits of the third test at `SHOWN`, and at `LINE`. repeats:
    element -> E and nu (`REPEATS`, tests, 2). causes: name -> element -> fits of the shorter and the longer pull.
    halving: by how much the mesh that is half as fine is stiffer at the full pull, and its pitch larger [-]. tets:
    number of the "truth", "P1" and "P2P1".
    """

    bench: Bench
    linear: Mapping[str, CalibrationResult]
    trials: Mapping[str, CalibrationResult]
    one_seed: Sequence[CalibrationResult]
    seeds: Sequence[CalibrationResult]
    linear_freed: Mapping[str, CalibrationResult]
    default: Mapping[str, CalibrationResult]
    freed: Mapping[str, CalibrationResult]
    joint: CalibrationResult
    with_mesh: CalibrationResult
    control: CalibrationResult
    lines: Mapping[str, tuple[Sequence[CalibrationResult], Sequence[CalibrationResult]]]
    repeats: Mapping[str, Floats]
    causes: Mapping[str, Mapping[str, Sequence[CalibrationResult]]]
    halving: tuple[float, float]
    tets: Mapping[str, int]


def solved(shape: Neck) -> Curve:
    """The twin's curve at the truth."""
    d = np.linspace(0.0, REACH, 71)
    mesh = shape.mesh()
    seen = simulate(_touching(neck_robot(mesh, "P2P1", TRUE[E], TRUE[NU])), pull(d), curve_tolerance=1e-4)
    if not seen.succeeded:
        raise RuntimeError(seen.status)
    return Curve(mesh.n_tets, d, seen.channels[TENSION], seen.channels[PITCH])


def _touching(robot: Robot) -> Robot:
    return replace(robot, contact=Contact())


def write_curve(curve: Curve, path: Path = CURVE) -> None:
    """Write the truth."""
    rows = np.column_stack([1e3 * curve.shortening, curve.tension, curve.pitch])
    head = f"{curve.n_tets} tets, P2P1, at E {TRUE[E]:g} Pa and nu {TRUE[NU]}, by benchmarks.table_one --truth\n"
    np.savetxt(path, rows, "%.8g", ",", header=head + "shortening_mm,tension_N,pitch_rad")


def read_curve(path: Path = CURVE) -> Curve:
    """The truth as it was written."""
    n_tets = int(path.read_text(encoding="utf-8").split()[1])
    shortening, tension, pitch = np.loadtxt(path, delimiter=",").T
    return Curve(n_tets, 1e-3 * shortening, tension, pitch)


def bench(curve: Curve, seed: int) -> Bench:
    """Four tests of the truth: a slack and a zero of the IMU of its own in each, and independent noise."""
    chance = np.random.default_rng([seed, 1])
    experiments: list[Experiment] = []
    slacks: list[float] = []
    zeros: list[float] = []
    for test in TESTS:
        slacks.append(float(chance.uniform(0.0, LARGEST_SLACK)))
        zeros.append(float(IMU_ZERO * chance.standard_normal()))
        d = np.linspace(0.0, test.reach, SAMPLES)
        tension, pitch = curve.at(d - slacks[-1])
        experiments.append(_measured(test.name, d, tension, pitch + zeros[-1], chance))
    return Bench(tuple(experiments), tuple(slacks), tuple(zeros))


def _measured(name: str, d: Floats, tension: Floats, pitch: Floats, chance: np.random.Generator) -> Experiment:
    noise = {channel: sd * chance.standard_normal(SAMPLES) for channel, sd in NOISE.items()}
    channels = {
        "shortening": Channel(d, "m"),
        "tension": Channel(tension + noise["tension"], "N", NOISE["tension"]),
        "pitch": Channel(pitch + noise["pitch"], "rad", NOISE["pitch"]),
    }
    return Experiment(name, Dataset(name, channels), cable="front", plate="plate")


@dataclass(frozen=True)
class Cause:
    """One thing that is wrong with a test: slack [m], zeros of load cell [N] and IMU [rad], and a share by which the
    force is higher, which it reaches over the first two millimetres, as after a reversal of the pull.
    """

    name: str
    slack: float = 0.0
    force: float = 0.0
    pitch: float = 0.0
    loading: float = 0.0

    def test(self, curve: Curve, reach: float) -> Experiment:
        d = np.linspace(0.0, reach, SAMPLES)
        tension, pitch = curve.at(d - self.slack)
        tension = tension * (1.0 + self.loading * (1.0 - 2.0 * np.exp(-d / 1e-3))) + self.force
        return _measured("pull", d, tension, pitch + self.pitch, np.random.default_rng([SEED, 2]))


CAUSES = (
    Cause("nothing but noise"),
    Cause("0.1 mm of slack", slack=0.1e-3),
    Cause("0.2 mm of slack", slack=0.2e-3),
    Cause("load cell 0.1 N low", force=-0.1),
    Cause("load cell 0.1 N high", force=0.1),
    Cause("IMU 0.3° low", pitch=-IMU_ZERO),
    Cause("IMU 0.3° high", pitch=IMU_ZERO),
    Cause("hysteresis, 3 % of the force", loading=0.03),
)


def problem(
    robot: Robot,
    experiments: Sequence[Experiment],
    twin: NeckTable | None,
    *,
    zeros: bool,
    ratios: tuple[float, float] = RATIOS,
) -> Problem:
    """By the paper's loss and within its bounds. zeros: slack and the IMU's zero are free too."""
    start = min(max(0.45, ratios[0]), ratios[1])
    free = [FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=2e6), FreeParameter(NU, "1", *ratios, start=start)]
    if zeros:
        each = len(experiments) > 1
        free.append(FreeParameter(SLACK, "m", -3e-3, 3e-3, start=0.0, per_experiment=each))
        free.append(FreeParameter(OFFSET, "rad", -0.05, 0.05, start=0.0, per_experiment=each))
    return make_problem(robot, experiments, free, simulate=twin)


@cache
def linear() -> tuple[Robot, NeckTable]:
    """The neck as the paper meshed it, and its table."""
    robot = neck_robot(PAPERS_MESH.mesh(), "P1")
    return robot, neck_table(robot, REACH + 3e-3, (0.395, 0.49995), (14, 24), locks=True)


@cache
def default() -> tuple[Robot, NeckTable]:
    """The neck of `softcal init neck`, softcal's default element, and its table."""
    robot = _touching(neck_robot(DEFAULT_MESH.mesh(), "P2P1"))
    return robot, neck_table(robot, REACH + 3e-3, (0.395, 0.49995), (48, 8))


Kind = tuple[Robot, NeckTable]


def each(kind: Kind, experiments: Sequence[Experiment], *, zeros: bool) -> dict[str, CalibrationResult]:
    """Every test alone."""
    return {one.name: calibrate(problem(kind[0], [one], kind[1], zeros=zeros)) for one in experiments}


def line(kind: Kind, one: Experiment, ratios: Sequence[float] | Floats) -> list[CalibrationResult]:
    """The best fits at given ratios, the zeros free."""
    near = 1e-7
    return [
        calibrate(problem(kind[0], [one], kind[1], zeros=True, ratios=(nu - near, nu + near)), starts=1)
        for nu in ratios
    ]


def repeated(kind: Kind, curve: Curve) -> Floats:
    """E and nu (`REPEATS`, tests, 2) of four tests alone, with new zeros and noise in every repeat."""
    drawn = [each(kind, bench(curve, 1000 + k).experiments, zeros=False) for k in range(REPEATS)]
    return np.array([[[value(one, E), value(one, NU)] for one in found.values()] for found in drawn])


def value(result: CalibrationResult, name: str) -> float:
    """What was found [SI]."""
    return result.parameters[name].value


def _control(kind: Kind) -> tuple[Robot, Sequence[Experiment], NeckTable]:
    """The same tests of a truth on the mesh that is calibrated."""
    robot, twin = kind
    d = np.linspace(0.0, REACH, 71)
    seen = twin(robot, pull(d), TRUE)
    own = Curve(robot.bodies[0].mesh.n_tets, d, seen.channels[TENSION], seen.channels[PITCH])
    return robot, bench(own, SEED).experiments, twin


def fitted(curve: Curve) -> Fits:
    """All fits of the page."""
    drawn, half = bench(curve, SEED), solved(HALF_AS_FINE)
    stiffer, leaning = half.tension[-1] / curve.tension[-1] - 1.0, half.pitch[-1] / curve.pitch[-1] - 1.0
    kinds = {"P1": linear(), "P2P1": default()}
    print("Both tables are made.", flush=True)
    (robot, twin), tests = kinds["P1"], drawn.experiments
    by_seed = {
        (one.name, seed): calibrate(problem(robot, [one], twin, zeros=False), method="tpe", trials=TRIALS, seed=seed)
        for k, one in enumerate(tests)
        for seed in (SEEDS if k == 0 else (SEEDS[0], SEEDS[k]))
    }
    print("The trials are run.", flush=True)
    repeats = {name: repeated(kind, curve) for name, kind in kinds.items()}
    print("The repeats are run.", flush=True)
    causes = {
        cause.name: {
            name: [
                calibrate(problem(kind[0], [cause.test(curve, reach)], kind[1], zeros=False))
                for reach in (TESTS[0].reach, TESTS[-1].reach)
            ]
            for name, kind in kinds.items()
        }
        for cause in CAUSES
    }
    together = problem(kinds["P2P1"][0], tests, None, zeros=True)
    return Fits(
        bench=drawn,
        linear=each(kinds["P1"], tests, zeros=False),
        trials={one.name: by_seed[one.name, seed] for one, seed in zip(tests, SEEDS, strict=False)},
        one_seed=[by_seed[one.name, SEEDS[0]] for one in tests],
        seeds=[by_seed[tests[0].name, seed] for seed in SEEDS],
        linear_freed=each(kinds["P1"], tests, zeros=True),
        default=each(kinds["P2P1"], tests, zeros=False),
        freed=each(kinds["P2P1"], tests, zeros=True),
        joint=calibrate(together),
        with_mesh=calibrate(together, mesh_error=True),
        control=calibrate(problem(*_control(kinds["P2P1"]), zeros=True)),
        lines={name: (line(kind, tests[2], SHOWN), line(kind, tests[2], LINE)) for name, kind in kinds.items()},
        repeats=repeats,
        causes=causes,
        halving=(float(stiffer), float(leaning)),
        tets={"truth": curve.n_tets} | {name: kind[0].bodies[0].mesh.n_tets for name, kind in kinds.items()},
    )
