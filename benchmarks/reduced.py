"""Reduced models of 1 to 9 cables: how long they are built, their error at random states, and their rates; and pages to
pull, which are made of them.

python -m benchmarks.reduced                  the models
python -m benchmarks.reduced --out docs/exports.md      models and pages, into the page: some ten minutes
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np

import softcal
from benchmarks.machine import machine
from benchmarks.reach import neck
from benchmarks.section import Goal, Section, run_alone, table
from benchmarks.timing import mkl_threads
from benchmarks.written_page import written_page
from softcal.export.reduced import Span, evaluator_of, reduced
from softcal.export.reduced_model import ReducedModel
from softcal.twin.manipulator import Manipulator, Springs, manipulator
from softcal.twin.robot import Robot
from softcal.workflows.export import ExportRequest
from softcal.workflows.exports.web import web

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "exports.md"
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
            powers = np.array(fit.model["powers"])
            size = [str(len(fit.sampled.points)), str(powers.max()), str(len(powers)), f"{built:.0f}"]
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


def pages() -> Iterator[list[str]]:
    """Rows of pages to pull: what is on them, inputs, equilibria, largest error, size, time on the processor."""
    examples, six = ROOT / "examples", ",".join(f"cable{k}=6N" for k in range(1, 7))
    for what, name, inputs, reach in (
        ("the calibrated neck", "neck", "1 cable", None),
        ("the manipulator", "manipulator", "3 cables to 6 N", "cable1=6N,cable3=6N,cable5=6N"),
        ("the manipulator", "manipulator", "6 cables to 6 N", six),
        ("the pneunet", "pneunet", "1 chamber to 24 kPa", "main=24kPa"),
    ):
        with tempfile.TemporaryDirectory() as place:
            source, said = examples / name / "project.yaml", list[str]()
            run = None
            if reach is None:
                run = Path(place, "run")
                softcal.calibrate(source, out=run)
            began = time.process_time()
            project = softcal.load(source) if run is None else softcal.load_calibrated(run)
            (page,) = web(ExportRequest(project, note=said.append, run=run), Path(place), reach)
            seconds, size = time.process_time() - began, page.stat().st_size
        error, n = re.search(r"from the twin: (.*?), at the (\d+) equilibria", said[-1]).groups()  # type: ignore[union-attr]
        yield [what, inputs, n, error, f"{1e-6 * size:.2f} MB", f"{seconds:.0f} s"]
        print(f"# {what}, {inputs}: {error}, {seconds:.0f} s", file=sys.stderr, flush=True)


def written(section: Section) -> str:
    """docs/exports.md with the figures of the models and of the pages."""
    at = [section.header.index(name) for name in ("robot", "equilibria", "built [s]", "p95 [µm]", "p95 [% of length]")]
    at += [k for k, name in enumerate(section.header) if name == "p99 [ms]"][::2]
    heads = ["robot", "equilibria", "built [s]", "95th percentile at the tip [µm]", "[% of length]", "state [ms]",
             "inverse along a path [ms]"]  # fmt: skip
    models = table(heads, [[row[k] for k in at] for row in section.rows])
    of_pages = table(["page", "inputs", "equilibria", "error", "size", "CPU time"], [*pages()])
    values = {"models": "\n".join(models), "pages": "\n".join(of_pages)}
    return written_page(PAGE, {**values, "processor": dict(machine())["processor"]})


def _seconds(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


if __name__ == "__main__":
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--out", type=Path)
    if (out := parser.parse_known_args()[0].out) is None:
        run_alone(measure)
    else:
        out.write_text(written(measure(quick=False)), encoding="utf-8")
