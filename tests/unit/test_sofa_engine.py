"""SOFA as an engine against a stand-in whose mechanics are a formula: what it is asked, what is read, how it fails."""

from __future__ import annotations

import importlib
import json
import math
import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, side_cable, tensed
from project_case import write_project
from sofa_case import FAKE, scene_modules, use_fake

from softcal.cli import main
from softcal.errors import InputError, ParameterError
from softcal.plugins.sofa import install as sofa_install
from softcal.plugins.sofa import process
from softcal.plugins.sofa.install import find_sofa
from softcal.plugins.sofa.process import _last_error, run_states
from softcal.plugins.sofa.robot import linear_robot
from softcal.plugins.sofa.scene import scene_parameters, write_scene
from softcal.plugins.sofa.settings import Rest, SofaSettings
from softcal.plugins.sofa.simulator import SofaEngine, sofa_engine
from softcal.processes import exit_code
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol

E_MODULUS, RATIO = 2.6e5, 0.3  # a shear modulus of 1e5 Pa
A, B, PITCH = 100.0, 2000.0, 20.0  # of fake_mechanics/spring.py
QUICK = SofaSettings(time_steps=(0.01, 0.005, 0.002), ramp=0.02, settle=Rest(longest=6.0))


def tension(d, scale=1.0):
    return scale * (A * d + B * d**2)


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> SofaEngine:
    use_fake(monkeypatch)
    return replace(sofa_engine(), settings=QUICK)


def column(**more):
    return column_robot(parameters=elastic(E_MODULUS, RATIO), divisions=(1, 1, 2), **more)


def test_every_sample_of_a_pull(engine):
    d = np.array([0.01, 0.0, 0.02, 0.01])
    response = engine(column(), pulled(*d), snapshots=True)
    assert response.succeeded, response.status
    assert "4 states at rest" in response.status  # the slack one and three that differ
    np.testing.assert_allclose(response.channels["front.tension"], tension(d), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(response.channels["front.shortening"], d)
    np.testing.assert_allclose(response.channels["plate.pitch"], PITCH * d, atol=1e-12)
    # SOFA's frame is the centre of mass, 20 mm above the reference; it goes down by half of the pull.
    np.testing.assert_allclose(response.channels["plate.z"], 0.12 - 0.5 * d - 0.02 * np.cos(PITCH * d), atol=1e-12)
    np.testing.assert_allclose(response.channels["plate.x"], -0.02 * np.sin(PITCH * d), atol=1e-12)
    assert response.units["plate.pitch"] == "rad"
    assert [shape.label for shape in response.snapshots] == ["at rest", "state 1", "state 2", "state 3"]
    last = response.snapshots[-1]
    assert last.efforts["front"] == pytest.approx(tension(0.02))
    np.testing.assert_allclose(last.routes["front"], [[0.05, 0.0, 0.08], [0.05, 0.0, 0.0]], atol=1e-12)
    assert last.points["neck"].shape == response.snapshots[0].points["neck"].shape


def test_tension_goes_to_sofa_as_an_impulse_and_comes_back_as_a_force(engine):
    T = np.array([0.0, 0.5, 1.5])
    for dt in (0.01, 0.005):
        response = replace(engine, settings=replace(QUICK, time_steps=(dt,)))(column(), tensed(*T))
        np.testing.assert_allclose(response.channels["front.tension"], T)
        expected = (-A + np.sqrt(A**2 + 4 * B * T)) / (2 * B)
        np.testing.assert_allclose(response.channels["front.shortening"], expected, atol=1e-12)


def test_many_samples_are_read_between_few_states(engine):
    d = np.linspace(0.0, 0.03, 301)
    response = engine(column(), pulled(*d))
    assert "13 states at rest" in response.status
    assert "cubic spline" in response.status
    np.testing.assert_allclose(response.channels["front.tension"], tension(d), atol=1e-9)
    np.testing.assert_allclose(response.slopes["front.tension"][1:], A + 2 * B * d[1:], rtol=1e-6)
    assert response.slopes["front.tension"][0] == 0.0  # where it is slack
    np.testing.assert_array_equal(response.slopes["front.shortening"], 1.0)


def test_derivatives_are_differences(engine):
    d = np.array([0.005, 0.02])
    names = ["neck.youngs_modulus", "neck.poissons_ratio", "front.shortening"]
    response = engine(column(), pulled(*d), sensitivities=names)
    by = response.sensitivities["front.tension"]
    np.testing.assert_allclose(by["neck.youngs_modulus"], tension(d) / E_MODULUS, rtol=1e-6)
    np.testing.assert_allclose(by["neck.poissons_ratio"], -tension(d) / (1 + RATIO), rtol=6e-3)
    np.testing.assert_allclose(by["front.shortening"], A + 2 * B * d, rtol=1e-2)
    assert response.n_factorisations == 3 * (10 + 2 * 12)  # two derivatives are two more runs; the third is the slope


def test_several_cables_row_by_row(engine):
    robot = column(cables=(side_cable("front", (0.05, 0.0)), side_cable("back", (-0.05, 0.0))))
    protocol = Protocol({"front": Command("tension", [0.5, 1.0]), "back": Command("shortening", [0.001, 0.002])})
    response = engine(robot, protocol, sensitivities=["front.tension", "back.shortening"])
    assert response.succeeded, response.status
    np.testing.assert_allclose(response.channels["front.tension"], [0.5, 1.0])
    np.testing.assert_allclose(response.channels["back.tension"], tension(np.array([0.001, 0.002])))
    by = response.sensitivities["back.tension"]
    np.testing.assert_allclose(by["back.shortening"], A + 2 * B * np.array([0.00105, 0.00205]), rtol=1e-9)
    np.testing.assert_allclose(by["front.tension"], 0.0, atol=1e-12)


def test_nothing_driven_is_one_state(engine):
    response = engine(column(), Protocol({}))
    assert response.succeeded
    np.testing.assert_allclose(response.channels["plate.z"], [0.1])


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        # Rest: 10 steps. Each state: 2 steps of ramp and 10 at rest, of 0.01 s: the second state begins at step 23.
        ("nan@30", r"State 2 of 3: positions or velocities are no numbers.*last good ones are those at 0.29 s"),
        ("crash@30", r"State 2 of 3: SOFA crashed \(SIGSEGV\); the last good time is 0.22 s: \[ERROR\] the LDL"),
        ("restless@30", r"State 2 of 3: it does not come to rest: 0.0173 m/s, and no slower than 2 s ago"),
    ],
)
def test_a_run_that_fails_says_why_and_keeps_what_was_reached(engine, monkeypatch, fault, reason):
    use_fake(monkeypatch, fault=fault)
    once = replace(engine, settings=replace(QUICK, time_steps=(0.01,)))
    response = once(column(), pulled(0.01, 0.02, 0.03))
    assert not response.succeeded
    assert response.status.startswith("SOFA: ")
    assert re.search(reason, response.status), response.status
    assert response.status.count("Then") == 0
    np.testing.assert_allclose(response.channels["front.tension"], [tension(0.01)])


