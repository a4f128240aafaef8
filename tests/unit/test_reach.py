"""`softcal reach`: its options and files, what it refuses, and the least squares with inequalities of a step."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from project_case import write_project
from scipy.optimize import minimize

import softcal
from softcal.analysis.reach import _least
from softcal.units import format_quantity
from softcal.workflows.reach import REACH


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_project(tmp_path_factory.mktemp("bar"))


@pytest.mark.parametrize("seed", range(20))
def test_least_squares_with_inequalities_is_the_minimum(seed: int) -> None:
    random = np.random.default_rng(seed)
    m, n = random.integers(1, 6), random.integers(1, 9)
    A, b = random.normal(size=(random.integers(1, 6), m)), random.normal(size=1)
    b = random.normal(size=len(A))
    G, h = random.normal(size=(n, m)), -random.random(n) * random.integers(0, 2)
    x, multipliers = _least(A, b, np.concatenate([G, np.eye(m), -np.eye(m)]), np.concatenate([h, np.full(2 * m, -1.0)]))
    assert (G @ x - h).min() > -1e-9
    assert np.abs(x).max() <= 1.0 + 1e-9
    assert multipliers.min() >= 0.0
    end = minimize(lambda x: float(np.sum((A @ x - b) ** 2)), np.zeros(m), method="SLSQP", bounds=[(-1.0, 1.0)] * m,
                   constraints=[{"type": "ineq", "fun": lambda x: G @ x - h}], options={"ftol": 1e-14})  # fmt: skip
    assert np.sum((A @ x - b) ** 2) <= end.fun + 1e-7


@pytest.mark.slow
def test_the_commands_are_printed_written_and_replayed(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "targets.csv"
    table.write_text("time [s],plate.pitch [deg]\n0,2\n1,4\n2,3\n")
    out, again = tmp_path / "reach", tmp_path / "again"
    options = ("--by", "front=shortening", "--limit", "tension=..50N", "--rate", "front.shortening=100mm/s")
    code, told, _ = run(capsys, "reach", project, "--targets", table, *options, "--out", out)
    assert code == 0
    assert "3 of 3 target(s) reached" in told
    assert told.count("│ reached") == 3
    stored = REACH.read(out)
    assert stored is not None
    assert [step.outcome for step in stored.study.steps] == ["reached"] * 3
    code, _, told = run(capsys, "simulate", project, "--commands", out / "commands.csv", "--out", again)
    assert code == 0, told
    with (again / "response-commands.csv").open() as file:
        pitches = [float(row["plate.pitch [rad]"]) for row in csv.DictReader(file)]
    assert np.degrees(pitches) == pytest.approx([2.0, 4.0, 3.0], abs=0.01)
    with (out / "reached.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["outcome"] for row in rows] == ["reached"] * 3
    code, _, told = run(capsys, "reach", project, "--to", "plate.pitch=3deg", "--out", out)
    assert code == 2
    assert "nothing is overwritten" in told


def test_a_robot_is_set_and_one_target_is_given_in_the_line(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, told, _ = run(capsys, "reach", project, "--to", "plate.pitch=3deg", "--set", "bar.youngs_modulus=4MPa")
    assert code == 0
    stiff = softcal.reach(project, {"plate.pitch": np.radians(3.0)}, theta={"bar.youngs_modulus": 4e6})
    tension = stiff.steps[0].commands["front.tension"]
    assert format_quantity(tension, "N") in told
    soft = softcal.reach(softcal.load(project), {"plate.pitch": np.radians(3.0)})
    assert tension == pytest.approx(2.0 * soft.steps[0].commands["front.tension"], rel=1e-3)
    assert "reached" in soft._repr_html_()


@pytest.mark.slow
def test_a_run_has_its_calibrated_values(project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "calibrate", project, "--out", tmp_path / "run", "--no-report")[0] == 0
    code, told, _ = run(capsys, "reach", tmp_path / "run", "--to", "plate.pitch=3deg")
    assert code == 0
    E = softcal.load_run(tmp_path / "run").headline.parameters["bar.youngs_modulus"].value
    same = softcal.reach(project, {"plate.pitch": np.radians(3.0)}, theta={"bar.youngs_modulus": E})
    assert format_quantity(same.steps[0].commands["front.tension"], "N") in told


FAULTS = {
    "an unknown channel": (["--to", "plate.pich=3deg"], "the robot has no such channel; got 'plate.pich'.*plate.pitch"),
    "a wrong unit": (["--to", "plate.pitch=3mm"], "the unit does not fit; got 'mm'"),
    "no unit": (["--to", "plate.x=3"], "the unit is missing"),
    "out of the world": (["--to", "plate.x=300m"], "the length is out of range"),
    "no number": (["--to", "plate.x=nan"], "this is not a quantity"),
    "no pair": (["--to", "plate.x"], "this is no pair"),
    "a push": (["--to", "front.tension=-3N"], "the tension is out of range"),
    "a length of another unit": (["--to", "front.shortening=3m"], "this is not plausible.*mm read as m"),
    "no target": ([], "given by one of two options"),
    "limits the wrong way round": (
        ["--to", "plate.pitch=3deg", "--limit", "front.tension=5N..1N"],
        "limits.front.tension: the limits contradict each other; got 5 N to 1 N; allowed: the lower one first"),
    "limits against pretension": (
        ["--to", "plate.x=3mm", "--limit", "tension=..1N", "--pretension", "2N"], "the limits contradict each other"),
    "a target beyond its limit": (["--to", "plate.x=3mm", "--limit", "x=..2mm"], "the target is beyond a limit"),
    "limits without an end": (["--to", "plate.x=3mm", "--limit", "x=.."], "these are no limits"),
    "limits of a single end": (["--to", "plate.x=3mm", "--limit", "x=2mm"], "these are no limits"),
    "a rate without times": (["--to", "plate.x=3mm", "--rate", "tension=1N/s"], "a rate needs times"),
    "a rate in another unit": (["--to", "plate.x=3mm", "--rate", "tension=1N"], "the unit does not fit"),
    "a tolerance of zero": (["--to", "plate.x=3mm", "--tolerance", "x=0"], "this must be positive"),
    "another preference": (["--to", "plate.x=3mm", "--prefer", "beauty"], "this is of the wrong kind; got 'beauty'"),
    "another control": (
        ["--to", "plate.x=3mm", "--by", "force"],
        "no actuator is commanded by this quantity; got 'force'",
    ),
    "an unknown cable": (["--to", "plate.x=3mm", "--by", "back=tension"], "back"),
    "an unknown stiffness": (["--to", "plate.q_stiffness=3N/m"], "the robot has no such channel.*plate.x_stiffness"),
    "a stiffness in another unit": (["--to", "plate.x_stiffness=3N"], "the unit does not fit; got 'N'"),
    "a stiffness below zero": (["--to", "plate.x_stiffness=-3N/m"], "a stiffness is positive"),
    "a stiffness beyond its limit": (
        ["--to", "plate.x_stiffness=3N/m", "--limit", "plate.x_stiffness=5N/m.."], "the target is beyond a limit"),
    "no file of obstacles": (["--to", "plate.x=3mm", "--obstacles", "none.yaml"], "none.yaml"),
    "another file of a picture": (["--to", "plate.x=3mm", "--picture", "reached.pdf"], "a name with .png or .svg"),
    "all at once": (["--to", "plate.pich=3deg,plate.x=3N", "--limit", "tension=1"], "3 faults"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_what_cannot_be_is_refused(
    name: str, project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options, told = FAULTS[name]
    code, _, error = run(capsys, "reach", project, *options, "--out", tmp_path / "out")
    assert code == 2, error
    assert "Traceback" not in error

    assert re.search(told, error, re.DOTALL), error
    assert not (tmp_path / "out").exists()


AROUND = """\
obstacles:
  beam: {sphere: {centre: [0 mm, 0 mm, 50 mm], radius: 8 mm}}
  table: {half_space: {point: [0 mm, 0 mm, -10 mm], normal: [0, 0, 1]}}
