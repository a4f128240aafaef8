"""Via points in a bore: held by the wall all around, found with its diameter, refused with one sentence elsewhere."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bore_case import AT, BORE, LONG, WIDE, drilled_bar, drilled_robot
from hypothesis import given
from hypothesis import strategies as st
from project_case import write_project

from softcal.cli import main
from softcal.errors import InputError, MeshError
from softcal.geometry import cell
from softcal.geometry.bore import wall_around
from softcal.geometry.generate import mesh_file
from softcal.geometry.locate import barycentric_in, distances_to_triangles, nearest_tets, tets_holding
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import to_quadratic
from softcal.geometry.surface import boundary_faces
from softcal.geometry.write import write_mesh
from softcal.mechanics.attachment import attach_point
from softcal.plugins.sofa.robot import scene_faults
from softcal.project.project import load
from softcal.twin.routing import bores
from softcal.workflows.checking import check

needs_gmsh = pytest.mark.skipif(importlib.util.find_spec("gmsh") is None, reason="Gmsh is not installed")
BAR = drilled_bar()
INNER = st.floats(-0.49, 0.49)


@given(INNER, INNER, st.floats(0.0, 1.0))
def test_a_point_in_a_bore_follows_every_linear_field(x: float, y: float, z: float):
    point = np.array([AT + x * BORE, y * BORE, z * LONG])
    for mesh in (BAR, to_quadratic(BAR)):
        held = attach_point(mesh, point)
        assert held.weights.sum() == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(held.weights @ mesh.points[held.nodes], point, atol=1e-14)


def test_the_wall_is_on_all_sides():
    """On one side alone the same point would take the mesh's accidents with it."""
    held = attach_point(BAR, np.array([AT, 0.0, 0.4 * LONG]))
    around = BAR.points[held.nodes] - np.array([AT, 0.0, 0.4 * LONG])
    for side in ([1, 0], [-1, 0], [0, 1], [0, -1]):
        assert (around[:, :2] @ side).max() >= 0.5 * BORE - 1e-9
    assert BORE <= held.bore <= BORE * 2**0.5
    assert held.weights.max() < 0.5


def test_points_at_the_mouth_and_beside_it():
    assert attach_point(BAR, np.array([AT, 0.0, LONG])).bore > 0.0
    assert attach_point(BAR, np.array([AT, 0.0, LONG + 1e-5])).bore > 0.0
    with pytest.raises(MeshError, match="outside its body"):
        attach_point(BAR, np.array([AT, 0.0, LONG + BORE]))


@pytest.mark.parametrize("at", [[0.7 * WIDE, 0.0, 0.03], [0.0, -0.52 * WIDE, 0.03], [0.0, 0.0, -0.001]])
def test_no_wall_surrounds_what_is_beside_the_body(at: list[float]):
    assert wall_around(BAR, np.array(at)) is None


@pytest.mark.slow
def test_points_are_located_as_by_all_tets_and_all_triangles():
    low, high = BAR.points.min(axis=0), BAR.points.max(axis=0)
    points = np.random.default_rng(3).uniform(low - 0.002, high + 0.002, (200, 3))
    coordinates = np.stack([[barycentric_in(BAR, tet, at) for tet in range(BAR.n_tets)] for at in points])
    inside = coordinates.min(axis=2).max(axis=1) >= 0.0
    assert 20 < inside.sum() < 180
    holding = tets_holding(BAR, points)
    np.testing.assert_array_equal(holding, np.where(inside, coordinates.min(axis=2).argmax(axis=1), -1))
    triangles = BAR.points[boundary_faces(BAR)[:, :3]]
    far = [distances_to_triangles(at, triangles).min() for at in points]
    np.testing.assert_array_equal(nearest_tets(BAR, points)[1], far)


def test_the_faces_of_a_mesh_are_searched_once(monkeypatch: pytest.MonkeyPatch):
    n, mesh = 0, drilled_bar(4)

    def outer_faces(tets: np.ndarray) -> np.ndarray:
        nonlocal n
        n += 1
        return cell.outer_faces(tets)

    monkeypatch.setattr("softcal.geometry.mesh.outer_faces", outer_faces)
    for z in (0.01, 0.02, 0.03):
        assert attach_point(mesh, np.array([AT, 0.0, z])).bore > 0.0
    assert n == 1


def test_no_wall_surrounds_what_is_in_an_open_groove():
    """The channel with its bricks on one side taken away as well: a ray escapes."""
    centres = BAR.points[BAR.tets].mean(axis=1)
    open_side = (centres[:, 0] > BORE) & (np.abs(centres[:, 1]) < 0.5 * BORE)
    grooved = TetMesh(BAR.points, BAR.tets[~open_side])
    assert wall_around(BAR, np.array([AT, 0.0, 0.03])) is not None
    assert wall_around(grooved, np.array([AT, 0.0, 0.03])) is None


def test_bores_are_listed_and_sofa_refuses_them():
    robot = drilled_robot()
    assert list(bores(robot)) == ["front"]
    assert list(bores(robot)["front"]) == [0, 1, 2, 3, 4]
    (fault,) = scene_faults(robot)
    assert "one element" in fault.what
    assert fault.got == "via points 1, 2, 3, 4, 5 in bores"
    assert scene_faults(drilled_robot(offset=(-0.5 * BORE, 0.0))) == []


