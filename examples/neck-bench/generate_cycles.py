"""Write the record of whole cycles of this example: the robot of cycles.yaml at known constants, and noise.

python generate_cycles.py [--out DIR] makes cycles.csv from truth-cycles.yaml; always the same; seconds.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from softcal.calibration.problem.pulley_gain import reversals
from softcal.checks import Floats
from softcal.project.project import Project, load
from softcal.twin.parameters import robot_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.units import parse_quantity

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Record:
    """Rows of the record: time [s], shortening [m], tension at the machine [N], pitch [rad]."""

    time: Floats
    shortening: Floats
    tension: Floats
    pitch: Floats


def read_truth(path: Path = HERE / "truth-cycles.yaml") -> dict[str, Any]:
    """The true values; quantities still as text with a unit."""
    with path.open(encoding="utf-8") as stream:
        return YAML(typ="safe").load(stream)


def rows(machine: Mapping[str, Any]) -> tuple[Floats, Floats]:
    """Times [s] and shortenings [m] of the rows: the same on every way, whatever its speed."""
    target, hold = parse_quantity(machine["target"], "m"), parse_quantity(machine["hold"], "s")
    half, n = machine["cycles"] // 2, machine["rows"]
    up = np.linspace(0.0, 1.0, n + 1)
    at, times = [np.zeros(1)], [np.zeros(1)]

    def go(shares: Floats, after: Floats) -> None:
        at.append(shares)
        times.append(times[-1][-1] + after)

    for speed in (parse_quantity(value, "m/s") for value in machine["speeds"]):
        for cycle in range(half):
            go(up[1:], target / speed * up[1:])
            if cycle == half - 1:
                go(np.ones(n), hold * up[1:] ** 2)  # most of the relaxation is at its beginning
            go(up[-2::-1], target / speed * up[1:])
    return np.concatenate(times), target * np.concatenate(at)


def perform(truth: Mapping[str, Any], project: Project) -> Record:
    """The test without noise."""
    known = robot_parameters(project.robot)
    values = {
        f"neck.{name}": parse_quantity(value, known[f"neck.{name}"].unit) for name, value in truth["neck"].items()
    }
    time, shortening = rows(truth["machine"])
    response = simulate(project.robot, Protocol({"front": Command("shortening", shortening)}, time), values)
    if not response.succeeded:
        raise SystemExit(response.status)
    share, _ = reversals(shortening, parse_quantity(truth["pulleys"]["presliding"], "m"))
    gain = np.exp(truth["pulleys"]["friction_coefficient"] * parse_quantity(truth["pulleys"]["turning"], "rad") * share)
    return Record(time, shortening, gain * response.channels["front.tension"], response.channels["plate.pitch"])


def with_noise(record: Record, noise: Mapping[str, Any], seed: int) -> Record:
    """The record with noise that is correlated from row to row, of either channel."""
    random = np.random.Generator(np.random.PCG64(seed))
    keeps = np.exp(-1.0 / noise["length"])

    def disturbed(values: Floats) -> Floats:
        error = random.standard_normal(len(values))
        for k in range(1, len(error)):
            error[k] = keeps * error[k - 1] + np.sqrt(1.0 - keeps**2) * error[k]
        return values + noise["share"] * np.abs(values).max() * error

    return Record(record.time, record.shortening, disturbed(record.tension), disturbed(record.pitch))


def write_record(path: Path, record: Record) -> None:
    """The table that cycles.yaml reads."""
    columns = (record.time, 1e3 * record.shortening, record.tension, np.degrees(record.pitch))
    lines = [f"{t:.4f},{d:.4f},{f:.4f},{p:.4f}" for t, d, f, p in zip(*columns, strict=True)]
    path.write_text(
        "\n".join(["Time [s],Displacement [mm],Force [N],Pitch [deg]", *lines, ""]), encoding="utf-8", newline="\n"
    )


def main() -> None:
    """Read the arguments and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE, metavar="DIR", help="where to write")
    told = parser.parse_args()
    truth = read_truth()
    told.out.mkdir(parents=True, exist_ok=True)
    record = with_noise(perform(truth, load(HERE / "cycles.yaml")), truth["noise"], truth["noise"]["seed"])
    write_record(told.out / "cycles.csv", record)


if __name__ == "__main__":
    main()
