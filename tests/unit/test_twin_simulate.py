"""simulate's own bookkeeping: what comes back where a path ends early, without cables, without samples to reach."""

from collections.abc import Mapping
from dataclasses import is_dataclass, replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, side_cable, tensed
from project_case import bar_robot

from softcal.errors import ParameterError
from softcal.geometry.primitives import box_mesh
from softcal.mechanics import path as path_module
from softcal.twin.live import LiveTwin
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

NAMES = ("neck.youngs_modulus",)


@pytest.fixture
def wall(monkeypatch):
    """No equilibrium beyond a shortening of 12 mm."""
    original = path_module.Statics.equilibrium

    def stopped(self, guess, controls):
        found = original(self, guess, controls)
        beyond = np.any(controls.coordinate[~controls.is_held] > 0.012)
        return replace(found, converged=False, status="a wall") if beyond else found

    monkeypatch.setattr(path_module.Statics, "equilibrium", stopped)


@pytest.mark.parametrize("tolerance", [0.0, 1e-4])
def test_path_that_ends_early_gives_the_samples_before_and_a_sentence(wall, tolerance):
    robot = column_robot("P1", parameters=elastic(0.5e6, 0.4), divisions=(1, 1, 4))
    d = np.array([0.002, 0.006, 0.011, 0.02, 0.004])
    response = simulate(robot, pulled(*d), sensitivities=NAMES, curve_tolerance=tolerance)
    assert not response.succeeded
    assert response.status.startswith("No equilibrium beyond 12 mm of shortening of front (3 of 5 samples reached)")
    np.testing.assert_allclose(response.channels["front.shortening"], d[:3])
    assert len(response.sensitivities["front.tension"][NAMES[0]]) == 3


@pytest.mark.parametrize(("cables", "furthest"), [(("front",), 0.018), (("front", "left"), 0.008)])
@pytest.mark.parametrize(("C01", "is_unstable"), [(-1.6e5, True), (2e4, False)])
def test_a_law_that_is_unstable_at_the_furthest_state_is_a_warning(cables, furthest, C01, is_unstable):
    robot = column_robot("P1", divisions=(1, 1, 4))
    own = {"C10": 2e5, "C01": C01, "bulk_modulus": 2e6}
    robot = replace(
        robot,
        bodies=(replace(robot.bodies[0], law="mooney-rivlin", parameters=own),),
        cables=(*robot.cables, side_cable("left", (0.0, 0.01))) if len(cables) > 1 else robot.cables,
    )
    commands = {cable: Command("shortening", np.array([0.004, furthest, 0.0])) for cable in cables}
    response = simulate(robot, Protocol(commands))
    assert response.succeeded
    assert ("its law mooney-rivlin is unstable" in response.remarks) == is_unstable
    assert (response.remarks in response.warnings) == is_unstable
    assert response.remarks in response.status


def test_a_law_that_gives_way_where_the_path_ends_is_reported(wall, monkeypatch):
    robot = column_robot("P1", parameters=elastic(0.5e6, -0.4), divisions=(1, 1, 4))
    assert simulate(robot, pulled(0.02)).status.endswith("a wall.")
    monkeypatch.setattr("softcal.mechanics.system.System.remarks", lambda *_: " Its law gives way.")
    assert simulate(robot, pulled(0.02)).status.endswith("a wall. Its law gives way.")
    assert simulate(robot, pulled(0.01)).status.startswith("Solved")


@pytest.mark.parametrize("tolerance", [0.0, 1e-4])
def test_tension_that_is_not_reached_ends_the_channels_before_it(wall, tolerance):
    robot = column_robot("P1", parameters=elastic(0.5e6, 0.4), divisions=(1, 1, 4))
    T = np.array([0.2, 0.5, 9.0, 0.3])
    response = simulate(robot, tensed(*T), curve_tolerance=tolerance)
    assert not response.succeeded
    assert "2 of 4 samples reached" in response.status
    np.testing.assert_allclose(response.channels["front.tension"], T[:2])
    assert all(len(values) == 2 and np.all(np.isfinite(values)) for values in response.channels.values())


