"""How surely and in how many trajectories least squares finds the minimum, in random problems; prints a table.

python -m benchmarks.search [--problems 26] [--kinds NAME …]

Every problem draws its truth, noise, start and bounds. An independent minimiser, SciPy's `least_squares` from many
random starts followed by L-BFGS-B on the loss itself, says where its least loss is. The twins are read off tables of
softcal's own answers (`benchmarks.table_twins`), and of formulas whose elements lock.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.coverage import CABLES, CAMERA, FORCES, LENGTH, MARKERS, NECK, REACH, SPRINGS, manipulator, neck
from benchmarks.section import table
from benchmarks.table_twins import NU, SOLVED, E
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.frame import FRAME
from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.losses.distance import DistanceLoss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem, make_problem
from softcal.calibration.problem.rig import Rig
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.convergence import in_standard_errors
from softcal.calibration.statistics.local_model import Point
from softcal.checks import Floats
from softcal.experiments.dataset import Channel, Dataset
from softcal.project.project import load
from softcal.twin.parameters import parameter_values, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot

PROBLEMS = 26
NEAR = 0.1  # standard errors
STARTS = 8  # of the independent minimiser
SLACK, TENSION, PITCH = "front.slack", "front.tension_offset", "plate.pitch_offset"
UNITS = {E: "Pa", NU: "1", SLACK: "m", TENSION: "N", PITCH: "rad"}
NOISE = 0.005  # of each channel's largest value


HEADER = ["problems", "starts", "at the least loss", "converged elsewhere", "trajectories: median", "most"]


@dataclass(frozen=True)
class LockingNeck:
    """A neck whose elements lock, in formulas: tension E (a f d + b (1 + 2 nu) f^power d^3), pitch k d (1 + nu d).

    f = 1 + layer / (0.5 - nu)^rate: how much stiffer elements that lock are.
    """

    layer: float
    rate: float
    power: float

    def __call__(
        self,
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response:
        """As `softcal.twin.simulate.simulate`, for the neck whose front cable is driven by its shortening."""
        values = parameter_values(robot, theta)
        modulus, nu = values[E], values[NU]
        d = protocol.commands["front"].values
        a, b, k = 1.6e-4, 0.02, 20.0
        f = 1 + self.layer * (0.5 - nu) ** -self.rate
        by_nu = self.layer * self.rate * (0.5 - nu) ** (-self.rate - 1)
        g = (1 + 2 * nu) * f**self.power
        h = 2 * f**self.power + (1 + 2 * nu) * self.power * f ** (self.power - 1) * by_nu
        over_e, slope = a * f * d + b * g * d**3, a * f + 3 * b * g * d**2
        by: Mapping[str, Mapping[str, Floats]] = {
            "front.tension": {E: over_e, NU: modulus * (a * by_nu * d + b * h * d**3)},
            "plate.pitch": {E: np.zeros_like(d), NU: k * d**2},
        }
        return Response(
            {"front.shortening": d, "front.tension": modulus * over_e, "plate.pitch": k * d * (1 + nu * d)},
            {"front.shortening": "m", "front.tension": "N", "plate.pitch": "rad"},
            SOLVED,
            succeeded=True,
            n_factorisations=0,
            sensitivities={channel: {name: held[name] for name in sensitivities} for channel, held in by.items()},
            slopes={
                "front.shortening": np.ones_like(d),
                "front.tension": modulus * slope,
                "plate.pitch": k * (1 + 2 * nu * d),
            },
        )


@dataclass(frozen=True)
class Kind:
    """A kind of problem: its words, its loss and its twin: "table", "locking" or "manipulator"."""

    name: str
    words: str
    loss: Loss
    twin: str


KINDS = (
    Kind("neck-papers", "neck's table, `papers`", PapersLoss(), "table"),
    Kind("neck-likelihood", "neck's table, `likelihood`", LikelihoodLoss(), "table"),
    Kind("locking-papers", "neck that locks, `papers`", PapersLoss(), "locking"),
    Kind("locking-likelihood", "neck that locks, `likelihood`", LikelihoodLoss(), "locking"),
    Kind("manipulator", "manipulator's table, `distance`, camera free", DistanceLoss(LENGTH), "manipulator"),
)


@dataclass(frozen=True)
class Found:
    """What one search found: whether at the least loss, whether it said that it converged, and its trajectories.

    distance: from the independent minimum, in standard errors, 0 where the search ended lower.
    """

    distance: float
    converged: bool
    trajectories: int

    @property
    def near(self) -> bool:
        return self.distance <= NEAR


def problem(kind: Kind, seed: int) -> Problem:
    """A random problem."""
    chance = np.random.default_rng([seed, 9])
    return _manipulator(kind, chance) if kind.twin == "manipulator" else _neck(kind, chance)


def _neck(kind: Kind, chance: np.random.Generator) -> Problem:
    robot = load(NECK).robot
    if kind.twin == "table":
        twin = neck()[1]
    else:
        twin = LockingNeck(10 ** chance.uniform(-3, -1.3), chance.uniform(0.6, 1.0), chance.uniform(0.5, 1.2))
    true = {
        E: 10 ** chance.uniform(5.3, 7.3), NU: chance.uniform(0.32, 0.49), SLACK: chance.uniform(0.5e-3, 3.5e-3),
        TENSION: chance.uniform(-0.5, 0.5), PITCH: np.deg2rad(chance.uniform(-5, 5)),
    }  # fmt: skip
    free = [E, NU, *(name for name in (SLACK, TENSION, PITCH) if chance.random() < 0.5)]
    shortening = np.linspace(*REACH, 60)
    offset = {name: true[name] if name in free else 0.0 for name in (SLACK, TENSION, PITCH)}
    pulled = Protocol({"front": Command("shortening", shortening - offset[SLACK])})
    seen = twin(with_parameters(robot, {name: true[name] for name in (E, NU)}), pulled)
    channels = {"shortening": Channel(shortening, "m")}
    for name, unit, channel, shift in (
        ("tension", "N", "front.tension", offset[TENSION]), ("pitch", "rad", "plate.pitch", offset[PITCH]),
    ):  # fmt: skip
        values = seen.channels[channel]
        noise = NOISE * float(np.abs(values).max())
        channels[name] = Channel(values + shift + noise * chance.standard_normal(len(values)), unit, noise)
    pull = Experiment("pull", Dataset("pull", channels), cable="front", plate="plate", rig=Rig())
    bounds = {
        E: (true[E] * 10 ** -chance.uniform(0.3, 2), true[E] * 10 ** chance.uniform(0.3, 2)),
        NU: (chance.uniform(0.295, 0.32), chance.uniform(0.4905, 0.4998)),
        SLACK: (0.0, 4e-3),
        TENSION: (true[TENSION] - chance.uniform(0.1, 5), true[TENSION] + chance.uniform(0.1, 5)),
        PITCH: (true[PITCH] - chance.uniform(0.02, 0.5), true[PITCH] + chance.uniform(0.02, 0.5)),
    }
    parameters = [_free(name, UNITS[name], bounds[name], "log" if name == E else "linear", chance) for name in free]
    return make_problem(robot, [pull], parameters, kind.loss, twin)


def _manipulator(kind: Kind, chance: np.random.Generator) -> Problem:
    from softcal.calibration.problem.frame import rotation

    robot, twin = manipulator()
    experiments: list[Experiment] = []
    for cable in CABLES:
        channels = {f"{cable}.tension": Channel(np.array(FORCES), "N")}
        for marker in MARKERS:
            places = np.column_stack([twin.places[cable][f"{marker}.{axis}"] for axis in "xyz"])
            places = places @ rotation(np.array(CAMERA[3:])).T + CAMERA[:3]
            places = places + 5e-4 * chance.standard_normal(places.shape)
            channels |= {f"{marker}.{axis}": Channel(places[:, k], "m", 5e-4) for k, axis in enumerate("xyz")}
        data = Dataset(cable, channels)
        experiments.append(Experiment(cable, data, drive=(f"{cable}.tension",), rig=Rig(length=LENGTH)))
    parameters = [_free(name, "Pa", (0.1e9, 10e9), "log", chance) for name in SPRINGS]
    for k, (name, true) in enumerate(zip(FRAME, CAMERA, strict=True)):
        below, above = chance.uniform(0.05, 0.5, 2)
        parameters.append(_free(name, "m" if k < 3 else "rad", (true - below, true + above), "linear", chance))
    return make_problem(robot, experiments, parameters, kind.loss, twin)


def _free(name: str, unit: str, bounds: tuple[float, float], scale: Any, chance: np.random.Generator) -> FreeParameter:
    one = FreeParameter(name, unit, *bounds, scale)
    start = SearchSpace((one,)).to_model([chance.random()])[name]
    return replace(one, start=start)


def searched(problem: Problem, least: Evaluation, starts: int) -> Found:
    """softcal's own search, judged by the independent minimum."""
    result = calibrate(problem, method="least-squares", starts=starts)
    theta = {name: estimate.value for name, estimate in result.parameters.items()}
    ended = problem.evaluate(theta, jacobian=True)
    if ended.loss is None or least.loss is None:
        raise RuntimeError(ended.failure or least.failure)
    space = problem.space
    distance = 0.0
    if ended.loss > least.loss:
        z = space.to_search(least.theta)
        distance = in_standard_errors(space, problem.loss, Point(z, least.blocks), space.to_search(theta) - z)
    return Found(distance, bool(result.converged), result.n_solves)


