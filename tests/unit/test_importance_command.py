"""`softcal importance`: of a run and of a project, its files, and its place in the report."""

from __future__ import annotations

import csv
import inspect
import json
import shutil
from pathlib import Path

import pytest
from changed_trials import undigested
from command_line import run
from project_case import write_project

import softcal
from softcal.analysis.importance import SIMULATIONS
from softcal.cli import main
from softcal.cli.commands import study_commands
from softcal.errors import StorageError
from softcal.report.figure import report_pictures
from softcal.report.html import render_page
from softcal.report.section import all_tables
from softcal.workflows.importance import IMPORTANCE, INDICES
from softcal.workflows.reporting import report_content
from softcal.workflows.run_folder import load_run

E, SLACK = "bar.youngs_modulus", "front.slack[pull]"
NARROW = ("[0.1 MPa, 40 MPa]", "[0.5 MPa, 4 MPa]")


@pytest.fixture(scope="module")
def studied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run by trials, with its importance study."""
    folder = tmp_path_factory.mktemp("bar")
    project = str(write_project(folder, NARROW))
    with pytest.raises(SystemExit):
        main(["calibrate", project, "--method", "tpe", "--trials", "12", "--out", str(folder / "run"), "--no-report"])
    with pytest.raises(SystemExit) as ended:
        main(["importance", str(folder / "run")])
    assert not ended.value.code
    return folder / "run"


@pytest.mark.slow
def test_a_run_is_studied_in_its_folder_beside_fanova(studied: Path, capsys: pytest.CaptureFixture[str]):
    stored = IMPORTANCE.read(studied / IMPORTANCE.folder)
    assert stored is not None
    results = load_run(studied).results
    assert stored.is_of(results)
    assert stored.study.fanova == pytest.approx(dict(results["pull"].importance))
    assert set(stored.study.outputs) == {"loss", "tension", "pitch"}
    record = json.loads((studied / IMPORTANCE.folder / IMPORTANCE.file).read_text(encoding="utf-8"))
    assert any(E in one and "tension" in one for one in record["sentences"])
    with (studied / IMPORTANCE.folder / INDICES).open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 5
    indices = stored.study.outputs["pitch"].total
    (held,) = (r for r in rows if (r["output"], r["order"], r["parameter"]) == ("pitch", "total", SLACK))
    assert float(held["index [1]"]) == pytest.approx(indices[SLACK].value)
    assert IMPORTANCE.read(studied) is None
    code, _, message = run(capsys, "importance", studied)
    assert code == 2
    assert "the folder is not empty" in message


@pytest.mark.slow
def test_the_report_shows_it_while_the_bounds_are_the_same(studied: Path, tmp_path: Path):
    content = report_content(load_run(studied))
    table = all_tables(content)["importance"]
    assert len(table.rows) == 3 * 2
    assert [row[4] is not None for row in table.rows] == [True] * 2 + [False] * 4
    (picture,) = report_pictures(content, ["importance"])
    assert "fANOVA" in picture.caption
    page = render_page(content, [picture])
    assert "What decides each output" in page
    assert f"{E} and {SLACK}" in page or "these explain alone" in page
    other = tmp_path / "run"
    shutil.copytree(studied, other)
    path = other / IMPORTANCE.folder / IMPORTANCE.file
    record = undigested(json.loads(path.read_text(encoding="utf-8")))
    record["study"]["ranges"][E]["upper"] *= 2
    path.write_text(json.dumps(record), encoding="utf-8")
    content = report_content(load_run(other))
    assert content.importance is None
    assert "not over the bounds of the search" in content.importance_note
    path.write_text(path.read_text(encoding="utf-8").replace('"facts"', '"fakts"'), encoding="utf-8")
    with pytest.raises(StorageError, match="importance study"):
        IMPORTANCE.read(other / IMPORTANCE.folder)


@pytest.mark.slow
def test_a_project_is_studied_before_any_calibration(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    project = write_project(tmp_path, NARROW)
    code, out, _ = run(capsys, "importance", project, "--out", tmp_path / "study")
    assert code == 0
    assert "with others" in out
    assert "fANOVA" not in out
    assert "evaluations" in out
    assert "Error of the surrogate" in out
    assert (tmp_path / "study" / INDICES).is_file()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--set", "bar.youngs_modulus=1MPa"], "one parameter explains everything"),
        (["--simulations", "0"], "simulations"),
        (["--workers", "0"], "--workers"),
        (["--calibration", "joint"], "holds no calibrations"),
    ],
)
def test_bad_input_ends_with_a_sentence_and_no_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
):
    project = write_project(tmp_path, NARROW)
    code, _, error = run(capsys, "importance", project, "--out", tmp_path / "study", *options)
    assert code == 2
    assert message in error
    assert not (tmp_path / "study").exists()


def test_the_defaults_are_those_of_the_library():
    of_command = inspect.signature(study_commands.importance).parameters
    of_library = inspect.signature(softcal.importance).parameters
    assert of_command["simulations"].default == SIMULATIONS == of_library["simulations"].default
    assert of_command["seed"].default == of_library["seed"].default