def test_sample_of_several_cables_that_is_not_reached(wall):
    robot = column_robot(
        "P1",
        parameters=elastic(0.5e6, 0.4),
        divisions=(1, 1, 4),
        cables=(side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05))),
    )
    protocol = Protocol(
        {name: Command("shortening", np.array([0.005, 0.01, 0.02, 0.001])) for name in ("front", "left")}
    )
    response = simulate(robot, protocol)
    assert not response.succeeded
    assert response.status.startswith("Sample 3 of 4 was not reached (front 20 mm, left 20 mm): ")
    assert response.status.endswith(" The other 3 are solved.")
    assert response.samples == (0, 1, 3)
    np.testing.assert_allclose(response.channels["front.shortening"], [0.005, 0.01, 0.001])


def test_states_after_one_without_equilibrium_are_those_without_it(wall):
    """And the further ones on its way are not tried: 10 states, each of which takes seconds to fail."""
    robot = column_robot(
        "P1",
        parameters=elastic(0.5e6, 0.4),
        divisions=(1, 1, 4),
        cables=(side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05))),
    )
    front, left = np.array([[5, 2], [20, 10], [4, 8], *[[20 + 2 * k, 10 + k] for k in range(1, 8)], [1, 2]]).T * 1e-3

    def response(rows):
        return simulate(
            robot,
            Protocol({"front": Command("shortening", front[rows]), "left": Command("shortening", left[rows])}),
            sensitivities=(*NAMES, "front.shortening"),
        )

    some, alone = response(slice(None)), response([0, 2, 10])
    assert alone.succeeded
    assert alone.samples is None
    assert some.samples == (0, 2, 10)
    for name, values in alone.channels.items():
        np.testing.assert_allclose(some.channels[name], values, rtol=1e-7, atol=1e-10)
        for p, by in alone.sensitivities[name].items():
            np.testing.assert_allclose(some.sensitivities[name][p], by, rtol=1e-5, atol=1e-9)
    assert some.n_factorisations < 3 * response([0, 1]).n_factorisations
    assert "Sample 4 of 11 was not reached (front 22 mm, left 11 mm): it is beyond sample 2 on" in some.status
    assert "Nor were samples 6, 7, 8, 9, 10. The other 3 are solved." in some.status
    full = some.over(11).channels["front.tension"]
    assert np.flatnonzero(np.isfinite(full)).tolist() == [0, 2, 10]


def test_robot_without_cables_or_commands_rests():
    robot = replace(column_robot("P1", gravity=(1.0, 0, -9.81), mass=0.1), cables=())
    response = simulate(robot, Protocol({}), sensitivities=("plate.mass",))
    assert response.succeeded
    assert response.status == "Solved: no cable is driven."
    assert set(response.channels) == {f"plate.{key}" for key in ("x", "y", "z", "pitch", "roll", "yaw")}
    assert response.sensitivities["plate.x"]["plate.mass"][0] > 0.0


def test_snapshots_hold_what_the_channels_say():
    robot = column_robot("P2P1", divisions=(1, 1, 4))
    response = simulate(robot, pulled(0.01, 0.03), snapshots=True, curve_tolerance=0.0)
    for d, T, pitch in zip(
        *(response.channels[name] for name in ("front.shortening", "front.tension", "plate.pitch")), strict=True
    ):
        shot = min(response.snapshots, key=lambda shot: abs(shot.controls["front"] - d))
        assert shot.efforts["front"] == pytest.approx(T)
        length = np.linalg.norm(np.diff(shot.routes["front"], axis=0), axis=1).sum()
        assert length == pytest.approx(0.1 - d, abs=1e-9)
        _, R = shot.plates["plate"]
        assert np.arctan2(R[0, 2], R[2, 2]) == pytest.approx(pitch)
    assert shot.points["neck"].shape[0] == response.tets["neck"].max() + 1
    assert response.snapshots[0].controls["front"] == 0.0


