"""The exported scene, run to rest as the engine runs it, ends where SOFA and softcal do.

Without SOFA the scene runs in a stand-in that reads the robot back from the recorded components and steps it by SOFA's
scheme (tests/fake_sofa). Where SOFA_ROOT is set, the last tests run SOFA itself.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, shared_json, tensed
from project_case import write_project
from sofa_case import (
    assert_neck_as_measured,
    assert_tip_as_measured,
    beam_robot,
    many_parts,
    neck_robot,
    scene_modules,
    use_fake,
)

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import make_problem
from softcal.calibration.run import calibrate
from softcal.experiments.dataset import Channel, Dataset
from softcal.geometry.centreline import straight
from softcal.geometry.section import RoundBar
from softcal.plugins.sofa.install import find_sofa
from softcal.plugins.sofa.robot import linear_robot
from softcal.plugins.sofa.scene import scene_parameters, write_scene
from softcal.plugins.sofa.simulator import SofaEngine, sofa_engine
from softcal.plugins.sofa.writing import write_sofa
from softcal.project.project import load
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Cable, Plate, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import calibrate as calibrate_project

needs_sofa = pytest.mark.skipif("SOFA_ROOT" not in os.environ, reason="SOFA is not installed: SOFA_ROOT is not set")


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> SofaEngine:
    use_fake(monkeypatch, mechanics="twin")
    return sofa_engine()


def assert_beam_as_measured(engine, data):
    robot = beam_robot(data)
    T = [row["tension_N"] for row in data["static"]]
    response = engine(robot, tensed(*T, cable="tendon"), snapshots=True)
    assert response.succeeded, response.status
    for row, shape in zip(data["static"], response.snapshots[1:], strict=True):
        assert_tip_as_measured(robot, shape, row)
    shortening = [row["shortening_m"] for row in data["static"]]
    np.testing.assert_allclose(response.channels["tendon.shortening"], shortening, rtol=1e-4)


def assert_many_parts_rest_alike(engine, tolerance):
    """In every channel, of 0.1 m or of 1 rad or N; the responses of the engine and of softcal."""
    robot = many_parts()
    protocol = Protocol({"through": Command("tension", [0.4, 0.8]), "between": Command("shortening", [0.001, 0.002])})
    theirs, ours = engine(robot, protocol, snapshots=True), simulate(robot, protocol)
    assert theirs.succeeded, theirs.status
    assert ours.succeeded, ours.status
    for channel, values in ours.channels.items():
        scale = 0.1 if ours.units[channel] == "m" else 1.0
        np.testing.assert_allclose(theirs.channels[channel], values, rtol=0, atol=tolerance * scale, err_msg=channel)
    return theirs, ours


@pytest.mark.slow
def test_neck_by_shortening(engine):
    data = shared_json("neck-shortening.json")
    rows = data["rows"]
    assert_neck_as_measured(engine(neck_robot(data), pulled(*[row["shortening_m"] for row in rows])), rows)


@pytest.mark.slow
def test_a_state_begun_again_ends_where_it_would_have(engine, monkeypatch):
    """After numbers that are none, from the positions at rest before: plates, ties and cables follow."""
    robot, d = many_parts(), [0.001, 0.002, 0.003]
    protocol = Protocol({"between": Command("shortening", d), "through": Command("tension", [0.4, 0.8, 1.0])})
    settings = replace(engine.settings, time_steps=(0.02, 0.006), settle=replace(engine.settings.settle, speed=1e-8))
    engine = replace(engine, settings=settings)
    expected = engine(robot, protocol)
    monkeypatch.setenv("FAKE_SOFA_FAULT", "far-nan@0.0025")
    found = engine(robot, protocol)
    assert "the shortest of 0.006 s" in found.status
    assert "the shortest of 0.02 s" in expected.status
    for channel, values in expected.channels.items():
        np.testing.assert_allclose(found.channels[channel], values, rtol=0, atol=1e-8, err_msg=channel)


def test_a_scene_goes_back_to_where_everything_was(monkeypatch, tmp_path):
    use_fake(monkeypatch, mechanics="twin")
    linear, protocol = linear_robot(many_parts()), Protocol({"between": Command("shortening", [0.002])})
    write_scene(linear, scene_parameters(linear, protocol), tmp_path)
    with scene_modules(tmp_path) as modules:
        parameters = modules.scene.read_parameters()
        run = importlib.import_module("run").SofaRun(parameters, parameters["rest"])
        for state in ({}, {"between": 0.002}):
            run.reach(state)
        there, time = run.scene.positions(), run.time
        fast = max(run.step({"between": 0.004}) for _ in range(3))
        for dt in (0.05, 0.01):
            run.go_back(dt)
            assert run.time == time
            for path, positions in run.scene.positions().items():
                np.testing.assert_allclose(positions, there[path], rtol=0, atol=1e-12, err_msg=path)
            assert run.step(run.values) < 1e-6  # where it is it stays
    assert fast > 1e-2


@pytest.mark.slow
def test_neck_by_tension(engine):
    """Its last state needs a shorter time step, which the engine finds."""
    data = shared_json("neck-tension.json")
    rows = data["rows"]
    assert_neck_as_measured(engine(neck_robot(data), tensed(*[row["tension_N"] for row in rows])), rows)


@pytest.mark.slow
def test_beam(engine):
    assert_beam_as_measured(engine, shared_json("beam-cable.json"))


@pytest.mark.slow
def test_many_parts_rest_where_softcal_has_them(engine):
    """Ties, plates with mass off their reference, one that stands still, loads, weight, markers, cables over all."""
    theirs, ours = assert_many_parts_rest_alike(engine, 2e-6)
    assert abs(ours.channels["head.x"][-1]) > 1e-3
    assert set(theirs.snapshots[0].plates) == {"foot", "head"}


def test_slack_and_weight(engine):
    """A cable that is taut from some pull on, and slack before."""
    robot = column_robot(
        parameters=elastic(3e5, 0.4), density=1100.0, mass=0.05, gravity=(2.0, 0.0, -9.81), divisions=(2, 2, 5)
    )
    d = np.array([-0.004, 0.0, 0.002, 0.006, 0.012])
    theirs, ours = engine(robot, pulled(*d)), simulate(robot, pulled(*d), curve_tolerance=0.0)
    assert theirs.succeeded, theirs.status
    np.testing.assert_allclose(theirs.channels["front.tension"], ours.channels["front.tension"], atol=1e-5)
    np.testing.assert_allclose(theirs.channels["plate.pitch"], ours.channels["plate.pitch"], atol=1e-5)
    assert (ours.channels["front.tension"] == 0.0).any()
    assert (ours.channels["front.tension"] > 0.0).any()
    np.testing.assert_allclose(theirs.slopes["front.tension"][-2:], ours.slopes["front.tension"][-2:], rtol=0.05)


@pytest.mark.slow
def test_derivatives_are_the_twins(engine):
    robot = column_robot(divisions=(1, 1, 4))
    names = ["neck.youngs_modulus", "neck.poissons_ratio"]
    theirs = engine(robot, pulled(0.01, 0.02), sensitivities=names)
    ours = simulate(robot, pulled(0.01, 0.02), sensitivities=names, curve_tolerance=0.0)
    for name in names:
        exact = ours.sensitivities["front.tension"][name]
        np.testing.assert_allclose(theirs.sensitivities["front.tension"][name], exact, rtol=0.03)


def assert_published_comes_back(engine, robot, seen):
    """Tension and pitch of a body of 2.3 MPa and 0.43, fitted through the engine: the same within 0.5 %."""
    units = {"front.shortening": "m", "front.tension": "N", "plate.pitch": "rad"}
    channels = {name: Channel(np.asarray(seen[name]), unit, 1e-4) for name, unit in units.items()}
    experiment = Experiment("pull", Dataset("pull", channels), drive=("front.shortening",))
    free = [
        FreeParameter("neck.youngs_modulus", "Pa", 2e5, 2e7, "log", start=1.5e6),
        FreeParameter("neck.poissons_ratio", "1", 0.2, 0.48, start=0.35),
    ]
    problem = make_problem(robot, [experiment], free, LikelihoodLoss(), simulate=engine)
    result = calibrate(problem, method="least-squares", starts=1, trials=12)
    assert result.parameters["neck.youngs_modulus"].value == pytest.approx(2.3e6, rel=5e-3)
    assert result.parameters["neck.poissons_ratio"].value == pytest.approx(0.43, rel=5e-3)


def assert_a_column_comes_back(engine):
    robot = column_robot(parameters=elastic(2.3e6, 0.43), divisions=(2, 2, 6))
    truth = simulate(robot, pulled(*np.linspace(0.004, 0.024, 6)), curve_tolerance=0.0)
    assert_published_comes_back(engine, robot, truth.channels)


@pytest.mark.long
def test_what_was_published_comes_back(engine):
    assert_a_column_comes_back(engine)


def test_tpe_of_the_project_through_the_engine(monkeypatch, tmp_path):
    """The papers' pipeline: a few trials, kept as SOFA's, with a failed one among them kept with its reason."""
    use_fake(monkeypatch, mechanics="spring")
    project = load(write_project(tmp_path / "project"))
    found = calibrate_project(project, out=tmp_path / "run", method="tpe", trials=3, engine="sofa")
    result = found.headline
    assert result.method == "tpe"
    assert [trial.state for trial in result.trials] == ["COMPLETE"] * 3
    assert result.hashes["engine"] == "sofa"
    with pytest.raises(Exception, match="engine"):
        calibrate_project(project, out=tmp_path / "run", resume=True, method="tpe", trials=3)
    use_fake(monkeypatch, fault="nan@150")
    with pytest.raises(Exception, match="no numbers any more"):
        calibrate_project(project, out=tmp_path / "failed", method="tpe", trials=1, engine="sofa")


@needs_sofa
def test_sofa_itself_neck():
    data = shared_json("neck-shortening.json")
    rows = data["rows"]
    response = sofa_engine()(neck_robot(data), pulled(*[row["shortening_m"] for row in rows]))
    assert_neck_as_measured(response, rows)


@needs_sofa
def test_sofa_itself_beam():
    assert_beam_as_measured(sofa_engine(), shared_json("beam-cable.json"))


@needs_sofa
def test_sofa_itself_many_parts():
    assert_many_parts_rest_alike(sofa_engine(), 1e-4)


@needs_sofa
@pytest.mark.slow
def test_sofa_itself_gives_what_was_published():
    assert_a_column_comes_back(sofa_engine())


@needs_sofa
@pytest.mark.slow
def test_sofa_itself_gives_the_necks_published_parameters():
    """From SOFA's own measured states."""
    data = shared_json("neck-shortening.json")
    keys = {"front.shortening": "shortening_m", "front.tension": "tension_N", "plate.pitch": "pitch_rad"}
    seen = {name: [row[key] for row in data["rows"]] for name, key in keys.items()}
    assert_published_comes_back(sofa_engine(), neck_robot(data), seen)


