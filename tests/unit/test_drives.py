"""Drives at every door: project files, tables of counts and currents, calibration, commands, reach."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from project_text import changed

from softcal.errors import InputError, ParameterError, ProjectFileError
from softcal.project.project import Project, load
from softcal.twin.actuators.drive import Drive
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import calibrate
from softcal.workflows.cases import commanded, parse_pulls
from softcal.workflows.checking import check
from softcal.workflows.reach import reach
from softcal.workflows.reporting import write_report
from softcal.workflows.simulation import protocol_of
from softcal.workflows.template import write_template

TORQUE_CONSTANT, COUNTS = 0.9, 4096
SERVO = (
    "servo: {actuator: drive, cables: {left: 1, right: -1}, radius: 8 mm, spring_rate: 5 N/mm, pretension: 1 N, "
    "gear_backlash: 4 deg, zero: 1 deg}"
)
ROBOT = f"""\
softcal: 1
name: a rod between two cables
robot:
  plates:
    tip: {{reference: [0 mm, 0 mm, 100 mm]}}
  rods:
    spine:
      straight: {{start: [0 mm, 0 mm, 0 mm], end: [0 mm, 0 mm, 100 mm]}}
      elements: 6
      section: {{diameter: 3 mm}}
      youngs_modulus: 1 GPa
      poissons_ratio: 0.35
      fixed: start
      clamped: {{tip: end}}
  cables:
    left: {{via: [{{at: [10 mm, 0 mm, 0 mm]}}, {{on: tip, at: [10 mm, 0 mm, 100 mm]}}], pulled_end: first}}
    right: {{via: [{{at: [-10 mm, 0 mm, 0 mm]}}, {{on: tip, at: [-10 mm, 0 mm, 100 mm]}}], pulled_end: first}}
  actuators:
    {SERVO}
experiments:
  sweep:
    drive: [servo.angle]
    plate: tip
    files:
      - path: sweep.csv
        columns:
          servo.angle: {{name: encoder, unit: counts, scale: {COUNTS} counts/turn}}
          servo.torque: {{name: current, unit: mA, scale: {TORQUE_CONSTANT} N*m/A}}
          pitch: {{name: "pitch [deg]"}}
          left.tension: {{name: cell, unit: mV, scale: -2 mV/N}}
    noise: {{servo.torque: 0.5 mN*m, pitch: 0.1 deg, left.tension: 0.05 N}}
parameters:
  spine.youngs_modulus: {{bounds: [0.2 GPa, 5 GPa], scale: log}}
  servo.radius: {{bounds: [4 mm, 16 mm]}}
  servo.gear_backlash: {{bounds: [0 deg, 10 deg]}}
  servo.zero: {{bounds: [-10 deg, 10 deg]}}
