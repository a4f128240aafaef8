"""A project of paper B's kind, from tables to a prediction: markers, loads, frames, ties, settings, held-out tests."""

from __future__ import annotations

import csv
import functools
import io
import json
from pathlib import Path

import numpy as np
import pytest
from project_text import changed
from typer.testing import CliRunner

from softcal.calibration.problem.frame import rotation
from softcal.cli import app
from softcal.errors import InputError, ProjectFileError
from softcal.project.project import Project, load
from softcal.report.section import all_tables
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import calibrate, calibrated
from softcal.workflows.checking import check
from softcal.workflows.reporting import report_content
from softcal.workflows.run_folder import load_run
from softcal.workflows.simulation import simulate as simulate_project

ROBOT = """\
softcal: 1
name: two springs
robot:
  manipulator:
    total_length: 200 mm
    sections: 2
    springs: {wire_diameter: 6 mm, turns: 3, elements_per_turn: 8, youngs_modulus: 1.6 GPa, poissons_ratio: 0.4}
    cables: {ends: {S1: 0 deg, S2: 60 deg}}
  loads:
    weight: {on: S2, at: [0 mm, 0 mm, -200 mm], force: 0 N, direction: [0, 0, -1]}
  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]
rig: {length: 200 mm}
"""
EXPERIMENTS = """\
experiments:
  cable1: &test
    drive: [cable1.tension]
    label: group
    files:
      - {path: loads.csv, columns: {cable1.tension: {name: force}}, where: {cable: cable1}}
      - &markers {path: markers.csv, markers: {marker1: A, marker2: B}}
  cable5:
    drive: [cable5.tension]
    label: group
    files:
      - {path: loads.csv, columns: {cable5.tension: {name: force}}, where: {cable: cable5}}
      - *markers
  hanging:
    label: group
    settings: {weight.mass: 100 g}
    files:
      - {path: markers.csv, markers: {marker1: A, marker2: B}, where: {group: hanging}}
"""
PARAMETERS = """\
parameters:
  springs.youngs_modulus: {of: spring*.youngs_modulus, bounds: [0.1 GPa, 10 GPa], scale: log}
  frame.x: {bounds: [-50 mm, 50 mm]}
  frame.rz: {bounds: [-30 deg, 30 deg]}
calibration: {loss: distance, starts: 1, hold_out: cable5}
"""
MODULUS, SHIFT, TURN, FORCES = 0.9e9, 0.01, 0.2, (0.3, 0.6)


@functools.cache
def tables() -> tuple[str, str]:
    """loads.csv and markers.csv of the robot with springs of MODULUS, seen by a camera; B is missing in one state."""
    folder_free = ROBOT.replace("youngs_modulus: 1.6 GPa", "youngs_modulus: 0.9 GPa")
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.yaml"
        path.write_text(folder_free)
        robot = load(path).robot
    states = [(f"{c}-{f}", c, f) for c in ("cable1", "cable5") for f in FORCES] + [("hanging", "", 0.0)]
    loads, places = io.StringIO(), io.StringIO()
    to_loads, to_places = csv.writer(loads), csv.writer(places)
    to_loads.writerow(["group", "cable", "force [kgf]"])
    axes = [f"{m}.{a}{end} [m]" for m in "AB" for end in ("", "_sd") for a in "xyz"]
    to_places.writerow(["group", "images [1]", *axes, "notes"])
    for label, cable, force in states:
        if cable:
            to_loads.writerow([label, cable, force])
            response = simulate(robot, Protocol({cable: Command("tension", np.array([force * 9.80665]))}))
        else:
            response = simulate(robot, Protocol({}), {"weight.force": 0.981})
        cells: list[object] = []
        for m in ("marker1", "marker2"):
            p = rotation(np.array([0, 0, TURN])) @ [response.channels[f"{m}.{a}"][0] for a in "xyz"] + [SHIFT, 0, 0]
            lost = (label, m) == ("cable1-0.6", "marker2")
            cells += [""] * 6 if lost else [*(f"{v:.9f}" for v in p), *["0.0005"] * 3]
        to_places.writerow([label, 3, *cells, "marker2 is missing" if "" in cells else ""])
    return loads.getvalue(), places.getvalue()


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    text = changed(ROBOT + EXPERIMENTS + PARAMETERS, changes)
    folder.mkdir(exist_ok=True)
    for name, table in zip(("loads.csv", "markers.csv"), tables(), strict=True):
        (folder / name).write_text(table)
    (folder / "project.yaml").write_text(text)
    return folder / "project.yaml"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    return load(write(tmp_path_factory.mktemp("positions")))


