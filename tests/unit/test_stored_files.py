"""Stored files that are damaged: every command that reads one ends with a sentence and exit code 2."""

from __future__ import annotations

import contextlib
import copy
import csv
import io
import json
import pickle
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_trials import change_trials, undigest, undigested
from project_case import write_project

import softcal
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.results.store import RECORD, write_text
from softcal.calibration.results.stored import digest, read_rows
from softcal.calibration.results.trial_journal import JOURNAL, stored_trials
from softcal.cli import main
from softcal.csv_text import csv_text, plain
from softcal.errors import StorageError
from softcal.experiments.table import load_table
from softcal.experiments.table_format import TableFormat
from softcal.report.write import write_files
from softcal.workflows.mesh_study import MESH_STUDY
from softcal.workflows.run_folder import load_run

STORE = "calibrations/pull"
RESULT = f"{STORE}/result.json"


def write_study(folder: Path) -> None:
    estimate = {
        "value": 1e6,
        "unit": "Pa",
        "at_bound": False,
        "lower": 1e5,
        "upper": 4e7,
        "standard_error": 1e4,
        "interval": [9e5, 1.1e6],
        "of": [],
    }
    size = {"tets": 192, "rod_elements": 0, "unknowns": 300}
    change = {
        "experiment": "pull",
        "name": "tension",
        "unit": "N",
        "rms": 0.1,
        "share": -0.1,
        "noise": 0.05,
        "residual": 0.04,
        "magnitude": 1.0,
        "n": 25,
        "order": None,
    }
    finer = {
        "name": "P2P1",
        "what": "quadratic",
        "size": size,
        "failure": "",
        "loss": 1.0,
        "reachable": 0.5,
        "changes": [change],
        "values": {"bar.youngs_modulus": 9e5},
        "at_bound": [],
        "n_factorisations": 9,
        "seconds": 1.0,
    }
    study = {
        "parameters": {"bar.youngs_modulus": estimate},
        "of_robot": ["bar.youngs_modulus"],
        "loss": 1.0,
        "loss_name": "papers",
        "elements": ["P1"],
        "element": "P2P1",
        "size": size,
        "finer": [finer],
        "reference": "P2P1",
        "notes": [],
    }
    folder.mkdir()
    (folder / "mesh-study.json").write_text(json.dumps({"format": 1, "study": study, "calibration": "pull"}))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project, two runs of it that have ended, by squares and by TPE, and a mesh study."""
    folder = tmp_path_factory.mktemp("stored")
    path = write_project(folder / "p")
    for name, options in (("run", ()), ("tpe", ("--method", "tpe", "--trials", "4"))):
        with pytest.raises(SystemExit) as left:
            main(["calibrate", str(path), "--out", str(folder / name), "--no-report", *options])
        assert not left.value.code
    write_study(folder / "study")
    return folder


@pytest.fixture
def run(finished: Path, tmp_path: Path) -> Path:
    """A copy of the run, to be damaged."""
    return Path(shutil.copytree(finished / "run", tmp_path / "run"))


def outcome(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    with pytest.raises(SystemExit) as left:
        main([str(argument) for argument in arguments])
    err = capsys.readouterr().err
    assert "Traceback" not in err
    return int(left.value.code or 0), err


def resume(capsys: pytest.CaptureFixture[str], finished: Path, run: Path, *options: str) -> tuple[int, str]:
    return outcome(
        capsys, "calibrate", finished / "p" / "project.yaml", "--out", run, "--resume", "--no-report", *options
    )


@pytest.mark.slow
def test_the_files_are_read_as_they_were_written(
    capsys: pytest.CaptureFixture[str], finished: Path, run: Path, tmp_path: Path
) -> None:
    """What every case below damages is whole."""
    assert load_run(run).results["pull"].loss == load_result(run / STORE).loss
    assert MESH_STUDY.read(finished / "study") is not None
    assert resume(capsys, finished, run)[0] == 0
    tpe = shutil.copytree(finished / "tpe", tmp_path / "tpe")
    assert resume(capsys, finished, tpe, "--method", "tpe", "--trials", "4")[0] == 0


def test_a_result_of_an_earlier_version_is_read(run: Path) -> None:
    """Its file has no format, and no key without a value."""
    after = load_result(run / STORE)
    document = undigested(json.loads((run / RESULT).read_text()))
    for part in ("parameters", "experiments"):
        for entry in document[part].values():
            for key in [key for key, value in entry.items() if value in (None, [], {})]:
                del entry[key]
    del document["format"]
    (run / RESULT).write_text(json.dumps(document))
    before = load_result(run / STORE)
    assert before.parameters == after.parameters
    assert before.experiments["pull"].rmse == after.experiments["pull"].rmse


def leaves(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The place of every value in a JSON document, mappings and lists among them."""
    if path:
        yield path
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        yield from leaves(entry, (*path, key))


