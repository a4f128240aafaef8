"""Reduced models of 1 to 9 cables: how long they are built, their error at random states, and their rates.

python -m benchmarks.reduced
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

import softcal
from benchmarks.machine import machine
from benchmarks.reach import neck
from benchmarks.section import Goal, Section, run_alone
from benchmarks.timing import mkl_threads
from softcal.export.reduced import Span, evaluator_of, reduced
from softcal.export.reduced_model import ReducedModel
from softcal.twin.manipulator import Manipulator, Springs, manipulator
from softcal.twin.robot import Robot

SHARE = 0.3  # of the length, in per cent, that the 95th percentile may reach
BUILT = 600.0  # [s]
SEED = 5


@dataclass(frozen=True)
class Case:
    """A robot, the largest tension [N], the channels that are wanted, what is the tip, and the length [m]."""

    name: str
    robot: Robot
    most: float
    channels: tuple[str, ...]
    tip: str
    length: float
    rate: float = 500.0  # of the inverse, at its 99th percentile [1/s]


def cases() -> list[Case]:
    springs = Springs(youngs_modulus=1.6e9, poissons_ratio=0.43)
    of_discs = manipulator(Manipulator(springs=springs))
    opencr = softcal.load(str(files("softcal.plugins.bench") / "data" / "opencr-v4" / "project.yaml")).robot
    tip = next(plate for plate in of_discs.plates if plate.name == "S4")
    discs = ("S4.x", "S4.y", "S4.z", "S2.x", "S2.y")
    pose = ("plate.pitch", "plate.roll", "plate.z")
    return [
        Case("neck, 1 cable", neck(1), 8.0, pose[:1], "plate", 0.1, 1000.0),
        Case("neck, 3 cables", neck(3), 6.0, pose, "plate", 0.1, 1000.0),
        Case("manipulator, 6 cables", of_discs, 8.0, discs, "S4", abs(tip.reference[2])),
        Case("OpenCR v4, 9 cables", opencr, 6.0, ("tip.x", "tip.y", "tip.z"), "tip", 0.1865, 0.0),
    ]


def measure(quick: bool) -> Section:
    header = ["robot", "equilibria", "degree", "terms", "built [s]", "tip: p50 [µm]", "p95 [µm]", "largest [µm]",
              "p95 [% of length]", "state p50 [ms]", "p99 [ms]", "inverse from rest p50 [ms]", "p99 [ms]",
              "inverse along a path p50 [ms]", "p99 [ms]"]  # fmt: skip
    rows: list[list[str]] = []
    goals: list[Goal] = []
    with mkl_threads(1):
        for case in cases()[: 2 if quick else None]:
            start = time.perf_counter()
            fit = reduced(case.robot, {cable.name: Span(0.0, case.most, "N") for cable in case.robot.cables})
            built = time.perf_counter() - start
            error, read = fit.error[f"{case.tip}.position"], evaluator_of(fit.model)
            share = 100.0 * error.p95 / case.length
            state, from_rest, along = _rates(read, case.channels, 200 if quick else 2000)
            row = [f"{1e6 * value:.3g}" for value in (error.p50, error.p95, error.largest)]
            times = [
                f"{1e3 * value:.2f}" for each in (state, from_rest, along) for value in np.quantile(each, [0.5, 0.99])
            ]
            size = [str(fit.n_samples), str(fit.degree), str(len(fit.model["powers"])), f"{built:.0f}"]
            rows.append([case.name, *size, *row, f"{share:.2g}", *times])
            goals.append(Goal(f"Reduced model, {case.name}: p95 at the tip", share, SHARE, "% of the length"))
            goals.append(Goal(f"Reduced model, {case.name}: built", built, BUILT, "s"))
            goals.append(
                Goal(f"Reduced model, {case.name}: state, p99", 1e3 * float(np.quantile(state, 0.99)), 1.0, "ms")
            )
            if case.rate:
                worst = 1e3 * float(np.quantile(along, 0.99))
                goals.append(
                    Goal(f"Reduced model, {case.name}: inverse along a path, p99", worst, 1e3 / case.rate, "ms")
                )
    notes = [
        "Inputs are the tensions of all cables from zero. *Built*: the equilibria, the fit, and its error at 100 other "
        "random states, on one core. *State*: poses, coordinates and Jacobian by the exported Python evaluator. "
        "*Inverse*: tensions for the channels of a state, within the ranges: of random states from no tension, and "
        "along a closed path of 200 states, each from the last one as a controller does. Of OpenCR v4 the range of 6 N "
        "takes the tip over 0.29 m, its records over 0.27 and 0.30 m; with 10 N, where it curls up, the 95th "
        "percentile is 1.7 % of the length. Processor: "
        f"{dict(machine())['processor']}."
    ]  # fmt: skip
    return Section("Reduced models", header, rows, goals, notes)


def _rates(read: ReducedModel, channels: tuple[str, ...], n: int) -> tuple[list[float], list[float], list[float]]:
    """Seconds of each state, inverse from rest, and inverse along a path."""
    rng, size = np.random.default_rng(SEED), len(read.inputs)

    def wanted(shares: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
        at = read.least + shares * (read.most - read.least)
        commands = dict(zip(read.inputs, at.tolist(), strict=True))
        return commands, dict(zip(channels, read.read(commands, [*channels])[0].tolist(), strict=True))

    state: list[float] = []
    from_rest: list[float] = []
    along: list[float] = []
    for shares in rng.uniform(size=(n, size)):
        commands, targets = wanted(shares)
        state.append(_seconds(lambda commands=commands: read.state(commands)))
        from_rest.append(_seconds(lambda targets=targets: read.inverse(targets)))
    phase, last = rng.uniform(size=size), dict[str, float]()
    for k in range(n):
        _, targets = wanted(0.5 + 0.4 * np.sin(2.0 * np.pi * (k / 200 + phase)))

        def follow(targets: Mapping[str, float] = targets) -> None:
            last.update(read.inverse(dict(targets), start=last)["commands"])

        along.append(_seconds(follow))
    return state, from_rest, along


def _seconds(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


if __name__ == "__main__":
    run_alone(measure)
