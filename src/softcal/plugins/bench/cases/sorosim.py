"""SoRoSim's static shapes of two slender rods: softcal's rods against another code."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import ClassVar

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault, SimulationError
from softcal.executors.each import executor_of, results
from softcal.executors.executor import Executor
from softcal.experiments.columns import number_in
from softcal.experiments.text_file import open_text
from softcal.geometry.centreline import spaced, straight
from softcal.geometry.section import RoundBar
from softcal.limits import LIMITS
from softcal.plugins.bench.case import BenchmarkCase, Progress, Published, register_case
from softcal.plugins.bench.predictions import Predictions
from softcal.plugins.bench.record import CaseRecord
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Marker, Moment, PointLoad, Robot, Rod
from softcal.twin.simulate import simulate

HALF = (0.0469, 0.2308, 0.5, 0.7692, 0.9531, 1.0)  # stations of one half of the rod, as fractions of it
STATIONS = tuple(0.5 * f for f in HALF) + tuple(0.5 * (1.0 + f) for f in HALF)
POINTS = (*(f"s{k:02d}" for k in range(1, len(STATIONS))), "tip")
KINDS = ("EulX", "EulY", "EulZ", "Px", "Py", "Pz")  # the lines of a shape
LINES = len(KINDS)
COLUMNS = 3 + 2 * (len(HALF) + 1)  # gravity and two wrenches, then the stations, the base and the middle twice
ELEMENTS = 24  # at least; the stations are nodes, too
SOURCE = "ContinuumRoboticsLab/opencr-mujoco, data/reference/sorosim; computed with SoRoSim"


@dataclass(frozen=True)
class Shape:
    """A row of the reference: its name, the loads [SI] in the file's frame, and the stations' positions (12, 3) [m]."""

    name: str
    gravity: Floats
    forces: Floats
    moments: Floats
    positions: Floats


class SoroSimRod(BenchmarkCase):
    """A straight round rod, clamped at one end, under its weight and a wrench at the middle and at the tip."""

    source = SOURCE
    licence = "MIT, © 2026 Continuum Robotics Lab"
    tip = "tip"
    diameter: ClassVar[float]
    youngs_modulus: ClassVar[float]
    poissons_ratio: ClassVar[float]
    density: ClassVar[float]

    @property
    def folder(self) -> Path:
        return super().folder.with_name("sorosim")

    def record(self, data: Path | None = None) -> CaseRecord:
        shapes = self.shapes(data)
        positions = np.array([shape.positions for shape in shapes])
        channels = {
            f"{point}.{axis}": positions[:, k, i] for k, point in enumerate(POINTS) for i, axis in enumerate("xyz")
        }
        none = np.zeros(len(shapes), dtype=bool)
        return CaseRecord(tuple(shape.name for shape in shapes), none, channels, dict.fromkeys(channels, "m"))

    def run(
        self,
        data: Path | None = None,
        *,
        workers: int | Executor = 1,
        store: Path | None = None,
        resume: bool = False,
        progress: Progress,
    ) -> Predictions:
        shapes, began = self.shapes(data), perf_counter()
        progress(f"Simulating {len(shapes)} shapes")
        robots = [self._robot(shape) for shape in shapes]
        with executor_of(workers) as executor:
            found = list(results(executor, _positions_of, robots, [(k,) for k in range(len(robots))]))
        at = np.array(found)
        channels = {f"{point}.{axis}": at[:, k, i] for k, point in enumerate(POINTS) for i, axis in enumerate("xyz")}
        samples = tuple(shape.name for shape in shapes)
        return Predictions(samples, channels, method="softcal", evaluations=0, wall_s=perf_counter() - began)

    def robot(self) -> Robot:
        return self._robot(self.shapes(None)[0])

    def shapes(self, data: Path | None) -> list[Shape]:
        """The shapes of a file in SoRoSim's layout.

        Raises
        ------
        StorageError, DatasetError
            Where it cannot be read, or has another layout.
        """
        path = data or self.folder / f"{self.name.removeprefix('sorosim-')}.csv"
        try:
            lines = list(csv.reader(line for _, block in open_text(path).blocks() for line in block))
        except csv.Error as error:
            raise DatasetError(Fault("the line cannot be cut into cells", str(path), str(error))) from error
        LIMITS["samples"].check(len(lines), where=str(path))
        rows = [(number, row) for number, row in enumerate(lines, start=1) if any(cell.strip() for cell in row)][2:]
        table = _table(rows, str(path))
        kept = [k for k in range(3, COLUMNS) if k not in (3, 3 + len(HALF) + 1)]
        blocks = table.reshape(-1, LINES, COLUMNS)
        names = [rows[LINES * i][1][0].rpartition("_")[2] for i in range(len(blocks))]
        return [
            Shape(name, one[3:, 0], one[3:, 1:3].T, one[:3, 1:3].T, one[3:][:, kept].T)
            for name, one in zip(names, blocks, strict=True)
        ]

    def _robot(self, shape: Shape) -> Robot:
        def at(share: float) -> Floats:
            return np.array([share * self.length, 0.0, 0.0])

        rod = Rod(
            "rod",
            straight(at(0.0).tolist(), at(1.0).tolist(), spaced(STATIONS, 1.0 / ELEMENTS)),
            RoundBar(self.diameter),
            {"youngs_modulus": self.youngs_modulus, "poissons_ratio": self.poissons_ratio},
            fixed=np.array([0]),
            density=self.density,
        )
        places = (("middle", at(0.5)), ("end", at(1.0)))
        forces = [PointLoad(f"{n}_force", "rod", p, f) for (n, p), f in zip(places, shape.forces, strict=True)]
        moments = [Moment(f"{n}_moment", "rod", m, p) for (n, p), m in zip(places, shape.moments, strict=True)]
        markers = [Marker(point, "rod", at(share)) for point, share in zip(POINTS, STATIONS, strict=True)]
        return Robot(rods=(rod,), loads=(*forces, *moments), markers=tuple(markers), gravity=shape.gravity)


def _table(rows: Sequence[tuple[int, list[str]]], where: str) -> Floats:
    """The numbers (n, COLUMNS) of numbered lines in SoRoSim's layout.

    Raises
    ------
    DatasetError
        With everything that is wrong with them.
    """
    faults: list[Fault] = []
    table = np.full((len(rows), COLUMNS), np.nan)
    for k, (number, row) in enumerate(rows):
        if len(row) != COLUMNS + 1:
            got = f"{len(row)} cells"
            faults.append(
                Fault("the line has not the cells of a shape", f"{where}, line {number}", got, f"{COLUMNS + 1}")
            )
            continue
        for place, cell in enumerate(row[1:]):
            table[k, place] = number_in(cell)
        if wrong := [row[place + 1] for place in np.flatnonzero(~np.isfinite(table[k]))]:
            faults.append(Fault("cells are no numbers", f"{where}, line {number}", repr(wrong[0]), "a finite number"))
    labels = [row[0].rpartition("_") for _, row in rows]
    shapes = dict.fromkeys(shape for _, _, shape in labels)
    for shape in shapes:
        own = [kind for kind, _, one in labels if one == shape]
        if own != list(KINDS):
            faults.append(Fault(f"shape {shape} needs {LINES} lines", where, ", ".join(own), ", ".join(KINDS)))
    ordered = [(kind, shape) for shape in shapes for kind in KINDS]
    if not faults and (astray := [i for i, (kind, _, shape) in enumerate(labels) if (kind, shape) != ordered[i]]):
        got = ", ".join(f"{kind} of {shape}" for kind, _, shape in labels[astray[0] - 1 : astray[0] + 1])
        faults.append(Fault("the lines of the shapes are not in order", where, got, f"{', '.join(KINDS)} of each"))
    if not rows:
        faults.append(Fault("the file has no shape", where, allowed=f"two header lines, then {LINES} for each shape"))
    if faults:
        raise DatasetError(faults)
    return table


def _positions_of(robots: Sequence[Robot], k: int) -> Floats:
    response = simulate(robots[k], Protocol({}))
    if not response.succeeded:
        raise SimulationError(response.status)
    return np.array([[response.channels[f"{point}.{axis}"][0] for axis in "xyz"] for point in POINTS])


def _chains(*rows: tuple[int, float, float, float]) -> Sequence[Published]:
    """The rival's rows, chains of rigid links: their number, and mean, 95 % and largest error [% of the length]."""
    source = "its figure sorosim_statics_error.png, all 500 shapes"
    tip = "tip: mean {:g} %, 95 % below {:g} %, largest {:g} % of the length"
    return tuple(Published(f"OpenCR-MuJoCo, {n} links", source, note=tip.format(*errors)) for n, *errors in rows)


@register_case
class SpringSteelRod(SoroSimRod):
    """Spring steel, 0.6 m by 1.6 mm."""

    name = "sorosim-steel"
    title = "Spring-steel rod under gravity and wrenches, 250 static shapes (computed by SoRoSim)"
    length = 0.6
    diameter, youngs_modulus, poissons_ratio, density = 1.6e-3, 200e9, 0.33, 7870.0
    published = _chains((25, 0.67, 1.35, 2.2), (50, 0.19, 0.53, 1.07), (100, 0.098, 0.26, 0.56))
    goal = "mean tip error within 0.05 % of the length"


@register_case
class TpuRod(SoroSimRod):
    """TPU, 0.4 m by 10 mm."""

    name = "sorosim-tpu"
    title = "TPU rod under gravity and wrenches, 250 static shapes (computed by SoRoSim)"
    length = 0.4
    diameter, youngs_modulus, poissons_ratio, density = 10e-3, 70e6, 0.4, 1200.0
    published = _chains((25, 0.69, 1.57, 2.3), (50, 0.20, 0.59, 1.06), (100, 0.105, 0.30, 0.53))
    goal = "mean tip error within 0.05 % of the length"