def with_value(document: Any, path: tuple[str | int, ...], value: object) -> Any:
    document = copy.deepcopy(document)
    here = document
    for key in path[:-1]:
        here = here[key]
    here[path[-1]] = value
    return document


def of_another_type(value: object) -> list[object]:
    """Values of the types that JSON has, but for the value's own, and numbers that are none."""
    if isinstance(value, bool):
        return [1, "false", None, []]
    if isinstance(value, int | float):
        return [str(value), True, [value], {"value": value}, float("nan"), float("inf")]
    if isinstance(value, str):
        return [1.0, [value], {"value": value}]
    if isinstance(value, dict):
        return [list(value), "text", 1]
    return [{"0": value}, "text", 1] if isinstance(value, list) else []


# Where any value may be: what is only shown, and lists of text of any length.
FREE = {"project"}
DOCUMENTS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "the record of a run": ("run/run.json", load_run),
    "a result": (f"run/{RESULT}", lambda folder: load_result(folder / STORE)),
    "a mesh study": ("study/mesh-study.json", MESH_STUDY.read),
}


@pytest.mark.parametrize("name", DOCUMENTS)
def test_a_value_of_another_type_anywhere_in_a_record_is_refused(name: str, finished: Path, tmp_path: Path) -> None:
    """Some hundred cases: each value of the file in turn, each type that it does not have."""
    file, read = DOCUMENTS[name]
    folder = shutil.copytree(finished / file.split("/")[0], tmp_path / "copy")
    target = folder / file.partition("/")[2]
    document = undigested(json.loads(target.read_text()))
    accepted: list[str] = []
    n = 0
    for path in leaves(document):
        value: Any = document
        for key in path:
            value = value[key]
        if path[0] in FREE:
            continue
        for other in of_another_type(value):
            if path == ("converged",) and other is None:  # of a search that looks for no minimum
                continue
            n += 1
            target.write_text(json.dumps(with_value(document, path, other)))
            with contextlib.suppress(StorageError):
                read(folder)
                accepted.append(f"{path}: {other!r} for {value!r}")
    assert n > 80
    assert not accepted


@pytest.mark.parametrize("name", DOCUMENTS)
def test_a_key_that_is_missing_is_refused(name: str, finished: Path, tmp_path: Path) -> None:
    file, read = DOCUMENTS[name]
    folder = shutil.copytree(finished / file.split("/")[0], tmp_path / "copy")
    target = folder / file.partition("/")[2]
    document = undigested(json.loads(target.read_text()))
    optional = {"project", "sentences", "changes", *(("format", "residuals") if "result" in name else ())}
    refused = 0
    for key in document:
        if key in optional:
            continue
        target.write_text(json.dumps({other: value for other, value in document.items() if other != key}))
        if key in ("hashes", "versions") and "study" in name:
            continue
        with pytest.raises(StorageError, match=f"{key}: field required"):
            read(folder)
        refused += 1
    assert refused >= 3


TEXTS: dict[str, bytes] = {
    "empty": b"",
    "half": b'{"format": 1, "values": {',
    "not text": bytes(range(256)),
    "zeros": bytes(4096),
    "a list": b"[]",
    "null": b"null",
    "UTF-16": '{"format": 1}'.encode("utf-16"),
    "another format": b'{"format": 2}',
    "a format of text": b'{"format": "1"}',
    "a format of half": b'{"format": 1.5}',
    "no format": b'{"settings": {}}',
    "an integer of 5,000 digits": b'{"format": ' + b"9" * 5000 + b"}",
    "nested too deep": b'{"format": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
    "not JSON": b"softcal: 1",
    "two documents": b'{"format": 1}{"format": 1}',
}


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("file", ["run/run.json", f"run/{STORE}/run.json", f"run/{RESULT}", "study/mesh-study.json"])
def test_a_record_that_is_none_is_refused(
    file: str, text: str, capsys: pytest.CaptureFixture[str], finished: Path, tmp_path: Path
) -> None:
    first, _, inside = file.partition("/")
    folder = shutil.copytree(finished / first, tmp_path / "copy")
    (folder / inside).write_bytes(TEXTS[text])
    if first == "study":
        with pytest.raises(StorageError, match="mesh study"):
            MESH_STUDY.read(folder)
        return
    reading = f"{STORE}/run.json" == inside
    code, err = resume(capsys, finished, folder) if reading else outcome(capsys, "report", folder)
    assert code == 2
    assert str(folder / inside) in err


