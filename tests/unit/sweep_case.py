"""A small hanging manipulator of two sections with one cable, and a table of markers that its own twin made."""

from __future__ import annotations

import csv
import functools
import io
from pathlib import Path

import numpy as np
from project_text import changed

from softcal.twin.manipulator import Cables, Discs, Manipulator, Springs, manipulator
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

MODULUS, RATIO, LENGTH = 0.8e9, 0.3, 0.2
FORCES = (2.0, 4.0, 6.0)
CABLES = ("cable1", "cable2")

PROJECT = """\
softcal: 1
name: a small manipulator
robot:
  manipulator:
    total_length: 200 mm
    sections: 2
    hanging: true
    discs: {diameter: 60 mm, mass: 20 g}
    springs:
      wire_diameter: 6 mm
      turns: 2
      elements_per_turn: 6
      youngs_modulus: 1.6 GPa
      poissons_ratio: 0.43
    cables: {radius: 25 mm, per_end: 2, ends: {S2: 30 deg}}
  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]
rig: {length: 200 mm}
experiments:
  cable1:
    drive: [cable1.tension]
    files:
      - path: places.csv
        columns: {cable1.tension: {name: cable1, unit: N}}
        markers: [marker1, marker2]
        where: {pulled: cable1}
  cable2:
    drive: [cable2.tension]
    files:
      - path: places.csv
        columns: {cable2.tension: {name: cable2, unit: N}}
        markers: [marker1, marker2]
        where: {pulled: cable2}
parameters:
  springs.youngs_modulus: {of: spring*.youngs_modulus, bounds: [0.2 GPa, 10 GPa], scale: log}
  springs.poissons_ratio: {of: spring*.poissons_ratio, bounds: [0.05, 0.49]}
calibration: {loss: distance, starts: 1}
sweep:
  over:
    springs.youngs_modulus: 1.2 GPa:0.4 GPa:0.4 GPa
    springs.poissons_ratio: [0.1, 0.3]
  experiments: [cable1]
"""
OVER = {"springs.youngs_modulus": "1.2GPa:0.4GPa:0.4GPa", "springs.poissons_ratio": "0.1,0.3"}


def robot(modulus: float = MODULUS, ratio: float = RATIO, elements_per_turn: int = 6) -> Robot:
    springs = Springs(
        youngs_modulus=modulus, poissons_ratio=ratio, density=0.0, wire_diameter=0.006, turns=2.0,
        elements_per_turn=elements_per_turn,
    )  # fmt: skip
    cables = Cables(ends={"S2": np.radians(30.0)}, per_end=2)
    return manipulator(
        Manipulator(total_length=LENGTH, sections=2, springs=springs, discs=Discs(mass=0.02), cables=cables)
    )


def write_sweep(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the project with texts of it replaced; every text must be there."""
    text = changed(PROJECT, changes)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "places.csv").write_text(table(), encoding="utf-8")
    path = folder / "project.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@functools.cache
def table() -> str:
    """Where the twin's markers are at the true values, with each cable pulled by each force."""
    lines = [["pulled", *CABLES, *(f"{m}.{axis} [m]" for m in ("marker1", "marker2") for axis in "xyz")]]
    for cable in CABLES:
        response = simulate(robot(), Protocol({cable: Command("tension", np.array(FORCES))}), curve_tolerance=0.0)
        assert response.succeeded, response.status
        places = [response.channels[f"{m}.{axis}"] for m in ("marker1", "marker2") for axis in "xyz"]
        for i, force in enumerate(FORCES):
            forces = [f"{force if name == cable else 0.0:g}" for name in CABLES]
            lines.append([cable, *forces, *(f"{values[i]:.9f}" for values in places)])
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue()
