"""What must not matter: where the scene stands, the unit of stress, the numbering of nodes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanics_cases import column_robot, elastic, irregular_box, moved_points, pulled, side_cable, tensed
from scipy.spatial.transform import Rotation

from softcal.geometry.mesh import TetMesh
from softcal.twin.simulate import simulate

rotation_vector = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3).map(np.array)
translation = st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3).map(np.array)


@pytest.mark.parametrize("element", ["P1", "P2P1"])
@settings(max_examples=6, deadline=None)
@given(rotation_vector, translation, st.sampled_from(["shortening", "tension"]))
def test_response_does_not_depend_on_where_the_scene_stands(element, omega, shift, drive):
    R = Rotation.from_rotvec(omega).as_matrix()
    robot = column_robot(
        element,
        parameters=elastic(0.5e6, 0.45),
        divisions=(1, 1, 3),
        gravity=(1.0, 2.0, -9.81),
        density=1100.0,
        mass=0.05,
    )
    elsewhere = moved_points(robot, lambda at: at @ R.T + shift, R)
    protocol = pulled(0.01, 0.03) if drive == "shortening" else tensed(0.5, 1.5)
    here, there = (simulate(r, protocol, snapshots=True, curve_tolerance=0.0) for r in (robot, elsewhere))
    assert here.succeeded, here.status
    for channel in ("front.tension", "front.shortening"):
        np.testing.assert_allclose(there.channels[channel], here.channels[channel], rtol=1e-6, atol=1e-9)
    for a, b in zip(here.snapshots, there.snapshots, strict=True):
        np.testing.assert_allclose(b.points["neck"], a.points["neck"] @ R.T + shift, atol=1e-7)
        np.testing.assert_allclose(b.plates["plate"][0], R @ a.plates["plate"][0] + shift, atol=1e-7)
        np.testing.assert_allclose(b.plates["plate"][1], R @ a.plates["plate"][1] @ R.T, atol=1e-6)


@settings(max_examples=10, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(0.4, 0.4999), st.sampled_from(["P1", "P2P1"]))
def test_tension_is_linear_in_the_modulus(exponent, nu, element):
    """At given shortening and nu, without weight: E scales the tension and moves nothing."""
    # Not further: the four locked cells of P1 buckle beyond 20 mm, and have no equilibrium to compare.
    d = (0.002, 0.005, 0.01)
    ones, other = (
        simulate(column_robot(element, parameters=elastic(E, nu), divisions=(1, 1, 4)), pulled(*d), curve_tolerance=0.0)
        for E in (1.0e6, 1.0e6 * 10.0**exponent)
    )
    assert ones.succeeded, ones.status
    assert other.succeeded, other.status
    np.testing.assert_allclose(
        other.channels["front.tension"], 10.0**exponent * ones.channels["front.tension"], rtol=1e-6
    )
    for channel in ("plate.pitch", "plate.x", "plate.z"):
        np.testing.assert_allclose(other.channels[channel], ones.channels[channel], rtol=1e-6)


@settings(max_examples=8, deadline=None)
@given(st.floats(0.2, 20.0))
def test_size_scales_force_by_area(scale):
    """A robot `scale` times as large takes `scale` squared the tension at `scale` times the shortening."""
    one = column_robot("P1", parameters=elastic(0.5e6, 0.4), divisions=(1, 1, 3))
    large = moved_points(one, lambda at: scale * at, np.eye(3))
    d = np.array([0.01, 0.04])
    a, b = simulate(one, pulled(*d), curve_tolerance=0.0), simulate(large, pulled(*(scale * d)), curve_tolerance=0.0)
    assert b.succeeded, b.status
    np.testing.assert_allclose(b.channels["front.tension"], scale**2 * a.channels["front.tension"], rtol=1e-6)
    np.testing.assert_allclose(b.channels["plate.pitch"], a.channels["plate.pitch"], rtol=1e-6)


@pytest.mark.parametrize("element", ["P1", "P2", "P2P1"])
def test_numbering_of_nodes_and_tets_does_not_matter(element):
    mesh = irregular_box((0.03, 0.03, 0.1), (2, 2, 3), "P1", seed=2)
    rng = np.random.default_rng(0)
    new = rng.permutation(mesh.n_points)  # old number -> new number
    points = np.empty_like(mesh.points)
    points[new] = mesh.points
    turned = mesh.tets[:, [1, 2, 0, 3]]  # an even permutation of the corners
    shuffled = TetMesh(
        points, new[turned][rng.permutation(mesh.n_tets)], {name: new[nodes] for name, nodes in mesh.node_sets.items()}
    )
    a, b = (
        simulate(
            column_robot(element, mesh=m, parameters=elastic(1e6, 0.45), cables=(side_cable("front", (0.05, 0.015)),)),
            pulled(0.02),
        ).channels
        for m in (mesh, shuffled)
    )
    for name, values in a.items():
        np.testing.assert_allclose(b[name], values, rtol=1e-7, atol=1e-10, err_msg=name)
