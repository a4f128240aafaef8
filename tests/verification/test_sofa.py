"""SOFA's settled states and transients on the same meshes: linear tets, the same energy, so the same numbers."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import pulled, shared_json, tensed
from sofa_case import assert_neck_as_measured, assert_tip_as_measured, beam_robot, beam_tip, neck_robot

from softcal.twin.in_time import simulate_in_time
from softcal.twin.protocol import Command
from softcal.twin.robot import Marker
from softcal.twin.schedule import Schedule
from softcal.twin.simulate import simulate
from softcal.twin.time_settings import TimeSettings


@pytest.mark.parametrize("name", ["neck-shortening.json", "neck-tension.json"])
def test_neck_settles_as_in_sofa(name):
    data = shared_json(name)
    rows = data["rows"]
    drive = pulled if data["control"] == "shortening" else tensed
    protocol = drive(*[row["shortening_m" if drive is pulled else "tension_N"] for row in rows])

    response = simulate(neck_robot(data), protocol, curve_tolerance=0.0)

    assert_neck_as_measured(response, rows)
    np.testing.assert_allclose(response.channels["plate.pitch"], [row["pitch_rad"] for row in rows], rtol=1e-4)
    # y leaves the plane by the mesh alone: micrometres beside centimetres.
    np.testing.assert_allclose(response.channels["plate.y"], [row["plate_y_m"] for row in rows], rtol=0, atol=1e-6)


@pytest.mark.parametrize("by", ["tension", "shortening"])
def test_beam_with_embedded_cable_settles_as_in_sofa(by):
    data = shared_json("beam-cable.json")
    robot = beam_robot(data)
    for row in data["static"]:
        value = row["tension_N"] if by == "tension" else row["shortening_m"]
        protocol = (tensed if by == "tension" else pulled)(value, cable="tendon")
        response = simulate(robot, protocol, snapshots=True, curve_tolerance=0.0)
        assert response.succeeded, response.status
        assert response.channels["tendon.shortening"][0] == pytest.approx(row["shortening_m"], rel=1e-4)
        assert response.channels["tendon.tension"][0] == pytest.approx(row["tension_N"], rel=1e-4)
        at_value = [shot for shot in response.snapshots if abs(shot.efforts["tendon"] - row["tension_N"]) < 1e-4 * 0.03]
        assert_tip_as_measured(robot, at_value[0], row)


@pytest.mark.parametrize("run", ["dt0.01_rs0.2_rm0.1", "dt0.05_rs0.1_rm0.1"])
def test_beam_moves_as_in_sofa_with_one_linear_solve_per_step(run):
    """Every row of the trajectory. A difference in the scheme shows in the first per cents, not in the fifth digit."""
    data = shared_json("beam-cable.json")
    dynamic = data["dynamic"][run]
    robot = beam_robot(data)
    body = replace(robot.bodies[0], density=data["density_kg_m3"])
    nodes = np.flatnonzero(beam_tip(robot))
    markers = tuple(Marker(f"tip{i}", "beam", body.mesh.points[i]) for i in nodes)
    rows = np.array(dynamic["rows"])
    schedule = Schedule(np.append(0.0, rows[:, 0]), {"tendon": Command("tension", np.append(rows[0, 1], rows[:, 1]))})
    settings = TimeSettings(
        time_step=dynamic["dt_s"],
        rayleigh_stiffness=dynamic["rayleigh_stiffness"],
        rayleigh_mass=dynamic["rayleigh_mass"],
        scheme="one-solve",
    )

    response = simulate_in_time(replace(robot, bodies=(body,), markers=markers), schedule, settings)

    assert response.succeeded, response.status
    np.testing.assert_allclose(response.channels["time"][1:], rows[:, 0], rtol=1e-12)
    tip = np.stack([np.mean([response.channels[f"{m.name}.{k}"] for m in markers], axis=0) for k in "xyz"], axis=1)
    error = np.linalg.norm(tip[1:] - tip[0] - rows[:, 2:], axis=1)
    assert (error / np.linalg.norm(rows[:, 2:], axis=1)).max() < 1e-8
    assert response.n_factorisations == len(rows)
