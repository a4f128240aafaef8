"""Fleets: every specimen calibrated, kept, resumed; failures are rows; the command."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_trials import undigest
from fleet_case import FILE, E, write_fleet
from project_case import MODULUS

from softcal.cli import main
from softcal.errors import InputError, ProjectFileError, SimulationError, StorageError
from softcal.executors.kinds.local import LocalExecutor
from softcal.plugins.fleet import workflow as fleets
from softcal.plugins.fleet.folder import read_specimen
from softcal.plugins.fleet.report import write_fleet_report
from softcal.plugins.fleet.workflow import Fleet, fleet
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate
from softcal.workflows.run_folder import load_run

FACTORS = (1.0, 1.1, 0.9, 1.05, 0.95, 1.02)
TABLE = f"specimen,{FILE},filament\n" + "".join(f"s {k},p{k}.csv,{'AB'[k % 2]}\n" for k in range(1, 7))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fleet(tmp_path_factory.mktemp("fleet"), FACTORS, TABLE)


@pytest.fixture(scope="module")
def found(folder: Path) -> Fleet:
    return fleet(folder, out=folder / "out")


@pytest.mark.slow
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


@pytest.mark.slow
def test_two_processes_find_the_same(folder: Path, found: Fleet) -> None:
    again = fleet(folder, out=folder / "two", workers=2)
    assert [one.parameters for one in again.specimens] == [one.parameters for one in found.specimens]


@pytest.mark.slow
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


@pytest.mark.parametrize("place", ["specimens", "figures", "tables"])
def test_a_resumed_fleet_is_not_written_through_a_link(folder: Path, found: Fleet, tmp_path: Path, place: str) -> None:
    mine, out = tmp_path / "mine", tmp_path / "out"
    mine.mkdir()
    shutil.copytree(found.folder, out)
    shutil.rmtree(out / place, ignore_errors=True)
    (out / place).symlink_to(mine)
    with pytest.raises(StorageError, match=f"{place}: this lies outside the folder"):
        fleet(folder, out=out, resume=True)
    assert list(mine.iterdir()) == []


def test_a_specimen_that_fails_is_a_row_with_its_reason_and_begins_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def simulate_bar(robot: Robot, protocol: Protocol, *given: Any, **more: Any) -> Response:
        if max(float(told.values.max()) for told in protocol.commands.values()) > 0.025:
            raise SimulationError("The bar buckles.")
        return simulate(robot, protocol, *given, **more)

    monkeypatch.setattr("softcal.twin.simulate.simulate", simulate_bar)
    folder = write_fleet(tmp_path / "own", FACTORS[:2], f"specimen,{FILE}\ns 1,p1.csv\ns 2,p2.csv\n")
    right = (folder / "p2.csv").read_text()
    header, *rows = right.splitlines()
    cells = [row.split(",") for row in rows]
    far = [",".join([t, f"{2 * float(d):.6f}", *rest]) for t, d, *rest in cells]
    (folder / "p2.csv").write_text("\n".join([header, *far]) + "\n")
    result = fleet(folder, out=tmp_path / "out")
    one, two = result.specimens
    assert (one.state, two.state, two.parameters) == ("DONE", "FAILED", {})
    assert "The bar buckles." in two.reason
    assert (result.statement.done, result.statement.failed) == (1, 1)
    place = tmp_path / "out" / "specimens" / "s 2"
    journal = (place / "calibrations" / "pull" / "optuna.journal").read_bytes()
    # With the same data in vain, but not by the trials that are stored; with the right data well. All is kept.
    assert fleet(folder, out=tmp_path / "out", resume=True).statement.failed == 1
    (folder / "p2.csv").write_text(right)
    again = fleet(folder, out=tmp_path / "out", resume=True)
    assert again.specimens[0] == one
    assert again.specimens[1].parameters[E].value == pytest.approx(MODULUS * FACTORS[1], rel=5e-3)
    first, second = (place.with_name(f"s 2.failed-{n}") for n in (1, 2))
    assert (first / "calibrations" / "pull" / "optuna.journal").read_bytes() == journal
    assert (second / "calibrations" / "pull" / "optuna.journal").is_file()
    assert json.loads(first.with_name("s 2.failed-1.json").read_text())["reason"] == two.reason


def test_results_of_changed_data_are_not_kept(folder: Path, found: Fleet, tmp_path: Path) -> None:
    own, out = tmp_path / "own", tmp_path / "out"
    shutil.copytree(folder, own, ignore=shutil.ignore_patterns("out", "two"))
    shutil.copytree(found.folder, out)
    (out / "specimens" / "s 4.json").unlink()  # in work, so that it is judged by its own run folder
    before = sorted((path, path.stat().st_mtime_ns) for path in out.rglob("*.json"))
    for k in (2, 4, 5):
        with (own / f"p{k}.csv").open("a", encoding="utf-8") as file:
            file.write("\n")
    (own / "p6.csv").unlink()
    with pytest.raises(StorageError) as error:
        fleet(own, out=out, resume=True)
    assert [(one.where, one.got) for one in error.value.faults] == [
        ("p2.csv", "results of 's 2'"), ("p5.csv", "results of 's 5'"), ("p6.csv", "results of 's 6'"),
    ]  # fmt: skip
    assert [one.what for one in error.value.faults] == [
        *["the file was changed after specimens were calibrated with it"] * 2, "the file cannot be read",
    ]  # fmt: skip
    assert all("another --out" in one.attempt for one in error.value.faults)
    assert sorted((path, path.stat().st_mtime_ns) for path in out.rglob("*.json")) == before
    with (own / "bar.msh").open("ab") as file:  # of all of them
        file.write(b"\n")
    with pytest.raises(StorageError, match=r"bar.msh.*results of 's 1', 's 2', 's 3', 's 5', 's 6'"):
        fleet(own, out=out, resume=True)


def test_a_specimen_in_work_whose_data_were_changed_begins_anew_at_once_and_the_old_run_is_kept(
    folder: Path, found: Fleet, tmp_path: Path
) -> None:
    own, out = tmp_path / "own", tmp_path / "out"
    shutil.copytree(folder, own, ignore=shutil.ignore_patterns("out", "two"))
    shutil.copytree(found.folder, out)
    place = out / "specimens" / "s 4"
    place.with_name("s 4.json").unlink()
    (place / "result.json").unlink()
    shutil.copyfile(own / "p2.csv", own / "p4.csv")
    before = {path.relative_to(place): path.read_bytes() for path in place.rglob("*") if path.is_file()}
    again = fleet(own, out=out, resume=True)
    assert again.specimens[3].state == "DONE"
    assert again.specimens[3].parameters[E].value == pytest.approx(found.specimens[1].parameters[E].value)
    old = place.with_name("s 4.changed-1")
    assert {path.relative_to(old): path.read_bytes() for path in old.rglob("*") if path.is_file()} == before
    assert not place.with_name("s 4.changed-1.json").exists()


def test_a_wrong_factor_is_refused_when_resumed_too(folder: Path, found: Fleet) -> None:
    with pytest.raises(ProjectFileError, match=r"the table has no such factor; got 'filamnt'"):
        fleet(folder, out=found.folder, resume=True, by=["filamnt"])


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("file", ["s 4.json", "s 4/result.json"])
def test_a_file_that_cannot_be_written_is_an_error_of_the_machine(
    folder: Path, found: Fleet, tmp_path: Path, file: str, workers: int
) -> None:
    """As where the disk is full: such a specimen is handed to other workers, and begun anew by --resume."""
    out = tmp_path / "out"
    shutil.copytree(found.folder, out)
    (out / "specimens" / "s 4.json").unlink()
    (out / "specimens" / "s 4" / "result.json").unlink()
    blocked = out / "specimens" / f"{file}.part"
    blocked.mkdir()
    if file == "s 4.json":
        with pytest.raises(StorageError, match=r"s 4.json: the run cannot be kept"):
            fleet(folder, out=out, resume=True, workers=workers)
        assert not (out / "specimens" / "s 4.json").exists()
    else:  # no other worker could either
        reason = fleet(folder, out=out, resume=True, workers=workers).specimens[3].reason
        assert "could not do it" in reason
        assert "result.json: the run cannot be kept" in reason
    blocked.rmdir()
    again = fleet(folder, out=out, resume=True)
    assert [one.parameters for one in again.specimens] == [one.parameters for one in found.specimens]


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
    with pytest.raises(
        StorageError, match=r"fleet-2\.csv: the fleet began with other files; allowed: 'fleet.csv' and 'p"
    ):
        fleet(table, out=found.folder, resume=True)
    table.write_text(TABLE, encoding="utf-8")
    with pytest.raises(
        StorageError, match=r"fleet-2\.csv: the fleet began with this file under another name; allowed: 'fleet\.csv'\.$"
    ):
        fleet(table, out=found.folder, resume=True)
    (tmp_path / "fleet.csv").write_text(TABLE.replace("s 1", "s 7"), encoding="utf-8")
    with pytest.raises(StorageError, match=r"fleet\.csv: the file was changed after the fleet began"):
        fleet(tmp_path / "fleet.csv", template=folder / "project.yaml", out=found.folder, resume=True)
    with pytest.raises(
        StorageError, match=r"with other settings; got --method tpe --option starts=2; allowed: no options"
    ):
        fleet(folder, out=found.folder, resume=True, method="tpe", starts=2)
    with pytest.raises(StorageError, match=r"got --option mesh_error=true --option 'loss=a b'; allowed"):
        fleet(folder, out=found.folder, resume=True, mesh_error=True, loss="a b")
    with pytest.raises(StorageError, match=r"there is no fleet here"):
        fleet(folder, out=tmp_path, resume=True)
    with pytest.raises(StorageError, match=r"nothing is overwritten.*--resume"):
        fleet(folder, out=found.folder)
    with pytest.raises(StorageError, match=r"not empty, and nothing is overwritten.*Try: another --out\.$"):
        fleet(folder, out=folder)
    with pytest.raises(InputError, match=r"neither the method"):
        fleet(folder, out=tmp_path / "new", trails=2)


@pytest.mark.slow
def test_a_report_of_other_specimens_is_kept_aside(
    folder: Path, found: Fleet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    shutil.copytree(found.folder, out)
    write_fleet_report(replace(found, folder=out))
    page = (out / "report.html").read_bytes()
    old = sorted(path.relative_to(out) for name in ("figures", "tables") for path in (out / name).iterdir())
    fleet(folder, out=out, resume=True)  # nothing is left to do
    assert (out / "report.html").read_bytes() == page
    assert not (out / "report.old-1").exists()
    specimen = out / "specimens" / "s 4.json"
    held = json.loads(specimen.read_text())
    specimen.write_text(json.dumps({**held, "state": "FAILED", "reason": "It buckles.", "hashes": {}}))
    undigest(specimen)

    def stop(what: str, of: int, done: int, failed: int) -> None:
        import signal

        signal.raise_signal(signal.SIGINT)

    stopped = fleet(folder, out=out, resume=True, progress=stop)
    assert stopped.statement.failed == 1
    assert not any((out / name).exists() for name in ("report.html", "figures", "tables"))
    assert (out / "report.old-1" / "report.html").read_bytes() == page
    aside = out / "report.old-1"
    assert sorted(path.relative_to(aside) for n in ("figures", "tables") for path in (aside / n).iterdir()) == old
    with pytest.raises(SystemExit):
        main(["fleet", str(folder), "--out", str(out), "--resume"])
    assert (out / "report.html").is_file()
    with pytest.raises(SystemExit):  # the statement is the same
        main(["fleet", str(folder), "--out", str(out), "--resume", "--by", "filament", "--no-report"])
    assert not (out / "report.old-2").exists()
    table = (out / "fleet.csv").read_text()
    (out / "fleet.csv").write_text(table.replace("DONE", "FAILED"))
    assert fleet(folder, out=out, resume=True).statement == found.statement
    assert (out / "fleet.csv").read_text() == table
    assert (out / "report.old-2" / "report.html").is_file()
    write_fleet_report(replace(found, folder=out))
    record = json.loads((out / "fleet.json").read_text())
    record["statement"]["done"] = 5  # as if compared by other factors
    (out / "fleet.json").write_text(json.dumps(record))
    undigest(out / "fleet.json")
    fleet(folder, out=out, resume=True)
    assert (out / "report.old-3" / "report.html").is_file()


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_command_and_the_page_name_what_was_counted_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_fleet(tmp_path, FACTORS[:2], f"specimen,{FILE}\ns1,p1.csv\ns2,p2.csv\ns3,copy.csv\n")
    shutil.copyfile(folder / "p1.csv", folder / "copy.csv")
    with pytest.raises(SystemExit) as end:
        main(["fleet", str(folder)])
    assert end.value.code in (0, None)
    said = "Specimens share data files but are counted separately: s1, s3."
    assert said in capsys.readouterr().out
    assert said in (folder / "fleet" / "report.html").read_text(encoding="utf-8")


def test_two_methods_are_refused(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["fleet", str(folder), "--method", "tpe", "--option", "method=grid", "--out", str(tmp_path / "out")])
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert "given twice; got '--method tpe' and '--option method=grid'" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["fleet", "calibrate"])
@pytest.mark.parametrize("option", ["workers=2", "out=x", "project=2", "engine=sofa", "source=x", "strats=5"])
def test_what_is_no_option_is_refused_by_its_name(
    command: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_fleet(tmp_path, FACTORS[:2], f"specimen,{FILE}\ns 1,p1.csv\ns 2,p2.csv\n")
    source = folder if command == "fleet" else folder / "project.yaml"
    with pytest.raises(SystemExit) as end:
        main([command, str(source), "--option", option, "--option", "no=1", "--out", str(tmp_path / "out")])
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("Error: 2 faults:\n")
    assert f"--option {option}: neither a method nor a loss has this option; allowed: one of " in said
    assert ("Try: 'starts'" in said) == (option == "strats=5")
    assert not (tmp_path / "out").exists()


def test_it_says_where_other_machines_do_the_work(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["fleet", str(folder), "--out", str(folder), "--workers", "2"]
    said: list[str] = []
    for here in (True, False):
        monkeypatch.setattr(LocalExecutor, "here", property(lambda _, here=here: here))
        with pytest.raises(SystemExit):  # the folder is not empty
            main(command)
        said.append(capsys.readouterr().out)
    assert said[0] == ""
    assert re.fullmatch(r"On 2 processes of this machine: \d workers? at present.*\.\n", said[1])


@pytest.mark.parametrize("name", ["s 3", "s 2"])
def test_the_record_of_another_specimen_is_not_believed(folder: Path, found: Fleet, tmp_path: Path, name: str) -> None:
    out = Path(shutil.copytree(found.folder, tmp_path / "out"))
    record = json.loads((out / "specimens" / "s 3.json").read_text())
    (out / "specimens" / "s 2.json").write_text(json.dumps({**record, "specimen": name}))
    undigest(out / "specimens" / "s 2.json")
    with pytest.raises(StorageError, match=r"s 2.json: .*another specimen"):
        fleet(folder, out=out, resume=True)


def test_factors_of_a_record_are_those_of_the_table(folder: Path, found: Fleet, tmp_path: Path) -> None:
    out = Path(shutil.copytree(found.folder, tmp_path / "out"))
    record = json.loads((out / "specimens" / "s 2.json").read_text())
    assert record["factors"] == {"filament": "A"}
    (out / "specimens" / "s 2.json").write_text(json.dumps({**record, "factors": {"filament": "B"}}))
    undigest(out / "specimens" / "s 2.json")
    with pytest.raises(StorageError, match=r"s 2.json: .*another specimen; got filament B; allowed: filament A"):
        fleet(folder, out=out, resume=True)


def test_a_record_in_another_unit_than_the_others_is_refused(folder: Path, found: Fleet, tmp_path: Path) -> None:
    out = Path(shutil.copytree(found.folder, tmp_path / "out"))
    path = out / "specimens" / "s 2.json"
    path.write_text(path.read_text().replace('"unit": "Pa"', '"unit": "MPa"'))
    undigest(path)
    with pytest.raises(StorageError, match=r"s 2.json: .*another specimen; got .*youngs_modulus in MPa; allowed: Pa"):
        fleet(folder, out=out, resume=True)