def arrays_of(value: object) -> list[np.ndarray]:
    if isinstance(value, np.ndarray):
        return [value]
    inner = value.values() if isinstance(value, Mapping) else value if isinstance(value, tuple) else ()
    inner = vars(value).values() if is_dataclass(value) else inner
    return [array for one in inner for array in arrays_of(one)]


def test_a_result_cannot_be_changed():
    robot = bar_robot()
    pull = Protocol({"front": Command("shortening", np.array([0.0, 0.002]))})
    response = simulate(robot, pull, sensitivities=["bar.youngs_modulus"], snapshots=True)
    jacobian = LiveTwin(robot).at({"front": 0.001}).by_commands()
    arrays = [*arrays_of(response), *arrays_of(response.over(3)), *arrays_of(jacobian)]
    assert len(arrays) > 20
    assert not any(array.flags.writeable for array in arrays)


def test_two_robots_in_turn_do_not_mix():
    """The kept twins: the same answers whichever was asked for before."""
    robots = [
        column_robot(e, divisions=(1, 1, 3), parameters=elastic(E, 0.4)) for e in ("P1", "P2") for E in (1e6, 2e6)
    ]
    first = [simulate(robot, pulled(0.02)).channels["front.tension"][0] for robot in robots]
    again = [simulate(robot, pulled(0.02)).channels["front.tension"][0] for robot in reversed(robots)]
    assert again[::-1] == first
    assert first[1] == pytest.approx(2.0 * first[0], rel=1e-7)


@pytest.mark.parametrize("element", ["P1", "P2", "P2P1"])
@pytest.mark.parametrize("nu", [-0.5, -0.9])
def test_a_ratio_at_which_the_law_gives_way_is_refused(element, nu):
    with pytest.raises(ParameterError, match=r"allowed: between -0\.5 and 0\.5\. Try: law neo-hooke-isochoric"):
        column_robot(element, parameters=elastic(1e6, nu), divisions=(1, 1, 4))
    robot = column_robot(element, parameters=elastic(1e6, 0.3), divisions=(1, 1, 4))
    with pytest.raises(ParameterError, match=r"allowed: between -0\.5 and 0\.5\. Try: law neo-hooke-isochoric"):
        simulate(robot, pulled(0.01), {"neck.poissons_ratio": nu})
    other = column_robot(element, parameters=elastic(1e6, nu), divisions=(1, 1, 4), law="neo-hooke-isochoric")
    assert simulate(other, pulled(0.01, 0.05)).succeeded


@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_a_block_that_does_not_bend_takes_few_equilibria(element):
    """The plate turns by rounding alone, which is not resolved: that took 1,000 equilibria."""
    mesh = box_mesh((0.1, 0.1, 0.1), (2, 2, 2), origin=(-0.05, -0.05, 0.0))
    robot = column_robot(element, parameters=elastic(1e6, 0.45), mesh=mesh, cables=(side_cable("front", (0.0, 0.0)),))
    response = simulate(robot, pulled(0.01, 0.02))
    assert response.succeeded
    assert response.n_factorisations <= 20


def test_sample_by_tension_is_solved_once_as_one_by_shortening_is():
    robot = column_robot("P2P1", parameters=elastic(1e6, 0.45), divisions=(1, 1, 4))
    d = np.linspace(0.002, 0.03, 9)
    by_length = simulate(robot, pulled(*d), curve_tolerance=0.0)
    T = by_length.channels["front.tension"]
    by_tension = simulate(robot, tensed(*T), curve_tolerance=0.0)
    np.testing.assert_allclose(by_tension.channels["front.shortening"], d, rtol=1e-8)
    way = simulate(robot, tensed(*T), curve_tolerance=1.0)  # the few nodes on the way to the largest tension
    assert by_tension.n_factorisations <= by_length.n_factorisations + way.n_factorisations
