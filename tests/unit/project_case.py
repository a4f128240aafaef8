"""A whole small project for the tests: a square bar, one cable, a bench file made by the twin itself."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from project_text import changed

from softcal.geometry.primitives import box_mesh
from softcal.geometry.write import write_mesh
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint
from softcal.twin.simulate import simulate

MODULUS, RATIO, SLACK = 1.3e6, 0.42, 0.0015

PROJECT = """\
softcal: 1
name: a square bar
robot:
  bodies:
    bar:
      mesh: {file: bar.msh, unit: mm}
      element: P1
      youngs_modulus: 2 MPa
      poissons_ratio: 0.42
      regions:
        foot: {plane: {point: [0 mm, 0 mm, 0 mm], normal: [0, 0, 1]}}
        head: {group: z1}
      fixed: foot
  plates:
    plate: {body: bar, region: head, reference: [0 mm, 0 mm, 100 mm]}
  cables:
    front:
      via:
        - {on: plate, at: [30 mm, 0 mm, 100 mm]}
        - {at: [30 mm, 0 mm, 0 mm]}
experiments:
  pull:
    cable: front
    plate: plate
    files:
      - path: data/pull.csv
        columns:
          time: {name: Time}
          shortening: {name: Displacement, unit: mm}
          tension: {name: Force, unit: N}
          pitch: {name: Pitch, unit: deg}
    noise: {tension: 0.05 N, pitch: 0.2 deg}
parameters:
  bar.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}
  front.slack: {bounds: [0 mm, 5 mm], per: experiment}
calibration: {method: least-squares, starts: 1}
print: {bulk_youngs_modulus: [8 MPa, 12 MPa], infill: 0.3, exponent: [1.2, 1.6]}
"""


def write_project(folder: Path, *changes: tuple[str, str], data: str | None = None, mesh: bytes | None = None) -> Path:
    """Write the project with texts of it replaced; every text must be there."""
    text = changed(PROJECT, changes)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "data").mkdir(exist_ok=True)
    (folder / "data" / "pull.csv").write_text(bench_csv() if data is None else data, encoding="utf-8")
    if mesh is None:
        write_mesh(bar_mesh(in_millimetres=True), folder / "bar.msh")
    else:
        (folder / "bar.msh").write_bytes(mesh)
    path = folder / "project.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def bar_mesh(*, in_millimetres: bool = False):
    scale = 1.0 if in_millimetres else 1e-3
    size = [20 * scale, 20 * scale, 100 * scale]
    return box_mesh(size, [2, 2, 8], origin=[-10 * scale, -10 * scale, 0.0])


def bar_robot(modulus: float = MODULUS, ratio: float = RATIO) -> Robot:
    mesh = bar_mesh()
    z = mesh.points[:, 2]
    parameters = {"youngs_modulus": modulus, "poissons_ratio": ratio}
    body = Body("bar", mesh, np.flatnonzero(z < 1e-9), parameters, element="P1")
    plate = Plate("plate", {"bar": np.flatnonzero(z > 0.1 - 1e-9)}, np.array([0.0, 0.0, 0.1]))
    via = (ViaPoint(np.array([0.03, 0, 0.1]), "plate"), ViaPoint(np.array([0.03, 0, 0.0])))
    return Robot((body,), (plate,), (Cable("front", via),))


@functools.cache
def bench_values() -> tuple[Sequence[float], ...]:
    """Time [s], shortening [mm], tension [N] and pitch [deg] of the bar at the true values."""
    shortening = np.linspace(0.002, 0.02, 25)
    response = simulate(bar_robot(), Protocol({"front": Command("shortening", shortening - SLACK)}))
    assert response.succeeded, response.status
    pitch = np.rad2deg(response.channels["plate.pitch"])
    return np.arange(25) * 0.1, 1e3 * shortening, response.channels["front.tension"], pitch


def bench_csv() -> str:
    rows = zip(*bench_values(), strict=True)
    lines = ["Time [s],Displacement [mm],Force [N],Pitch [deg]"]
    lines += [f"{t:.3f},{d:.6f},{f:.6f},{p:.6f}" for t, d, f, p in rows]
    return "\n".join(lines) + "\n"