def test_tables_are_joined_by_the_labels_of_their_states(project: Project) -> None:
    data = project.experiments["cable1"].dataset
    assert data.labels == ("cable1-0.3", "cable1-0.6")
    np.testing.assert_allclose(data.values("cable1.tension"), np.array(FORCES) * 9.80665)
    np.testing.assert_array_equal(np.isnan(data.values("marker2.x")), [False, True])
    np.testing.assert_allclose(project.experiments["cable1"].sigma("marker1.z"), 5e-4)
    assert project.experiments["hanging"].drives == ()
    assert project.experiments["hanging"].settings == {"weight.force": pytest.approx(0.981)}
    assert project.space is not None
    assert project.space.parameters[0].of == ("spring1.youngs_modulus", "spring2.youngs_modulus")


def test_settings_are_told_with_their_unit(project: Project) -> None:
    assert "weight.force = 0.981 N" in dict(check(project).rows)["experiment hanging"]


def test_the_settings_of_an_experiment_hold_when_it_is_simulated(project: Project) -> None:
    loaded = simulate_project(project, experiment="hanging").channels["marker2.z"]
    free = simulate(project.robot, Protocol({})).channels["marker2.z"]
    assert loaded[0] < free[0] - 1e-4


@pytest.mark.slow
def test_a_calibration_finds_the_modulus_and_predicts_what_was_held_out(tmp_path: Path) -> None:
    project = load(write(tmp_path))
    found = calibrate(project, out=tmp_path / "run").headline
    assert found.parameters["springs.youngs_modulus"].value == pytest.approx(MODULUS, rel=1e-3)
    assert found.parameters["springs.youngs_modulus"].of == ("spring1.youngs_modulus", "spring2.youngs_modulus")
    assert found.parameters["frame.rz"].value == pytest.approx(TURN, abs=1e-3)
    assert set(found.experiments) == {"cable1", "hanging"}
    held = json.loads((tmp_path / "run" / "result.json").read_text())
    told = held["experiments"]["cable1"]
    assert "tension_rmse" not in told
    assert told["missing"] == {"marker2": 1}
    assert told["distances"]["marker2"]["n"] == 1
    assert told["distances"]["marker1"]["max_percent"] == pytest.approx(100 * told["distances"]["marker1"]["max"] / 0.2)
    assert held["held_out"]["cable5"]["distances"]["marker2"]["mean"] < 2e-5
    assert any("marker2 in state cable1-0.6" in note.text for note in found.notes)
    assert "NaN" not in (tmp_path / "run" / "result.json").read_text()
    assert (tmp_path / "run" / "response-cable5.csv").is_file()
    run = load_run(tmp_path / "run")
    tables = all_tables(report_content(run))
    rows = {tuple(row[1:4]): row for row in tables["distances"].rows}
    assert set(rows) == {
        (name, kind, marker)
        for name, kind in (("cable1", "fitted"), ("cable5", "predicted"), ("hanging", "fitted"))
        for marker in ("marker1", "marker2")
    }
    assert rows["cable1", "fitted", "marker2"][-2:] == (1, 1)
    robot = calibrated(run.project, found).robot
    values = parameter_values(robot)
    assert values["spring1.youngs_modulus"] == values["spring2.youngs_modulus"] == pytest.approx(MODULUS, rel=1e-3)


