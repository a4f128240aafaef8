"""Weight, and cables that hang slack, become taut, or are wound up to their end."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, mirrored_box, pulled, tensed

from softcal.errors import ParameterError
from softcal.twin.protocol import Protocol
from softcal.twin.robot import PointLoad
from softcal.twin.simulate import simulate

G = 9.81
AREA, HEIGHT = 0.03**2, 0.1


def at_rest(robot):
    response = simulate(robot, Protocol({}))
    assert response.succeeded, response.status
    return {name: values[0] for name, values in response.channels.items()}


@pytest.mark.parametrize("element", ["P1", "P2", "P2P1"])
def test_hanging_column_lengthens_by_the_closed_form(element):
    """nu = 0: rho g L^2 / 2 E by its own weight, m g L / E A by the plate's; small loads, 24 layers."""
    E, density, mass = 1.0e8, 1000.0, 0.2
    robot = column_robot(
        element,
        parameters=elastic(E, 0.0),
        divisions=(1, 1, 24),
        gravity=(0, 0, G),
        density=density,
        mass=mass,
    )
    expected = density * G * HEIGHT**2 / (2 * E) + mass * G * HEIGHT / (E * AREA)
    # P1 puts half of the last layers' weight on the clamp and on the plate, exactly as the closed form asks for.
    assert at_rest(robot)["plate.z"] - HEIGHT == pytest.approx(expected, rel=1e-4)


def test_mass_on_the_plate_is_a_force_at_its_centre_of_mass():
    heavy = column_robot("P1", gravity=(G, -2.0, -3.0), mass=0.3)
    loaded = replace(
        column_robot("P1"),
        loads=(PointLoad("weight", "plate", np.array([0.0, 0.0, 0.12]), 0.3 * np.array([G, -2.0, -3.0])),),
    )
    one, other = at_rest(heavy), at_rest(loaded)
    assert abs(one["plate.pitch"]) > 0.01
    for name, value in one.items():
        assert other[name] == pytest.approx(value, rel=1e-9, abs=1e-14)


def test_plate_settles_sideways_as_a_cantilever():
    """A slender bar of P2: tip force F = m g and moment F c of the mass that stands c above the reference."""
    robot = column_robot("P2", parameters=elastic(1.0e8, 0.0), divisions=(1, 1, 10), gravity=(G, 0, 0), mass=0.05)
    inertia, F, c = 0.03**4 / 12, 0.05 * G, 0.02
    E, L = 1.0e8, HEIGHT
    bending = F * L**3 / (3 * E * inertia) + F * c * L**2 / (2 * E * inertia)
    shear = F * L / (5 / 6 * 0.5 * E * AREA)
    rest = at_rest(robot)
    assert rest["plate.x"] == pytest.approx(bending + shear, rel=0.02)
    assert rest["plate.pitch"] == pytest.approx(F * L**2 / (2 * E * inertia) + F * c * L / (E * inertia), rel=0.02)


def test_mirrored_loads_give_mirrored_rests():
    mesh = mirrored_box((0.03, 0.03, 0.1), (1, 2, 5))
    ends = [
        at_rest(column_robot("P2P1", mesh=mesh, parameters=elastic(0.3e6, 0.45), gravity=(s * G, 0, -G), mass=0.05))
        for s in (1, -1)
    ]
    signs = {"x": -1, "y": 1, "z": 1, "pitch": -1, "roll": 1, "yaw": -1}
    assert abs(ends[0]["plate.pitch"]) > 0.05
    for key, sign in signs.items():
        assert ends[1][f"plate.{key}"] == pytest.approx(sign * ends[0][f"plate.{key}"], rel=1e-7, abs=1e-11)


# Slack. Gravity along +x lets the column sag towards its front cable.


def sagging(sign: float):
    return column_robot("P1", parameters=elastic(0.3e6, 0.4), gravity=(sign * G, 0, 0), mass=0.03)


@pytest.mark.parametrize("tolerance", [0.0, 1e-4])
def test_cable_is_slack_until_the_sag_is_taken_up(tolerance):
    robot = sagging(+1.0)
    sag = at_rest(robot)
    taut_at = sag["front.shortening"]
    assert taut_at > 1e-3  # what the cable could be pulled in without a tension
    d = taut_at * np.array([-1.0, 0.0, 0.5, 0.99, 1.01, 1.5])
    response = simulate(robot, pulled(*d), curve_tolerance=tolerance)
    assert response.succeeded, response.status
    T, pitch = response.channels["front.tension"], response.channels["plate.pitch"]
    np.testing.assert_allclose(response.channels["front.shortening"], d, rtol=1e-12)
    assert np.all(T[:4] == 0.0)
    np.testing.assert_allclose(pitch[:4], sag["plate.pitch"], rtol=1e-7)
    assert np.all(np.diff(T[3:]) > 0.0)
    assert np.all(np.diff(pitch[3:]) > 0.0)
    # and it comes into tension without a jump
    assert T[4] == pytest.approx(T[5] * 0.01 / 0.5, rel=0.1)