def state(**changed):
    """The third record with these parts in place of its own, or without those of None."""

    def change(lines):
        record = {name: value for name, value in {**json.loads(lines[2]), **changed}.items() if value is not None}
        return [*lines[:2], json.dumps(record), *lines[3:]]

    return change


def posed(*at):
    return state(plates={"plate": list(at)})


def cabled(**cable):
    return state(cables={"front": {"tension": 2.8, "shortening": 0.02, "points": [[0, 0, 0], [0, 0, 1]], **cable}})


@pytest.mark.parametrize(
    "change",
    [
        *(state(**{name: None}) for name in ("plates", "cables", "markers", "dt", "time", "steps")),
        *(
            posed(*at)
            for at in ([0] * 6, [0] * 7, [0] * 8, [0, 0, 0, 0, 0, 0, 2], [0, 0, 1e200, 0, 0, 0, 1], [None] * 7)
        ),
        *(cabled(tension=value) for value in (None, "2.8", True, [2.8], 1e308, math.inf, 10**400)),
        cabled(points=[[0, 0]]),
        *(state(plates=value) for value in ([], 5, {"other": [0] * 7})),
        *(state(steps=value) for value in ("12", -12)),
        *(state(time=value) for value in (-1.0, 0.0)),
        *(state(dt=value) for value in (0.0, -0.01)),
        lambda lines: [*lines[:2], "[" * 100_000, *lines[2:]],
        lambda lines: [*lines[:2], "\0", *lines[2:]],
        lambda lines: [*lines[:2], '{"done": true, "steps": "x"}'],
        lambda lines: [*lines[:2], "5", *lines[2:]],
        lambda lines: [*lines[:2], lines[2].replace('"tension": 2.8', '"tension": NaN'), *lines[3:]],
        lambda lines: [*lines[:2], *lines[3:]],
        lambda lines: [*lines[:2], lines[1], *lines[2:]],
        lambda lines: [*lines[:2], lines[3], lines[2], *lines[4:]],
        lambda lines: [*lines[:2], lines[2][:100], *lines[3:]],
        lambda lines: [*lines[:2], lines[-1]],
    ],
    ids=[
        *(f"no {name}" for name in ("plates", "cables", "markers", "dt", "time", "steps")),
        *(f"a pose of {what}" for what in ("6", "zeros", "8", "a long quaternion", "a planet", "null")),
        *(f"a tension of {what}" for what in ("null", "text", "true", "a list", "a star", "infinity", "400 digits")),
        "a point in a plane",
        *(f"plates of {what}" for what in ("a list", "a number", "another name")),
        *("steps as text", "steps below zero", "a time below zero", "a time that goes back", "no step", "a step back"),
        *("brackets", "NUL", "an end with a word"),
        "a number",
        "NaN",
        "a state is missing",
        "a state twice",
        "states in another order",
        "cut off",
        "the end too early",
    ],
)
def test_an_answer_that_is_not_whole_counts_up_to_there(engine, monkeypatch, change):
    def altered(command, folder, log, **options):
        code = exit_code(command, folder, log, **options)
        answer = folder / process.ANSWER
        answer.write_text("\n".join(change(answer.read_text().splitlines())))
        return code

    monkeypatch.setattr(process, "exit_code", altered)
    response = engine(column(), pulled(0.01, 0.02, 0.03))
    assert not response.succeeded
    assert response.status.startswith("SOFA: State 2 of 3: SOFA ended with exit code 0")
    np.testing.assert_allclose(response.channels["front.tension"], [tension(0.01)])


