"""A body of several materials in a project: read, refused, listed, exported, and each modulus found again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from project_text import changed

import softcal
from softcal.errors import InputError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.write import write_mesh
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.stress import cauchy_stress
from softcal.plugins.calculix.deck import calculix_deck, in_its_law
from softcal.plugins.calculix.load_path import load_path
from softcal.plugins.sofa.robot import scene_faults
from softcal.project.project import load
from softcal.report.format import parameter_label
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Material
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import calibrate
from softcal.workflows.checking import check

PROJECT = """\
softcal: 1
name: printed in one piece
robot:
  bodies:
    bar:
      mesh: {file: bar.vtu, unit: mm}
      element: P1
      youngs_modulus: 2 MPa
      poissons_ratio: 0.35
      density: 900 kg/m^3
      materials:
        soft: {region: upper half, youngs_modulus: 1 MPa}
      fixed: z0
  plates:
    plate: {body: bar, region: z1, reference: [0 mm, 0 mm, 100 mm]}
  cables:
    front: {via: [{on: plate, at: [30 mm, 0 mm, 100 mm]}, {at: [30 mm, 0 mm, 0 mm]}]}
experiments:
  pull:
    cable: front
    plate: plate
    compare: [tension, x, z]
    files:
      - path: pull.csv
        columns:
          shortening: {name: d, unit: mm}
          tension: {name: T, unit: N}
          x: {name: x, unit: mm}
          z: {name: z, unit: mm}
    noise: {tension: 0.01 N, x: 0.1 mm, z: 0.1 mm}
parameters:
  bar.youngs_modulus: {bounds: [0.2 MPa, 20 MPa], scale: log}
  bar.soft.youngs_modulus: {bounds: [0.1 MPa, 10 MPa], scale: log}
