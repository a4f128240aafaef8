"""SOFA's settled states on the same meshes: linear tets, the same energy, so the same numbers."""

import numpy as np
import pytest
from mechanics_cases import SHARED, elastic, pulled, shared_json, tensed

from softcal.geometry.read import read_mesh
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint
from softcal.twin.simulate import simulate


def neck_robot(data: dict) -> Robot:
    mesh = read_mesh(SHARED / "data" / "sofa" / data["mesh"])
    D, z = data["outer_diameter_m"], mesh.points[:, 2]
    body = Body(
        "neck",
        mesh,
        fixed=np.flatnonzero(z <= 0.37 * D + 1e-12),
        parameters=elastic(data["youngs_modulus_Pa"], data["poissons_ratio"]),
        element="P1",
    )
    collar = np.flatnonzero(z >= D * (0.617 + 4 * 0.481) - 1e-9)
    plate = Plate("plate", {"neck": collar}, reference=np.array([0.0, 0.0, data["height_m"]]))
    ends = (ViaPoint(np.array(data["cable"]["on_plate_m"]), "plate"), ViaPoint(np.array(data["cable"]["pull_point_m"])))
    return Robot((body,), (plate,), (Cable("front", ends),))


@pytest.mark.parametrize("name", ["neck-shortening.json", "neck-tension.json"])
def test_neck_settles_as_in_sofa(name):
    data = shared_json(name)
    rows = data["rows"]
    drive = pulled if data["control"] == "shortening" else tensed
    protocol = drive(*[row["shortening_m" if drive is pulled else "tension_N"] for row in rows])

    response = simulate(neck_robot(data), protocol, curve_tolerance=0.0)

    assert response.succeeded, response.status
    for channel, key in {
        "front.tension": "tension_N",
        "front.shortening": "shortening_m",
        "plate.pitch": "pitch_rad",
        "plate.x": "plate_x_m",
        "plate.z": "plate_z_m",
    }.items():
        np.testing.assert_allclose(response.channels[channel], [row[key] for row in rows], rtol=1e-4, err_msg=channel)
    # y leaves the plane by the mesh alone: micrometres beside centimetres.
    np.testing.assert_allclose(response.channels["plate.y"], [row["plate_y_m"] for row in rows], rtol=0, atol=1e-6)


def beam_robot(data: dict) -> Robot:
    mesh = read_mesh(SHARED / "data" / "sofa" / data["mesh"])
    body = Body(
        "beam",
        mesh,
        fixed=np.flatnonzero(mesh.points[:, 0] <= 1e-4),
        parameters=elastic(data["youngs_modulus_Pa"], data["poissons_ratio"]),
        element="P1",
    )
    inside = [ViaPoint(np.array(at), "beam") for at in data["cable"]["via_points_m"]]
    pull = ViaPoint(np.array(data["cable"]["pull_point_m"], dtype=float))
    return Robot((body,), (), (Cable("tendon", (*reversed(inside), pull)),))


@pytest.mark.parametrize("by", ["tension", "shortening"])
def test_beam_with_embedded_cable_settles_as_in_sofa(by):
    data = shared_json("beam-cable.json")
    robot = beam_robot(data)
    tip = robot.bodies[0].mesh.points[:, 0] > 0.1 - 1e-9
    assert tip.any()
    for row in data["static"]:
        value = row["tension_N"] if by == "tension" else row["shortening_m"]
        protocol = (tensed if by == "tension" else pulled)(value, cable="tendon")
        response = simulate(robot, protocol, snapshots=True, curve_tolerance=0.0)
        assert response.succeeded, response.status
        assert response.channels["tendon.shortening"][0] == pytest.approx(row["shortening_m"], rel=1e-4)
        assert response.channels["tendon.tension"][0] == pytest.approx(row["tension_N"], rel=1e-4)
        at_value = [
            shot for shot in response.snapshots if abs(shot.tensions["tendon"] - row["tension_N"]) < 1e-4 * 0.03
        ]
        moved = (at_value[0].points["beam"] - robot.bodies[0].mesh.points)[tip].mean(axis=0)
        expected = np.array(row["tip_displacement_m"])
        assert np.linalg.norm(moved - expected) < 1e-4 * np.linalg.norm(expected)