@pytest.mark.parametrize(
    "command",
    [
        ("report",),
        ("mesh-study",),
        ("crosscheck",),
        ("export", "sofa"),
        ("export", "vtk"),
        ("export", "reduced", "--reach", "front=1 N"),
        ("export", "calculix"),
    ],
    ids=" ".join,
)
@pytest.mark.parametrize("file", ["run.json", RESULT, f"{STORE}/trials.csv", f"{STORE}/response-pull.csv"])
def test_every_command_that_reads_a_run_refuses_a_damaged_one(
    file: str, command: tuple[str, ...], capsys: pytest.CaptureFixture[str], run: Path, tmp_path: Path
) -> None:
    whole = (run / file).read_bytes()
    (run / file).write_bytes(whole[: len(whole) // 2])
    before = sorted(tmp_path.rglob("*"))
    code, err = outcome(capsys, *command, run, "--out", tmp_path / "out")
    assert code == 2, err
    assert str(run) in err
    assert sorted(tmp_path.rglob("*")) == before


def without_line(text: str) -> str:
    lines = text.splitlines(keepends=True)
    return "".join(lines[:-1])


def in_cell(row: int, column: int, value: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        lines = text.splitlines()
        cells = lines[row].split(",")
        cells[column] = value
        lines[row] = ",".join(cells)
        return "\n".join(lines) + "\n"

    return change


TABLES: dict[str, tuple[str, Callable[[str], str]]] = {
    **{
        f"{value!r} in row {row}, column {column} of {file}": (file, in_cell(row, column, value))
        for file, column, values in (
            ("trials.csv", 0, ("", "x", "1.5", "-1", "nan")),
            ("trials.csv", 1, ("", "RUNNING", "FAILED", "complete")),
            ("trials.csv", 2, ("", "x", "nan", "inf", "1e400", "0")),
            ("trials.csv", 3, ("", "x", "nan", "-1")),
            ("trials.csv", 4, ("", "x", "0.5", "-3")),
            ("trials.csv", 6, ("", "x", "nan", "-inf", "0")),
            ("response-pull.csv", 1, ("", "x", "nan", "inf", "1e999", "0x1p3", "1,5")),
        )
        for value in values
        for row in (-1,)
    },
    "a simulated value that is another": ("response-pull.csv", in_cell(-1, -5, "0.5")),
    "a measured value that is another": ("response-pull.csv", in_cell(-1, -8, "77")),
    "a band that is no number": ("response-pull.csv", in_cell(-1, -1, "nan")),
    "a simulated channel in another unit": (
        "response-pull.csv",
        lambda text: text.replace("simulated.tension [N]", "simulated.tension [kN]"),
    ),
    "a channel in another unit": ("response-pull.csv", lambda text: text.replace("tension [N]", "tension [kN]")),
    "a channel without its unit": ("response-pull.csv", lambda text: text.replace("[rad]", "[]")),
    "a parameter in another unit": ("trials.csv", lambda text: text.replace("modulus [Pa]", "modulus [MPa]")),
    "a trial twice": ("trials.csv", lambda text: text + text.splitlines()[-1] + "\n"),
    "a trial less": ("trials.csv", without_line),
    "a sample less": ("response-pull.csv", without_line),
    "no samples": ("response-pull.csv", lambda text: text.splitlines()[0] + "\n"),
    "no trials": ("trials.csv", lambda text: text.splitlines()[0] + "\n"),
    "an empty table": ("response-pull.csv", lambda text: ""),
    "a column twice": (
        "response-pull.csv",
        lambda text: text.replace("front.shortening", "front.tension").replace("[m]", "[N]", 1),
    ),
    "another column": ("trials.csv", lambda text: text.replace("state", "estate", 1)),
    "a channel that is not there": (
        "response-pull.csv",
        lambda text: text.replace("simulated.pitch", "simulated.roll"),
    ),
    "a NUL": ("response-pull.csv", lambda text: text.replace(".", "\0", 9)),
    "a cell too many": ("trials.csv", lambda text: text.rstrip("\n") + ",1\n"),
    "an open quote": ("trials.csv", lambda text: text.replace(",COMPLETE", ',"COMPLETE', 1)),
    "a huge field": ("trials.csv", lambda text: text.replace("COMPLETE", "C" * 200_000, 1)),
}


@pytest.mark.parametrize("case", TABLES)
def test_a_damaged_table_of_a_result_is_refused(case: str, finished: Path, tmp_path: Path) -> None:
    file, change = TABLES[case]
    folder = shutil.copytree(finished / "run" / STORE, tmp_path / "copy")
    text = (folder / file).read_text()
    assert change(text) != text
    (folder / file).write_text(change(text))
    with pytest.raises(StorageError, match=r"the result cannot be read"):
        load_result(folder)


VALUES: dict[str, tuple[tuple[str | int, ...], object]] = {
    "a value below its bounds": (("parameters", "bar.youngs_modulus", "value"), 5.0),
    "a value that no trial has": (("parameters", "bar.youngs_modulus", "value"), 1.4e6),
    "bounds reversed": (("parameters", "bar.youngs_modulus", "lower"), 1e9),
    "a standard error below zero": (("parameters", "bar.youngs_modulus", "standard_error"), -1.0),
    "a value in another unit": (("parameters", "bar.youngs_modulus", "unit"), "MPa"),
    "a value without its unit": (("parameters", "bar.youngs_modulus", "unit"), ""),
    "a logarithm of a bound below zero": (("parameters", "bar.youngs_modulus", "lower"), -5.0),
    "degrees of freedom below zero": (("parameters", "bar.youngs_modulus", "dof"), -3.0),
    "shares of more than the whole": (("parameters", "bar.youngs_modulus", "shares"), {"noise": -8.0, "mesh": 9.0}),
    "a loss of a place that is none": (("parameters", "bar.youngs_modulus", "profile"), [[-3.0, 1.0], [2e6, 1.0]]),
    "an interval reversed": (("parameters", "bar.youngs_modulus", "interval"), [2e6, 1e6]),
    "an interval beside its value": (("parameters", "bar.youngs_modulus", "interval"), [3e6, 4e6]),
    "an interval beyond its bounds": (("parameters", "bar.youngs_modulus", "interval"), [1e3, 4e7]),
    "a standard error without its interval": (("parameters", "bar.youngs_modulus", "interval"), None),
    "a loss that no trial has": (("loss",), 0.5),
    "an error that its table does not give": (("experiments", "pull", "tension_rmse"), 0.5),
    "an error that is null": (("experiments", "pull", "tension_rmse"), None),
    "failed trials that are none": (("n_failed_trials",), 3),
    "a count below zero": (("n_solves",), -1),
    "a time below zero": (("wall_s",), -1.0),
    "a table elsewhere": (("experiments", "pull", "file"), "../../../../etc/passwd"),
    "a detrended error that its table does not give": (("experiments", "pull", "tension_rmse_detrended"), 0.5),
    "another seed than that of the settings": (("seed",), 77),
    "another method than that of the settings": (("method",), "tpe"),
    "more importance than the whole": (("importance", "bar.youngs_modulus"), 1.5),
    "no residuals": (("residuals", "pull", "pitch", "n"), 0),
    "a correlation above one": (("residuals", "pull", "pitch", "correlation"), 1.2),
    "runs below zero": (("residuals", "pull", "pitch", "runs"), -4),
    "residuals of a size below zero": (("residuals", "pull", "pitch", "size"), -1.0),
    "residuals beyond the record": (("residuals", "pull", "pitch", "largest"), 1.5),
    "a share of residuals above one": (("residuals", "pull", "pitch", "explained"), {"an offset": 1.5}),
    "a sample before the first": (("residuals", "pull", "pitch", "outliers"), [-26]),
    "no parameters": (("parameters",), {}),
    "no experiments": (("experiments",), {}),
    "a format of the future": (("format",), 2),
}


@pytest.mark.parametrize("case", VALUES)
def test_a_value_that_contradicts_the_others_is_refused(case: str, finished: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(finished / "run" / STORE, tmp_path / "copy")
    path, value = VALUES[case]
    document = undigested(json.loads((folder / "result.json").read_text()))
    (folder / "result.json").write_text(json.dumps(with_value(document, path, value)))
    with pytest.raises(StorageError, match=r"the result (cannot be read|is of another format; got 2; allowed: 1)"):
        load_result(folder)


PLACES = ["..", "../run", "/etc", "", "pull/../../x", "a\0b"]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("key", ["copies", "calibrations"])
def test_a_run_names_no_place_outside_its_folder(key: str, place: str, run: Path) -> None:
    record = json.loads((run / "run.json").read_text())
    record[key] = {"bar.msh": place} if key == "copies" else [place]
    (run / "run.json").write_text(json.dumps(record))
    with pytest.raises(StorageError, match="a path within the run's folder"):
        load_run(run)


@pytest.mark.parametrize("unit", ["m", "MPa", "<b>"])
def test_units_of_a_result_are_those_of_its_project(unit: str, run: Path) -> None:
    """In both of its files, as somebody who means it changes them."""
    for name in ("result.json", "trials.csv"):
        text = (run / STORE / name).read_text()
        (run / STORE / name).write_text(text.replace('"unit": "Pa"', f'"unit": "{unit}"').replace("[Pa]", f"[{unit}]"))
    undigest(run / RESULT)
    with pytest.raises(
        StorageError, match=r"bar\.youngs_modulus has another unit than in the project; got '.*'; all.*: Pa"
    ):
        load_run(run)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('"scale": "log"', '"scale": "linear"', r"other bounds than in the project; got .*, linear; allowed: .*, log"),
        ('"upper": 40000000.0', '"upper": 50000000.0', r"other bounds than in the project; got 100000 to 5e\+07 Pa"),
        ('"loss_name": "papers"', '"loss_name": "likelihood"', "the loss differs from that of the run; got likelihood"),
    ],
)
def test_bounds_and_loss_of_a_result_are_those_of_its_project(before: str, after: str, message: str, run: Path) -> None:
    path = run / STORE / "result.json"
    assert before in path.read_text()
    path.write_text(path.read_text().replace(before, after))
    undigest(path)
    with pytest.raises(StorageError, match=message):
        load_run(run)


def test_a_result_of_another_runs_experiment_is_refused(run: Path) -> None:
    folder = run / STORE
    (folder / "response-pull.csv").rename(folder / "response-push.csv")
    text = (
        (folder / "result.json").read_text().replace('"pull": {', '"push": {').replace("response-pull", "response-push")
    )
    (folder / "result.json").write_text(text)
    undigest(folder / "result.json")
    with pytest.raises(StorageError, match="an experiment that the run does not have; got push"):
        load_run(run)


# File of a run -> a change of it that contradicts nothing else there, as by an editor.
EDITS: dict[str, tuple[str, Callable[[str], str]]] = {
    "a narrower interval": (
        RESULT,
        lambda text: re.sub(r'(?s)("interval": \[\s*)[\d.]+', r"\g<1>1290000.0", text, count=1),
    ),
    "a smaller standard error": (
        RESULT,
        lambda text: json.dumps(
            with_value(json.loads(text), ("parameters", "front.slack[pull]", "standard_error"), 1e-9)
        ),
    ),
    "other words": (RESULT, lambda text: text.replace("Converged in", "Converged well in")),
    "fewer warnings": (RESULT, lambda text: json.dumps({**json.loads(text), "warnings": [], "notes": []})),
    "the loss of another trial": (
        f"{STORE}/trials.csv",
        lambda text: re.sub(r"(?m)^0,COMPLETE,[^,]*", "0,COMPLETE,7.5", text),
    ),
    "a channel that is not compared": (
        f"{STORE}/response-pull.csv",
        lambda text: re.sub(r"(?m)\A(.*\n)[^,]*", r"\g<1>0.5", text),
    ),
    "the headline": ("result.json", lambda text: re.sub(r'"value": [\d.]+', '"value": 2000000.0', text, count=1)),
    "the record": ("run.json", lambda text: text.replace('"values": {}', '"values": {"bar.poissons_ratio": 0.3}')),
}


@pytest.mark.parametrize("case", EDITS)
def test_a_run_that_was_edited_is_refused_by_the_name_of_the_file(case: str, run: Path) -> None:
    """Its numbers agree with each other, and nobody computed them."""
    file, edit = EDITS[case]
    text = (run / file).read_text()
    (run / file).write_text(edit(text))
    assert (run / file).read_text() != text
    with pytest.raises(StorageError, match=rf"{re.escape(file)}: the .* was changed after it was written"):
        load_run(run)


def test_a_record_that_another_program_has_laid_out_is_the_same(run: Path) -> None:
    """Its keys in another order, without blanks, and whole numbers without a point."""
    before = load_run(run)
    document = json.loads(
        (run / RESULT).read_text(),
        parse_float=lambda text: int(float(text)) if float(text).is_integer() else float(text),
    )
    (run / RESULT).write_text(json.dumps(document, sort_keys=True, separators=(",", ":")))
    assert load_run(run).results["pull"].parameters == before.results["pull"].parameters


@pytest.mark.parametrize(
    "tables", [{"../run.json": "0"}, {"": "0"}, {"..": "0"}, {"a\0b": "0"}, {"trials.csv": 7}, {"x.csv": "0"}]
)
def test_tables_that_a_record_names_are_files_beside_it(tables: dict[str, object], run: Path) -> None:
    document = {**undigested(json.loads((run / RESULT).read_text())), "tables": tables}
    (run / RESULT).write_text(json.dumps({**document, "sha256": digest(document)}))
    with pytest.raises(StorageError, match="the result was changed after it was written"):
        load_run(run)


def test_a_trial_of_a_journal_that_was_edited_is_refused(run: Path) -> None:
    path = run / STORE / "optuna.journal"
    text = path.read_text()
    path.write_text(re.sub(r'"value": ?[\d.e-]+', '"value": 1e-09', text, count=1))
    assert path.read_text() != text
    with pytest.raises(StorageError, match="trial 0 was changed after it was told"):
        stored_trials(run / STORE)


def set_attribute(name: str, value: object) -> Callable[[dict[str, Any]], object]:
    return lambda trial: trial["user_attrs"].update({name: value})


def set_entry(name: str, value: object) -> Callable[[dict[str, Any]], object]:
    return lambda trial: trial.update({name: value})


ROWS: dict[str, Callable[[dict[str, Any]], object]] = {
    "theta that is none": set_entry("params", None),
    "theta that is a list": set_entry("params", [1]),
    "theta of text": set_entry("params", {"bar.youngs_modulus": "1"}),
    "theta of another point": set_entry("params", {"bar.youngs_modulus": 1e6}),
    "NaN in theta": set_entry("params", {"bar.youngs_modulus": float("nan")}),
    "theta without its distribution": set_entry("distributions", {}),
    "a distribution that is none": set_entry("distributions", {"bar.youngs_modulus": "none"}),
    "an unknown state": set_entry("state", 9),
    "a trial that is not at its end": set_entry("state", 0),
    "a trial that was given up": set_entry("state", 2),
    "a failed trial with a loss": set_entry("state", 3),
    "no loss": set_entry("value", None),
    "an infinite loss": set_entry("value", float("inf")),
    "a loss of text": set_entry("value", "low"),
    "another loss": lambda trial: trial.update(value=trial["value"] + 1),
    "a time that is none": set_entry("datetime_start", "yesterday"),
    "a trial of no study": set_entry("study_id", 7),
    "a number twice": set_attribute("number", 0),
    "a number below zero": set_attribute("number", -1),
    "no attributes": set_entry("user_attrs", {}),
    "a reason that is none": set_attribute("reason", None),
    "seconds below zero": set_attribute("seconds", -1),
    "seconds of text": set_attribute("seconds", "long"),
    "solves of text": set_attribute("n_solves", "many"),
    "solves below zero": set_attribute("n_solves", -4),
    "solves of half": set_attribute("n_factorisations", 0.5),
    "losses that are none": set_attribute("experiment_losses", ""),
    "errors that are none": set_attribute("errors", {"pull": 1}),
    "an elapsed time that is infinite": set_attribute("elapsed", float("inf")),
    "arrays that are not kept": set_attribute("arrays", False),
    "arrays of text": set_attribute("arrays", "arrays"),
}
# Nothing is missed where trials are lost, if the search asks for the same points again.
HARMLESS = {"a trial of no study"}


@pytest.mark.parametrize("case", ROWS)
def test_damaged_trials_of_a_store_are_refused(
    case: str, capsys: pytest.CaptureFixture[str], finished: Path, run: Path
) -> None:
    change_trials(run / STORE, ROWS[case])
    code, err = resume(capsys, finished, run)
    if case in HARMLESS:
        assert code == 0, err
    else:
        assert code == 2, err
        assert str(run / STORE) in err


ARRAY_FILES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda held: b"",
    "none": lambda held: b"PK\x03\x04\xde\xad\xbe\xef",
    "cut off": lambda held: held[: len(held) // 2],
    "a pickle": lambda held: pickle.dumps({"predicted": [1.0]}),
}


@pytest.mark.parametrize("case", ARRAY_FILES)
def test_damaged_files_of_arrays_are_refused(
    case: str, capsys: pytest.CaptureFixture[str], finished: Path, run: Path
) -> None:
    path = run / STORE / "arrays" / "0.npz"
    path.write_bytes(ARRAY_FILES[case](path.read_bytes()))
    code, err = resume(capsys, finished, run)
    assert code == 2, err
    assert f"{path}: trial 0 of the run cannot be read" in err


def other_arrays(change: Callable[[dict[str, np.ndarray]], None]) -> Callable[[bytes], bytes]:
    def changed(payload: bytes) -> bytes:
        with np.load(io.BytesIO(payload)) as held:
            arrays = dict(held)
        change(arrays)
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **arrays)
        return buffer.getvalue()

    return changed


ARRAYS: dict[str, Callable[[dict[str, np.ndarray]], None]] = {
    "a value that is another": lambda held: held.update({"0": held["0"] + 1}),
    "a value that is NaN": lambda held: held.update({"0": held["0"] * np.nan}),
    "a sample less": lambda held: held.update({"0": held["0"][:-1]}),
    "a table": lambda held: held.update({"0": np.stack([held["0"]] * 2)}),
    "whole numbers": lambda held: held.update({"0": held["0"].astype(int)}),
    "text": lambda held: held.update({"0": np.array(["a"] * 25)}),
    "an array less": lambda held: held.pop("0"),
    "keys that are numbers": lambda held: held.update(keys=np.arange(len(held["keys"]))),
    "no keys": lambda held: held.pop("keys"),
    "a key of one part": lambda held: held.update(keys=np.array(["predicted"] * len(held["keys"]))),
    "another experiment": lambda held: held.update(keys=np.char.replace(held["keys"], "pull", "push")),
    "a derivative less": lambda held: held.update(keys=np.char.replace(held["keys"], "youngs", "other")),
}


@pytest.mark.parametrize("case", ARRAYS)
def test_damaged_arrays_of_a_trial_are_refused(
    case: str, capsys: pytest.CaptureFixture[str], finished: Path, run: Path
) -> None:
    folder = run / STORE / "arrays"
    for path in folder.iterdir():
        path.write_bytes(other_arrays(ARRAYS[case])(path.read_bytes()))
    code, err = resume(capsys, finished, run)
    assert code == 2, err
    assert str(run / STORE) in err
    assert "trial 0 of the run cannot be read" in err or case == "a derivative less"


SETTINGS = {
    "a batch of text": '"two"',
    "a batch of zero": "0",
    "a batch beyond all workers": "1000000000",
    "a batch of half": "0.5",
    "a batch that is null": "null",
}


@pytest.mark.parametrize("case", SETTINGS)
def test_damaged_settings_of_a_store_are_refused(
    case: str, capsys: pytest.CaptureFixture[str], finished: Path, run: Path
) -> None:
    path = run / STORE / "run.json"
    record = json.loads(path.read_text())
    record["settings"]["batch"] = json.loads(SETTINGS[case])
    path.write_text(json.dumps(record))
    code, err = resume(capsys, finished, run)
    assert code == 2, err
    assert "settings.batch" in err


FILES: dict[str, tuple[str, Callable[[Path], object]]] = {
    "no journal": ("optuna.journal", Path.unlink),
    "a folder in the place of the journal": ("optuna.journal", lambda path: (path.unlink(), path.mkdir())),
    "a file in the place of the arrays": ("arrays", lambda path: (shutil.rmtree(path), path.write_text(""))),
    "no arrays": ("arrays", shutil.rmtree),
    "a folder in the place of the record": ("run.json", lambda path: (path.unlink(), path.mkdir())),
    "a journal that is none": ("optuna.journal", lambda path: path.write_bytes(bytes(range(256)))),
    "a journal of other things": ("optuna.journal", lambda path: path.write_text('{"a": 1}\n[]\n')),
    "a journal of an unknown kind": ("optuna.journal", lambda path: path.write_text('{"op_code": 99}\n')),
    "a journal whose last line is none": ("optuna.journal", lambda path: path.write_bytes(path.read_bytes() + b"]\n")),
    "a journal of other trials": (
        "optuna.journal",
        lambda path: path.write_text(path.read_text().replace('"bar.youngs_modulus"', '"bar.other"')),
    ),
}


@pytest.mark.parametrize("case", FILES)
def test_damaged_files_of_a_store_are_refused(
    case: str, capsys: pytest.CaptureFixture[str], finished: Path, tmp_path: Path
) -> None:
    run = Path(shutil.copytree(finished / "tpe", tmp_path / "run"))
    file, damage = FILES[case]
    damage(run / STORE / file)
    code, err = resume(capsys, finished, run, "--method", "tpe", "--trials", "4")
    assert code == 2, err
    assert str(run / STORE) in err


NOTES = b"my notes,\nand the last line has no end"


def linked_out(run: Path, place: str, target: Path) -> None:
    shutil.move(run / place, target) if (run / place).exists() else None
    (run / place).symlink_to(target)


@pytest.mark.parametrize("place", [JOURNAL, RECORD])
@pytest.mark.parametrize("content", ["its own", NOTES])
def test_a_link_in_the_place_of_a_file_is_not_followed(
    capsys: pytest.CaptureFixture[str], finished: Path, run: Path, tmp_path: Path, place: str, content: bytes | str
) -> None:
    outside = tmp_path / "outside"
    linked_out(run / STORE, place, outside)
    if isinstance(content, bytes):
        outside.write_bytes(content)
    before = outside.read_bytes()
    code, err = resume(capsys, finished, run)
    assert code
    assert "a link to another file" in err
    assert outside.read_bytes() == before


@pytest.mark.parametrize("content", [NOTES, NOTES[:8], b'{"a": 1}\n{"a": 2}\n{"a"', b'{"op_code": "or not",\nan end'])
def test_what_is_no_journal_is_refused_before_it_is_cut(
    capsys: pytest.CaptureFixture[str], finished: Path, run: Path, content: bytes
) -> None:
    path = run / STORE / JOURNAL
    path.write_bytes(content)
    code, err = resume(capsys, finished, run)
    assert code
    assert str(path) in err
    assert path.read_bytes() == content


@pytest.mark.parametrize("place", ["calibrations", STORE, f"{STORE}/arrays"])
def test_a_folder_that_is_a_link_is_not_followed(
    capsys: pytest.CaptureFixture[str], finished: Path, run: Path, tmp_path: Path, place: str
) -> None:
    outside = tmp_path / "outside"
    linked_out(run, place, outside)
    before = {path: path.read_bytes() for path in outside.rglob("*") if path.is_file()}
    code, err = resume(capsys, finished, run)
    assert code
    assert "outside" in err
    assert before == {path: path.read_bytes() for path in outside.rglob("*") if path.is_file()}


@pytest.mark.parametrize("write", [write_text, lambda path, text: write_files({path: text.encode()})])
def test_a_link_left_where_a_file_is_being_written_is_not_followed(tmp_path: Path, write: Callable[..., None]) -> None:
    (tmp_path / "notes").write_bytes(NOTES)
    for part in ("result.json.part", ".result.json.part"):
        (tmp_path / part).symlink_to(tmp_path / "notes")
    write(tmp_path / "result.json", "{}")
    assert (tmp_path / "notes").read_bytes() == NOTES
    assert (tmp_path / "result.json").read_bytes() == b"{}"


OPENING = re.compile(r"\.read_(text|bytes)\(|\.open\(|\bopen\((?!.*opener=)|np\.load\((?!io\.BytesIO)")
# Not of a run's folder: the system's own, the page's own, and a journal that the user names.
OTHERS = {
    "plugins/watch/command.py": 1,  # the browser's
    "plugins/watch/live.py": 3,
    "plugins/watch/new_page.py": 1,  # a file that is dropped onto the page
    "plugins/watch/server.py": 1,
    "plugins/watch/twin.py": 2,
    "calibration/search/interrupts.py": 1,
    "calibration/search/shared_journal.py": 1,
    "calibration/results/trial_journal.py": 1,
}


def test_files_of_a_run_folder_are_opened_in_one_way() -> None:
    source = Path(softcal.__file__).parent
    ours = ("plugins/watch/*.py", "plugins/fleet/folder.py", "plugins/fleet/report.py", "plugins/bench/page.py")
    places = ("calibration/**/*.py", "workflows/*_folder.py", *ours)
    assert all(any(source.glob(place)) for place in places)
    paths = [path for place in places for path in source.glob(place)]
    found = {path.relative_to(source).as_posix(): len(OPENING.findall(path.read_text("utf-8"))) for path in paths}
    assert {place: n for place, n in found.items() if n} == OTHERS


FORMULAS = ["=1+1", "=cmd|' /C calc'!A0", "+a", "-b", "@c", "\td", "\re", "＝f", "'=g", "''-h", "-1 mm", "--1"]
PLAIN = ["", "a", "-1.5", "+2e3", "-inf", "'", "'a", "a=b", "-", "it's"]


def test_a_text_that_begins_as_a_formula_is_marked_as_text() -> None:
    table = csv_text(["name", "=x"], [[text, 1] for text in [*FORMULAS, *PLAIN]])
    header, *rows = csv.reader(io.StringIO(table, newline=""))
    assert header == ["name", "'=x"]
    assert [row[0] for row in rows] == [*(f"'{text}" for text in FORMULAS), *PLAIN]
    assert [plain(row[0]) for row in rows] == [*FORMULAS, *PLAIN]
    assert csv_text(["a"], [[-1.5], [None], [np.float64(-2.0)], [-3]]) == 'a\n-1.5\n""\n-2.0\n-3\n'


def test_stored_and_measured_tables_are_read_with_the_texts_that_were_written(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(csv_text(["=name", "x [mm]"], [["=a", 1.0], ["-b", -2.0]]), encoding="utf-8", newline="")
    assert read_rows(path, "the table") == (["=name", "x [mm]"], [["=a", "1.0"], ["-b", "-2.0"]])
    table = load_table(path, ["x"], TableFormat())
    assert table.headers[0] == "=name"
    assert [cells for _, rows in table.rows() for cells in rows] == [["=a", "1.0"], ["-b", "-2.0"]]
