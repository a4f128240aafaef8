"""A body of several materials: as tied bodies of one material each, with exact derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from mechanics_cases import pulled

from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.twin.finer import halved
from softcal.twin.parameters import robot_parameters
from softcal.twin.robot import Body, Cable, Material, Plate, Robot, Tie, ViaPoint
from softcal.twin.simulate import simulate

SIDE, HEIGHT = 0.02, 0.1
STIFF = {"youngs_modulus": 2.0e6, "poissons_ratio": 0.35}
SOFT = {"youngs_modulus": 0.5e6, "poissons_ratio": 0.45}
GRAVITY = np.array([0.0, 0.0, -9.81])


def with_cable(bodies: tuple[Body, ...], top: str, ties: tuple[Tie, ...] = ()) -> Robot:
    mesh = next(body.mesh for body in bodies if body.name == top)
    head = np.flatnonzero(np.isclose(mesh.points[:, 2], HEIGHT))
    plate = Plate("plate", {top: head}, np.array([0.0, 0.0, HEIGHT]))
    cable = Cable("front", (ViaPoint(np.array([0.02, 0.0, HEIGHT]), "plate"), ViaPoint(np.array([0.02, 0.0, 0.0]))))
    return Robot(bodies, (plate,), (cable,), gravity=GRAVITY, ties=ties)


def one_body(element: str, soft: dict[str, float] = SOFT) -> Robot:
    """The upper half is soft and heavy."""
    mesh = box_mesh([SIDE, SIDE, HEIGHT], [2, 2, 8], origin=[-0.5 * SIDE, -0.5 * SIDE, 0.0])
    upper = np.flatnonzero(mesh.points[mesh.tets].mean(axis=1)[:, 2] > 0.5 * HEIGHT)
    part = Material("soft", upper, soft, density=1500.0)
    body = Body("bar", mesh, mesh.node_sets["z0"], STIFF, element=element, density=900.0, inclusions=(part,))  # type: ignore[arg-type]
    return with_cable((body,), "bar")


def two_bodies(element: str) -> Robot:
    half = box_mesh([SIDE, SIDE, 0.5 * HEIGHT], [2, 2, 4], origin=[-0.5 * SIDE, -0.5 * SIDE, 0.0])
    above = TetMesh(half.points + [0.0, 0.0, 0.5 * HEIGHT], half.tets)
    seam = np.flatnonzero(np.isclose(above.points[:, 2], 0.5 * HEIGHT))
    none = np.array([], dtype=int)
    lower = Body("lower", half, half.node_sets["z0"], STIFF, element=element, density=900.0)  # type: ignore[arg-type]
    upper = Body("upper", above, none, SOFT, element=element, density=1500.0)  # type: ignore[arg-type]
    return with_cable((lower, upper), "upper", (Tie("seam", "upper", seam, "lower"),))


@pytest.mark.parametrize("element", ["P1", "P2", "P2P1"])
def test_two_materials_are_two_bodies_tied(element: str):
    there, here = (simulate(robot, pulled(0.0, 0.01, 0.02)) for robot in (two_bodies(element), one_body(element)))
    assert there.succeeded
    assert here.succeeded
    for channel_name in ("front.tension", "plate.pitch", "plate.z"):
        np.testing.assert_allclose(here.channels[channel_name], there.channels[channel_name], rtol=1e-6, atol=1e-9)
    alike = simulate(one_body(element), pulled(0.02), {"bar.soft.youngs_modulus": 2.0e6})
    assert alike.channels["front.tension"][0] > 1.5 * here.channels["front.tension"][2]


NAMES = tuple(f"bar{part}.{key}" for part in ("", ".soft") for key in ("youngs_modulus", "poissons_ratio", "density"))


@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_each_material_has_its_own_derivatives(element: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    robot = one_body(element)
    assert set(NAMES) <= set(robot_parameters(robot))
    response = simulate(robot, pulled(0.02), sensitivities=NAMES, curve_tolerance=0.0)
    for name in NAMES:
        value = robot_parameters(robot)[name].value
        h = 3e-4 * value
        up, down = (simulate(robot, pulled(0.02), {name: value + s * h}, curve_tolerance=0.0).channels for s in (1, -1))
        for channel_name in ("front.tension", "plate.pitch"):
            expected = (up[channel_name] - down[channel_name]) / (2.0 * h)
            np.testing.assert_allclose(response.sensitivities[channel_name][name], expected, rtol=2e-5)


def test_a_finer_mesh_keeps_the_materials():
    robot = one_body("P1")
    fine = halved(robot).bodies[0]
    (part,) = fine.inclusions
    centres = fine.mesh.points[fine.mesh.tets[part.elements]].mean(axis=1)
    assert len(part.elements) == 8 * len(robot.bodies[0].inclusions[0].elements)
    assert (centres[:, 2] > 0.5 * HEIGHT).all()
