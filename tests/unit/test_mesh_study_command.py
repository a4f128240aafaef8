"""`softcal mesh-study`: of a run and of a project, its files, and the section of the report."""

from __future__ import annotations

import csv
import inspect
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from changed_trials import undigest
from command_line import run
from project_case import MODULUS, write_project

import softcal
from softcal.analysis.mesh_study import UNKNOWNS
from softcal.cli import main
from softcal.cli.commands import mesh_study_command
from softcal.report.figure import report_pictures
from softcal.report.figures.mesh_study import drawn_parameters
from softcal.report.html import render_page
from softcal.report.section import all_tables
from softcal.workflows.mesh_study import MESH_STUDY, study
from softcal.workflows.reporting import report_content
from softcal.workflows.run_folder import load_run
from softcal.workflows.study_source import study_source


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bar")
    with pytest.raises(SystemExit):
        main(["calibrate", str(write_project(folder)), "--out", str(folder / "run"), "--no-report"])
    return folder / "run"


@pytest.fixture(scope="module")
def studied(calibrated: Path) -> Path:
    with pytest.raises(SystemExit) as ended:
        main(["mesh-study", str(calibrated)])
    assert not ended.value.code
    return calibrated


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_a_run_is_studied_in_its_folder_and_nothing_is_overwritten(
    studied: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    assert sorted(path.name for path in (studied / MESH_STUDY.folder).iterdir()) == [
        "changes.csv", "mesh-study.json", "parameters.csv",
    ]  # fmt: skip
    before = (studied / MESH_STUDY.folder / "mesh-study.json").read_bytes()

    def never(*arguments: object, **options: object) -> None:
        raise AssertionError("it must be refused before anything is simulated")

    monkeypatch.setattr("softcal.workflows.mesh_study.study_problem", never)
    code, _, told = run(capsys, "mesh-study", studied)
    assert code == 2
    assert "the folder is not empty, and nothing is overwritten" in told
    assert (studied / MESH_STUDY.folder / "mesh-study.json").read_bytes() == before


@pytest.mark.slow
def test_the_files_hold_every_discretisation(studied: Path):
    record = json.loads((studied / MESH_STUDY.folder / "mesh-study.json").read_text(encoding="utf-8"))
    assert record["calibration"] == "pull"
    assert "The mesh makes bar.youngs_modulus too low by" in record["sentences"][0]
    names = [one["name"] for one in record["study"]["finer"]]
    assert names[:4] == ["P2P1", "h/2", "h/4", "P2P1 h/2"]
    parameters = rows(studied / MESH_STUDY.folder / "parameters.csv")
    assert {row["discretisation"] for row in parameters} == set(names)
    modulus = next(r for r in parameters if (r["discretisation"], r["parameter"]) == ("h/2", "bar.youngs_modulus"))
    assert float(modulus["found"]) == pytest.approx(MODULUS, rel=1e-3)
    assert float(modulus["expected"]) > 1.1 * MODULUS
    assert float(modulus["shift"]) == pytest.approx(float(modulus["expected"]) - float(modulus["found"]))
    changes = rows(studied / MESH_STUDY.folder / "changes.csv")
    first = next(row for row in changes if (row["discretisation"], row["of"]) == ("h/2", "tension"))
    assert float(first["relative [1]"]) < -0.1
    assert float(first["noise sd"]) == pytest.approx(0.05)


def test_a_study_is_read_back_as_it_was(studied: Path):
    stored = MESH_STUDY.read(studied / MESH_STUDY.folder)
    assert stored is not None
    assert stored.is_of(load_run(studied).results)
    assert stored.study.best is not None
    assert stored.study.best.name == "P2P1 h/2"
    assert stored.study.parameters["bar.youngs_modulus"].interval is not None
    assert MESH_STUDY.read(studied) is None


@pytest.mark.slow
def test_the_table_fits_eighty_columns(
    calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("softcal.cli.printing.LOG_WIDTH", 80)
    code, told, _ = run(capsys, "mesh-study", calibrated, "--halvings", 1, "--out", tmp_path / "study")
    assert code == 0
    table = [line for line in told.splitlines() if line and line[0] in "┏┃┡│├└"]
    assert max(map(len, table)) <= 80
    for expected in ("original", "P2P1 h/2", "tension", "pitch", "bar.youngs_modulus", "s.e.)", "front.slack[pull]"):
        assert expected in told, expected
    assert "This error exceeds the noise: use P2P1 elements or a finer mesh" in told
    assert "Add it to the report" not in told
    assert (tmp_path / "study" / "mesh-study.json").is_file()


def test_the_report_of_a_run_tells_its_study(studied: Path, monkeypatch: pytest.MonkeyPatch):
    from softcal.workflows import reporting

    monkeypatch.setattr(reporting, "twin_view", lambda *_: None)
    monkeypatch.setattr(reporting, "_landscapes", lambda *_: {})
    content = report_content(load_run(studied))
    assert content.mesh_study is not None
    (picture,) = [one for one in report_pictures(content) if one.section == "mesh"]
    assert picture.name == "mesh-study"
    assert drawn_parameters(content.mesh_study) == ["bar.youngs_modulus", "front.slack[pull]"]
    still = replace(content.mesh_study.parameters["front.slack[pull]"], interval=None)
    held = {**content.mesh_study.parameters, "front.slack[pull]": still}
    finer = tuple(
        replace(one, values={**one.values, "front.slack[pull]": still.value}) for one in content.mesh_study.finer
    )
    assert drawn_parameters(replace(content.mesh_study, parameters=held, finer=finer)) == ["bar.youngs_modulus"]
    tables = all_tables(content)
    assert len(tables["mesh-study"].rows) == 2 * len(content.mesh_study.finer)
    page = render_page(content, [picture])
    assert "What the mesh contributes" in page
    assert "The mesh makes bar.youngs_modulus too low by" in page


def test_a_study_of_other_values_is_not_told_as_this_runs(
    studied: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from softcal.workflows import reporting

    monkeypatch.setattr(reporting, "twin_view", lambda *_: None)
    monkeypatch.setattr(reporting, "_landscapes", lambda *_: {})
    copied = tmp_path / "run"
    shutil.copytree(studied, copied)
    path = copied / MESH_STUDY.folder / "mesh-study.json"
    record = json.loads(path.read_text(encoding="utf-8"))
    modulus = record["study"]["parameters"]["bar.youngs_modulus"]
    modulus["value"] *= 1.01
    modulus["interval"] = [1.01 * end for end in modulus["interval"]]
    path.write_text(json.dumps(record), encoding="utf-8")
    undigest(path)
    content = report_content(load_run(copied))
    assert content.mesh_study is None
    page = render_page(content, [])
    assert "is not of the calibrated values" in page
    shutil.rmtree(copied / MESH_STUDY.folder)
    assert "What the mesh contributes" not in render_page(report_content(load_run(copied)), [])


@pytest.mark.parametrize("text", ["{", '{"format": 1}', '{"format": 7}'], ids=["broken", "not whole", "other"])
def test_a_broken_study_is_told_by_its_path(studied: Path, tmp_path: Path, text: str):
    from softcal.errors import StorageError

    (tmp_path / "mesh-study.json").write_text(text, encoding="utf-8")
    with pytest.raises(StorageError, match=r"mesh-study\.json"):
        MESH_STUDY.read(tmp_path)


def test_a_project_is_studied_at_its_parameters_and_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write_project(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    code, told, _ = run(capsys, "mesh-study", path, "--halvings", 1, "--unknowns", 2000, "--set", "front.slack=1.5mm")
    assert code == 0
    assert re.search(r"\b2\.0* ± ", told)  # MPa, as the project has it
    assert "Not simulated, P2P1 h/2" in told
    assert "more than the limit of 2,000" in told
    assert sorted(tmp_path.rglob("*")) == before


def test_another_engine_is_noted(calibrated: Path, tmp_path: Path):
    copied = tmp_path / "run"
    shutil.copytree(calibrated, copied, ignore=shutil.ignore_patterns(MESH_STUDY.folder))
    assert study_source(copied).notes == ()
    path = copied / "calibrations" / "pull" / "result.json"
    record = json.loads(path.read_text(encoding="utf-8"))
    record["hashes"]["engine"] = "sofa"
    path.write_text(json.dumps(record), encoding="utf-8")
    undigest(path)
    (note,) = study(study_source(copied), halvings=1, max_unknowns=100).notes
    assert note == "The calibration was computed by sofa, the study by softcal."


def test_the_present_values_are_those_of_each_experiment(tmp_path: Path):
    source = study_source(write_project(tmp_path, ("  pull:\n", "  pull:\n    slack: 3 mm\n")))
    assert source.theta == {"bar.youngs_modulus": 2.0e6, "front.slack[pull]": 0.003}
    assert source.calibration == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--element", "P3"], "this is not a higher-order element; got 'P3'; allowed: P2, P2P1"),
        (["--element", "P1"], "this is not a higher-order element"),
        (["--halvings", "4"], "this number of halvings is not allowed"),
        (["--unknowns", "0"], "the limit of unknowns must be positive"),
        (["--calibration", "joint"], "a project file holds no calibrations"),
        (["--set", "bar.youngs_modulus=50MPa", "--set", "front.slack=1mm"], "there is no free parameter"),
    ],
)
def test_bad_input_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str):
    code, _, told = run(capsys, "mesh-study", write_project(tmp_path), *arguments)
    assert code == 2
    assert message in told


def test_values_outside_their_bounds_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write_project(tmp_path, ("bounds: [0 mm, 5 mm]", "bounds: [1 mm, 5 mm]"))
    code, _, told = run(capsys, "mesh-study", path)
    assert code == 2
    assert "front.slack[pull]: the present value is outside its bounds; got 0 m" in told


def test_nothing_finer_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write_project(tmp_path, ("element: P1", "element: P2P1"))
    code, _, told = run(capsys, "mesh-study", path, "--halvings", 0)
    assert code == 2
    assert "no refinement is requested" in told


def test_what_is_no_calibration_is_refused(calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    for arguments, message in (
        ((calibrated, "--calibration", "joint", "--out", tmp_path / "a"), "the run has no such calibration"),
        (
            (calibrated, "--set", "bar.youngs_modulus=2MPa", "--out", tmp_path / "b"),
            "a run has its calibrated values",
        ),
        ((tmp_path,), "there is no run here"),
    ):
        code, _, told = run(capsys, "mesh-study", *arguments)
        assert code == 2
        assert message in told


def test_a_sweep_has_no_optimum(calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    softcal.sweep(load_run(calibrated).project, over={"bar.youngs_modulus": ["1 MPa", "2 MPa"]}, out=tmp_path / "run")
    code, _, told = run(capsys, "mesh-study", tmp_path / "run", "--out", tmp_path / "study")
    assert code == 2
    assert "a sweep has no optimum to study" in told


def test_the_limit_of_the_command_is_that_of_the_study():
    assert inspect.signature(mesh_study_command.mesh_study).parameters["unknowns"].default == UNKNOWNS


def test_in_python(calibrated: Path, tmp_path: Path):
    found = softcal.mesh_study(calibrated, halvings=1, max_unknowns=2000, out=tmp_path / "study")
    stored = MESH_STUDY.read(tmp_path / "study")
    assert stored is not None
    assert stored.study == found
    with pytest.raises(softcal.StorageError, match="nothing is overwritten"):
        softcal.mesh_study(calibrated, out=tmp_path / "study")
