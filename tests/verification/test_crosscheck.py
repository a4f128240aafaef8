"""Engines compared: they agree where they should, a difference is seen and told, and what is absent is named."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, side_cable
from project_case import write_project
from typer.testing import CliRunner

from softcal.cli import app
from softcal.errors import SimulationError
from softcal.export import crosscheck as module
from softcal.export.crosscheck import ENGINES, Engine, Outcome, _fitted_pose, crosscheck, furthest_state
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed; Debian: calculix-ccx"
)
ROBOT = column_robot(
    "P2P1",
    parameters=elastic(1e6, 0.4),
    divisions=(1, 1, 3),
    cables=[side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05))],
)


def softer(factor: float) -> Engine:
    """softcal itself with every modulus off by a factor."""

    def solve(robot: Robot, protocol: Protocol, shape) -> Outcome:
        off = with_parameters(robot, {"neck.youngs_modulus": factor * 1e6})
        return module._of_response(simulate(off, protocol, snapshots=True, curve_tolerance=0.0))

    return Engine(lambda robot: robot, lambda: "", solve)


@needs_ccx
def test_calculix_agrees_with_two_cables():
    commands = {
        "front": Command("shortening", np.array([0.0, 0.006])),
        "left": Command("tension", np.array([0.0, 0.4])),
    }
    found = crosscheck(ROBOT, Protocol(commands), ["softcal", "calculix"])
    (one,) = found.comparisons
    assert one.agrees
    assert one.verdict.startswith("calculix and softcal agree to 0.0001")
    assert one.changed == ("neck: law neo-hooke becomes neo-hooke-isochoric", "neck: element P2P1 becomes P2")
    by_name = {d.quantity: d for d in one.differences}
    assert by_name["front.shortening"].softcal == pytest.approx(0.006)
    assert by_name["left.shortening"].engine == pytest.approx(by_name["left.shortening"].softcal, rel=1e-4)
    assert by_name["plate.rotation"].softcal > 0.05
    assert by_name["neck: largest displacement"].engine > 0.005


def test_an_engine_that_is_itself_agrees_and_one_that_is_not_is_told(monkeypatch):
    monkeypatch.setitem(ENGINES, "same", softer(1.0))
    monkeypatch.setitem(ENGINES, "softer", softer(0.9))
    same, other = crosscheck(ROBOT, pulled(0.0, 0.006), ["same", "softer"]).comparisons
    assert same.agrees
    assert max(d.absolute for d in same.differences) == 0.0
    assert not other.agrees
    assert "softer and softcal differ by" in other.verdict
    assert "in front.tension, 1.0e-01 relative" in other.verdict
    # At a given shortening the modulus changes no shape.
    assert {d.quantity for d in other.differences if d.relative > 1e-6} == {"front.tension"}


def test_an_engine_that_fails_or_is_absent_stops_no_other(monkeypatch):
    def fail(robot, protocol, shape):
        raise SimulationError("it fell over")

    monkeypatch.setitem(ENGINES, "broken", replace(softer(1.0), solve=fail))
    monkeypatch.setitem(ENGINES, "absent", replace(softer(1.0), missing=lambda: "get it at the shop"))
    monkeypatch.setitem(ENGINES, "same", softer(1.0))
    found = crosscheck(ROBOT, pulled(0.0, 0.006), ["broken", "absent", "same"])
    assert found.failed == {"broken": "it fell over"}
    assert found.absent == {"absent": "get it at the shop"}
    assert [one.engine for one in found.comparisons] == ["same"]


def test_what_calculix_cannot_be_given_is_a_reason():
    cable = replace(side_cable("front", (0.05, 0.0)), friction_coefficient=0.1)
    found = crosscheck(replace(ROBOT, cables=(cable,)), pulled(0.0, 0.004), ["calculix"])
    if "calculix" not in found.absent:
        assert "a cable with friction is not written" in found.failed["calculix"]


def test_a_robot_that_nothing_moves_is_no_comparison(monkeypatch):
    monkeypatch.setitem(ENGINES, "same", softer(1.0))
    found = crosscheck(ROBOT, Protocol({}), ["same"])
    assert "nothing moves the robot" in found.failed["same"]


def test_the_furthest_state_is_where_the_cables_are_pulled_most():
    protocol = Protocol(
        {"a": Command("shortening", np.array([0.0, 0.02, 0.01])), "b": Command("tension", np.array([0.0, 4.0, 8.0]))}
    )
    assert {name: command.values.tolist() for name, command in furthest_state(protocol).commands.items()} == {
        "a": [0.02],
        "b": [4.0],
    }
    assert furthest_state(Protocol({})).commands == {}


def test_a_fitted_pose_is_the_motion_that_was_put_in():
    rng = np.random.default_rng(3)
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    R *= np.sign(np.linalg.det(R))
    X = rng.normal(size=(6, 3)) * [1.0, 1.0, 0.0]  # a flat plate
    at, turn = _fitted_pose(X, X @ R.T + [1.0, 2.0, 3.0], np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(turn, R, atol=1e-12)
    np.testing.assert_allclose(at, R @ [0.1, 0.2, 0.3] + [1.0, 2.0, 3.0], atol=1e-12)


@needs_ccx
def test_the_command_prints_a_table_and_a_verdict(tmp_path):
    project = write_project(tmp_path)
    pull = ["--engines", "softcal,calculix", "--pull", "front=3mm"]
    done = CliRunner().invoke(app, ["crosscheck", str(project), *pull])
    assert done.exit_code == 0, done.output
    assert "plate.rotation" in done.output
    assert "pull: calculix and softcal agree to 0.0001" in done.output


def test_an_absent_engine_is_named_with_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("SOFA_ROOT", raising=False)
    done = CliRunner().invoke(app, ["crosscheck", str(write_project(tmp_path)), "--pull", "front=3mm"])
    assert done.exit_code == 1
    assert "apt-get install calculix-ccx" in done.output
    assert "conda install -c sofa-framework sofa-softrobots" in done.output


@pytest.mark.parametrize(
    ("engines", "sentence"),
    [("softcal,calculx", "did you mean 'calculix'?"), ("softcal", "nothing to compare softcal with")],
)
def test_engines_that_make_no_comparison_are_refused(tmp_path, engines, sentence):
    done = CliRunner().invoke(app, ["crosscheck", str(write_project(tmp_path)), "--engines", engines])
    assert done.exit_code == 2
    assert sentence in done.output