def told_by_sofa(script: str, folder: Path) -> list[dict]:
    """What a script prints as lines of JSON, run by SOFA's Python in the folder of a scene."""
    sofa = find_sofa()
    done = subprocess.run(
        [sofa.python, "-c", script], cwd=folder, env=sofa.environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    # SOFA's own messages are on the same stream.
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


@needs_sofa
def test_sofa_itself_pulls_the_scene_by_schedule_and_by_keys(tmp_path):
    """As runSofa has it: createScene, and the controller that hears of every step and key."""
    robot = column_robot(parameters=elastic(2.3e6, 0.43), divisions=(2, 2, 6))
    write_sofa(robot, pulled(0.0, 0.002), tmp_path, "column")
    records = told_by_sofa(STEP_THE_SCENE, tmp_path)
    for record, d in zip(records, (0.002, 0.00204), strict=True):
        told = record["cables"]["front"]
        assert told["shortening"] == pytest.approx(d, rel=1e-6)
        expected = simulate(robot, pulled(d), curve_tolerance=0.0).channels["front.tension"][0]
        assert told["tension"] == pytest.approx(expected, rel=1e-3)


def backbone() -> Robot:
    """A rod with a plate at its end, which a cable bends."""
    rod = Rod(
        "rod", straight((0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 4, first=(0.0, 1.0, 0.0)), RoundBar(4e-3),
        elastic(1e9, 0.4), clamped={"tip": np.array([4])}, fixed=[0],
    )  # fmt: skip
    tip = Plate("tip", {}, np.array([0.0, 0.0, 0.1]), mass=0.01)
    front = Cable("front", (ViaPoint((0.02, 0.0, 0.1), "tip"), ViaPoint((0.02, 0.0, 0.0))))
    return Robot(plates=(tip,), rods=(rod,), cables=(front,))


@needs_sofa
@pytest.mark.parametrize(
    "robot", [column_robot(parameters=elastic(2.3e6, 0.43), divisions=(2, 2, 6)), backbone()], ids=["body", "rod"]
)
def test_sofa_itself_goes_on_from_where_it_settled_as_if_nothing_had_been(tmp_path, robot):
    """After it was lost, and with another time step: the steps that a state takes tell what SOFA still remembers."""
    linear = linear_robot(robot)
    write_scene(linear, scene_parameters(linear, pulled(0.002)), tmp_path)
    plain, back, shorter, after_longer = told_by_sofa(GO_BACK, tmp_path)
    assert back == pytest.approx(plain, rel=1e-12)
    assert after_longer["steps"] == shorter["steps"]
    assert after_longer["tension"] == pytest.approx(shorter["tension"], rel=1e-7)


GO_BACK = """
import contextlib
import json
from run import Lost, SofaRun
from scene import read_parameters

parameters = read_parameters()
rest = parameters["rest"]

def told(run, shortening):
    record = run.reach({"front": shortening})
    print(json.dumps({"steps": record["steps"], "tension": record["cables"]["front"]["tension"]}))

def settled(dt):
    run = SofaRun(parameters, {**rest, "time_steps": [dt]})
    for state in ({}, {"front": 0.004}):
        run.reach(state)
    return run

told(settled(0.05), 0.008)
lost = settled(0.05)
with contextlib.suppress(Lost):
    for _ in range(20):
        lost.step({"front": 0.09})
lost.go_back(0.05)
told(lost, 0.008)
told(settled(0.01), 0.008)
longer = settled(0.05)
longer.rest = {**rest, "time_steps": [0.01]}
told(longer, 0.008)
"""

STEP_THE_SCENE = """
import json
import Sofa, Sofa.Core, Sofa.Simulation
from robot_state import read_state
from scene import createScene, read_parameters

root = Sofa.Core.Node("root")
assert createScene(root) is root
getattr(Sofa.Simulation, "initRoot", Sofa.Simulation.init)(root)
dt = float(root.dt.value)
for key in ("", "+"):
    if key:
        root.pulling.onKeypressedEvent({"key": key})
    for _ in range(round(5.0 / dt)):
        Sofa.Simulation.animate(root, dt)
    print(json.dumps(read_state(root.pulling.parts, read_parameters(), dt)))
"""