def test_shapes_of_other_bodies_are_none(engine, monkeypatch):
    def altered(command, folder, log, **options):
        code = exit_code(command, folder, log, **options)
        answer = folder / process.ANSWER
        answer.write_text("\n".join(state(points={"neck": [[0, 0, 0]]})(answer.read_text().splitlines())))
        return code

    monkeypatch.setattr(process, "exit_code", altered)
    assert not engine(column(), pulled(0.01, 0.02), snapshots=True).succeeded


def test_a_crash_is_not_tried_again_and_a_restless_run_is(engine, monkeypatch):
    use_fake(monkeypatch, fault="long-steps@1")
    response = engine(column(), pulled(0.01))
    assert response.succeeded, response.status
    assert "the shortest of 0.005 s" in response.status
    use_fake(monkeypatch, fault="restless@1")
    response = engine(column(), pulled(0.01))
    assert response.status.count("does not come to rest") == 3
    assert response.status.count("The rest state with slack cables") == 1
    assert [f"(time step {dt:g} s)" in response.status for dt in QUICK.time_steps] == [True] * 3
    assert len(response.channels["front.tension"]) == 0
    use_fake(monkeypatch, fault="crash@1")
    assert engine(column(), pulled(0.01)).status.count("SIGSEGV") == 1


REST, EASY, SHORTER = 10, 2 + 10, 4 + 20  # steps: to rest, and of a state with 0.01 s and with 0.005 s
NAN, DANCE = 1, 2 + 400  # in which a state with 0.01 s is given up


def resting_steps(robot, protocol, states):
    """What SOFA answers for states, one by one."""
    outcome = run_states(find_sofa(), linear_robot(robot), protocol, states, replace(QUICK, timeout=60.0))
    return outcome, [(record["steps"], record["dt"]) for record in outcome.records]


@pytest.mark.parametrize(("fault", "given_up"), [("far-nan@0.025", NAN), ("far-dance@0.025", DANCE)])
def test_a_state_that_does_not_settle_is_begun_again_from_the_one_before(engine, monkeypatch, fault, given_up):
    use_fake(monkeypatch, fault=fault)
    d = np.array([0.01, 0.02, 0.03, 0.04])
    outcome, steps = resting_steps(column(), pulled(*d), [{"front": x} for x in d])
    # Half of the way to 30 mm is where the ramp's first step of two ends; the states before stay as they are.
    first, last = outcome.records[3]["steps"] - SHORTER, outcome.records[4]
    assert steps[:3] == [(REST, 0.01), (EASY, 0.01), (EASY, 0.01)]
    assert first in (given_up, given_up + 1)
    assert (last["steps"], last["dt"]) == (SHORTER, 0.005)  # not tried with 0.01 s
    assert outcome.steps == REST + 2 * EASY + first + 2 * SHORTER
    # The time that was given up is not counted.
    assert last["time"] == pytest.approx(0.01 * (REST + 2 * EASY) + 0.005 * 2 * SHORTER)
    response = engine(column(), pulled(*d))
    assert response.succeeded, response.status
    assert f"{outcome.steps} steps, the shortest of 0.005 s" in response.status
    np.testing.assert_allclose(response.channels["front.tension"], tension(d), rtol=1e-9)


