"""The cable-space model: the twin's own at the nodes, within the stated error between, and read without any package."""

from __future__ import annotations

import ast
import itertools
import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, side_cable
from project_case import write_project
from typer.testing import CliRunner

from softcal.cli import app
from softcal.errors import ParameterError, SimulationError
from softcal.export import reduced_model
from softcal.export.reduced import Reach, _quaternions, measured_error, reduced, write_reduced
from softcal.export.reduced_model import ReducedModel
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


def folder_of(tmp_path, names, samples, most=3.0):
    reaches = {name: Reach(most, "N") for name in names}
    model = reduced(ROBOT, reaches, samples)
    write_reduced(model, tmp_path)
    return model, ReducedModel(tmp_path / "model.json")


@pytest.mark.parametrize(("names", "samples"), [(["front"], 4), (["front", "left"], 4), (["front", "left", "back"], 3)])
def test_it_is_the_twin_at_nodes_and_near_it_between(tmp_path, names, samples):
    model, read = folder_of(tmp_path, names, samples)
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
def test_it_says_which_of_the_other_cables_are_held(tmp_path, line, told):
    front, left, back = ROBOT.cables
    robot = replace(ROBOT, cables=(front, replace(left, line=line), back))
    write_reduced(reduced(robot, {"front": Reach(1.0, "N")}, 2), tmp_path)
    text = (tmp_path / "README.txt").read_text()
    assert ("At zero shortening, with their pretension: left." in text) == told
    assert "All other cables are slack. Statics only" in text


def test_the_channels_are_the_twins(tmp_path):
    _, read = folder_of(tmp_path, ["front", "left"], 5)
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


def test_the_compliance_is_the_derivative_of_the_poses(tmp_path):
    _, read = folder_of(tmp_path, ["front", "left"], 4)
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


def test_quaternions_are_of_the_twins_angles():
    angles = np.array([[[0.4, 1.0]], [[-0.3, 0.5]], [[0.7, -0.2]]])
    q = _quaternions(*angles)[0]
    (p, r, y), h = angles[:, 0, 0], 1e-6

    def rotation(p, r, y):
        Ry = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
        Rx = np.array([[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]])
        Rz = np.array([[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]])
        return Ry @ Rx @ Rz

    a, b, c, w = q[0]
    cross = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    np.testing.assert_allclose(np.eye(3) + 2 * w * cross + 2 * cross @ cross, rotation(p, r, y), atol=1e-14)
    moved = _quaternions(*(angles + np.array([[[h, 0.0]], [[0.5 * h, 0.0]], [[-0.2 * h, 0.0]]])))[0]
    np.testing.assert_allclose((moved[0] - q[0]) / h, q[1], atol=1e-5)


def test_the_evaluator_needs_no_package(tmp_path):
    model, read = folder_of(tmp_path, ["front", "left"], 3)
    command = [sys.executable, "-S", "-I", str(tmp_path / "reduced_model.py"), "front=1.25", "left=0.5"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd="/")
    assert json.loads(done.stdout) == read.state({"front": 1.25, "left": 0.5})
    stated = model.error["plate.position"].largest
    assert f"plate.position: at most {stated:.2g} m" in (tmp_path / "README.txt").read_text()


def test_the_evaluator_is_fifty_lines_that_old_pythons_read():
    text = Path(reduced_model.__file__).read_text()
    assert len(text.splitlines()) <= 50
    ast.parse(text, feature_version=(3, 8))


@pytest.mark.parametrize(
    ("tensions", "sentence"),
    [
        ({"front": 3.01}, "front: 3.01 N is outside the model, which holds from 0 to 3 N"),
        ({"front": -0.1}, "front: -0.1 N is outside"),
        ({"front": float("nan")}, "front: nan N is outside"),
        ({"right": 1.0}, "The model has no cable 'right'; it has front."),
    ],
)
def test_the_evaluator_does_not_extrapolate(tmp_path, tensions, sentence):
    _, read = folder_of(tmp_path, ["front"], 3)
    with pytest.raises(ValueError, match=sentence):
        read.state(tensions)


def test_a_reach_in_length_ends_there(tmp_path):
    model = reduced(ROBOT, {"front": Reach(0.02, "m")}, 6)
    write_reduced(model, tmp_path)
    read = ReducedModel(tmp_path / "model.json")
    assert read.state({"front": read.axes[0][-1]})["shortenings"]["front"] == pytest.approx(0.02, abs=1e-9)
    assert read.axes[0][0] == 0.0


def test_what_makes_no_model_is_refused():
    with pytest.raises(ParameterError, match=r"(?s)no such cable.*too few samples"):
        reduced(ROBOT, {"rear": Reach(1.0, "N")}, 1)
    with pytest.raises(ParameterError, match="1 to 3"):
        reduced(ROBOT, {}, 3)
    with pytest.raises(ParameterError, match="the reach of a cable must be positive"):
        reduced(ROBOT, {"front": Reach(0.0, "N")}, 3)
    with pytest.raises((ParameterError, SimulationError)):
        reduced(ROBOT, {"front": Reach(0.5, "m")}, 3)


def test_the_command_writes_it(tmp_path):
    project = write_project(tmp_path / "project")
    out = tmp_path / "out"
    arguments = ["export", "reduced", str(project), "--out", str(out), "--reach", "10mm", "--samples", "4"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in out.iterdir()) == ["README.txt", "model.json", "reduced_model.py"]
    assert "plate.rotation: at most" in done.output
    bad = CliRunner().invoke(app, [*arguments[:4], str(tmp_path / "b"), "--reach", "front=8N,10mm"])
    assert bad.exit_code == 2
    assert "the reach is not defined for each cable" in bad.output
