"""Chambers against closed forms: thick spheres and tubes under pressure, the gas law, work round a closed loop."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad

from softcal.checks import Floats
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_quadratic
from softcal.geometry.surface import boundary_faces
from softcal.mechanics.chamber import ChamberTerm
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.chamber import Chamber
from softcal.twin.build import build_twin
from softcal.twin.material import Material
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Robot
from softcal.twin.simulate import simulate

INNER, OUTER, FAR = 0.02, 0.03, 0.09  # radii [m] of the sphere, and of what holds it
SOFT = 1e-6  # modulus of that over the sphere's


def balloon(law: str, constants: dict[str, float], soft: dict[str, float], n: int = 4, layers: int = 2) -> Robot:
    """A thick sphere in something a million times as soft, which keeps it in its place."""
    cube = box_mesh((2.0,) * 3, (n,) * 3, origin=(-1.0,) * 3)
    triangles = boundary_faces(cube)
    used, numbers = np.unique(triangles, return_inverse=True)
    triangles = np.sort(numbers.reshape(-1, 3), axis=1)
    way = np.tan(0.25 * np.pi * cube.points[used])  # so that triangles on the sphere are of about one size
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    radii = [*np.linspace(INNER, OUTER, layers + 1), FAR]
    points = np.concatenate([radius * way for radius in radii])
    a, b, c = triangles.T
    tets: list[Floats] = []
    for k in range(len(radii) - 1):
        low, high = k * len(way), (k + 1) * len(way)
        for four in ((a + low, b + low, c + low, c + high), (a + low, b + low, b + high, c + high)):
            tets.append(np.stack(four, axis=1))
        tets.append(np.stack((a + low, a + high, b + high, c + high), axis=1))
    every = np.concatenate(tets)
    is_turned = np.linalg.det(points[every[:, 1:]] - points[every[:, :1]]) < 0.0
    every[is_turned] = every[is_turned][:, [1, 0, 2, 3]]
    mesh = to_quadratic(TetMesh(points, every))
    ends = np.zeros((mesh.n_points, 2), dtype=int)
    for i, (one, other) in enumerate(mesh.cell.edges):
        ends[mesh.tets[:, 4 + i]] = mesh.tets[:, [one, other]]
    r, curved = np.linalg.norm(mesh.points, axis=1), mesh.points.copy()
    middle = np.unique(mesh.tets[:, 4:])
    curved[middle] *= (r[ends[middle]].mean(axis=1) / r[middle])[:, None]
    mesh = TetMesh(curved, mesh.tets)
    r = np.linalg.norm(curved, axis=1)
    beyond = np.flatnonzero(r[mesh.tets[:, :4]].max(axis=1) > OUTER * 1.01)
    faces = boundary_faces(mesh)
    body = Body(
        "balloon",
        mesh,
        np.flatnonzero(r > 0.99 * FAR),
        constants,
        law=law,
        inclusions=(Material("outside", beyond, soft),),
    )
    chamber = Chamber({"balloon": faces[r[faces].max(axis=1) < 1.01 * INNER]}, medium="liquid")
    return Robot((body,), actuators=(NamedActuator("air", chamber),))


def pressure_of(W_rate: Callable[[float], float], stretch: float) -> float:
    """Of a thick incompressible sphere, by the stretch of its inner surface: int W'(s) / (s^3 - 1) ds, with
    W(s) = W(s, s, 1 / s^2), between the stretches of its two surfaces.
    """
    outer = (1.0 + (INNER / OUTER) ** 3 * (stretch**3 - 1.0)) ** (1.0 / 3.0)
    return quad(lambda s: W_rate(s) / (s**3 - 1.0), outer, stretch, epsabs=0.0, epsrel=1e-10)[0]


MU, BULK, OGDEN = 1e5, 1e9, 1e5
SPHERES = {
    "neo-hooke": (
        {"youngs_modulus": 3 * MU, "poissons_ratio": 0.49999},
        {"youngs_modulus": 3 * MU * SOFT, "poissons_ratio": 0.3},
        lambda s: 2 * MU * (s - s**-5),
    ),
    "mooney-rivlin": (
        {"C10": 0.4 * MU, "C01": 0.1 * MU, "bulk_modulus": BULK},
        {"C10": 0.4 * MU * SOFT, "C01": 0.1 * MU * SOFT, "bulk_modulus": MU * SOFT},
        lambda s: 0.4 * MU * 4 * (s - s**-5) + 0.1 * MU * 4 * (s**3 - s**-3),
    ),
    "ogden-1": (
        {"mu1": MU, "alpha1": 2.6, "bulk_modulus": BULK},
        {"mu1": MU * SOFT, "alpha1": 2.6, "bulk_modulus": MU * SOFT},
        lambda s: 2 * OGDEN * (s**1.6 - s**-6.2),
    ),
}


@pytest.mark.parametrize("law", SPHERES)
def test_a_thick_sphere_is_blown_up_through_its_limit_point(law):
    constants, soft, rate = SPHERES[law]
    robot = balloon(law, constants, soft)
    stretches = np.array([1.0, 1.1, 1.3, 1.6, 2.0])
    rest = build_twin(robot).system.of(ChamberTerm)[0].rest_volume
    assert rest == pytest.approx(4.0 / 3.0 * np.pi * INNER**3, rel=2e-3)
    response = simulate(
        robot, Protocol({"air": Command("volume", rest * (stretches**3 - 1.0))}), curve_tolerance=0.0, crossings=False
    )
    assert response.succeeded, response.status
    exact = [0.0, *(pressure_of(rate, s) for s in stretches[1:])]
    print(law, response.channels["air.pressure"], exact, response.channels["air.pressure"][1:] / exact[1:] - 1)
    np.testing.assert_allclose(response.channels["air.pressure"], exact, rtol=1e-3, atol=1e-9)