def least_loss(problem: Problem, seed: int = 0, starts: int = STARTS) -> Evaluation:
    """The lowest point that SciPy finds from many random starts, without softcal's search."""
    from scipy.optimize import least_squares, minimize

    space = problem.space
    by_squares = problem.loss.surrogate

    def at(z: Floats) -> Evaluation:
        return problem.evaluate(space.to_model(np.clip(z, 0.0, 1.0)), jacobian=True)

    def rows(z: Floats, *, derivatives: bool) -> Floats:
        found: list[Floats] = []
        for block in at(z).blocks:
            if block.jacobian is None:
                raise RuntimeError("no derivatives")
            root = np.sqrt(by_squares.square_weights(block, block.residual))
            found.append(root[:, None] * block.jacobian * space.jacobian(z) if derivatives else root * block.residual)
        return np.concatenate(found)

    def value_and_gradient(z: Floats) -> tuple[float, Floats]:
        one = at(z)
        if one.loss is None or one.gradient is None:
            raise RuntimeError(one.failure)
        return one.loss, one.gradient * space.jacobian(z)

    jacobian: Any = lambda z: rows(z, derivatives=True)  # noqa: E731 - SciPy's stubs know of no function here
    ends: list[Floats] = []
    for z in np.random.default_rng([seed, 10]).uniform(0.02, 0.98, (starts, space.size)):
        way = least_squares(
            lambda z: rows(z, derivatives=False), z, jacobian, bounds=(0.0, 1.0),
            xtol=1e-10, ftol=1e-10, gtol=1e-12, max_nfev=100, x_scale="jac",
        )  # fmt: skip
        ends.append(way.x)
    ends.sort(key=lambda z: value_and_gradient(z)[0])
    polished = [
        minimize(value_and_gradient, z, jac=True, method="L-BFGS-B", bounds=[(0, 1)] * space.size,
                 options={"ftol": 1e-15, "gtol": 1e-12, "maxiter": 500}).x
        for z in ends[:4]
    ]  # fmt: skip
    found = [at(z) for z in (*ends, *polished)]
    return min(found, key=lambda one: np.inf if one.loss is None else one.loss)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=PROBLEMS, help=f"of each kind; {PROBLEMS} by default")
    names = [kind.name for kind in KINDS]
    parser.add_argument("--kinds", nargs="+", metavar="NAME", choices=names, default=names, help=", ".join(names))
    arguments = parser.parse_args()
    rows: list[list[str]] = []
    for kind in KINDS:
        if kind.name not in arguments.kinds:
            continue
        posed = [problem(kind, seed) for seed in range(arguments.problems)]
        least = [least_loss(one) for one in posed]
        for starts in (1, 3):
            rows.append(row(kind, starts, [searched(one, end, starts) for one, end in zip(posed, least, strict=True)]))
            print("  ".join(rows[-1]), flush=True)
    print("\n".join(table(HEADER, rows)))


def row(kind: Kind, starts: int, found: Sequence[Found]) -> list[str]:
    """A row of the table."""
    trajectories = [one.trajectories for one in found]
    return [
        kind.words,
        str(starts),
        f"{sum(one.near for one in found)} of {len(found)}",
        str(sum(one.converged and not one.near for one in found)),
        f"{np.median(trajectories):g}",
        str(max(trajectories)),
    ]


if __name__ == "__main__":
    main()
