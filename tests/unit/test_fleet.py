"""Fleets: every specimen calibrated, kept, resumed; failures are rows; the command."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from fleet_case import FILE, E, write_fleet
from project_case import MODULUS

from softcal.cli import main
from softcal.errors import CalibrationError, InputError, ProjectFileError, StorageError
from softcal.workflows import fleet as fleets
from softcal.workflows.fleet import Fleet, fleet
from softcal.workflows.fleet_folder import read_specimen
from softcal.workflows.run_folder import load_run

FACTORS = (1.0, 1.1, 0.9, 1.05, 0.95, 1.02)
TABLE = f"specimen,{FILE},filament\n" + "".join(f"s {k},p{k}.csv,{'AB'[k % 2]}\n" for k in range(1, 7))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fleet(tmp_path_factory.mktemp("fleet"), FACTORS, TABLE)


@pytest.fixture(scope="module")
def found(folder: Path) -> Fleet:
    return fleet(folder, out=folder / "out")


def test_every_specimen_gets_its_own_modulus(found: Fleet) -> None:
    assert [one.state for one in found.specimens] == ["DONE"] * 6
    for one, factor in zip(found.specimens, FACTORS, strict=True):
        assert one.parameters[E].value == pytest.approx(MODULUS * factor, rel=5e-3)
    (of_E,) = [one for one in found.statement.populations if one.label == E]
    logs = np.log(MODULUS * np.array(FACTORS))
    assert of_E.mean == pytest.approx(np.exp(logs.mean()), rel=2e-3)
    assert of_E.spread == pytest.approx(logs.std(ddof=1), rel=0.05)
    assert of_E.differs


def test_a_specimen_has_a_run_folder_that_other_commands_read(found: Fleet) -> None:
    run = load_run(found.folder / "specimens" / "s 2")
    assert dict(run.project.changes) == {"experiments.pull.files[0].path": "p2.csv"}
    assert run.project.experiments["pull"].dataset.n_samples == 25
    assert run.results["pull"].parameters[E].value == found.specimens[1].parameters[E].value
    assert "mesh" not in run.results["pull"].parameters[E].shares  # the same in all specimens


def test_the_files_tell_what_was_found(found: Fleet) -> None:
    record = json.loads((found.folder / "fleet.json").read_text())
    assert record["specimens"] == [f"s {k}" for k in range(1, 7)]
    assert record["statement"]["done"] == 6
    rows = list(csv.DictReader((found.folder / "fleet.csv").read_text().splitlines()))
    assert len(rows) == 6 * len(found.specimens[0].parameters)
    first = next(row for row in rows if row["specimen"] == "s 1" and row["parameter"] == E)
    assert float(first["value"]) == found.specimens[0].parameters[E].value
    assert (first["filament"], first["unit"], first["state"]) == ("B", "Pa", "DONE")
    kept = read_specimen(found.folder, "s 3")
    assert kept is not None
    assert kept.parameters == found.specimens[2].parameters
    assert (found.folder / "table.csv").read_text() == TABLE
    live = json.loads((found.folder / "live.json").read_text())
    assert (live["done"], live["total"], live["failed"], live["ended"]) == (6, 6, 0, True)


def test_two_processes_find_the_same(folder: Path, found: Fleet) -> None:
    again = fleet(folder, out=folder / "two", workers=2)
    assert [one.parameters for one in again.specimens] == [one.parameters for one in found.specimens]


def test_a_stopped_fleet_is_resumed(
    folder: Path, found: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(what: str, of: int, done: int, failed: int) -> None:
        if what == "specimens" and done == 2:
            import signal

            signal.raise_signal(signal.SIGINT)

    stopped = fleet(folder, out=tmp_path / "out", progress=stop)
    assert stopped.interrupted
    assert [one.name for one in stopped.specimens] == ["s 1", "s 2"]
    calibrated: list[str] = []
    whole = fleets.calibrated_specimen

    def noted(order, row):
        calibrated.append(row.name)
        return whole(order, row)

    monkeypatch.setattr(fleets, "calibrated_specimen", noted)
    again = fleet(folder, out=tmp_path / "out", resume=True)
    assert calibrated == ["s 3", "s 4", "s 5", "s 6"]
    assert [one.parameters for one in again.specimens] == [one.parameters for one in found.specimens]
    assert again.statement == found.statement


def test_what_a_killed_worker_began_is_gone_on_with(folder: Path, found: Fleet, tmp_path: Path) -> None:
    shutil.copytree(found.folder, tmp_path / "out")
    (tmp_path / "out" / "specimens" / "s 4.json").unlink()
    (tmp_path / "out" / "specimens" / "s 4" / "result.json").unlink()
    again = fleet(folder, out=tmp_path / "out", resume=True)
    assert [one.parameters for one in again.specimens] == [one.parameters for one in found.specimens]


def test_a_specimen_that_fails_is_a_row_with_its_reason(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = fleets.calibrate

    def failing(project, **given):
        if "p3.csv" in project.inputs:
            raise CalibrationError("No trial could be simulated: the bar buckles.")
        return whole(project, **given)

    monkeypatch.setattr(fleets, "calibrate", failing)
    result = fleet(folder, out=tmp_path / "out")
    assert [one.state for one in result.specimens].count("FAILED") == 1
    assert result.specimens[2].reason == "No trial could be simulated: the bar buckles."
    assert result.statement.failed == 1
    assert next(one for one in result.statement.populations if one.label == E).n == 5
    monkeypatch.setattr(fleets, "calibrate", whole)
    assert fleet(folder, out=tmp_path / "out", resume=True).statement.failed == 0  # it is tried again


def test_nothing_is_begun_where_a_specimen_has_a_fault(folder: Path, tmp_path: Path) -> None:
    table = folder / "bad.csv"
    table.write_text(TABLE.replace("p2.csv", "no.csv").replace("p5.csv", "none.csv"), encoding="utf-8")
    with pytest.raises(ProjectFileError, match=r"lines 3, 6.*'no.csv', 'none.csv'") as error:
        fleet(table, out=tmp_path / "out")
    assert len(error.value.faults) == 1
    assert not (tmp_path / "out").exists()


def test_another_table_does_not_go_on_with_a_fleet(folder: Path, found: Fleet, tmp_path: Path) -> None:
    table = folder / "fleet-2.csv"
    table.write_text(TABLE.replace("s 1", "s 7"), encoding="utf-8")
    with pytest.raises(StorageError, match="the file was changed after the fleet began"):
        fleet(table, out=found.folder, resume=True)
    with pytest.raises(StorageError, match="the fleet has other settings"):
        fleet(folder, out=found.folder, resume=True, starts=2)
    with pytest.raises(StorageError, match="there is no fleet here"):
        fleet(folder, out=tmp_path, resume=True)
    with pytest.raises(StorageError, match="nothing is overwritten"):
        fleet(folder, out=found.folder)
    with pytest.raises(InputError, match="neither the method"):
        fleet(folder, out=tmp_path / "new", trails=2)


def test_the_command_prints_the_statement(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["fleet", str(folder), "--out", str(tmp_path / "out"), "--no-report"])
    assert end.value.code in (0, None)
    said = capsys.readouterr().out
    assert f"{E}: geometric mean 1.30" in said
    assert "They differ by more than their errors" in said
    with pytest.raises(SystemExit) as end:
        main(["fleet", str(folder), "--template", str(tmp_path / "no.yaml")])
    assert end.value.code == 2
    assert "the template cannot be read" in capsys.readouterr().err
