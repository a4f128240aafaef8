"""Euler-Eytelwein: over a total turn phi friction takes exp(-mu phi) of the tension, on the rig and along cables."""

from dataclasses import replace

import numpy as np
import pytest
from drum_case import MU, robot_over_a_drum
from mechanics_cases import column_robot, elastic, full_matrix, pulled, side_cable, tensed, twin_and_theta

from softcal.experiments.dataset import Channel, Dataset
from softcal.experiments.steps.pulleys import correct_pulley_friction
from softcal.mechanics.cable import cables_of
from softcal.mechanics.state import moved, rest_state
from softcal.mechanics.term import Controls, Given
from softcal.twin.robot import Cable, ViaPoint
from softcal.twin.simulate import simulate


def test_pulleys_of_the_rig():
    """Paper A: two pulleys, half a turn each, mu = 0.1: 0.5335 of the machine's tension reaches the neck."""
    measured = Channel(np.array([0.0, 5.0, 12.0]), "N", 0.1)
    dataset = Dataset("bench", {"tension": measured})
    at_neck = correct_pulley_friction(dataset, 2, 0.1, np.pi).channels["tension"]
    np.testing.assert_allclose(at_neck.values, np.exp(-0.2 * np.pi) * measured.values, rtol=1e-12)
    np.testing.assert_allclose(at_neck.values[1:] / measured.values[1:], 0.5335, atol=5e-5)


@pytest.mark.parametrize("n", [3, 12, 100, 1000, 3000])
def test_a_drum_turns_a_cable_by_as_much_through_any_number_of_points(n):
    """A quarter turn takes exp(-mu pi / 2), whether a few points make it or thousands."""
    twin, _ = twin_and_theta(robot_over_a_drum(MU, n))
    cables = cables_of(twin.system)
    rest, free = rest_state(twin.system.layout), Controls(np.zeros(1, dtype=bool), np.zeros(1), np.zeros(1))
    along = cables.tensions(Given(replace(rest, effort=np.ones(1)), free, {"front.friction_coefficient": MU}))
    assert along.factor[0] == 1.0  # at the pulled end
    assert along.factor[-1] == pytest.approx(np.exp(-MU * np.pi / 2), rel=1e-8)
    by_mu = along.respond(along.by_property("friction_coefficient", 0)[0][:, None])[:, 0]
    assert by_mu[-1] == pytest.approx(-0.5 * np.pi, rel=1e-8)


def test_via_points_that_nothing_turns_cost_no_column():
    """Of a thousand points fixed in space, only the angle at the first is changed by the plate."""
    twin, theta = twin_and_theta(robot_over_a_drum(MU, 1000))
    state = rest_state(twin.system.layout)
    state.effort[:] = 1.0
    free = Controls(np.zeros(1, dtype=bool), np.zeros(1), np.zeros(1))
    border = twin.system.linearise(state, free, theta).border
    assert border.columns.shape[1] == 2  # the tension's, and that angle's


def turn_of(cable: np.ndarray) -> float:
    """Total turning angle of a polyline [rad]."""
    step = np.diff(cable, axis=0)
    step /= np.linalg.norm(step, axis=1)[:, None]
    return float(np.arccos(np.clip((step[1:] * step[:-1]).sum(axis=1), -1.0, 1.0)).sum())


@pytest.mark.parametrize("tension", [0.2, 1.0, 2.0])
def test_drum_takes_its_share_of_the_tension(tension):
    """The robot moves as under the frictionless tension T exp(-mu phi) of a cable that ends where the drum begins."""
    robot = robot_over_a_drum(MU)
    rubbed = simulate(robot, tensed(tension), snapshots=True, curve_tolerance=0.0)
    assert rubbed.succeeded, rubbed.status
    shot = min(rubbed.snapshots, key=lambda shot: abs(shot.efforts["front"] - tension))
    phi = turn_of(shot.routes["front"])
    assert abs(phi - 0.5 * np.pi) > 0.003  # the plate's end swings

    free = column_robot("P1", parameters=elastic(0.5e6, 0.4), cables=(side_cable("front", (0.05, 0.0)),))
    smooth = simulate(free, tensed(tension * np.exp(-MU * phi)), curve_tolerance=0.0)

    for channel in ("plate.pitch", "plate.x", "plate.z"):
        assert rubbed.channels[channel][0] == pytest.approx(smooth.channels[channel][0], rel=1e-6)


