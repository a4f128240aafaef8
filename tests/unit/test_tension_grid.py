"""The model of a page to pull: the twin's own at the nodes, within the stated error between."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, side_cable

from softcal.errors import ParameterError, SimulationError
from softcal.export.tension_grid import Reach, _errors, _sampled, tension_grid
from softcal.export.tension_grid_model import GridModel
from softcal.twin.cables import CableLine
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

ROBOT = column_robot(
    "P1",
    parameters=elastic(1e6, 0.4),
    divisions=(1, 1, 4),
    density=1000.0,
    mass=0.05,
    gravity=(0.0, 0.0, -9.81),
    cables=[side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05)), side_cable("back", (-0.05, -0.01))],
)


def grid_of(names, samples, most=3.0):
    model = tension_grid(ROBOT, {name: Reach(most, "N") for name in names}, samples)
    return model, GridModel(model.model)


def measured_error(robot, model, points):
    return _errors(model, points, _sampled(robot, model["cables"], points)[0])


@pytest.mark.parametrize(("names", "samples"), [(["front"], 4), (["front", "left"], 4), (["front", "left", "back"], 3)])
def test_it_is_the_twin_at_nodes_and_near_it_between(names, samples):
    model, read = grid_of(names, samples)
    nodes = np.array(list(itertools.product(*read.axes)))
    at_nodes = measured_error(ROBOT, model.model, nodes)
    between = measured_error(ROBOT, model.model, np.random.default_rng(7).uniform(0.0, 3.0, (30, len(names))))
    for name, stated in model.error.items():
        assert at_nodes[name].largest < 1e-7 * stated.change, name
        assert stated.rms <= stated.largest < 1e-2 * stated.change, name
        assert between[name].largest <= 2.0 * stated.largest, name
        assert between[name].rms <= 1.5 * stated.rms + 1e-12, name
        assert read.error[name]["max"] == stated.largest


@pytest.mark.parametrize(("line", "told"), [(CableLine(1e3, pretension=0.5), True), (CableLine(1e3), False)])
def test_it_says_which_of_the_other_cables_are_held(line, told):
    front, left, back = ROBOT.cables
    robot = replace(ROBOT, cables=(front, replace(left, line=line), back))
    text = tension_grid(robot, {"front": Reach(1.0, "N")}, 2).model["others"]
    assert ("At zero shortening, with their pretension: left." in text) == told
    assert text.endswith("All other cables are slack.")


def test_the_channels_are_the_twins():
    _, read = grid_of(["front", "left"], 5)
    state = read.state({"front": 3.0, "left": 1.5})
    commands = {"front": Command("tension", np.array([3.0])), "left": Command("tension", np.array([1.5]))}
    twin = simulate(ROBOT, Protocol(commands))
    position = [twin.channels[f"plate.{axis}"][0] for axis in "xyz"]
    np.testing.assert_allclose(state["plates"]["plate"]["position"], position, atol=1e-10)
    x, y, z, w = state["plates"]["plate"]["quaternion"]
    pitch = math.atan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y))
    assert pitch == pytest.approx(twin.channels["plate.pitch"][0], abs=1e-9)
    for cable in ("front", "left", "back"):
        assert state["shortenings"][cable] == pytest.approx(twin.channels[f"{cable}.shortening"][0], abs=1e-10)


def test_the_compliance_is_the_derivative_of_the_poses():
    _, read = grid_of(["front", "left"], 4)
    at, h = {"front": 1.3, "left": 0.4}, 1e-5
    here = read.state(at)
    for column, name in enumerate(read.cables):
        ahead, behind = (read.state({**at, name: at[name] + sign * h}) for sign in (1, -1))
        moved = np.subtract(ahead["plates"]["plate"]["position"], behind["plates"]["plate"]["position"]) / (2 * h)
        np.testing.assert_allclose([row[column] for row in here["compliance"][:3]], moved, rtol=1e-6, atol=1e-12)
        x, y, z, w = ahead["plates"]["plate"]["quaternion"]
        a, b, c, d = behind["plates"]["plate"]["quaternion"]
        turn = np.array(
            [w * -a + d * x + y * -c + z * b, w * -b + d * y + z * -a + x * c, w * -c + d * z - x * b + y * a]
        )
        np.testing.assert_allclose([row[column] for row in here["compliance"][3:6]], turn / h, rtol=1e-5, atol=1e-9)
    assert read.rows[:7] == [f"plate.{k}" for k in ("x", "y", "z", "rx", "ry", "rz")] + ["front.shortening"]
    by_tension = [[row[k] for k in range(2)] for row in here["compliance"][6:8]]
    np.testing.assert_allclose(by_tension, np.transpose(by_tension), rtol=1e-3)  # Betti


@pytest.mark.parametrize(
    ("tensions", "sentence"),
    [
        ({"front": 3.01}, "front: 3.01 N is outside the model, which holds from 0 to 3 N"),
        ({"front": -0.1}, "front: -0.1 N is outside"),
        ({"front": float("nan")}, "front: nan N is outside"),
        ({"right": 1.0}, "The model has no cable 'right'; it has front."),
    ],
)
def test_the_evaluator_does_not_extrapolate(tensions, sentence):
    _, read = grid_of(["front"], 3)
    with pytest.raises(ValueError, match=sentence):
        read.state(tensions)


def test_a_reach_in_length_ends_there():
    read = GridModel(tension_grid(ROBOT, {"front": Reach(0.02, "m")}, 6).model)
    assert read.state({"front": read.axes[0][-1]})["shortenings"]["front"] == pytest.approx(0.02, abs=1e-9)
    assert read.axes[0][0] == 0.0


def test_what_makes_no_model_is_refused():
    with pytest.raises(ParameterError, match=r"(?s)no such cable.*too few samples"):
        tension_grid(ROBOT, {"rear": Reach(1.0, "N")}, 1)
    with pytest.raises(ParameterError, match="1 to 3"):
        tension_grid(ROBOT, {}, 3)
    with pytest.raises(ParameterError, match="the reach of a cable must be positive"):
        tension_grid(ROBOT, {"front": Reach(0.0, "N")}, 3)
    with pytest.raises((ParameterError, SimulationError)):
        tension_grid(ROBOT, {"front": Reach(0.5, "m")}, 3)