PROJECT = """\
softcal: 1
name: a bar with a channel
robot:
  bodies:
    bar:
      mesh: {file: bar.msh, unit: mm}
      element: P1
      youngs_modulus: 2 MPa
      poissons_ratio: 0.42
      fixed: z0
  cables:
    front:
      via:
        - {on: bar, at: [2 mm, 0 mm, 60 mm]}
        - {on: bar, at: [2 mm, 0 mm, 40 mm]}
        - {on: bar, at: [2 mm, 0 mm, 20 mm]}
        - {at: [2 mm, 0 mm, -10 mm]}
"""


def bored_project(folder: Path, *, move: str = "2 mm, 0 mm") -> Path:
    folder.mkdir()
    mesh = drilled_bar()
    write_mesh(type(mesh)(1e3 * mesh.points, mesh.tets, dict(mesh.node_sets)), folder / "bar.msh")
    (folder / "project.yaml").write_text(PROJECT.replace("2 mm, 0 mm", move), encoding="utf-8")
    return folder / "project.yaml"


def said(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as left:
        main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return int(left.value.code or 0), captured.out, captured.err


def test_check_says_which_via_points_are_in_bores(tmp_path: Path):
    rows = dict(check(load(bored_project(tmp_path / "p"))).rows)
    assert re.match(
        r"(\d+) of (?!\1)\d+ via points lie in bores, [34]\.\d+ mm across \(median\), 4\.\d+ mm at most",
        rows["  bores"],
    )
    assert "  bores" not in dict(check(load(write_project(tmp_path / "q"))).rows)


def test_check_warns_of_a_cable_that_leaves_its_bore_for_the_material(tmp_path: Path):
    """And says in a row where the material alone guides it: without a bore in the mesh, that is how it is meant."""

    def checked(name: str, first: str, second: str) -> tuple[list[str], dict[str, str]]:
        path = bored_project(tmp_path / name)
        text = path.read_text(encoding="utf-8")
        via = f"- {{at: [{first}, 0 mm, 70 mm]}}\n        - {{on: bar, at: [{second}, 0 mm, 5 mm]}}\n"
        begin, end = text.index("- {on: bar"), text.index("        - {at: [2 mm")
        path.write_text(text[:begin] + via + text[end:].replace("2 mm", second), encoding="utf-8")
        found = check(load(path), solve=False)
        return [one for one in found.warnings if "front" in one], dict(found.rows)

    (warning,), _ = checked("leaves", "2 mm", "-4 mm")
    length = float(re.search(r"front: ([\d.]+) mm of it run through the material of bar, beside the bore", warning)[1])  # type: ignore[index]
    assert 20.0 < length < 50.0
    assert checked("along", "2 mm", "2 mm")[0] == []
    none, rows = checked("without", "-4 mm", "-4 mm")
    assert none == []
    assert rows["  embedded"].endswith("mm in the material of bar, which has no bore there and guides it")


def test_several_points_outside_are_one_fault(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    code, _, err = said(capsys, "check", bored_project(tmp_path / "p", move="12 mm, 0 mm"))
    assert code == 2
    assert err.count("outside their body") == 1
    assert len(err.strip().splitlines()) == 1
    assert "robot.cables.front.via[0].at: 3 via points lie outside their body, by up to 6 mm" in err
    assert "x -6 to 6 mm" in err
    assert "in a bore whose wall is all around" in err


DRILLED = """\
import gmsh, sys
gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
occ.cut([(3, occ.addBox(-10, -5, 0, 20, 10, 40))], [(3, occ.addCylinder(6, 0, -1, 0, 0, 42, 1.0))])
occ.synchronize()
gmsh.write(sys.argv[1] + ".step")
gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 16)
gmsh.option.setNumber("Mesh.MeshSizeMax", 6)
gmsh.model.mesh.generate(2)
gmsh.write(sys.argv[1] + ".stl")
"""


@pytest.fixture(scope="module")
def drilled_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    stem = tmp_path_factory.mktemp("drilled") / "bar"
    subprocess.run([sys.executable, "-c", DRILLED, str(stem)], check=True, capture_output=True)
    return stem


@needs_gmsh
def test_elements_larger_than_a_bore_are_named(drilled_files: Path):
    path = drilled_files.with_suffix(".step")
    with pytest.raises(MeshError, match=r"got a size of 4 mm beside a round face 2 mm across .*edges_around: 6"):
        mesh_file(path, size=4e-3)
    mesh = mesh_file(path, size=4e-3, edges_around=6)
    assert attach_point(mesh, np.array([6e-3, 0.0, 20e-3])).bore == pytest.approx(2e-3, rel=0.15)
    with pytest.raises(InputError, match="too few edges around a bore; got 2; allowed: 3 to 100"):
        mesh_file(path, size=4e-3, edges_around=2)


@needs_gmsh
def test_a_round_hole_in_an_stl_is_one_face(drilled_files: Path):
    """Each strip of its triangles was a face of its own, whose edges the mesh kept: 17,000 tets."""
    mesh = mesh_file(drilled_files.with_suffix(".stl"), size=5e-3)
    assert mesh.n_tets < 3000
    with pytest.raises(MeshError, match="a STEP file, which says where it is round"):
        mesh_file(drilled_files.with_suffix(".stl"), size=5e-3, edges_around=6)