def test_cable_pulled_at_its_first_end_loses_towards_the_last():
    """The same robot, its cable listed the other way round."""
    robot = robot_over_a_drum(MU)
    (cable,) = robot.cables
    turned = replace(robot, cables=(replace(cable, via_points=cable.via_points[::-1], pulled_end="first"),))
    one, other = (simulate(r, pulled(0.01, 0.02), curve_tolerance=0.0).channels for r in (robot, turned))
    for channel, values in one.items():
        np.testing.assert_allclose(other[channel], values, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("n", [12, 1000])
def test_friction_makes_the_pull_harder_by_the_capstan_formula(n):
    smooth, rubbed = (
        simulate(robot_over_a_drum(mu, n), pulled(0.01), snapshots=True, curve_tolerance=0.0) for mu in (0.0, MU)
    )
    phi = turn_of(rubbed.snapshots[-1].routes["front"])
    ratio = rubbed.channels["front.tension"][0] / smooth.channels["front.tension"][0]
    assert ratio == pytest.approx(np.exp(MU * phi), rel=1e-6)


@pytest.mark.parametrize("drive", ["shortening", "tension"])
def test_sensitivity_to_friction_is_the_difference(drive, monkeypatch):
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    robot, name = robot_over_a_drum(MU, 5), "front.friction_coefficient"
    protocol = pulled(0.01, 0.02) if drive == "shortening" else tensed(0.5, 1.5)
    names = (name, "neck.youngs_modulus", "neck.poissons_ratio")
    got = simulate(robot, protocol, sensitivities=names, curve_tolerance=0.0).sensitivities
    for name, value in zip(names, (MU, 0.5e6, 0.4), strict=True):
        h = 3e-4 * value
        ends = [simulate(robot, protocol, {name: value + s * h}, curve_tolerance=0.0).channels for s in (1, -1)]
        for channel in ("front.tension", "front.shortening", "plate.pitch", "plate.x"):
            want = (ends[0][channel] - ends[1][channel]) / (2 * h)
            np.testing.assert_allclose(
                got[channel][name], want, rtol=1e-5, atol=1e-5 * np.abs(want).max() + 1e-10, err_msg=f"{channel} {name}"
            )


@pytest.mark.parametrize("drive", [pulled, tensed])
def test_sensitivity_to_friction_is_exact_where_there_is_none_yet(drive):
    """At a coefficient of zero, by the one-sided difference of second order: a search must not be held there."""
    robot, name, h = robot_over_a_drum(0.0, 5), "front.friction_coefficient", 1e-3
    command = drive(0.01) if drive is pulled else drive(1.0)
    exact = simulate(robot, command, sensitivities=(name,), curve_tolerance=0.0)
    at = [simulate(robot, command, {name: k * h}, curve_tolerance=0.0).channels for k in range(3)]
    for channel in ("front.shortening" if drive is tensed else "front.tension", "plate.x"):
        difference = (-3.0 * at[0][channel] + 4.0 * at[1][channel] - at[2][channel]) / (2.0 * h)
        scale = np.abs(at[0][channel])
        assert np.abs(exact.sensitivities[channel][name] - difference) < 1e-4 * scale
        if channel != "plate.x":
            assert np.abs(difference) > 0.1 * scale


def test_tangent_with_friction_is_the_jacobian():
    """Via points on the plate and in the body that friction pulls along; the tangent is not symmetric then."""
    via = (
        ViaPoint(np.array([0.01, 0.0, 0.1]), "plate"),
        ViaPoint(np.array([0.012, 0.003, 0.06]), "neck"),
        ViaPoint(np.array([0.004, -0.004, 0.03]), "neck"),
        ViaPoint(np.array([0.02, 0.0, -0.02])),
    )
    robot = column_robot("P1", parameters=elastic(1.0, 0.4), divisions=(1, 1, 3), cables=(Cable("front", via, 0.3),))
    twin, theta = twin_and_theta(robot)
    system, layout = twin.system, twin.system.layout
    controls = Controls(np.zeros(1, dtype=bool), np.zeros(1), np.array([0.01]))
    rng = np.random.default_rng(0)
    start = rng.uniform(-1e-3, 1e-3, layout.n_unknowns)
    start[layout.first_effort_unknown :] = 1e-4
    state = moved(layout, rest_state(layout), start)
    at = system.linearise(state, controls, theta)
    unit = np.full(layout.n_unknowns, 1e-3)
    unit[layout.first_effort_unknown :] = 1e-4
    plate = slice(layout.first_frame_unknown + 3, layout.first_frame_unknown + 6)
    unit[plate] = 0.1
    K = full_matrix(system, at) * unit * unit[:, None]
    jacobian = np.zeros_like(K)
    for j in range(layout.n_unknowns):
        dz = np.zeros(layout.n_unknowns)
        dz[j] = 1e-4 * unit[j]
        ends = [system.linearise(moved(layout, state, s * dz), controls, theta, tangent=False).reduced for s in (1, -1)]
        jacobian[:, j] = (ends[0] - ends[1]) / 2e-4 * unit
    scale = np.abs(K).max()
    # Two turns of a plate: see test_taylor.
    jacobian[plate, plate] = 0.5 * (jacobian[plate, plate] + jacobian[plate, plate].T)
    K[plate, plate] = 0.5 * (K[plate, plate] + K[plate, plate].T)
    np.testing.assert_allclose(jacobian, K, rtol=0, atol=1e-7 * scale)
    assert np.abs(K - K.T).max() > 1e-5 * scale
