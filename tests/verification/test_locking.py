"""Near nu = 0.5 linear tets lock and P2P1 does not: Cook's membrane, and a bent column."""

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled

from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_quadratic
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Body, Marker, Robot, SurfaceLoad
from softcal.twin.simulate import simulate


def cooks_membrane(element: str, n: int, through: int, nu: float = 0.4999) -> float:
    """How far the upper corner rises [m]: 48 x 44 tapered to 16, 10 thick, clamped left, sheared on the right."""
    box = box_mesh((1.0, 1.0, 1.0), (2 * n, 2 * n, through))
    x, y, z = box.points.T
    points = np.stack([48 * x, 44 * x * (1 - y) + y * (44 + 16 * x), 10 * z], axis=1)
    mesh = TetMesh(points, box.tets, dict(box.node_sets), dict(box.face_sets))
    body = Body("membrane", mesh, fixed=mesh.node_sets["x0"], parameters=elastic(1.0, nu), element=element)
    shear = SurfaceLoad("shear", "membrane", mesh.face_sets["x1"], np.array([0.0, 4e-3, 0.0]))
    response = simulate(Robot((body,), loads=(shear,)), Protocol({}), snapshots=True)
    assert response.succeeded, response.status
    corner = np.flatnonzero((box.points == [1.0, 1.0, 0.0]).all(axis=1))
    return float((response.snapshots[-1].points["membrane"][corner] - points[corner])[0, 1])


@pytest.mark.slow
def test_cooks_membrane_locks_with_p1_and_not_with_p2p1():
    reference = cooks_membrane("P2P1", 8, 2)
    assert cooks_membrane("P2P1", 4, 2) == pytest.approx(reference, rel=0.02)
    assert cooks_membrane("P1", 8, 2) < 0.3 * reference


def stiffness(element: str, nu: float, divisions) -> float:
    """Tension at a small bend over E."""
    robot = column_robot(element, parameters=elastic(1.0e6, nu), divisions=divisions)
    response = simulate(robot, pulled(0.001), curve_tolerance=0.0)
    assert response.succeeded, response.status
    return float(response.channels["front.tension"][0]) / 1.0e6


def test_bent_column_stiffens_with_p1_alone():
    """What a calibration of nu sees: the true change over the papers' range of nu is small."""
    fine = {nu: stiffness("P2P1", nu, (4, 4, 12)) for nu in (0.4, 0.4999)}
    coarse = {nu: stiffness("P2P1", nu, (2, 2, 6)) for nu in (0.4, 0.4999)}
    linear = {nu: stiffness("P1", nu, (4, 4, 12)) for nu in (0.4, 0.4999)}
    assert fine[0.4999] / fine[0.4] == pytest.approx(1.0, abs=0.1)
    for nu in (0.4, 0.4999):
        assert coarse[nu] == pytest.approx(fine[nu], rel=0.02)
    assert linear[0.4999] / linear[0.4] > 3.0


@pytest.mark.parametrize(
    ("nu", "off"), [(-0.45, 0.034), (-0.3, 0.014), (0.0, 1e-5), (0.3, 0.016), (0.45, 0.042), (0.4999, 0.055)]
)
def test_coarse_p2p1_is_near_the_fine_mesh_at_every_ratio(nu, off):
    """With the bulk modulus in the mixed part 1.4, 3.6 and 4.7 % at 0.3, 0.45 and 0.4999, with Lame's lambda 5.5 %."""
    fine = stiffness("P2P1", nu, (4, 4, 16))
    assert stiffness("P2", nu, (4, 4, 16)) == pytest.approx(fine, rel=4e-3 if nu <= 0.45 else 0.02)
    assert 1.0 - 1e-5 < stiffness("P2P1", nu, (1, 1, 6)) / fine < 1.0 + off


def test_forces_made_by_rounding_do_not_keep_newton_busy():
    """P1, nu = 0.49999, a load so small that rounding exceeds a fixed fraction of it."""
    mesh = box_mesh((50.0, 10.0, 10.0), (10, 2, 2))
    body = Body("bar", mesh, fixed=mesh.node_sets["x0"], parameters=elastic(1.0, 0.49999), element="P1")
    shear = SurfaceLoad("shear", "bar", mesh.face_sets["x1"], np.array([0.0, 1e-7, 0.0]))
    response = simulate(Robot((body,), loads=(shear,)), Protocol({}))
    assert response.succeeded, response.status
    assert response.n_factorisations <= 4


def test_a_traction_on_linear_tets_of_a_quadratic_mesh_is_that_of_the_linear_mesh():
    """Also where the corners are not numbered first, as in most mesh files."""
    linear = box_mesh((50.0, 10.0, 10.0), (4, 1, 1))
    whole = to_quadratic(linear)
    shuffled = np.random.default_rng(0).permutation(whole.n_points)
    number = np.argsort(shuffled)
    mixed = TetMesh(
        whole.points[shuffled],
        number[whole.tets],
        node_sets={name: number[nodes] for name, nodes in whole.node_sets.items()},
        face_sets={name: number[faces] for name, faces in whole.face_sets.items()},
    )
    tips = []
    for mesh in (linear, mixed):
        body = Body("bar", mesh, fixed=mesh.node_sets["x0"], parameters=elastic(1.0, 0.3), element="P1")
        shear = SurfaceLoad("shear", "bar", mesh.face_sets["x1"], np.array([0.0, 1e-4, 0.0]))
        tip = Marker("tip", "bar", np.array([50.0, 5.0, 5.0]))
        response = simulate(Robot((body,), loads=(shear,), markers=(tip,)), Protocol({}))
        tips.append([response.channels[f"tip.{axis}"][0] for axis in "xyz"])
    np.testing.assert_allclose(tips[1], tips[0], rtol=1e-9)