@pytest.mark.slow
def test_a_tie_can_be_split_and_the_run_remembers_it(tmp_path: Path) -> None:
    path = write(tmp_path, ("starts: 1,", "starts: 1, split: springs.youngs_modulus,"))
    found = calibrate(load(path), out=tmp_path / "run").headline
    each = [f"spring{k}.youngs_modulus" for k in (1, 2)]
    assert set(found.parameters) == {*each, "frame.x", "frame.rz"}
    assert [found.parameters[name].value for name in each] == pytest.approx([MODULUS, MODULUS], rel=3e-3)
    run = load_run(tmp_path / "run")
    assert run.settings.split == ["springs.youngs_modulus"]
    assert set(each) <= {str(row[1]) for row in all_tables(report_content(run))["parameters"].rows}
    told = CliRunner().invoke(
        app,
        ["calibrate", str(write(tmp_path)), "--split", "frame.x", "--out", str(tmp_path / "other")],
    )
    assert told.exit_code == 2
    assert "no tied parameters have this name" in told.output
    assert not (tmp_path / "other").exists()


def test_a_held_tie_holds_all_its_parts_and_a_held_part_leaves_the_others_tied(tmp_path: Path) -> None:
    path = write(tmp_path)
    held = load(path, values={"springs.youngs_modulus": "1 GPa", "frame.x": "5 mm"})
    assert held.space is not None
    assert held.space.labels == ("frame.rz",)
    assert [rod.parameters["youngs_modulus"] for rod in held.robot.rods] == [1e9, 1e9]
    assert held.experiments["cable1"].rig_values()["frame.x"] == 0.005
    one = load(path, values={"spring1.youngs_modulus": "1 GPa"})
    assert one.space is not None
    assert one.space.parameters[0].of == ("spring2.youngs_modulus",)


@pytest.mark.parametrize(
    ("change", "where", "what"),
    [
        (("marker2: B", "marker9: B"), "experiments.cable1.files[1].markers.marker9", "Try: 'marker2'"),
        (("marker2: B", "marker2: C"), "experiments.cable1.files[1]", "no columns 'C.x', 'C.y', 'C.z'"),
        (("{weight.mass: 100 g}", "{wieght.force: 1 N}"), "experiments.hanging.settings.wieght.force", "weight.force"),
        (("{weight.mass: 100 g}", "{weight.mass: 1 N}"), "experiments.hanging.settings.weight.mass", "unit"),
        (("{weight.mass: 100 g}", "{spring1.youngs_modulus: 1 GPa}"), "hanging.settings", "set and free at once"),
        (("direction: [0, 0, -1]", "direction: [1, 0, 0]"), "hanging.settings.weight.mass", "along gravity"),
        (("hold_out: cable5", "hold_out: cable55"), "calibration.hold_out[0]", "Try: 'cable5'"),
        (("starts: 1,", "starts: 1, split: x,"), "calibration.split[0]", "tied parameter"),
        (("rig: {length: 200 mm}\n", ""), "calibration.loss", "rig: {length"),
        (
            ("drive: [cable5.tension]", "drive: [cable5.tention]"),
            "experiments.cable5.drive[0]",
            "no such channel among the columns; got 'cable5.tention'",
        ),
        (("    drive: [cable5.tension]\n", ""), "experiments.cable5.drive", "drive of the twin"),
        (("drive: [cable5.tension]", "drive: tension"), "experiments.cable5.drive", "driven cable is not specified"),
        (("drive: [cable5.tension]", "drive: pull"), "experiments.cable5.drive", "there is no such choice"),
        (("columns: {cable5.tension", "columns: {cable9.tension"), "columns.cable9.tension", "Try: 'cable6'"),
        (
            ("of: spring*.youngs", "of: sprig*.youngs"),
            "parameters.springs.youngs_modulus.of",
            "no such part of the robot",
        ),
        (("  hanging:\n", "  hanging:\n    compare: [marker3]\n"), "hanging.compare[0]", "'marker3'"),
        (("  hanging:\n", "  hanging:\n    noise: {marker3: 1 mm}\n"), "hanging.noise.marker3", "no such channel"),
        (("label: group\n    settings", "label: state\n    settings"), "experiments.hanging", "no column 'state'"),
    ],
)
def test_every_slip_is_told_where_it_stands(tmp_path: Path, change: tuple[str, str], where: str, what: str) -> None:
    with pytest.raises(ProjectFileError) as caught:
        load(write(tmp_path, change))
    told = [str(fault) for fault in caught.value.faults]
    assert any(where in text and what in text for text in told), "\n".join(told)