calibration: {{method: least-squares, starts: 1, loss: likelihood}}
"""
TRUTH = {
    "spine.youngs_modulus": 1.2e9,
    "servo.radius": 8.4e-3,
    "servo.gear_backlash": np.radians(3.0),
    "servo.zero": np.radians(-0.7),
}


def project(folder: Path, *changes: tuple[str, str]) -> Project:
    """Its record made by the twin at the true values, turned to both sides, with noise."""
    path = folder / "project.yaml"
    path.write_text(changed(ROBOT, changes), encoding="utf-8")
    table = folder / "sweep.csv"
    if not table.exists():
        table.write_text("encoder,current,pitch [deg],cell\n0,0,0,0\n1,0,0,0\n", encoding="utf-8")
        (folder / "true.yaml").write_text(ROBOT, encoding="utf-8")
        robot = with_parameters(load(folder / "true.yaml").robot, TRUTH)
        counts = np.round(np.linspace(-600.0, 600.0, 25))
        angles = 2.0 * np.pi * counts / COUNTS
        read = simulate(robot, Protocol({"servo": Command("angle", angles)})).channels
        noise = np.random.default_rng(4).normal(size=(3, len(counts)))
        columns = [
            counts,
            1e3 * (read["servo.torque"] + 5e-4 * noise[0]) / TORQUE_CONSTANT,
            np.degrees(read["tip.pitch"]) + 0.1 * noise[1],
            -2.0 * (read["left.tension"] + 0.05 * noise[2]),
        ]
        rows = (",".join(f"{value:.8g}" for value in row) for row in zip(*columns, strict=True))
        table.write_text("\n".join(["encoder,current,pitch [deg],cell", *rows]) + "\n", encoding="utf-8")
    return load(path)


def test_counts_and_currents_are_read_by_their_constants(tmp_path: Path) -> None:
    read = project(tmp_path).experiments["sweep"].dataset
    assert read.values("servo.angle")[0] == pytest.approx(-600.0 * 2.0 * np.pi / COUNTS)
    robot = with_parameters(project(tmp_path).robot, TRUTH)
    expected = simulate(robot, Protocol({"servo": Command("angle", read.values("servo.angle"))}))
    for name, size in (("servo.torque", 5e-4), ("left.tension", 0.05)):
        assert np.abs(read.values(name) - expected.channels[name]).max() < 4.0 * size


@pytest.mark.slow
def test_modulus_radius_backlash_and_zero_are_found(tmp_path: Path) -> None:
    found = calibrate(project(tmp_path), out=tmp_path / "run")
    (result,) = found.results.values()
    for name, value in TRUTH.items():
        low, high = result.parameters[name].interval
        assert low <= value <= high, name
    assert result.parameters["servo.radius"].value == pytest.approx(TRUTH["servo.radius"], rel=0.01)
    assert result.parameters["spine.youngs_modulus"].value == pytest.approx(TRUTH["spine.youngs_modulus"], rel=0.02)
    report = write_report(tmp_path / "run", figures=["trajectory"])
    drawn = next(path for path in report.figures if path.suffix == ".svg").read_text(encoding="utf-8")
    assert "servo.angle [deg]" in drawn


def test_the_template_has_the_truth_that_it_states(tmp_path: Path) -> None:
    project = load(write_template("servo", tmp_path / "arm"))
    assert not check(project, solve=False).warnings
    truth = {"spine.youngs_modulus": 0.9e9, "servo.gear_backlash": np.radians(3.0), "servo.zero": np.radians(1.5)}
    (experiment,) = project.experiments.values()
    response = simulate(with_parameters(project.robot, truth), protocol_of(project))
    for channel, noise in (("servo.torque", 0.2e-3), ("pitch", np.radians(0.1))):
        twin = response.channels[str(experiment.twin_channel(channel))]
        assert np.std(experiment.dataset.values(channel) - twin) == pytest.approx(noise, rel=0.3)


@pytest.mark.slow
def test_an_encoders_offset_is_free_as_the_zero_is(tmp_path: Path) -> None:
    """A parameter of the bench that changes the command of the one drive."""
    offset = ("  servo.zero: {bounds: [-10 deg, 10 deg]}", "  servo.angle_offset: {bounds: [-10 deg, 10 deg]}")
    (result,) = calibrate(project(tmp_path, offset), out=tmp_path / "run").results.values()
    shift = TRUTH["servo.zero"] - np.radians(1.0)
    assert result.parameters["servo.angle_offset"].value == pytest.approx(shift, abs=np.radians(0.2))


def test_a_check_states_its_cables_and_sizes(tmp_path: Path) -> None:
    told = dict(check(project(tmp_path)).rows)["drive servo"]
    sizes = "radius 8 mm, spring rate 5000 N/m, pretension 1 N, gear backlash 4 deg, zero 1 deg"
    assert told == f"of left and right, {sizes}"


def test_its_commands_have_units(tmp_path: Path) -> None:
    robot = project(tmp_path).robot
    assert parse_pulls(robot, ["servo=30deg"]).commands["servo"].values[-1] == pytest.approx(np.pi / 6.0)
    assert parse_pulls(robot, ["servo=-5 mN*m"]).commands["servo"].values[-1] == pytest.approx(-5e-3)
    with pytest.raises(InputError, match=r"a drive and a torque or angle: servo=1N\*m, servo=1deg"):
        parse_pulls(robot, ["servo=3mm"])
    table = tmp_path / "commands.csv"
    table.write_text("servo.angle [deg]\n0\n20\n-20\n", encoding="utf-8")
    response = simulate(robot, commanded(robot, table))
    assert response.channels["tip.pitch"][1] > 0.1 > -0.1 > response.channels["tip.pitch"][2]


@pytest.mark.parametrize("control", ["angle", "torque"])
def test_a_pose_is_reached(tmp_path: Path, control: str) -> None:
    found = reach(project(tmp_path).robot, {"tip.x": 5e-3}, controls={"servo": control})
    (step,) = found.steps
    assert step.outcome == "reached", step.status
    assert step.channels["tip.x"] == pytest.approx(5e-3, abs=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("{left: 1, right: -1}", "{lefty: 1}", r"there is no such cable; got 'lefty'.*Try: 'left'"),
        ("{left: 1, right: -1}", "{}", "the drive has no cable"),
        ("{left: 1, right: -1}", "{left: 0}", "the scale factor is out of range"),
        ("spring_rate: 5 N/mm, ", "", "without springs a drive has no pretension"),
        ("gear_backlash: 4 deg", "backlash: 4 deg", "unknown key; got 'backlash'"),
        (
            SERVO,
            f"{SERVO}\n    other: {{actuator: drive, cables: {{left: 1}}, radius: 1 mm}}",
            "two actuators drive one",
        ),
        ("4096 counts/turn", "4096 counts/mm", "the constant does not convert the column's unit to its channel's"),
        ("4096 counts/turn", "4096 cats/turn", "a plain number, %, or the constant of a sensor"),
        ("unit: counts, ", "", "the unit is missing.*Try: unit: counts"),
        ("drive: [servo.angle]", "drive: [left.tension]", "this cable has no command of its own; got servo drives it"),
    ],
)
def test_a_wrong_file_is_refused_in_a_sentence(tmp_path: Path, old: str, new: str, told: str) -> None:
    project(tmp_path)
    with pytest.raises(ProjectFileError, match=told):
        project(tmp_path, (old, new))


def test_a_pull_of_its_cable_is_refused(tmp_path: Path) -> None:
    robot = project(tmp_path).robot
    with pytest.raises(ParameterError, match="Try: command servo"):
        simulate(robot, parse_pulls(robot, ["left=3mm"]))


def test_a_drive_without_a_cable_is_none() -> None:
    with pytest.raises(InputError, match="the drive has no cable"):
        Drive({}, 0.01)
