"""What every element must keep; an element joins by being in the catalogue."""

from collections.abc import Generator
from dataclasses import replace
from math import factorial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanics_cases import body_theta, column_robot, elastic, held, irregular_box, placed, pulled, solid_system
from project_case import bar_robot, write_project

from softcal.errors import InputError, ParameterError
from softcal.geometry.cell import LINEAR, QUADRATIC
from softcal.geometry.surface import boundary_faces
from softcal.materials.neo_hooke import NEO_HOOKE
from softcal.mechanics.element import Element, Quadrature
from softcal.mechanics.elements import ELEMENTS, FOUR_POINTS, P1, P2, higher_elements, register_element
from softcal.mechanics.solid import SolidTerm
from softcal.mechanics.statics import Statics
from softcal.project.project import load
from softcal.twin.build import build_twin
from softcal.twin.finer import elevated, has_lower, size
from softcal.twin.simulate import simulate


def gauss() -> Quadrature:
    """Gauss's rule of three points in each direction of the cube, collapsed to the tetrahedron."""
    t, w = np.polynomial.legendre.leggauss(3)
    t, w = 0.5 * (t + 1.0), 0.5 * w
    a, b, c = (grid.ravel() for grid in np.meshgrid(t, t, t, indexing="ij"))
    weights = np.prod(np.meshgrid(w, w, w, indexing="ij"), axis=0).ravel() * (1.0 - a) ** 2 * (1.0 - b)
    x, y, z = a, b * (1.0 - a), c * (1.0 - a) * (1.0 - b)
    return Quadrature(np.stack([1.0 - x - y - z, x, y, z], axis=1), weights, degree=3)


# As somebody else may write them: more points than a linear tet needs, and a pressure as rich as the displacement.
LINEAR_4 = Element("P1_4", "linear tets with four points", LINEAR, FOUR_POINTS, rank=0)
QUADRATIC_2 = Element("P2P2", "quadratic tets, quadratic pressure", QUADRATIC, gauss(), rank=3, pressure=QUADRATIC)
every_element = pytest.mark.parametrize(
    "element", [*ELEMENTS.values(), LINEAR_4, QUADRATIC_2], ids=lambda element: element.name
)
inside = st.lists(st.floats(0.01, 1.0), min_size=4, max_size=4).map(lambda v: np.array([v]) / sum(v))
STRETCH = np.array([[1.25, 0.1, -0.05], [0.2, 0.9, 0.15], [-0.1, 0.05, 1.1]])


@pytest.fixture(autouse=True)
def _registered() -> Generator[None]:
    foreign = [register_element(element) for element in (LINEAR_4, QUADRATIC_2)]
    yield
    for element in foreign:
        ELEMENTS.remove(element.name)


@every_element
def test_it_is_known_by_its_name_and_told_in_words(element):
    assert ELEMENTS[element.name] is element
    assert element.in_words


@every_element
def test_shape_functions_are_one_at_their_node_and_zero_at_the_others(element):
    cell = element.cell
    np.testing.assert_allclose(cell.functions(cell.nodes), np.eye(cell.n_nodes), atol=1e-15)


@every_element
@settings(deadline=None, max_examples=20)
@given(inside)
def test_shape_functions_sum_to_one_and_their_gradients_are_theirs(element, at):
    cell, h = element.cell, 1e-6
    assert cell.functions(at).sum() == pytest.approx(1.0)
    for k in range(4):
        d = h * np.eye(4)[[k]]
        slope = (cell.functions(at + d) - cell.functions(at - d)) / (2 * h)
        np.testing.assert_allclose(cell.gradients(at)[:, :, k], slope, atol=1e-9)


@every_element
def test_pressure_is_that_of_the_first_nodes(element):
    if element.pressure is None:
        assert element.pressure_functions().shape == (len(element.quadrature.points), 0)
        return
    n = element.pressure.n_nodes
    np.testing.assert_allclose(element.pressure.nodes, element.cell.nodes[:n])
    np.testing.assert_allclose(element.pressure_functions().sum(axis=1), 1.0)


@every_element
def test_quadrature_is_exact_to_its_degree_and_no_further(element):
    """Integral of x^i y^j z^k over the unit tet: i! j! k! / (i + j + k + 3)!."""
    rule = element.quadrature
    _, x, y, z = rule.points.T
    for i, j, k in np.ndindex(4, 4, 4):
        exact = factorial(i) * factorial(j) * factorial(k) / factorial(i + j + k + 3)
        if i + j + k <= rule.degree:
            assert np.sum(rule.weights * x**i * y**j * z**k) == pytest.approx(exact, rel=1e-13)
    n = rule.degree + 1
    assert np.sum(rule.weights * x**n) != pytest.approx(factorial(n) / factorial(n + 3), rel=1e-6)