def test_a_frame_without_positions_and_a_missing_state_are_told(tmp_path: Path) -> None:
    no_positions = (
        "files:\n      - {path: markers.csv, markers: {marker1: A, marker2: B}, where: {group: hanging}}",
        "plate: S2\n    frame: {x: 1 mm}\n    files:\n      - {path: pitch.csv, columns: {pitch: {name: pitch}}}",
    )
    path = write(tmp_path, no_positions)
    (tmp_path / "pitch.csv").write_text("group,pitch [deg]\na,1.0\n")
    with pytest.raises(ProjectFileError, match=r"hanging\.frame: a frame needs positions"):
        load(path)
    path = write(tmp_path)
    kept = [line for line in (tmp_path / "markers.csv").read_text().splitlines() if not line.startswith("cable5-0.6")]
    (tmp_path / "markers.csv").write_text("\n".join(kept) + "\n")
    with pytest.raises(ProjectFileError, match=r"not in the other; got 'cable5-0\.6'"):
        load(path)


def test_a_marker_that_was_never_seen_is_left_out_with_a_warning(tmp_path: Path) -> None:
    path = write(tmp_path)
    rows = list(csv.reader((tmp_path / "markers.csv").read_text().splitlines()))
    for row in rows:
        if row[0] == "hanging":
            row[8:14] = [""] * 6
    with (tmp_path / "markers.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    project = load(path)
    assert project.experiments["hanging"].points == ("marker1",)
    assert any("marker2 was not measured in any row" in str(warning) for warning in project.warnings)


def test_check_says_in_how_many_states_a_marker_was_not_seen(tmp_path: Path) -> None:
    path = write(tmp_path)
    rows = list(csv.reader((tmp_path / "markers.csv").read_text().splitlines()))
    seen = next(row for row in rows if row[0].startswith("cable5"))
    seen[8:14] = [""] * 6
    with (tmp_path / "markers.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    assert "marker2 in 1 of" in dict(check(path, solve=False).rows)["  not measured"]


@pytest.mark.long
def test_the_command_line_validates_and_holds_out(tmp_path: Path) -> None:
    path = write(tmp_path)
    out = tmp_path / "validation.csv"
    told = CliRunner().invoke(
        app,
        ["validate", str(path), "--hold-out", "hang*", "--split", "springs.youngs_modulus", "--out", str(out)],
    )
    assert told.exit_code == 0, told.output
    assert "springs.youngs_modulus split" in told.output
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert {(row["left out"], row["experiment"]) for row in rows} == {("hanging", "hanging")}
    assert max(float(row["RMSE"]) for row in rows) < 1e-3
    wrong = CliRunner().invoke(app, ["calibrate", str(path), "--hold-out", "cable7", "--out", str(tmp_path / "run")])
    assert wrong.exit_code == 2
    assert "Try: '" in wrong.output
    assert not (tmp_path / "run").exists()
    with pytest.raises(InputError, match="hold_out"):
        calibrate(load(path), hold_out=["cable1", "cable5", "hanging"])