def test_cable_holds_back_a_sag_away_from_it():
    robot = sagging(-1.0)
    assert at_rest(robot)["front.shortening"] < -1e-3
    response = simulate(robot, pulled(-0.0005, 0.0, 0.002), curve_tolerance=0.0)
    assert np.all(response.channels["front.tension"] > 0.0)
    free = simulate(robot, tensed(0.0))
    assert free.channels["front.shortening"][0] == pytest.approx(at_rest(robot)["front.shortening"])


def test_tension_zero_among_others_is_the_rest():
    robot = sagging(+1.0)
    rest = at_rest(robot)
    response = simulate(robot, tensed(0.0, 0.3, 0.0, 0.1), curve_tolerance=0.0)
    for name, values in response.channels.items():
        if name != "front.tension":
            np.testing.assert_allclose(values[[0, 2]], rest[name], rtol=1e-6, atol=1e-12, err_msg=name)
    np.testing.assert_allclose(response.channels["front.tension"], [0.0, 0.3, 0.0, 0.1])


def test_two_ways_of_driving_are_one_curve():
    robot = sagging(+1.0)
    d = np.array([0.005, 0.01, 0.02, 0.03])
    by_length = simulate(robot, pulled(*d), curve_tolerance=0.0)
    by_tension = simulate(robot, tensed(*by_length.channels["front.tension"]), curve_tolerance=0.0)
    for name, values in by_length.channels.items():
        np.testing.assert_allclose(by_tension.channels[name], values, rtol=1e-6, atol=1e-10, err_msg=name)


def test_order_and_repetition_of_samples_do_not_matter():
    robot = sagging(+1.0)
    d = np.array([0.02, -0.001, 0.03, 0.02, 0.01, 0.03])
    response = simulate(robot, pulled(*d))
    ordered = simulate(robot, pulled(*np.unique(d)))
    for name, values in ordered.channels.items():
        np.testing.assert_array_equal(response.channels[name], values[np.searchsorted(np.unique(d), d)])


@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_soft_column_under_a_large_tension_is_wound_up(element):
    """0.1 MPa under 8 N: the plate comes down to the cable's foot. That is a state, and the status says so."""
    robot = column_robot(element, parameters=elastic(0.1e6, 0.45), divisions=(2, 2, 5))
    T = np.array([0.2, 1.0, 8.0])
    response = simulate(robot, tensed(*T))
    assert response.succeeded, response.status
    assert "wound up to zero length" in response.status
    assert all(len(values) == 3 and np.all(np.isfinite(values)) for values in response.channels.values())
    np.testing.assert_array_equal(response.channels["front.tension"], T)
    shortening = response.channels["front.shortening"]
    assert np.all(np.diff(shortening) >= 0.0)
    assert shortening[-1] == pytest.approx(0.1, rel=2e-3)


def test_what_no_cable_can_do_is_refused():
    robot = column_robot("P1")
    with pytest.raises(ParameterError, match="cannot push"):
        simulate(robot, tensed(1.0, -0.5))
    with pytest.raises(ParameterError, match="by more than its length"):
        simulate(robot, pulled(0.02, 0.11))
    with pytest.raises(ParameterError, match="no such cable"):
        simulate(robot, tensed(1.0, cable="back"))
    with pytest.raises(ParameterError, match=r"Try: 'neck\.youngs_modulus'"):
        simulate(robot, tensed(1.0), sensitivities=("neck.young_modulus",))
    with pytest.raises(ParameterError, match=r"Try: 'plate\.mass'"):
        simulate(robot, tensed(1.0), sensitivities=("plate.friction_coefficient",))


def test_a_load_without_equilibrium_ends_in_a_sentence():
    """A column that its own weight crushes."""
    robot = column_robot("P1", parameters=elastic(1.0e3, 0.45), gravity=(0, 0, -G), density=1e5, mass=50.0)
    response = simulate(robot, pulled(0.01))
    assert not response.succeeded
    assert "dead loads" in response.status
    assert response.status.endswith(".")
    assert all(len(values) == 0 for values in response.channels.values())