@every_element
def test_faces_are_sides_of_its_cell_and_a_traction_on_them_is_shared_out(element):
    """Each node of a face has a zero coordinate there; the shares are the integrals of the shape functions."""
    cell = element.cell
    for number, face in enumerate(cell.faces):
        off = cell.nodes[list(face)] == 0.0
        assert off.all(axis=0).sum() == 1, number
    a, b = 1.0 / 6.0, 2.0 / 3.0  # three points on the triangle, exact to degree two
    face = cell.faces[0]
    corners = np.array([[b, a, a], [a, b, a], [a, a, b]])
    N = cell.functions(corners @ cell.nodes[list(face[:3])])[:, list(face)]
    np.testing.assert_allclose(cell.face_shares, N.mean(axis=0), atol=1e-15)


@every_element
def test_affine_displacements_of_the_boundary_give_affine_ones_inside(element):
    mesh = irregular_box((1.0, 0.8, 1.2), (3, 3, 3), element.name)
    theta = body_theta(elastic(1.0, 0.4))
    system = solid_system(mesh, element.name, NEO_HOOKE, np.unique(boundary_faces(mesh)))
    exact = mesh.points @ STRETCH.T
    guess, inner = exact.copy(), system.layout.free_points
    guess[inner] += np.random.default_rng(1).uniform(-0.01, 0.01, (len(inner), 3))

    found = Statics(system, theta).equilibrium(placed(system, guess), held())

    assert found.converged, found.status
    np.testing.assert_allclose(found.state.x, exact, rtol=0, atol=1e-9)
    (solid,) = system.of(SolidTerm)
    F, *_ = solid.kinematics(found.state)
    np.testing.assert_allclose(F, np.broadcast_to(STRETCH, F.shape), rtol=0, atol=1e-8)
    if element.is_mixed:
        expected = NEO_HOOKE.bulk_modulus(elastic(1.0, 0.4)) * np.log(np.linalg.det(STRETCH))
        np.testing.assert_allclose(found.state.pressure, expected, rtol=1e-8)


@every_element
def test_unknowns_are_counted_without_making_them(element):
    robot = column_robot(element.name, cables=())
    twin = build_twin(robot)
    assert size(robot).unknowns == 3 * twin.meshes["neck"].n_points + twin.system.layout.n_pressures


@every_element
def test_it_is_better_than_those_of_lower_rank(element):
    robot = column_robot(element.name)
    for other in ELEMENTS.values():
        lower = other.rank > element.rank
        assert has_lower(robot, other.name) == lower
        (body,) = elevated(robot, other.name).bodies
        assert body.element == (other.name if lower else element.name)
    assert (element.name in higher_elements()) == (element.rank > 0)


@every_element
def test_a_project_file_may_name_it(element, tmp_path: Path):
    path = write_project(tmp_path, ("element: P1", f"element: {element.name}"))
    assert load(path).robot.bodies[0].element == element.name


def test_a_project_file_is_told_of_those_there_are(tmp_path: Path):
    path = write_project(tmp_path, ("element: P1", "element: P3"))
    told = r"there is no such element; got 'P3'; allowed: P1, P1_4, P2, P2P1, P2P2\. Try: 'P"
    with pytest.raises(InputError, match=told):
        load(path)
    with pytest.raises(
        InputError, match=r"bar\.element: there is no such element; got 'P3'; allowed: P1, P1_4, P2, P2P1"
    ):
        replace(bar_robot().bodies[0], element="P3")


def test_a_foreign_element_computes_what_the_same_with_fewer_points_does():
    found = {
        element.name: simulate(column_robot(element.name), pulled(0.0, 0.004)).channels["front.tension"][-1]
        for element in (P1, P2, LINEAR_4)
    }
    assert found["P1_4"] == pytest.approx(found["P1"], rel=1e-9)
    assert found["P2"] < 0.95 * found["P1"]


def test_a_name_stands_for_one_element():
    with pytest.raises(ParameterError, match="another element of this name"):
        register_element(replace(P1, rank=4))
    with pytest.raises(ParameterError, match="cannot be a name"):
        register_element(replace(P1, name="P 1"))
    with pytest.raises(ParameterError, match="softcal's own element cannot be removed"):
        ELEMENTS.remove("P1")
    assert register_element(P1) is P1
    assert ELEMENTS.registered == (LINEAR_4, QUADRATIC_2)
