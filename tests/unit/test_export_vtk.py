"""Shapes for ParaView: what is in the files, and stresses against closed forms."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, side_cable, tensed
from project_case import write_project

from softcal.cli import main
from softcal.errors import InputError, ParameterError
from softcal.export.vtk import shape_grid, write_vtk
from softcal.geometry.primitives import box_mesh
from softcal.materials.catalogue import LAWS
from softcal.mechanics.elements import P1, P2, P2P1
from softcal.mechanics.stress import cauchy_stress, green_lagrange_strain, von_mises
from softcal.twin.live import LiveTwin
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.workflows.cases import films


@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_shapes_are_written_with_their_fields(tmp_path, element):
    pyvista = pytest.importorskip("pyvista")
    robot = column_robot(element, parameters=elastic(1e6, 0.45))
    response = simulate(robot, pulled(0.0, 0.01, 0.02), snapshots=True)
    series, *shapes = write_vtk(robot, response, tmp_path)
    assert series.read_text().count("DataSet") == len(shapes) == len(response.snapshots)
    first, last = pyvista.read(shapes[0]), pyvista.read(shapes[-1])
    assert np.abs(first.point_data["displacement"]).max() == 0.0
    body = next(iter(response.snapshots[-1].points))
    x = response.snapshots[-1].points[body]
    np.testing.assert_allclose(last.points[: len(x)], x, atol=1e-9)
    assert last.cell_data["von_mises"].max() > 1e3
    assert last.field_data[f"{body}.youngs_modulus [Pa]"][0] == pytest.approx(1e6)
    tension = response.channels["front.tension"][-1]
    assert last.field_data["front.tension [N]"][0] == pytest.approx(tension, rel=1e-6)


def test_without_shapes_says_what_to_do(tmp_path):
    robot = column_robot("P1", parameters=elastic(1e6, 0.45))
    with pytest.raises(ParameterError, match="snapshots=True"):
        write_vtk(robot, simulate(robot, pulled(0.0)), tmp_path)


def test_a_shape_is_a_grid_that_pyvista_draws():
    pytest.importorskip("pyvista")
    robot = column_robot("P2P1", parameters=elastic(1e6, 0.45), divisions=(1, 1, 4))
    response = simulate(robot, pulled(0.0, 0.02), snapshots=True)
    rest, bent = (shape_grid(robot, response.snapshots[k]) for k in (0, -1))
    np.testing.assert_allclose(bent.points - bent["displacement"], rest.points, atol=1e-12)
    parts = list(bent.field_data["parts"])
    assert parts == [robot.bodies[0].name, "front"]
    body = bent.extract_cells(bent["part"] == parts.index(robot.bodies[0].name))
    np.testing.assert_allclose(body.points, response.snapshots[-1].points[robot.bodies[0].name], atol=1e-12)
    assert bent["von_mises"].max() > 1e3 > 1.0 > rest["von_mises"].max()
    picture = bent.plot(scalars="von_mises", off_screen=True, screenshot=True, return_img=True, window_size=(200, 200))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    live = LiveTwin(robot, {"front": "shortening"})
    at = shape_grid(robot, live.at({"front": 0.02}).shape)
    np.testing.assert_allclose(at["stress"], bent["stress"], atol=1e-4 * np.abs(bent["stress"]).max())


def test_a_part_may_have_any_letters_in_its_name():
    pytest.importorskip("pyvista")
    robot = column_robot("P1", divisions=(1, 1, 2))
    (body,), (plate,) = robot.bodies, robot.plates
    named = replace(
        robot, bodies=(replace(body, name="Süd"),), plates=(replace(plate, nodes={"Süd": plate.nodes["neck"]}),)
    )
    shape = simulate(named, pulled(0.0), snapshots=True).snapshots[0]
    assert [*shape_grid(named, shape).field_data["parts"]] == ["S\\xfcd", "front"]


def test_a_shape_of_another_robot_is_refused():
    pytest.importorskip("pyvista")
    robots = [column_robot("P1", parameters=elastic(1e6, 0.45), divisions=(1, 1, n)) for n in (4, 5)]
    (shape, *_) = simulate(robots[0], pulled(0.0), snapshots=True).snapshots
    with pytest.raises(ParameterError, match="the shape is of another robot"):
        shape_grid(robots[1], shape)


def test_without_pyvista_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    robot = column_robot("P1", parameters=elastic(1e6, 0.45), divisions=(1, 1, 4))
    (shape, *_) = simulate(robot, pulled(0.0), snapshots=True).snapshots
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'softcal\[pictures\]'"):
        shape_grid(robot, shape)


@pytest.mark.parametrize("order", [1, 2])
def test_stress_of_a_homogeneous_stretch(order):
    """Uniaxial stretch with a given contraction: sigma_i = (mu (l_i^2 - 1) + lambda ln J) / J; a turn turns it."""
    mesh = box_mesh((1.0, 1.0, 1.0), (2, 2, 2), order=order)
    E, nu = 2e6, 0.3
    mu, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    stretch = np.array([1.4, 0.9, 0.85])
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    J = stretch.prod()
    expected = turn @ np.diag((mu * (stretch**2 - 1) + lame * np.log(J)) / J) @ turn.T
    theta = {"youngs_modulus": E, "poissons_ratio": nu}
    x = (mesh.points * stretch) @ turn.T
    sigma = cauchy_stress({1: P1, 2: P2}[order], mesh, LAWS["neo-hooke"], theta, x)
    np.testing.assert_allclose(sigma, np.broadcast_to(expected, sigma.shape), rtol=1e-9, atol=1e-6 * mu)
    if order == 2:
        p = np.full(mesh.n_points, LAWS["neo-hooke"].bulk_modulus(theta) * np.log(J))
        mixed = cauchy_stress(P2P1, mesh, LAWS["neo-hooke"], theta, x, p)
        np.testing.assert_allclose(mixed, sigma, rtol=1e-9, atol=1e-6 * mu)
    strain = green_lagrange_strain({1: P1, 2: P2}[order], mesh, x)
    np.testing.assert_allclose(strain, np.broadcast_to(np.diag(0.5 * (stretch**2 - 1)), strain.shape), atol=1e-12)
    uniaxial = np.zeros((1, 3, 3))
    uniaxial[0, 0, 0] = -3.0
    np.testing.assert_allclose(von_mises(uniaxial), 3.0)


def test_stress_near_incompressibility_is_that_of_the_elements_pressure(tmp_path):
    """Of the displacements alone the stress would be hundreds of times too large at a ratio of 0.4999."""
    pyvista = pytest.importorskip("pyvista")
    stress = {}
    for ratio in (0.49, 0.4999):
        robot = column_robot("P2P1", parameters=elastic(1e6, ratio), divisions=(1, 1, 5))
        response = simulate(robot, tensed(3.0), snapshots=True)
        stress[ratio] = pyvista.read(write_vtk(robot, response, tmp_path)[-1]).cell_data["stress"]
    np.testing.assert_allclose(stress[0.4999], stress[0.49], atol=0.1 * np.abs(stress[0.49]).max())


def steps_of(series: Path) -> list[float]:
    return [float(text) for text in re.findall(r'timestep="([^"]*)"', series.read_text())]


@pytest.mark.parametrize(("make", "scale", "unit"), [(pulled, 1e-3, "shortening"), (tensed, 1.0, "tension")])
def test_shapes_of_samples_are_solved_there_and_timed_by_the_drive(tmp_path, make, scale, unit):
    robot = column_robot("P1", parameters=elastic(1e6, 0.3), divisions=(1, 1, 4))
    drive = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    response = simulate(robot, make(*(scale * drive)), snapshots="samples")
    assert steps_of(write_vtk(robot, response, tmp_path)[0]) == pytest.approx(drive, abs=1e-12)
    for k, shape in enumerate(response.snapshots):
        assert shape.controls == {"front": pytest.approx(scale * drive[k], abs=1e-15)}
        alone = simulate(robot, make(scale * drive[k]), snapshots=True).snapshots[-1]
        np.testing.assert_allclose(shape.points["neck"], alone.points["neck"], atol=1e-9)
        assert shape.efforts["front"] == pytest.approx(response.channels["front.tension"][k], abs=1e-9)


def test_shapes_that_do_not_ascend_are_numbered(tmp_path):
    robot = column_robot("P1", parameters=elastic(1e6, 0.3), divisions=(1, 1, 4))
    response = simulate(robot, pulled(0.0, 0.002, 0.001, 0.002), snapshots="samples")
    assert steps_of(write_vtk(robot, response, tmp_path)[0]) == [1.0, 2.0, 3.0, 4.0]
    np.testing.assert_array_equal(response.snapshots[1].points["neck"], response.snapshots[3].points["neck"])


def test_displacements_are_from_the_robot_without_loads(tmp_path):
    """Also where the first shape is pulled already, as the first of several states is, and of cables and rods."""
    pyvista = pytest.importorskip("pyvista")
    cables = (side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05)))
    robot = column_robot("P1", parameters=elastic(1e6, 0.3), divisions=(1, 1, 4), cables=cables)
    told = Protocol({cable.name: Command("shortening", np.array([0.004, 0.008])) for cable in cables})
    response = simulate(robot, told, snapshots=True)
    series, first, _ = write_vtk(robot, response, tmp_path)
    assert steps_of(series) == [1.0, 2.0]
    grid = pyvista.read(first)
    rest = grid.points - grid.point_data["displacement"]
    np.testing.assert_allclose(rest[-4:], [point.at for cable in cables for point in cable.via_points], atol=1e-9)
    np.testing.assert_allclose(rest[:-4], robot.bodies[0].mesh.points, atol=1e-9)


def test_film_of_a_pull_is_even_and_of_states_refused():
    up_and_down = {"front": Command("shortening", np.array([0.01, 0.04, 0.0]))}
    together = {**up_and_down, "left": Command("tension", np.array([0.5, 2.0, 0.0]))}
    apart = {**up_and_down, "left": Command("tension", np.array([2.0, 0.5, 0.0]))}
    found = films({"one": Protocol(up_and_down), "two": Protocol(together), "rest": Protocol({})}, 5)
    np.testing.assert_allclose(found["one"].commands["front"].values, [0.0, 0.01, 0.02, 0.03, 0.04])
    np.testing.assert_allclose(found["two"].commands["left"].values, [0.0, 0.5, 1.0, 1.5, 2.0])
    assert found["two"].commands["left"].control == "tension"
    assert found["rest"].n_samples == 1
    let_out = films({"out": Protocol({"front": Command("shortening", -0.03 * np.array([0.1, 0.7, 1.0]))})}, 4)
    np.testing.assert_allclose(let_out["out"].commands["front"].values, [0.0, -0.01, -0.02, -0.03])
    with pytest.raises(ParameterError, match="apart: the actuators' commands are not proportional"):
        films({"one": Protocol(up_and_down), "apart": Protocol(apart)}, 5)
    with pytest.raises(ParameterError, match="--shapes: nothing is pulled"):
        films({"rest": Protocol({"front": Command("tension", np.zeros(2))})}, 5)
    with pytest.raises(InputError, match="--shapes: there are too few shapes of a film; got 1; allowed: 2 to 2000"):
        films({"one": Protocol(up_and_down)}, 1)


def test_command_line_writes_a_film(tmp_path, capsys):
    pytest.importorskip("pyvista")
    path = write_project(tmp_path / "project")
    with pytest.raises(SystemExit) as left:
        main(["export", "vtk", str(path), "--pull", "front=6mm", "--shapes", "4", "--out", str(tmp_path / "out")])
    assert left.value.code in (0, None), capsys.readouterr().err
    assert steps_of(tmp_path / "out" / "shapes.pvd") == pytest.approx([0.0, 2.0, 4.0, 6.0])
