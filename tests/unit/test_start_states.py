"""`check` solves the robot at rest and the end of every experiment at the start values, and says what is odd there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from project_case import bench_csv, write_project
from test_experiments_synchronise import MOVED, imu, utm
from typer.testing import CliRunner

from softcal.cli import app
from softcal.experiments.synchronise import CommonMotion, clock_warning, synchronise
from softcal.geometry.primitives import box_mesh
from softcal.geometry.write import write_mesh
from softcal.project.project import load
from softcal.report import check_figures
from softcal.report.scene_render import Rendering
from softcal.workflows.checking import CheckReport, check

FINGER = """\
softcal: 1
name: a horizontal finger
robot:
  bodies:
    finger:
      mesh: {file: bar.msh, unit: mm}
      youngs_modulus: 60 kPa
      poissons_ratio: 0.45
      density: 1070 kg/m^3
      regions:
        foot: {plane: {point: [0 mm, 0 mm, 0 mm], normal: [1, 0, 0]}}
        head: {plane: {point: [100 mm, 0 mm, 0 mm], normal: [1, 0, 0]}}
      fixed: foot
  plates:
    tip: {body: finger, region: head, reference: [100 mm, 0 mm, 0 mm]}
  cables:
    tendon:
      via:
        - {on: tip, at: [100 mm, 0 mm, -8 mm]}
        - {on: finger, at: [50 mm, 0 mm, -8 mm]}
        - {at: [0 mm, 0 mm, -8 mm]}
  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]
experiments:
  pull:
    cable: tendon
    plate: tip
    files:
      - path: data/pull.csv
        columns:
          time: {name: Time}
          shortening: {name: Displacement, unit: mm}
          pitch: {name: Pitch, unit: deg}
parameters:
  finger.youngs_modulus: {bounds: [10 kPa, 100 MPa], scale: log}