calibration: {method: least-squares, loss: likelihood, starts: 1}
"""


def two_materials(folder: Path, *changes: tuple[str, str]) -> Path:
    folder.mkdir()
    box = box_mesh([20.0, 20.0, 100.0], [2, 2, 8], origin=[-10.0, -10.0, 0.0])
    upper = np.flatnonzero(box.points[box.tets].mean(axis=1)[:, 2] > 50.0)
    sets = {"upper half": upper, "all of it": np.arange(box.n_tets)}
    write_mesh(TetMesh(box.points, box.tets, dict(box.node_sets), {}, sets), folder / "bar.vtu")
    path = folder / "project.yaml"
    (folder / "pull.csv").write_text("d,T,x,z\n0,0,0,100\n1,1,1,99\n", encoding="utf-8")
    path.write_text(changed(PROJECT, changes), encoding="utf-8")
    return path


def test_the_group_has_a_material_of_its_own(tmp_path: Path):
    project = load(two_materials(tmp_path / "p"))
    known = robot_parameters(project.robot)
    assert known["bar.youngs_modulus"].value == 2e6
    assert known["bar.soft.youngs_modulus"].value == 1e6
    assert known["bar.soft.poissons_ratio"].value == 0.35
    assert known["bar.soft.density"].value == 900.0
    (part,) = project.robot.bodies[0].inclusions
    assert len(part.elements) == project.robot.bodies[0].mesh.n_tets // 2
    assert dict(check(project).rows)["  material of soft"] == "192 tets, E 1 MPa, ν 0.35, 900 kg/m³".replace(
        "192", str(len(part.elements))
    )
    assert parameter_label("bar.soft.youngs_modulus", known) == "E (bar.soft)"


@pytest.mark.parametrize("name", ["poissons_ratio", "density"])
@pytest.mark.parametrize("whose", ["bar", "bar*"])
def test_a_constant_that_is_omitted_and_does_not_vary_with_the_body_is_warned_of(tmp_path: Path, name: str, whose: str):
    uncertain = ("calibration: {", f'uncertain: {{"{whose}.{name}": {{sd: 0.01}}}}\ncalibration: {{')
    if name == "density":
        uncertain = uncertain[0], uncertain[1].replace("0.01", "10 kg/m^3")
    found = [str(one) for one in load(two_materials(tmp_path / "p", uncertain)).warnings]
    said = f"bar.soft.{name} is omitted, and keeps the file's value where bar.{name} has another"
    assert [said in one for one in found] == ([True] if whose == "bar" else [])


@pytest.mark.parametrize(("whose", "n"), [("bar", 1), ("bar*", 0)])
def test_a_constant_that_is_omitted_is_warned_of_where_that_of_the_body_is_set(tmp_path: Path, whose: str, n: int):
    project = load(two_materials(tmp_path / "p"), values={f"{whose}.poissons_ratio": 0.4})
    inclusion = robot_parameters(project.robot)["bar.soft.poissons_ratio"].value
    assert inclusion == (0.35 if n else 0.4)
    assert len(project.warnings) == n
    also = "" if n else ", bar.soft.poissons_ratio: 0.4"
    setting = "    cable: front\n", f"    cable: front\n    settings: {{bar.poissons_ratio: 0.4{also}}}\n"
    assert len(load(two_materials(tmp_path / "q", setting)).warnings) == n


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("region: upper half", "region: upper haf"), "'upper haf'.*upper half"),
        (("region: upper half", "region: all of it"), "leave none of the tets to its own material"),
        (("youngs_modulus: 1 MPa}", "youngs_modulus: 1 MPa}\n        b: {region: upper half, youngs_modulus: 3 MPa}"),
         "96 tets are of two materials"),
        (("soft: {region: upper half, ", "two words: {region: upper half, "), "this cannot be a name"),
        (("youngs_modulus: 1 MPa}", "youngs_modulus: -1 MPa}"), "out of range"),
    ],
    ids=["unknown", "whole", "twice", "name", "negative"],
)  # fmt: skip
def test_what_is_wrong_is_said(tmp_path: Path, change: tuple[str, str], said: str):
    keep = ("  bar.soft.youngs_modulus: {bounds: [0.1 MPa, 10 MPa], scale: log}\n", "")
    with pytest.raises(InputError, match=said) as caught:
        load(two_materials(tmp_path / "p", change, keep))
    assert "materials" in str(caught.value)


def test_both_moduli_are_found_again(tmp_path: Path):
    path = two_materials(tmp_path / "p")
    truth = with_parameters(load(path).robot, {"bar.youngs_modulus": 3.1e6, "bar.soft.youngs_modulus": 0.6e6})
    d = np.linspace(0.0, 0.02, 9)
    channels = simulate(truth, Protocol({"front": Command("shortening", d)})).channels
    rows = zip(1e3 * d, channels["front.tension"], 1e3 * channels["plate.x"], 1e3 * channels["plate.z"], strict=True)
    lines = ["d,T,x,z", *(",".join(f"{v:.9g}" for v in row) for row in rows)]
    (path.parent / "pull.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = calibrate(load(path), out=tmp_path / "run").headline.parameters
    assert found["bar.youngs_modulus"].value == pytest.approx(3.1e6, rel=1e-3)
    assert found["bar.soft.youngs_modulus"].value == pytest.approx(0.6e6, rel=1e-3)


def loaded_shape(path: Path):
    robot = load(path).robot
    pulled = Protocol({"front": Command("shortening", np.array([0.01]))})
    return robot, simulate(robot, pulled, snapshots="samples")


def test_stresses_are_each_materials_own(tmp_path: Path):
    robot, response = loaded_shape(two_materials(tmp_path / "p"))
    shape = response.snapshots[-1]
    grid = softcal.shape_grid(robot, shape)
    body, x = robot.bodies[0], shape.points["bar"]
    (part,) = body.inclusions
    stress = np.asarray(grid.cell_data["stress"]).reshape(-1, 3, 3)[: body.mesh.n_tets]
    own = cauchy_stress(ELEMENTS[body.element], body.mesh, _law(), part.parameters, x)
    rest = cauchy_stress(ELEMENTS[body.element], body.mesh, _law(), body.parameters, x)
    others = np.setdiff1d(np.arange(body.mesh.n_tets), part.elements)
    np.testing.assert_allclose(stress[part.elements], own[part.elements], rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(stress[others], rest[others], rtol=1e-12, atol=1e-9)


def _law():
    from softcal.materials.catalogue import LAWS

    return LAWS["neo-hooke"]


def test_calculix_gets_both_materials_and_sofa_refuses(tmp_path: Path):
    robot, _ = loaded_shape(two_materials(tmp_path / "p"))
    its = in_its_law(robot)
    pulled = Protocol({"front": Command("shortening", np.array([0.01]))})
    shape = simulate(its, pulled, snapshots="samples").snapshots[-1]
    text = calculix_deck(its, load_path(its, shape).shapes).text
    assert "*MATERIAL, NAME=BAR\n" in text
    assert "*MATERIAL, NAME=BAR__SOFT\n" in text
    assert text.count("*SOLID SECTION") == 2
    numbers = [
        int(line.split(",")[0])
        for line in text.split("*ELEMENT, TYPE=C3D4, ELSET=BAR__SOFT\n")[1].split("*")[0].splitlines()
    ]
    assert len(numbers) == len(robot.bodies[0].inclusions[0].elements)
    (fault,) = scene_faults(robot)
    assert "several materials" in fault.what
    assert fault.got == "soft"


def test_a_material_of_no_tets_is_no_part():
    mesh = box_mesh([0.02, 0.02, 0.1], [1, 1, 4])
    steel = {"youngs_modulus": 1e6, "poissons_ratio": 0.3}
    with pytest.raises(InputError, match="8 tets are of two materials"):
        Body("bar", mesh, np.array([0]), steel, inclusions=(
            Material("a", np.arange(8), steel), Material("b", np.arange(8), steel),
        ))  # fmt: skip