"""


def test_a_robot_inside_an_obstacle_and_faults_of_its_file_are_refused(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "around.yaml"
    for text, told in (
        (AROUND, r"obstacles\.beam: the obstacle is inside the robot at rest; got bar"),
        (AROUND.replace("8 mm", "12 mm"), r"obstacles\.beam: the robot at rest is inside the obstacle; got bar by"),
        (AROUND.replace("8 mm", "8 N"), r"around\.yaml:2: obstacles\.beam\.sphere\.radius: the unit does not fit"),
        (AROUND.replace("8 mm", ".nan mm"), "this is not a quantity"),
        (AROUND.replace("sphere", "cone"), "unknown key"),
    ):
        path.write_text(text)
        code, _, error = run(capsys, "reach", project, "--to", "plate.pitch=3deg", "--obstacles", path)
        assert (code, bool(re.search(told, error))) == (2, True), error
        assert "obstacles.table" not in error


@pytest.mark.slow
def test_obstacles_are_kept_and_the_state_is_drawn(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    free = softcal.reach(project, {"plate.pitch": np.radians(3.0)}).steps[0]
    state = softcal.LiveTwin(softcal.load(project), "tension").at({"front": free.commands["front.tension"]})
    top = state.shape.points["bar"]
    k = int(np.argmax(top[:, 0]))
    plane = softcal.HalfSpace((top[k, 0] - 2e-4, 0.0, 0.0), (-1.0, 0.0, 0.0))
    assert state.clearances({"wall": plane}).values.min() == pytest.approx(-2e-4, abs=1e-8)
    path = tmp_path / "around.yaml"
    path.write_text(
        "obstacles:\n"
        f"  wall: {{half_space: {{point: [{1e3 * top[k, 0] - 0.2:.9f} mm, 0 mm, 0 mm], normal: [-1, 0, 0]}}}}\n"
        "  far: {box: {lower: [-1 m, -1 m, -2 m], upper: [1 m, 1 m, -1 m]}}\n"
    )
    options = ("--to", "plate.pitch=3deg", "--obstacles", path, "--out", tmp_path / "out")
    code, told, error = run(capsys, "reach", project, *options, "--picture", tmp_path / "reached.svg")
    assert code == 0, error
    assert re.search(r"Least clearance: -?\S+ mm from wall, 1000 mm from far\.", told), told
    assert "bar touches wall" in told
    assert "reached.svg" in told
    assert (tmp_path / "reached.svg").read_text().startswith("<?xml")
    stored = REACH.read(tmp_path / "out")
    assert stored is not None
    (step,) = stored.study.steps
    assert step.outcome == "nearest"
    assert abs(step.clearances["wall"]) < 1e-6
    assert step.clearances["far"] == pytest.approx(1.0, abs=0.01)
    code, _, error = run(capsys, "reach", project, "--to", "plate.pitch=3deg", "--picture", tmp_path / "reached.svg")
    assert (code, "nothing is overwritten" in error) == (2, True), error
    code, told, _ = run(capsys, "reach", project, "--to", "plate.pitch=3deg")
    assert code == 0
    assert "clearance" not in told
    assert "Wrote" not in told


def test_a_stiffness_is_wanted_in_the_line_and_printed(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    live = softcal.LiveTwin(softcal.load(project), "tension")
    (name,) = (one for one in live.stiffness_units if one == "front.shortening_stiffness")
    wanted = live.at({"front": 2.0}).stiffnesses(name)[name]
    code, told, error = run(capsys, "reach", project, "--to", f"{name}={wanted:.6f}N/m", "--limit", "tension=..10N")
    assert code == 0, error
    assert "1 of 1 target(s) reached" in told
    assert name in told


TABLES = {
    "an unknown column": ("plate.q [mm]\n1\n", "there is no such channel; got 'plate.q'"),
    "a unit of another kind": ("plate.x [N]\n1\n", "the unit does not fit"),
    "no unit": ("plate.x\n1\n", "the unit is missing"),
    "an empty cell": ("plate.x [mm],plate.y [mm]\n1,2\n,3\n", "a value is missing"),
    "text": ("plate.x [mm]\nfar\n", "are not numbers"),
    "time that goes back": ("time [s],plate.x [mm]\n1,1\n0,2\n", "time runs backwards"),
    "only times": ("time [s]\n1\n2\n", "there is no target"),
    "nothing": ("", "the file is empty"),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_that_is_none_is_refused(
    name: str, project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, told = TABLES[name]
    (tmp_path / "t.csv").write_text(text)
    code, _, error = run(capsys, "reach", project, "--targets", tmp_path / "t.csv", "--out", tmp_path / "out")
    assert (code, told in error) == (2, True), error
    assert not (tmp_path / "out").exists()


def test_a_table_of_commands_has_one_for_each_cable(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "c.csv"
    for text, told in (
        ("front.tension [N],front.shortening [mm]\n1,2\n", "the cable has two commands"),
        ("time [s]\n1\n", "there is no command"),
        ("plate.x [mm]\n1\n", "there is no such channel"),
    ):
        table.write_text(text)
        code, _, error = run(capsys, "simulate", project, "--commands", table, "--out", tmp_path / "out")
        assert (code, told in error) == (2, True), error
    code, _, error = run(
        capsys, "simulate", project, "--commands", table, "--pull", "front=1N", "--out", tmp_path / "o"
    )
    assert (code, "exclude each other" in error) == (2, True)


def test_two_targets_may_have_one_time(project: Path) -> None:
    """Without rates they are one after the other; with one, the second cannot move."""
    wanted = {"plate.pitch": np.radians([2.0, 3.0])}
    steps = softcal.reach(project, wanted, times=[0.0, 0.0]).steps
    assert [step.outcome for step in steps] == ["reached", "reached"]
    held = softcal.reach(project, wanted, times=[0.0, 0.0], rates={"tension": 1.0}).steps[1]
    assert held.outcome == "nearest"
    assert held.commands == pytest.approx(steps[0].commands)


def test_python_refuses_what_the_command_line_does(project: Path) -> None:
    robot = softcal.load(project).robot
    for targets, options, told in (
        ({"plate.x": float("nan")}, {}, "this is not finite"),
        ({"plate.x": [0.001, 0.002], "plate.y": [0.0]}, {}, "different numbers of values"),
        ({"plate.x": []}, {}, "there is no target"),
        ({}, {}, "there is no target"),
        ({"plate.x": [0.0, 0.001]}, {"times": [1.0, 0.0]}, "do not ascend"),
        ({"plate.x": [0.0, 0.001]}, {"times": [1.0]}, "1 times"),
        ({"plate.x": 0.001}, {"weights": {"x": -1.0}}, "this must be positive"),
        ({"plate.x": 0.001}, {"limits": {"front.tension": (0.0, float("nan"))}}, "not a number|limits"),
        ({"plate.x": 0.001}, {"limits": {"tension": (float("inf"), float("inf"))}}, "the limits contradict each other"),
        ({"plate.x": 0.001}, {"controls": {}}, "controls: no actuator is commanded; got none; allowed: .*front"),
        ({"plate.x": 0.001}, {"out": "somewhere"}, "a folder needs a project, not a robot alone"),
        ({"plate.x": 0.001}, {"controls": {"nothing": "tension"}}, "nothing"),
    ):
        with pytest.raises(softcal.InputError, match=told):
            softcal.reach(robot, targets, **options)
    assert not Path("somewhere").exists()


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibrated")
    options = ("starts: 1}", "starts: 1, loss: likelihood, mesh_error: false}")
    softcal.calibrate(write_project(folder, options), out=folder / "run")
    return folder / "run"


@pytest.mark.slow
def test_the_bands_are_what_the_ends_of_the_interval_of_the_modulus_give(
    calibrated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = "bar.youngs_modulus"
    found = softcal.load_run(calibrated).headline.parameters[name]
    assert found.interval is not None
    target = np.radians(4.0)
    (step,) = softcal.reach(calibrated, {"plate.pitch": target}).steps
    pitches, tensions = [], []
    for E in found.interval:
        at_commands = {"front": softcal.Command("tension", np.array([step.commands["front.tension"]]))}
        seen = softcal.simulate(softcal.load_calibrated(calibrated), softcal.Protocol(at_commands), {name: E})
        pitches.append(float(seen.channels["plate.pitch"][-1]))
        (again,) = softcal.reach(calibrated, {"plate.pitch": target}, theta={name: E}).steps
        assert not again.bands
        tensions.append(again.commands["front.tension"])
    assert 2.0 * step.bands["plate.pitch"] == pytest.approx(abs(pitches[1] - pitches[0]), rel=0.05)
    assert 2.0 * step.command_bands["front.tension"] == pytest.approx(tensions[1] - tensions[0], rel=0.05)
    code, told, _ = run(capsys, "reach", calibrated, "--to", "plate.pitch=4deg")
    assert code == 0
    band, command = (
        format_quantity(value, unit, digits=2)
        for value, unit in ((step.bands["plate.pitch"], "rad"), (step.command_bands["front.tension"], "N"))
    )
    assert f"at these commands plate.pitch ± {band}; of commands that reach it front.tension ± {command}." in told


def test_a_pose_by_shortening_has_nearly_no_band_and_a_project_none(
    calibrated: Path, project: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (by_tension,) = softcal.reach(calibrated, {"plate.pitch": 0.07}).steps
    (by_shortening,) = softcal.reach(calibrated, {"plate.pitch": 0.07}, controls="shortening").steps
    assert by_shortening.bands["plate.pitch"] < 1e-3 * by_tension.bands["plate.pitch"]
    _, told, _ = run(capsys, "reach", project, "--to", "plate.pitch=4deg")
    assert "What the calibration leaves open" not in told
    assert "There are no bands" not in told


def test_one_cable_cannot_keep_two_angles_so_that_its_command_has_no_band(calibrated: Path) -> None:
    (step,) = softcal.reach(calibrated, {"plate.pitch": 0.07, "plate.x": 0.0}).steps
    assert step.outcome == "nearest"
    assert step.bands.keys() == {"plate.pitch", "plate.x"}
    assert not step.command_bands
