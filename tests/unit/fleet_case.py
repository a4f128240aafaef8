"""A small fleet for the tests: bars of the project case, whose forces are those of a modulus of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from project_case import bench_values, write_project

from softcal.calibration.problem.parameters import Scale
from softcal.calibration.statistics.estimate import Estimate
from softcal.plugins.fleet.specimen import Factor, Specimen

E, SLACK = "bar.youngs_modulus", "front.slack[pull]"
FILE = "experiments.pull.file"


def write_fleet(folder: Path, factors: Sequence[float], table: str, *changes: tuple[str, str], seed: int = 1) -> Path:
    """A template, a measured file a specimen (p1.csv, …), whose modulus is `MODULUS` times its factor, and a table."""
    write_project(folder, *changes)
    chance = np.random.default_rng(seed)
    for k, factor in enumerate(factors, 1):
        (folder / f"p{k}.csv").write_text(specimen_csv(factor, chance), encoding="utf-8")
    (folder / "fleet.csv").write_text(table, encoding="utf-8")
    return folder


def specimen_csv(factor: float, chance: np.random.Generator) -> str:
    """A bench file of a bar with a modulus so many times that of the case, with noise."""
    time, shortening, tension, pitch = bench_values()
    force = factor * np.asarray(tension) + 0.02 * chance.standard_normal(len(time))
    angle = np.asarray(pitch) + 0.1 * chance.standard_normal(len(time))
    rows = zip(time, shortening, force, angle, strict=True)
    lines = [
        "Time [s],Displacement [mm],Force [N],Pitch [deg]",
        *(f"{t:.3f},{d:.6f},{f:.6f},{p:.6f}" for t, d, f, p in rows),
    ]
    return "\n".join(lines) + "\n"


def estimates(
    values: Sequence[float],
    errors: Sequence[float],
    *,
    scale: Scale = "linear",
    factors: Sequence[Mapping[str, Factor]] | None = None,
    unit: str = "1",
    dof: float | None = None,
) -> list[Specimen]:
    """Specimens with estimates of one parameter x; errors: standard errors, of the logarithm on the log scale."""
    found: list[Specimen] = []
    for k, (value, error) in enumerate(zip(values, errors, strict=True)):
        size = error * value if scale == "log" else error
        estimate = Estimate(
            value,
            unit,
            False,
            -1e12,
            1e12,
            size,
            (value - 2 * size, value + 2 * size),
            scale=scale,
            dof=dof,
        )
        found.append(Specimen(f"s{k}", "DONE", {} if factors is None else factors[k], {"x": estimate}, 1.0))
    return found