def test_a_longer_step_comes_back_where_it_served(engine, monkeypatch):
    """A state begins with the step of the one that was pulled most alike."""
    use_fake(monkeypatch, fault="far-nan@0.025")
    robot = column(cables=[side_cable("front", (0.05, 0.0)), side_cable("back", (-0.05, 0.0))])
    d = [0.01, 0.03, 0.029, 0.011, 0.03]
    protocol = Protocol({"front": Command("shortening", d), "back": Command("tension", [0.1] * len(d))})
    outcome, steps = resting_steps(robot, protocol, [{"front": x, "back": 0.1} for x in d])
    assert not outcome.failure
    assert [dt for _, dt in steps] == [0.01, 0.01, 0.005, 0.005, 0.01, 0.005]
    assert [n for n, _ in steps[3:]] == [SHORTER, EASY, SHORTER]  # none was given up


def test_before_a_state_is_given_up_longer_steps_are_tried_too(engine, tmp_path):
    linear = linear_robot(column())
    write_scene(linear, scene_parameters(linear, pulled(0.01), settings=QUICK), tmp_path)
    tried = []
    with scene_modules(tmp_path) as modules:
        module = importlib.import_module("run")
        parameters = modules.scene.read_parameters()
        run = module.SofaRun(parameters, parameters["rest"])

        def approach(goal):
            tried.append(run.scene.dt)
            if (run.scene.dt < 0.01) == (goal["front"] == 0.02):
                raise module.Lost("it dances")

        run.approach = approach
        run.reach({"front": 0.01})
        run.reach({"front": 0.02})
    assert tried == [0.01, 0.005, 0.005, 0.002, 0.01]


def test_where_no_step_serves_all_reasons_are_told(engine, monkeypatch):
    use_fake(monkeypatch, fault="far-nan@0.015")
    twice = replace(engine, settings=replace(QUICK, time_steps=(0.01, 0.008)))
    status = twice(column(), pulled(0.01, 0.02, 0.03)).status
    assert re.fullmatch(
        r"SOFA: State 2 of 3: positions or velocities are no numbers any more; the last good ones are those at 0\.23 s "
        r"\(time step 0\.01 s\)\. Then positions .* at 0\.228 s \(time step 0\.008 s\)\.",
        status,
    ), status


@pytest.mark.slow
def test_a_hang_is_ended(engine, monkeypatch):
    use_fake(monkeypatch, fault="hang@12")
    response = replace(engine, settings=replace(QUICK, timeout=3.0))(column(), pulled(0.01))
    assert not response.succeeded
    assert response.status.endswith("was ended after 3 s without an answer; the last good time is 0.1 s.")


def test_only_a_reported_error_is_given_as_a_cause():
    said = ["[INFO] scene loaded", "[ERROR] [LDL] the matrix is singular", "[INFO] 12 steps"]
    assert _last_error(said) == "[ERROR] [LDL] the matrix is singular"
    assert _last_error(["[INFO] scene loaded", "[INFO] 12 steps"]) == ""
    assert _last_error([]) == ""


def test_failed_derivative_is_a_failure(engine, monkeypatch):
    ran = []
    from softcal.plugins.sofa import simulator as module

    real = module.run_states

    def once(*given, **more):
        if ran:
            monkeypatch.setenv("FAKE_SOFA_FAULT", "nan@5")
        ran.append(1)
        return real(*given, **more)

    monkeypatch.setattr(module, "run_states", once)
    response = engine(column(), pulled(0.01), sensitivities=["neck.youngs_modulus"])
    assert not response.succeeded
    assert "No derivative by neck.youngs_modulus" in response.status


def test_engine_goes_to_workers(engine):
    assert pickle.loads(pickle.dumps(engine)) == engine


def test_what_sofa_cannot_have_is_refused(engine):
    with pytest.raises(ParameterError, match=r"element: P1"):
        engine(column_robot("P2P1"), pulled(0.01))
    with pytest.raises(ParameterError, match="no such cable"):
        engine(column(), pulled(0.01, cable="back"))
    with pytest.raises(ParameterError, match=r"Try: 'neck\.youngs_modulus'"):
        engine(column(), pulled(0.01), sensitivities=["neck.youngs"])


