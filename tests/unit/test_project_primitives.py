"""Rods, springs and discs as meshes of a project's bodies; the manipulator with solid springs."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest
from robot_case import MANIPULATOR, write_robot

from softcal.errors import ProjectFileError
from softcal.project.meshes import is_generated
from softcal.project.project import load
from softcal.project.robot_schema import BodySection

needs_gmsh = pytest.mark.skipif(importlib.util.find_spec("gmsh") is None, reason="Gmsh is not installed")

SPRING = """\
softcal: 1
name: a spring
robot:
  bodies:
    coil:
      mesh: {primitive: spring, wire_diameter: 2 mm, coil_diameter: 12 mm, turns: 1.5, height: 9 mm, rings: 2}
      youngs_modulus: 1 GPa
      poissons_ratio: 0.4
      fixed: start
      placement: {position: [0 mm, 0 mm, 5 mm]}
  plates:
    top: {body: coil, region: end, reference: [0 mm, 0 mm, 14 mm]}
"""
SOLID = ("wire_diameter: 9 mm\n", "model: solid\n      layers_per_turn: 6\n      wire_diameter: 9 mm\n")


def faults_of(path: Path) -> list[str]:
    with pytest.raises(ProjectFileError) as error:
        load(path)
    return [str(fault) for fault in error.value.faults]


def test_a_spring_is_tied_by_its_end_faces(tmp_path: Path):
    project = load(write_robot(tmp_path, text=SPRING))
    (coil,) = project.robot.bodies
    wire = 1.5 * math.hypot(math.pi * 0.012, 0.006)
    assert project.qualities["coil"].volume == pytest.approx(0.25 * math.pi * 0.002**2 * wire, rel=1e-3)
    assert coil.mesh.points[coil.fixed].mean(axis=0) == pytest.approx([0.006, 0.0, 0.005], abs=1e-4)
    held = project.robot.plates[0].nodes["coil"]
    assert coil.mesh.points[held].mean(axis=0) == pytest.approx([-0.006, 0.0, 0.014], abs=1e-4)
    assert not project.generated, "made again without Gmsh, it need not be kept"


def test_a_rod(tmp_path: Path):
    text = SPRING.replace("wire_diameter: 2 mm, coil_diameter: 12 mm, turns: 1.5, height: 9 mm, rings: 2", "LENGTHS")
    text = text.replace("primitive: spring, LENGTHS", "primitive: rod, length: 9 mm, diameter: 3 mm, layers: 4")
    project = load(write_robot(tmp_path, text=text))
    assert project.robot.bodies[0].mesh.n_tets == 18 * 4
    assert project.qualities["coil"].upper[2] == pytest.approx(0.014)


DISC = SPRING.replace(
    "{primitive: spring, wire_diameter: 2 mm, coil_diameter: 12 mm, turns: 1.5, height: 9 mm, rings: 2}",
    "{primitive: disc, diameter: 30 mm, thickness: 9 mm, size: 6 mm, order: 1,\n"
    "             holes: {count: 3, diameter: 3 mm, radius: 10 mm, first_angle: 90 deg}}",
).replace("start", "rim")


@needs_gmsh
def test_a_disc(tmp_path: Path):
    project = load(write_robot(tmp_path, text=DISC.replace("region: end", "region: h1")))
    (disc,) = project.robot.bodies
    held = disc.mesh.points[project.robot.plates[0].nodes["coil"]]
    assert np.linalg.norm(held[:, :2] - [0.0, 0.010], axis=1) == pytest.approx(0.0015, rel=0.1)
    assert set(project.generated) == {"coil"}


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("primitive: spring", "primitive: sprin", ("mesh", "no such primitive; got 'sprin'", "Try: 'spring'")),
        ("primitive: spring", "primitive: coil", ("mesh", "no such primitive; got 'coil'", "neck, rod, spring, disc")),
        ("height: 9 mm, ", "", ("coil.mesh: the height of the spring is not specified; got neither",)),
        ("height: 9 mm, ", "height: 9 mm, pitch: 6 mm, ", ("got pitch and height",)),
        ("turns: 1.5", "turn: 1.5", ("mesh.turn", "unknown key", "'turns'")),
        ("height: 9 mm", "height: 2 mm", ("mesh", "coils of the spring overlap", "1.333 mm from wire to wire")),
        ("wire_diameter: 2 mm", "wire_diameter: 2 N", ("mesh.wire_diameter", "unit does not fit")),
        ("rings: 2", "layers_per_turn: 4", ("mesh.layers_per_turn", "too few layers in a turn; got 4", "6 to 1000")),
        ("region: end", "region: ends", ("plates.top.region", "'ends'", "end, skin, start")),
    ],
)
def test_faults_of_a_spring(tmp_path: Path, old: str, new: str, told: tuple[str, ...]):
    (fault,) = faults_of(write_robot(tmp_path, (old, new), text=SPRING))
    assert all(part in fault for part in told), fault


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("size: 6 mm, ", "", ("coil.mesh: the mesh needs a target; got neither size nor tets",)),
        ("radius: 10 mm", "radius: 14 mm", ("coil.mesh: the holes do not fit into the disc",)),
        ("count: 3, ", "", ("mesh.holes.count: a key is missing", "'count' must be given")),
    ],
)
def test_faults_of_a_disc(tmp_path: Path, old: str, new: str, told: tuple[str, ...]):
    (fault,) = faults_of(write_robot(tmp_path, (old, new), text=DISC.replace("region: end", "region: top")))
    assert all(part in fault for part in told), fault


@pytest.mark.parametrize(
    ("mesh", "told"),
    [
        ("3", "coil.mesh: this is of the wrong kind; got 3; allowed: a mapping of keys"),
        ("{file: 3, unit: mm}", "coil.mesh.file: this is of the wrong kind; got 3; allowed: text"),
        ("{file: a.stl, tets: 90}", "coil.mesh: the unit of the mesh is missing"),
    ],
)
def test_faults_of_a_mesh_stand_at_the_keys_of_the_file(tmp_path: Path, mesh: str, told: str):
    given = next(line for line in SPRING.splitlines() if "mesh:" in line).partition("mesh: ")[2]
    assert told in faults_of(write_robot(tmp_path, (given, mesh), text=SPRING))[0]


def test_only_meshes_of_gmsh_are_kept_with_a_run():
    values = {"youngs_modulus": "1 MPa", "poissons_ratio": 0.4}
    kinds = {
        True: ({"primitive": "disc", "diameter": "3 mm", "thickness": "1 mm", "size": "1 mm"},),
        False: ({"primitive": "rod", "diameter": "3 mm", "length": "1 mm"}, {"file": "a.msh", "unit": "mm"}),
    }
    for expected, meshes in kinds.items():
        for mesh in meshes:
            assert is_generated(BodySection.model_validate({"mesh": mesh, **values})) is expected


def test_the_manipulators_springs_can_be_solid(tmp_path: Path):
    rods = load(write_robot(tmp_path / "rods", text=MANIPULATOR))
    solid = load(write_robot(tmp_path / "solid", SOLID, text=MANIPULATOR))
    assert not solid.robot.rods
    assert [body.name for body in solid.robot.bodies] == ["spring1", "spring2", "spring3", "spring4"]
    assert solid.qualities["spring1"].n_tets == 18 * 3 * 6
    assert set(solid.parameters) == set(rods.parameters)
    assert [plate.name for plate in solid.robot.plates] == [plate.name for plate in rods.robot.plates]
    assert all(plate.nodes for plate in solid.robot.plates)
    assert solid.warnings == ()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("model: solid", "model: tets"), ("springs.model", "'tets'", "'rod', 'solid'")),
        (("layers_per_turn: 6", "layers_per_turn: 4"), ("springs.layers_per_turn", "too few layers in a turn; got 4")),
        (("1.6 GPa", "{spring9: 1 GPa}"), ("youngs_modulus.spring9",)),
    ],
)
def test_faults_of_solid_springs(tmp_path: Path, change: tuple[str, str], told: tuple[str, ...]):
    faults = faults_of(write_robot(tmp_path, SOLID, change, text=MANIPULATOR))
    assert all(part in faults[0] for part in told), faults[0]
