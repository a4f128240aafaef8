"""Sweeps of a project: cells, errors by section, best cells, failures, workers, resuming, bad input."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_trials import undigest
from project_case import write_project
from sweep_case import CABLES, FORCES, LENGTH, OVER, robot, table, write_sweep

from softcal.analysis.nominal import Nominal
from softcal.analysis.sweep import ALL, best_cells, improvement, reduction, section_errors, sections
from softcal.calibration.search.search import Progress
from softcal.cli import main
from softcal.errors import CalibrationError, InputError, StorageError
from softcal.project.project import Project, load
from softcal.report.surfaces import error_surfaces
from softcal.twin import simulate as simulating
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import calibrate
from softcal.workflows.run import SweepRun
from softcal.workflows.run_folder import load_run
from softcal.workflows.sweep import Swept, sweep, sweep_csv

E, NU = OVER
GRID = [(modulus, ratio) for modulus in (1.2e9, 0.8e9, 0.4e9) for ratio in (0.1, 0.3)]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    return load(write_sweep(tmp_path_factory.mktemp("project")))


@pytest.fixture(scope="module")
def swept(project: Project, tmp_path_factory: pytest.TempPathFactory) -> Swept:
    return sweep(project, out=tmp_path_factory.mktemp("sweep") / "run")


def distances(modulus: float, ratio: float, cable: str = "cable1") -> dict[str, np.ndarray]:
    """d_k [%] by marker, state by state, straight from the twin and the table."""
    response = simulate(robot(modulus, ratio), Protocol({cable: Command("tension", np.array(FORCES))}))
    rows = [row for row in csv.DictReader(table().splitlines()) if row["pulled"] == cable]
    found = {}
    for marker in ("marker1", "marker2"):
        measured = np.array([[float(row[f"{marker}.{axis} [m]"]) for axis in "xyz"] for row in rows])
        there = np.column_stack([response.channels[f"{marker}.{axis}"] for axis in "xyz"])
        found[marker] = 100 * np.linalg.norm(there - measured, axis=1) / LENGTH
    return found


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def soft_springs_fail(robot, protocol, theta=None, **options) -> Response:
    if parameter_values(robot, theta)["spring1.youngs_modulus"] < 0.5e9:
        return Response({}, {}, "No equilibrium beyond 3 mm.", succeeded=False, n_factorisations=0)
    return simulate(robot, protocol, theta, **options)


def test_the_project_says_what_is_swept_and_judged_by(swept: Swept):
    assert [(trial.theta[E], trial.theta[NU]) for trial in swept.result.trials] == GRID
    assert list(swept.result.experiments) == ["cable1"]
    assert swept.result.axes == {E: (1.2e9, 0.8e9, 0.4e9), NU: (0.1, 0.3)}


def test_the_errors_of_a_cell_are_equation_1(swept: Swept):
    for number in (0, 5):
        trial = swept.result.trials[number]
        expected = distances(trial.theta[E], trial.theta[NU])
        for marker, values in expected.items():
            assert 100 * trial.errors["cable1"][marker] / LENGTH == pytest.approx(rms(values), rel=1e-6)
        assert trial.loss == pytest.approx(rms(np.concatenate(list(expected.values()))), rel=1e-6)


def test_the_best_cell_is_the_truth_and_its_end_of_range_is_told(swept: Swept):
    assert [best.section.name for best in swept.best] == [ALL, "marker1", "marker2"]
    for best in swept.best:
        assert dict(best.trial.theta) == {E: 0.8e9, NU: 0.3}
        assert best.error < 1e-3
        (note,) = best.notes
        assert note.startswith(f"{NU} is at its upper bound of 0.3")


def test_the_nominal_values_are_those_of_the_project(swept: Swept):
    expected = distances(1.6e9, 0.43)
    assert swept.nominal.parameters == {E: 1.6e9, NU: 0.43}
    for best in swept.best[1:]:
        assert best.nominal == pytest.approx(rms(expected[best.section.name]) * LENGTH / 100, rel=1e-6)
        assert best.section.shown(best.error) == pytest.approx(100 * best.error / LENGTH)


def test_an_error_that_was_halved_is_reduced_by_half():
    assert reduction(40.0, 10.0) == pytest.approx(75.0)
    assert reduction(10.0, 10.0) == 0.0
    assert reduction(10.0, 20.0) == -100.0


def test_improvement_is_nominal_over_tuned_less_one():
    assert improvement(40.0, 10.0) == pytest.approx(300.0)
    assert improvement(10.0, 10.0) == 0.0
    assert improvement(10.0, 20.0) == -50.0


def test_the_table_holds_every_cell_in_per_cent(swept: Swept):
    assert swept.folder is not None
    with (swept.folder / "sweep.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["cell"] for row in rows] == [str(k) for k in range(6)]
    assert {row["status"] for row in rows} == {"COMPLETE"}
    assert float(rows[4][f"{E} [Pa]"]) == 0.4e9
    assert float(rows[4]["error of marker2 [%]"]) == pytest.approx(rms(distances(0.4e9, 0.1)["marker2"]), rel=1e-6)
    assert float(rows[4]["loss distance [%]"]) == pytest.approx(swept.result.trials[4].loss)


def test_result_json_tells_best_cells_nominal_and_gain(swept: Swept):
    assert swept.folder is not None
    held = json.loads((swept.folder / "result.json").read_text())
    told = held["sweep"]
    assert told["axes"][E] == {"unit": "Pa", "values": [1.2e9, 0.8e9, 0.4e9]}
    assert (told["cells"], told["failed"]) == (6, 0)
    best = told["best"]["marker2"]
    assert best["improvement_percent"] == pytest.approx(100 * (best["nominal_error"] / best["error"] - 1))
    assert best["unit"] == "%"
    assert told["nominal"]["errors"]["marker2"] == best["nominal_error"]
    assert any("upper bound" in note for note in best["notes"])
    assert held["parameters"][E]["value"] == 0.8e9
    assert held["headline"] == "sweep"


def test_a_run_folder_is_read_back(swept: Swept):
    assert swept.folder is not None
    run = load_run(swept.folder)
    assert isinstance(run, SweepRun)
    again = run.result
    assert (again.axes, again.extra) == (swept.result.axes, swept.result.extra)
    np.testing.assert_array_equal(again.losses, swept.result.losses)
    assert [trial.errors for trial in again.trials] == [trial.errors for trial in swept.result.trials]
    assert sweep_csv(again) == (swept.folder / "sweep.csv").read_text()


def test_a_sweep_is_kept_as_earlier_versions_did_so_that_theirs_are_read(swept: Swept):
    """They wrote the record of a calibration that looks for no minimum, with the grid among its settings."""
    assert swept.folder is not None
    kept = json.loads((swept.folder / "calibrations" / "sweep" / "result.json").read_text())
    assert (kept["format"], kept["method"], kept["converged"]) == (1, "grid", None)
    assert kept["extra"]["axes"] == {E: [1.2e9, 0.8e9, 0.4e9], NU: [0.1, 0.3]}


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        ({E: [1.2e9, 0.8e9], NU: [0.1, 0.3]}, r"trial 4 in trials\.csv is no cell of its grid"),
        ({NU: [0.1, 0.3], E: [1.2e9, 0.8e9, 0.4e9]}, r"trial 1 in trials\.csv is no cell of its grid"),
    ],
)
def test_a_kept_sweep_whose_cells_are_not_those_of_its_grid_is_refused(
    swept: Swept, tmp_path: Path, axes: dict[str, list[float]], message: str
):
    assert swept.folder is not None
    run = Path(shutil.copytree(swept.folder, tmp_path / "run"))
    path = run / "calibrations" / "sweep" / "result.json"
    document = json.loads(path.read_text())
    document["extra"]["axes"] = axes
    path.write_text(json.dumps(document))
    undigest(path)
    with pytest.raises(StorageError, match=message):
        load_run(run)


def test_a_sweep_among_calibrations_is_refused(swept: Swept, tmp_path: Path):
    assert swept.folder is not None
    run = Path(shutil.copytree(swept.folder, tmp_path / "run"))
    shutil.copytree(run / "calibrations" / "sweep", run / "calibrations" / "joint")
    record = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps({**record, "calibrations": ["sweep", "joint"]}))
    undigest(run / "run.json")
    with pytest.raises(StorageError, match="there is a sweep among its calibrations"):
        load_run(run)


def test_the_grid_of_losses_has_every_cell_and_its_best(swept: Swept):
    result = swept.result
    assert result.losses.shape == (3, 2)
    assert result.losses[1, 1] == result.losses.min() == result.best.loss == result.loss
    assert dict(result.best.theta) == {name: e.value for name, e in result.parameters.items()}
    failed = replace(result.trials[4], loss=None, state="FAILED")
    lost = replace(result, trials=(*result.trials[:4], failed)).losses
    assert np.isnan(lost[2]).all()
    np.testing.assert_array_equal(lost[:2], result.losses[:2])


def test_all_experiments_are_pooled_over_their_states(project: Project):
    found = sweep(project, over={E: "1.2GPa,0.4GPa"}, experiments=["cable*"])
    assert list(found.result.experiments) == list(CABLES)
    both = [distances(1.2e9, 0.43, cable)["marker2"] for cable in CABLES]
    joint = section_errors(found.result, found.result.trials[0].errors)
    assert 100 * joint["marker2"] / LENGTH == pytest.approx(rms(np.concatenate(both)), rel=1e-6)
    row = next(csv.DictReader(sweep_csv(found.result).splitlines()))
    assert float(row["error of marker2 in cable2 [%]"]) == pytest.approx(rms(both[1]), rel=1e-6)
    assert float(row["error of marker2 [%]"]) == pytest.approx(100 * joint["marker2"] / LENGTH)
    assert [section.name for section in sections(found.result)] == ["marker1", "marker2"]


def test_cells_that_fail_are_kept_with_their_reason_and_empty(
    project: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(simulating, "simulate", soft_springs_fail)
    found = sweep(project, over={**OVER, NU: "0.1,0.2,0.3"}, out=tmp_path / "run")
    failed = [trial for trial in found.result.trials if trial.state == "FAILED"]
    assert [trial.theta[E] for trial in failed] == [0.4e9] * 3
    with (tmp_path / "run" / "sweep.csv").open(newline="") as stream:
        last = list(csv.DictReader(stream))[-1]
    assert last["status"] == "FAILED"
    assert "No equilibrium beyond 3 mm." in last["reason"]
    assert last["error of marker1 [%]"] == ""
    surface = error_surfaces(found.result)[-1]
    assert np.isnan(surface.error[:, 0]).all()
    assert np.isfinite(surface.error[:, 1:]).all()
    assert surface.failed.tolist() == [[0.4e9, 0.1], [0.4e9, 0.2], [0.4e9, 0.3]]
    assert surface.best[:2] == (0.8e9, 0.3)


def no_robot_stands(robot, protocol, theta=None, **options) -> Response:
    return Response({}, {}, "No equilibrium beyond 1 mm.", succeeded=False, n_factorisations=0)


def test_where_every_cell_fails_the_table_is_written_and_named(
    project: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(simulating, "simulate", no_robot_stands)
    table = tmp_path / "run" / "sweep.csv"
    with pytest.raises(CalibrationError, match=r"All 6 trials failed.*Every cell and its reason: .*sweep\.csv\.$"):
        sweep(project, out=tmp_path / "run")
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(float(row[f"{E} [Pa]"]), float(row[f"{NU} [1]"])) for row in rows] == GRID
    assert {row["status"] for row in rows} == {"FAILED"}
    assert all("No equilibrium beyond 1 mm." in row["reason"] for row in rows)
    assert {row["loss distance [%]"] for row in rows} == {""}
    with pytest.raises(CalibrationError, match=r"or softcal check\.$"):
        sweep(project)


def test_nominal_values_that_fail_leave_the_gain_open(project: Project, monkeypatch: pytest.MonkeyPatch):
    def stiff_springs_fail(robot, protocol, theta=None, **options) -> Response:
        if parameter_values(robot, theta)["spring1.youngs_modulus"] > 1.5e9:
            return Response({}, {}, "Unstable.", succeeded=False, n_factorisations=0)
        return simulate(robot, protocol, theta, **options)

    monkeypatch.setattr(simulating, "simulate", stiff_springs_fail)
    found = sweep(project, over={E: "1.2GPa,0.8GPa"})
    assert found.nominal.failure.endswith("Unstable.")
    assert [best.improvement for best in found.best] == [None] * 3


def test_of_cells_that_differ_by_rounding_the_first_is_best(swept: Swept):
    first, second = swept.result.trials[2:4]
    alike = replace(second, errors=first.errors, loss=(first.loss or 0.0) * (1 - 1e-14), number=99)
    result = replace(swept.result, trials=(first, alike))
    assert {best.trial.number for best in best_cells(result, Nominal(None))} == {first.number}


@pytest.mark.slow
def test_many_workers_find_the_same(project: Project, swept: Swept):
    both = sweep(project, workers=2)
    for one, other in zip(swept.result.trials, both.result.trials, strict=True):
        assert one.theta == other.theta
        assert one.loss == pytest.approx(other.loss, rel=1e-9, abs=1e-9)
    assert [best.trial.number for best in both.best] == [best.trial.number for best in swept.best]


def test_a_sweep_that_was_stopped_goes_on_where_it_was(project: Project, swept: Swept, tmp_path: Path):
    def stop_after_five(_: str, progress: Progress) -> None:
        if progress.done == 5:
            raise KeyboardInterrupt

    first = sweep(project, out=tmp_path / "run", progress=stop_after_five)
    assert len(first.result.trials) == 5
    assert "Stopped by the user" in first.result.status
    seen: list[int] = []

    def note(_: str, progress: Progress) -> None:
        if not progress.stage:
            seen.append(progress.done)

    whole = sweep(project, out=tmp_path / "run", resume=True, progress=note)
    assert seen == [1, 2, 3, 4, 5, 6]
    strip = [replace(trial, seconds=0.0) for trial in whole.result.trials]
    assert strip == [replace(trial, seconds=0.0) for trial in swept.result.trials]
    assert (tmp_path / "run" / "sweep.csv").read_text() == sweep_csv(swept.result)
    with pytest.raises(StorageError, match=r"axes|free parameters"):
        sweep(project, over={E: "1GPa,2GPa"}, out=tmp_path / "run", resume=True)


def test_a_folder_that_holds_something_is_left_alone(project: Project, tmp_path: Path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(StorageError, match="nothing is overwritten"):
        sweep(project, out=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"over": {"springs.stiffness": "1GPa,2GPa"}}, "there is no such parameter"),
        ({"over": {NU: "0.5:0.05:0.05"}}, "the nearest being 0.4999"),
        ({"over": {E: "1GPa,2GPa", "spring1.youngs_modulus": "1GPa,2GPa"}}, "swept twice"),
        ({"experiments": ["cable3"]}, r"there is no such experiment; got 'cable3'; allowed: cable1, cable2"),
        ({"resume": True}, "a sweep is resumed from its folder, which is missing"),
    ],
)
def test_bad_input_is_refused_before_anything_runs(
    project: Project, options: dict[str, object], message: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(simulating, "simulate", lambda *_, **__: pytest.fail("something was simulated"))
    with pytest.raises(InputError, match=message):
        sweep(project, **options)  # type: ignore[arg-type]


def test_what_is_held_cannot_be_swept(project: Project):
    held = load(project.path, values={"spring1.youngs_modulus": "1 GPa"})
    with pytest.raises(InputError, match="fixed and swept at once"):
        sweep(held)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "[0.1, 0.3]",
            "[0.5, 0.3]",
            r"project\.yaml:\d+: sweep\.over\.springs\.poissons_ratio: Poisson's ratio must stay",
        ),
        ("1.2 GPa:0.4 GPa:0.4 GPa", "1.2:0.4:0.4", r"sweep\.over\.springs\.youngs_modulus: the unit is missing"),
        ("1.2 GPa:0.4 GPa:0.4 GPa", "{from: 1 GPa}", r"sweep\.over\.springs\.youngs_modulus"),
        ("experiments: [cable1]", "experiments: [cable7]", r"sweep\.experiments\[0\]: there is no such experiment"),
        ("  over:", "  along:", "Try: |unknown key"),
    ],
)
def test_faults_of_the_section_name_their_line(tmp_path: Path, old: str, new: str, message: str):
    with pytest.raises(InputError, match=message):
        load(write_sweep(tmp_path, (old, new)))


def test_a_plain_range_in_the_file(tmp_path: Path):
    found = load(write_sweep(tmp_path, ("[0.1, 0.3]", "0.3:0.1:0.1")))
    assert found.sweep is not None
    assert list(found.sweep.over[NU]) == ["0.3:0.1:0.1"]


def test_channels_other_than_positions_are_swept_by_the_projects_loss(tmp_path: Path):
    project = load(write_project(tmp_path))
    found = sweep(project, over={"bar.youngs_modulus": "0.9MPa:1.7MPa:0.4MPa", "front.slack": ["0 mm", "1.5 mm"]})
    assert found.result.loss_name == "papers"
    assert [best.section.name for best in found.best] == [ALL, "tension", "pitch"]
    assert dict(found.best[0].trial.theta) == {"bar.youngs_modulus": 1.3e6, "front.slack": 0.0015}
    header = sweep_csv(found.result).splitlines()[0]
    assert header == (
        "cell,status,reason,bar.youngs_modulus [Pa],front.slack [m],loss papers [1],error of tension [N],"
        "error of pitch [rad]"
    )


Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as left:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return int(left.value.code or 0), captured.out, captured.err

    return call


def test_the_command_prints_the_best_cells(run: Run, project: Project, tmp_path: Path):
    out = tmp_path / "run"
    options = (
        "--over",
        f"{E}=1.2GPa,0.8GPa",
        "--experiments",
        "cable2",
        "--set",
        f"{NU}=0.3",
        "--out",
        out,
        "--no-report",
    )
    code, printed, err = run("sweep", project.path, *options)
    assert code == 0, err
    assert "marker2" in printed
    assert "800 MPa" in printed
    assert f"{E} is at its lower bound" in printed
    assert (out / "sweep.csv").is_file()
    code, _, err = run("sweep", project.path, *options)
    assert code == 2
    assert "not empty" in err


def test_the_command_refuses_the_papers_ratio(run: Run, project: Project, tmp_path: Path):
    options = ("--over", f"{NU}=0.5:0.05:0.05", "--out", tmp_path / "run")
    code, _, err = run("sweep", project.path, *options)
    assert code == 2
    assert f"{NU}=0.4999,0.45:0.05:0.05" in err
    assert not (tmp_path / "run").exists()
    code, _, err = run("sweep", project.path, "--over", E)
    assert code == 2
    assert "this is not an axis" in err


def test_what_an_option_gives_twice_is_refused(run: Run, project: Project, tmp_path: Path):
    code, _, err = run(
        "sweep", project.path, "--over", f"{E}=1GPa,2GPa", "--over", f"{E} = 3GPa", "--out", tmp_path / "a"
    )
    assert code == 2
    assert f"--over: the name is given twice; got '{E}=1GPa,2GPa' and '{E}=3GPa'" in err
    assert not (tmp_path / "a").exists()
    code, _, err = run("sweep", project.path, "--over", f"{E}=1GPa", "--set", f"{NU}=0.3", "--set", f"{NU}=0.4")
    assert code == 2
    assert f"--set: the name is given twice; got '{NU}=0.3' and '{NU}=0.4'" in err


@pytest.mark.parametrize("workers", [0, -1, 2.5, "x", True, None, 10**6])
def test_a_wrong_number_of_workers_leaves_no_folder(project: Project, tmp_path: Path, workers: Any) -> None:
    for make, of in ((sweep, project), (calibrate, write_project(tmp_path / "p"))):
        with pytest.raises(InputError, match="workers"):
            make(of, out=tmp_path / "out", workers=workers)
        assert not (tmp_path / "out").exists()
