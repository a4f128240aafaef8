"""Shapes for ParaView: what is in the files, and stresses against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, tensed

from softcal.errors import ParameterError
from softcal.export.vtk import write_vtk
from softcal.geometry.primitives import box_mesh
from softcal.materials.catalogue import LAWS
from softcal.mechanics.stress import cauchy_stress, green_lagrange_strain, von_mises
from softcal.twin.simulate import simulate


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
    sigma = cauchy_stress(mesh, LAWS["neo-hooke"], theta, x)
    np.testing.assert_allclose(sigma, np.broadcast_to(expected, sigma.shape), rtol=1e-9, atol=1e-6 * mu)
    if order == 2:
        p = np.full(mesh.n_points, lame * np.log(J))
        mixed = cauchy_stress(mesh, LAWS["neo-hooke"], theta, x, p)
        np.testing.assert_allclose(mixed, sigma, rtol=1e-9, atol=1e-6 * mu)
    strain = green_lagrange_strain(mesh, x)
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
