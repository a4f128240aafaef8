"""The path to a shape: where it starts, how its steps are chosen, and the stiffness at its end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, side_cable, tensed

from softcal.plugins.calculix import load_path as module
from softcal.plugins.calculix.load_path import coordinates, load_path, positions
from softcal.twin.build import twin_of
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

ROBOT = column_robot("P1", parameters=elastic(1e6, 0.4), divisions=(1, 1, 4))


def end_of(robot, protocol):
    response = simulate(robot, protocol, snapshots=True)
    assert response.succeeded, response.status
    return response.snapshots[-1]


def test_the_steps_are_equal_parts_of_the_pull_of_some_15_degrees():
    end = end_of(ROBOT, pulled(0.04))
    path = load_path(ROBOT, end)
    turn = np.degrees(
        module._largest_turn(twin_of(ROBOT), simulate(ROBOT, pulled(0.0), snapshots=True).snapshots[0], end)
    )
    assert len(path.shapes) == np.ceil(turn / 15.0) > 2
    twin = twin_of(ROBOT)
    pulls = [coordinates(ROBOT, positions(twin, shape), shape.efforts)["front"] for shape in path.shapes]
    np.testing.assert_allclose(pulls, np.linspace(0.0, 0.04, len(pulls) + 1)[1:], rtol=1e-6)
    assert path.shapes[-1] is end


def test_a_small_pull_is_one_step_and_no_pull_none_more():
    assert len(load_path(ROBOT, end_of(ROBOT, pulled(0.002))).shapes) == 1
    assert len(load_path(ROBOT, end_of(ROBOT, Protocol({}))).shapes) == 1


def test_a_heavy_robot_hangs_first():
    heavy = replace(ROBOT, gravity=np.array([3.0, 0.0, 0.0]), bodies=(replace(ROBOT.bodies[0], density=1000.0),))
    path = load_path(heavy, end_of(heavy, tensed(1.0)))
    assert path.shapes[0].efforts == {"front": 0.0}
    assert np.abs(path.shapes[0].points["neck"] - ROBOT.bodies[0].mesh.points).max() > 1e-5
    assert path.shapes[-1].efforts["front"] == pytest.approx(1.0, rel=1e-6)


def test_the_stiffness_is_that_of_finite_differences():
    robot = replace(ROBOT, cables=(side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05))))
    at = {"front": 0.01, "left": 0.006}

    def tensions(**pulls: float) -> np.ndarray:
        protocol = Protocol({name: Command("shortening", np.array([d])) for name, d in pulls.items()})
        return np.array([simulate(robot, protocol).channels[f"{name}.tension"][-1] for name in at])

    commands = {name: Command("shortening", np.array([d])) for name, d in at.items()}
    path = load_path(robot, end_of(robot, Protocol(commands)))
    assert path.acting == ("front", "left")
    h = 1e-5
    by_hand = [(tensions(**{**at, n: d + h}) - tensions(**{**at, n: d - h})) / (2 * h) for n, d in at.items()]
    np.testing.assert_allclose(path.stiffness, np.column_stack(by_hand), rtol=1e-4)


@pytest.mark.parametrize("kind", ["cannot be gone", "leads elsewhere"])
def test_where_equal_pulls_lead_elsewhere_the_way_is_the_shape_alone(kind, monkeypatch):
    end = end_of(ROBOT, pulled(0.02))
    if kind == "leads elsewhere":
        end = replace(end, points={"neck": end.points["neck"] + [0.0, 1e-4, 0.0]})
    else:
        monkeypatch.setattr(module, "simulate", lambda *a, **k: replace(simulate(*a, **k), succeeded=not a[1].commands))
    path = load_path(ROBOT, end)
    assert path.shapes == (end,)
    assert path.stiffness is None