"""


def finger(folder: Path, *changes: tuple[str, str]) -> Path:
    text = FINGER
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "data").mkdir(parents=True)
    write_mesh(box_mesh([100.0, 20.0, 20.0], [6, 2, 2], origin=[0.0, -10.0, -10.0]), folder / "bar.msh")
    lines = [f"{i},{d:.4f},{3 * d:.4f}" for i, d in enumerate(np.linspace(0.0, 7.6, 20))]
    (folder / "data" / "pull.csv").write_text("\n".join(["Time [s],Displacement [mm],Pitch [deg]", *lines]) + "\n")
    path = folder / "project.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def rows_of(report: CheckReport) -> dict[str, str]:
    return dict(report.rows)


def test_a_finger_that_hangs_and_its_slack_tendon_are_told(tmp_path: Path) -> None:
    report = check(load(finger(tmp_path)))
    rows = rows_of(report)
    assert "tip moves by" in rows["under its loads"]
    assert "slack for the first" in rows["end of pull"]
    hangs, slack = report.warnings
    assert hangs.startswith("under its loads alone, tip moves by ")
    assert "direction of gravity" in hangs
    assert slack.startswith("pull: tendon is slack for the first ")
    assert " of 7.6 mm of the test" in slack


def test_a_stiff_finger_does_not_hang(tmp_path: Path) -> None:
    report = check(load(finger(tmp_path, ("60 kPa", "20 MPa"))))
    rows = rows_of(report)
    assert "tip moves by" in rows["under its loads"]
    assert "slack" not in rows["end of pull"]
    assert report.warnings == ()


def test_states_are_those_of_the_start_values(tmp_path: Path) -> None:
    start = ("{bounds: [10 kPa, 100 MPa]", "{bounds: [10 kPa, 100 MPa], start: 20 MPa")
    assert check(load(finger(tmp_path / "stiff", start))).warnings == ()
    given = check(load(finger(tmp_path / "given", ("60 kPa", "20 MPa"))))
    started = check(load(finger(tmp_path / "started", start)))
    for key in ("under its loads", "end of pull"):
        assert rows_of(started)[key] == rows_of(given)[key]


def test_a_slack_that_is_free_begins_at_its_start(tmp_path: Path) -> None:
    free = ("front.slack: {bounds: [0 mm, 5 mm], per: experiment}", "front.slack: {bounds: [0 mm, 9 mm], start: 4 mm}")
    (row,) = [text for name, text in check(load(write_project(tmp_path, free))).rows if name == "end of pull"]
    assert row.startswith("front 16 mm, ")
    assert "slack for the first 1.5 of 18 mm" in row  # the test begins at 2 mm, in steps of 0.75 mm


def test_where_it_fails_is_told_with_the_reason(tmp_path: Path) -> None:
    soft = ("youngs_modulus: 60 kPa", "youngs_modulus: 0.02 kPa")
    report = check(load(finger(tmp_path, soft)))
    told = [sentence for sentence in report.warnings if "no equilibrium under its loads" in sentence]
    assert len(told) == 1
    assert "end of pull" not in rows_of(report)


def test_a_robot_without_loads_has_no_rest_to_tell_of(tmp_path: Path) -> None:
    rows = rows_of(check(load(write_project(tmp_path))))
    assert "under its loads" not in rows
    assert rows["end of pull"].startswith("front 20 mm, ")


def pretensioned(tension: str) -> tuple[str, str]:
    line = f"      line: {{stiffness: 4 kN, pretension: {tension}, friction_memory: true}}\n"
    last = "        - {at: [0 mm, 0 mm, -8 mm]}\n"
    return last, f"{last}      friction_coefficient: 0.1\n{line}"


def test_the_line_of_a_cable_is_told_and_what_the_loads_leave_of_its_pretension(tmp_path: Path) -> None:
    stiff = ("60 kPa", "20 MPa")
    taut = check(load(finger(tmp_path / "taut", stiff, pretensioned("5 N"))))
    rows = rows_of(taut)
    assert rows["  line"] == "EA 4000 N, pretension 5 N"
    assert rows["  friction"].startswith("0.1, against the sliding")
    left = float(re.search(r"; tendon ([\d.]+) N$", rows["under its loads"])[1])  # type: ignore[index]
    assert 0.0 < left < 5.0
    assert taut.warnings == ()
    slack = check(load(finger(tmp_path / "slack", stiff, pretensioned("0.01 N"))))
    assert rows_of(slack)["under its loads"].endswith("; tendon 0 N")
    assert sum("tendon is slack, in spite of its pretension" in sentence for sentence in slack.warnings) == 1


def test_a_pretension_without_loads_is_solved(tmp_path: Path) -> None:
    weightless = ("  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]\n", "")
    rows = rows_of(check(load(finger(tmp_path, weightless, ("60 kPa", "20 MPa"), pretensioned("5 N")))))
    assert "tendon" in rows["under its loads"]


def test_nothing_is_solved_or_drawn_unless_wanted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = finger(tmp_path)
    done = CliRunner().invoke(app, ["check", str(path), "--no-pictures", "--no-solve"])
    assert done.exit_code == 0, done.output
    assert "end of pull" not in done.output
    assert "Warning" not in done.output
    assert "Pictures" not in done.output
    assert not (tmp_path / "check").exists()
    assert CliRunner().invoke(app, ["check", str(path), "--no-pictures", "--out", str(tmp_path / "o")]).exit_code == 2

    rendered: list[int] = []

    def flat(scenes: tuple[object, ...], cameras: tuple[object, ...]) -> Rendering:
        rendered.append(len(scenes))
        return Rendering(())

    monkeypatch.setattr(check_figures, "render_scenes", flat)
    report = check(load(path), tmp_path / "drawn")
    assert [picture.name for picture in report.pictures] == ["robot.png", "states.png", "data-pull.png"]
    assert all(picture.stat().st_size > 10_000 for picture in report.pictures)
    assert rendered == [2 + 3]  # undeformed, under its loads, the end of the pull; in one go


@pytest.mark.parametrize(("rate", "odd"), [(-1.6e-3, True), (1e-4, False), (-4e-4, True)])
def test_a_rate_that_no_quartz_has_is_warned_of(rate: float, odd: bool) -> None:
    told = clock_warning(synchronise(utm(), imu(0.7, rate)))
    assert bool(told) == odd
    if odd:
        (found,) = re.findall(r"runs (\d+) ppm slower", told)
        assert float(found) == pytest.approx(abs(rate) * 1e6, abs=60.0)
        assert "is taken to run as fast as the other, at a lag of +0.7" in told
        assert "estimate_rate: false" in told
    assert not clock_warning(synchronise(utm(), imu(0.7, rate), CommonMotion(estimate_rate=False, min_correlation=0.5)))
    assert not clock_warning(utm())


def test_check_tells_lag_and_rate(tmp_path: Path) -> None:
    moved = zip(MOVED.time, MOVED.shortening, strict=True)
    machine = ["Time [s],Displacement [mm],Force [N]", *(f"{t:.3f},{1e3 * d:.5f},{2e3 * d:.5f}" for t, d in moved)]
    record = imu(0.7, -1.6e-3)
    seen = zip(record.values("time"), np.rad2deg(record.values("pitch")), strict=True)
    sensor = ["Time [s],Pitch [deg]", *(f"{t:.4f},{p:.5f}" for t, p in seen)]
    pitch = "          pitch: {name: Pitch, unit: deg}\n"
    other = "      - path: data/imu.csv\n        columns:\n          time: {name: Time}\n"
    clocks = ("    noise:", "    synchronise: {max_lag: 3 s}\n    noise:")
    data = "\n".join(machine) + "\n"
    path = write_project(tmp_path, (pitch, other + pitch), clocks, data=data)
    (tmp_path / "data" / "imu.csv").write_text("\n".join(sensor) + "\n", encoding="utf-8")
    report = check(load(path), solve=False)
    assert "s beside that of" in rows_of(report)["  clocks"]
    assert "ppm" in rows_of(report)["  clocks"]
    assert any("quartz clocks differ by 200 ppm at most" in sentence for sentence in report.warnings)
    assert "  clocks" not in rows_of(check(load(write_project(tmp_path / "one", data=bench_csv())), solve=False))


def test_a_test_that_the_twin_cannot_follow_is_said_once(tmp_path: Path) -> None:
    rows = [line.split(",") for line in bench_csv().splitlines()]
    far = "\n".join(",".join([t, d if d[0] == "D" else f"{4.0 * float(d)}", *rest]) for t, d, *rest in rows)
    soft = ("      youngs_modulus", "      law: stvenant-kirchhoff\n      youngs_modulus")
    report = check(load(write_project(tmp_path, soft, data=far)))
    assert ("end of pull", "not reached") in report.rows
    assert report._repr_html_().count("The load path was ended at ") == 1
