"""A small robot section with one of everything, for the tests: two bars tied together, a rod, plates, cables."""

from __future__ import annotations

from pathlib import Path

from project_text import changed

from softcal.geometry.primitives import box_mesh
from softcal.geometry.write import write_mesh

ROBOT = """\
softcal: 1
name: one of everything
robot:
  bodies:
    lower:
      mesh: {file: bar.msh, unit: mm}
      element: P1
      youngs_modulus: 2 MPa
      poissons_ratio: 0.42
      regions:
        foot: {plane: {point: [0 mm, 0 mm, 0 mm], normal: [0, 0, 1]}}
        head: {group: z1}
      fixed: foot
    upper:
      mesh: {file: bar.msh, unit: mm}
      element: P1
      youngs_modulus: 3 MPa
      poissons_ratio: 0.42
      placement: {position: [0 mm, 0 mm, 40 mm], rotation: {axis: [0, 0, 1], angle: 15 deg}}
      regions:
        foot: {plane: {point: [0 mm, 0 mm, 0 mm], normal: [0, 0, 1]}}
        head: {group: z1}
  ties:
    seam: {body: upper, region: foot, on: lower}
  plates:
    top:
      body: upper
      region: head
      reference: [0 mm, 0 mm, 80 mm]
      mass: 10 g
      disc: {diameter: 60 mm, thickness: 4 mm, centre: [0 mm, 0 mm, 82 mm], hole_diameter: 2 mm}
      holes: {ring: {count: 3, radius: 25 mm, first_angle: 90 deg, names: [a, b, c]}}
    tip:
      reference: [0 mm, 0 mm, 200 mm]
      holes: {points: {p1: [25 mm, 0 mm, 200 mm]}}
  rods:
    mast:
      straight: {start: [0 mm, 0 mm, 82 mm], end: [0 mm, 0 mm, 200 mm]}
      section: {diameter: 4 mm}
      youngs_modulus: 1 GPa
      poissons_ratio: 0.35
      density: 900 kg/m^3
      clamped: {top: start, tip: end}
  cables:
    front:
      via:
        - {at: [0 mm, 25 mm, 0 mm]}
        - {on: top, hole: a}
        - {on: tip, at: [0 mm, 25 mm, 200 mm]}
      pulled_end: first
  loads:
    weight: {on: tip, at: [0 mm, 0 mm, 200 mm], mass: 5 g}
    push: {on: top, hole: b, direction: [0, 2, 0], force: 0.02 N}
  markers:
    eye: {on: tip, hole: p1}
    wall: {on: lower, at: [12 mm, 0 mm, 20 mm]}
  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]
"""

MANIPULATOR = """\
softcal: 1
name: a manipulator
robot:
  manipulator:
    total_length: 425 mm
    discs: {diameter: 60 mm, mass: 20 g}
    springs:
      wire_diameter: 9 mm
      turns: 3
      youngs_modulus: 1.6 GPa
      poissons_ratio: 0.43
    cables: {radius: 25 mm, ends: {S2: 0 deg, S4: 60 deg}}
  cables:
    extra: {via: [{at: [0 mm, 0 mm, 10 mm]}, {on: S3, hole: h2}]}
  markers:
    tip: {on: S4, at: [0 mm, 0 mm, -425 mm]}
  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]
"""


def write_robot(folder: Path, *changes: tuple[str, str], text: str = ROBOT) -> Path:
    """Write a project with texts of it replaced; every text must be there."""
    text = changed(text, changes)
    folder.mkdir(parents=True, exist_ok=True)
    write_mesh(box_mesh([20.0, 20.0, 40.0], [2, 2, 3], origin=[-10.0, -10.0, 0.0]), folder / "bar.msh")
    path = folder / "project.yaml"
    path.write_text(text, encoding="utf-8")
    return path