def test_parameters_reach_the_scene(engine):
    d = np.array([0.01])
    stiffer = engine(with_parameters(column(), {"neck.youngs_modulus": 3 * E_MODULUS}), pulled(*d))
    np.testing.assert_allclose(stiffer.channels["front.tension"], tension(d, 3.0))


# Where SOFA is, and what is told where it is not.


@pytest.fixture
def fresh():
    sofa_install._require_cables.cache_clear()
    yield
    sofa_install._require_cables.cache_clear()


def told(capsys, tmp_path, *arguments) -> tuple[int, str]:
    project = tmp_path / "project"
    if not project.exists():
        write_project(project)
    with pytest.raises(SystemExit) as left:
        main([arguments[0], str(project / "project.yaml"), *arguments[1:], "--engine", "sofa"])
    return int(left.value.code or 0), capsys.readouterr().err


@pytest.mark.parametrize("command", [("simulate", "--pull", "front=10mm"), ("calibrate",)])
def test_missing_sofa_is_one_message_with_the_way_to_get_it(monkeypatch, capsys, tmp_path, command):
    monkeypatch.delenv("SOFA_ROOT", raising=False)
    code, err = told(capsys, tmp_path, *command, "--out", str(tmp_path / "out"))
    assert code == 2
    assert err.count("\n") == 1
    assert "conda install -c sofa-framework sofa-softrobots" in err
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_not_sofa(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("SOFA_ROOT", str(tmp_path))
    code, err = told(capsys, tmp_path, "simulate", "--pull", "front=10mm", "--out", str(tmp_path / "out"))
    assert code == 2
    assert "this is not an installation of SOFA" in err
    monkeypatch.setenv("SOFA_ROOT", str(tmp_path / "nowhere"))
    assert "this folder does not exist" in told(capsys, tmp_path, "calibrate", "--out", str(tmp_path / "out"))[1]


def test_sofa_without_softrobots(monkeypatch, capsys, tmp_path, fresh):
    use_fake(monkeypatch, fault="no-softrobots")
    code, err = told(capsys, tmp_path, "calibrate", "--out", str(tmp_path / "out"))
    assert code == 2
    assert "no SoftRobots" in err
    assert "conda install" in err
    assert not (tmp_path / "out").exists()


def test_sofa_that_does_not_start(monkeypatch, tmp_path, fresh):
    package = tmp_path / "lib" / "python3" / "site-packages" / "Sofa"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("raise ImportError('libSofa.Core.so: cannot open shared object file')")
    monkeypatch.setenv("SOFA_ROOT", str(tmp_path))
    with pytest.raises(InputError, match=r"does not start.*libSofa\.Core\.so"):
        sofa_engine()


def test_the_python_of_the_bindings_is_found(monkeypatch, tmp_path):
    package = tmp_path / "plugins" / "SofaPython3" / "lib" / "python3" / "site-packages" / "Sofa"
    package.mkdir(parents=True)
    (package / "Core.cpython-399-x86_64-linux-gnu.so").touch()
    with pytest.raises(InputError, match=r"bindings are for Python 3\.99"):
        sofa_install.find_sofa({"SOFA_ROOT": str(tmp_path)})
    with pytest.raises(InputError, match="this Python does not exist"):
        sofa_install.find_sofa({"SOFA_ROOT": str(tmp_path), "SOFA_PYTHON": "/nowhere/python"})
    beside = tmp_path / "bin" / "python3"
    beside.parent.mkdir()
    beside.touch()
    assert sofa_install._python(tmp_path, [package.parent], "") == str(beside)


def test_a_relative_root_is_found_from_anywhere(monkeypatch, fresh):
    use_fake(monkeypatch)
    monkeypatch.chdir(FAKE.parent)
    monkeypatch.setenv("SOFA_ROOT", FAKE.name)
    assert Path(sofa_engine().sofa.root) == FAKE


def test_unknown_engine_and_time(monkeypatch, capsys, tmp_path):
    write_project(tmp_path / "project")
    path = str(tmp_path / "project" / "project.yaml")
    for more, text in (
        (["--engine", "ansys"], "allowed: softcal, sofa"),
        (["--engine", "sofa", "--in-time"], "states at rest only"),
    ):
        with pytest.raises(SystemExit) as left:
            main(["simulate", path, "--pull", "front=10mm", "--out", str(tmp_path / "out"), *more])
        assert left.value.code == 2
        assert text in capsys.readouterr().err
