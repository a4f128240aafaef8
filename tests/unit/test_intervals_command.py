"""`softcal intervals`: of a run, its files, and what it refuses."""

from __future__ import annotations

import inspect
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from project_case import bench_values, write_project

import softcal
from softcal.cli import main
from softcal.cli.commands import study_commands
from softcal.cli.printing import shown_path
from softcal.errors import StorageError
from softcal.workflows.intervals import INTERVALS, METHODS, POINTS, WITHOUT_MESH, default_folder, intervals
from softcal.workflows.run_folder import load_run

E, SLACK = "bar.youngs_modulus", "front.slack[pull]"


def noisy_csv() -> str:
    time, shortening, tension, pitch = (np.array(column) for column in bench_values())
    chance = np.random.default_rng(4)
    tension = tension + 0.05 * chance.standard_normal(len(time))
    pitch = pitch + 0.2 * chance.standard_normal(len(time))
    rows = zip(time, shortening, tension, pitch, strict=True)
    lines = [f"{t:.3f},{d:.6f},{f:.6f},{p:.6f}" for t, d, f, p in rows]
    return "\n".join(["Time [s],Displacement [mm],Force [N],Pitch [deg]", *lines]) + "\n"


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bar")
    project = write_project(folder, data=noisy_csv())
    with pytest.raises(SystemExit):
        main(["calibrate", str(project), "--out", str(folder / "run"), "--no-report"])
    return folder / "run"


@pytest.fixture(scope="module", params=METHODS)
def studied(calibrated: Path, request: pytest.FixtureRequest) -> tuple[Path, str]:
    with pytest.raises(SystemExit) as ended:
        main(["intervals", str(calibrated), "--by", request.param])
    assert not ended.value.code
    return calibrated, request.param


def test_a_study_is_written_into_the_run_and_read_back(studied: tuple[Path, str]):
    folder, by = studied
    held = default_folder(folder, by)
    assert sorted(path.name for path in held.iterdir()) == [INTERVALS.file, POINTS]
    stored = INTERVALS.read(held)
    assert stored is not None
    assert stored.study.by == by
    results = load_run(folder).results
    assert stored.is_of(results)
    for label, one in stored.study.intervals.items():
        without_mesh, whole = one.quick, results["pull"].parameters[label].interval
        assert whole is not None
        assert whole[0] < without_mesh[0] < without_mesh[1] < whole[1]
        assert one.found is not None
        assert one.difference is not None
        # The scatter of few pieces of a record is known less well than the noise of all samples.
        assert one.difference < (0.2 if one.chance is None else 0.6)
        assert not one.differs
    assert WITHOUT_MESH in stored.study.notes
    record = json.loads((held / INTERVALS.file).read_text(encoding="utf-8"))
    assert record["sentences"] == list(stored.study.sentences)
    assert set(stored.study.points) == {E, SLACK}
    assert len(stored.study.points[E]) >= 5
    assert INTERVALS.read(folder) is None


def test_it_is_printed_beside_the_quick_one_and_nothing_is_overwritten(
    studied: tuple[Path, str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    folder, by = studied
    code, told, _ = run(capsys, "intervals", folder, "--by", by, "--out", tmp_path / "study")
    assert code == 0
    for expected in (
        "quick",
        by,
        E,
        "MPa to",
        "trajectories",
        "differs from",
        f"Wrote {shown_path(tmp_path / 'study')}",
    ):
        assert expected in told, expected
    monkeypatch.setattr("softcal.workflows.intervals.study_intervals", None)
    code, _, told = run(capsys, "intervals", folder, "--by", by)
    assert code == 2
    assert "the folder is not empty, and nothing is overwritten" in told


def test_what_cannot_be_studied_is_refused_in_a_sentence(
    calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "study"
    for arguments, said in (
        ((calibrated, "--by", "magic"), "this is no method for intervals"),
        ((calibrated, "--by", "jackknife", "--over", "bolts"), "this is no kind of group"),
        ((calibrated, "--by", "jackknife", "--over", "experiments"), "too few experiments to estimate their scatter"),
        ((calibrated, "--by", "bootstrap", "--over", "cycles"), "too few cycles to estimate their scatter"),
        ((calibrated, "--by", "bootstrap", "--samples", "3"), "there are too few"),
        ((calibrated, "--over", "markers"), "'profile' takes no groups"),
        ((calibrated, "--calibration", "other"), "the run has no such calibration"),
        ((calibrated.parent / "project.yaml",), "a file holds no calibration"),
        ((tmp_path / "nowhere",), "nowhere"),
    ):
        code, _, told = run(capsys, "intervals", *arguments, "--out", out)
        assert code == 2, arguments
        assert said in told
        assert not out.exists()


def test_a_run_that_has_not_converged_is_refused(calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    project = calibrated.parent / "project.yaml"
    tpe = tmp_path / "tpe"
    code, *_ = run(capsys, "calibrate", project, "--out", tpe, "--no-report", "--method", "tpe", "--trials", 5)
    assert code == 0
    code, _, told = run(capsys, "intervals", tpe)
    assert code == 2
    assert "the noise can be estimated only at a minimum of the loss" in told
    assert "least-squares" in told


def test_damaged_files_are_named(studied: tuple[Path, str], tmp_path: Path):
    folder, by = studied
    shutil.copytree(default_folder(folder, by), tmp_path / "study")
    text = (tmp_path / "study" / POINTS).read_text(encoding="utf-8")
    (tmp_path / "study" / POINTS).write_text(text.replace(text.splitlines()[1].split(",")[0], "x", 1), encoding="utf-8")
    with pytest.raises(StorageError, match="'x' stands in the place of a number"):
        INTERVALS.read(tmp_path / "study")
    (tmp_path / "study" / INTERVALS.file).write_text("{}", encoding="utf-8")
    with pytest.raises(StorageError, match="the interval study"):
        INTERVALS.read(tmp_path / "study")


def test_python_and_the_command_line_have_the_same_defaults():
    python = inspect.signature(intervals).parameters
    command = inspect.signature(study_commands.intervals).parameters
    # Without --workers the executor of --on chooses their number: on this machine one, as in Python.
    for name in set(python) & set(command) - {"path", "out", "workers"}:
        assert python[name].default == command[name].default, name
    with softcal.executor_on(command["on"].default, command["workers"].default) as executor:
        assert executor.count == python["workers"].default
    assert softcal.intervals is intervals
