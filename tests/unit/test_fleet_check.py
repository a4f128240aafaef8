"""What is refused before a fleet begins, and with which place; one process at a time in a folder."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from fleet_case import FILE, write_fleet

from softcal.cli import main
from softcal.errors import ProjectFileError, StorageError
from softcal.plugins.fleet import check as fleet_check
from softcal.plugins.fleet.folder import LOCK, held_fleet
from softcal.plugins.fleet.report import write_fleet_report
from softcal.plugins.fleet.workflow import Fleet, fleet

NOISE = "    noise: {tension: 0.05 N, pitch: 0.2 deg}\n"
AGAIN = f"""{NOISE}  again:
    cable: front
    plate: plate
    files:
      - path: data/pull.csv
        columns:
          time: {{name: Time}}
          shortening: {{name: Displacement, unit: mm}}
          tension: {{name: Force, unit: N}}
          pitch: {{name: Pitch, unit: deg}}
{NOISE}"""
EACH = ("starts: 1}", "starts: 1, fit: each}")
ROWS = "".join(f"s{k},p{k}.csv\n" for k in range(1, 5))
TABLE = f"specimen,{FILE}\n{ROWS}"
HOLDS = """\
import pathlib, sys
from softcal.calibration.results.file_lock import hold
held = hold(pathlib.Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


def told(folder: Path, **changes: object) -> list[str]:
    """The faults of a fleet of a folder, which is not begun."""
    with pytest.raises(ProjectFileError) as error:
        fleet(folder, out=folder / "out", **changes)  # type: ignore[arg-type]
    assert not (folder / "out").exists()
    return [str(one).replace(f"{folder}/", "") for one in error.value.faults]


def spoil(path: Path, factor: float = 1000) -> None:
    """Shortenings as if metres were millimetres."""
    header, *rows = path.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    far = [",".join([t, f"{factor * float(d):.6f}", *rest]) for t, d, *rest in cells]
    path.write_text("\n".join([header, *far]) + "\n")


@pytest.mark.slow
def test_a_result_of_each_experiment_is_refused(tmp_path: Path) -> None:
    folder = write_fleet(tmp_path, [1.0, 1.1], f"specimen,{FILE}\ns1,p1.csv\ns2,p2.csv\n", (NOISE, AGAIN), EACH)
    (said,) = told(folder)
    assert said.startswith("project.yaml:47: calibration.fit: a fleet compares one result of each specimen")
    assert said.endswith("got 'each'; allowed: 'joint' or 'both'.")
    (said,) = told(folder, fit="each")
    assert said.startswith("--option fit: a fleet compares one result")
    found = fleet(folder, out=tmp_path / "both", fit="both")
    assert {"front.slack[pull]", "front.slack[again]"} <= found.specimens[0].parameters.keys()


def test_each_of_one_experiment_is_one_result(tmp_path: Path) -> None:
    folder = write_fleet(tmp_path, [1.0], f"specimen,{FILE}\ns1,p1.csv\n", EACH)
    assert fleet(folder, out=tmp_path / "out").statement.done == 1


def test_a_fault_of_a_specimens_data_names_the_specimen(tmp_path: Path) -> None:
    folder = write_fleet(tmp_path, [1.0] * 4, TABLE)
    spoil(folder / "p3.csv")
    (said,) = told(folder)
    assert said.startswith("fleet.csv, line 4 (s3): project.yaml:")
    assert "the cable is pulled in by more than its length" in said
    spoil(folder / "p4.csv")
    (said,) = told(folder)
    assert said.startswith("fleet.csv, lines 4, 5 (s3, s4): project.yaml:")
    (folder / "data" / "pull.csv").write_bytes((folder / "p3.csv").read_bytes())  # the template's, which no row reads
    assert told(folder) == [said]
    write_fleet(tmp_path, [1.0] * 4, TABLE)
    for k in range(1, 5):  # but the template's
        spoil(folder / f"p{k}.csv")
    (said,) = told(folder)
    assert said.startswith("fleet.csv, lines 2, 3, 4, 5 (s1, s2, s3, s4): project.yaml:")
    (folder / "data" / "pull.csv").write_bytes((folder / "p1.csv").read_bytes())  # and the template's
    assert told(folder)[0].startswith("project.yaml:")
    spoil(folder / "p4.csv", 2)  # by another number
    (said,) = told(folder)
    assert said.startswith("fleet.csv, lines 2, 3, 4, 5 (s1, s2, s3, s4): project.yaml:")
    assert "got 2e+04 mm, 4e+04 mm;" in said


def test_rows_of_one_name_are_told_by_their_lines(tmp_path: Path) -> None:
    folder = write_fleet(tmp_path, [1.0] * 4, TABLE.replace("s4", "s3"))
    spoil(folder / "p3.csv")
    said = told(folder)
    assert "two rows have the same name" in said[0]
    assert said[1].startswith("fleet.csv, line 4 (s3): project.yaml:")


def test_a_fault_that_all_specimens_have_is_the_templates(tmp_path: Path) -> None:
    folder = write_fleet(tmp_path, [1.0] * 4, TABLE, ("fixed: foot", "fixed: feet"))
    (said,) = told(folder)
    assert said.startswith("project.yaml:")
    folder = write_fleet(tmp_path / "one", [1.0], f"specimen,{FILE}\ns1,p1.csv\n", ("fixed: foot", "fixed: feet"))
    (said,) = told(folder)
    assert said.startswith("project.yaml:")
    folder = write_fleet(tmp_path / "right", [1.0], f"specimen,{FILE}\ns1,p1.csv\n")
    (said,) = told(folder, trails=2)
    assert said.startswith("--option trails=2:")


@pytest.mark.slow
def test_one_process_at_a_time_goes_on_with_a_fleet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_fleet(tmp_path, [1.0, 1.1], f"specimen,{FILE}\ns1,p1.csv\ns2,p2.csv\n")
    found: Fleet = fleet(folder, out=folder / "fleet")
    command = [sys.executable, "-c", HOLDS, str(folder / "fleet" / LOCK)]
    before = (folder / "fleet" / "fleet.json").read_bytes()
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(SystemExit) as end:
            main(["fleet", str(folder), "--resume"])
        assert end.value.code == 2
        said = capsys.readouterr().err
        assert "the fleet cannot be kept; got a folder locked by another process" in said
        with pytest.raises(StorageError, match="locked by another process"):
            write_fleet_report(found)
        assert (folder / "fleet" / "fleet.json").read_bytes() == before
        other.communicate()
    assert fleet(folder, out=folder / "fleet", resume=True).statement == found.statement


def test_a_fleet_holds_its_folder_while_it_runs(tmp_path: Path) -> None:
    folder = write_fleet(tmp_path, [1.0], f"specimen,{FILE}\ns1,p1.csv\n")
    seen: list[str] = []

    def look(what: str, of: int, done: int, failed: int) -> None:
        if what == "specimens":
            with pytest.raises(StorageError, match="locked by another process"), held_fleet(folder / "out"):
                pass
            seen.append(what)

    fleet(folder, out=folder / "out", progress=look)
    assert len(seen) == 2
    with held_fleet(folder / "out"):
        pass


def test_many_missing_files_are_told_without_a_look_at_every_specimen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    n, seen = 300, list[str]()
    rows = "".join(f"s{k},{'p1' if k == n else f'no{k}'}.csv\n" for k in range(1, n + 1))
    write_fleet(tmp_path, [1.0], f"specimen,{FILE}\n{rows}")
    read = fleet_check.row_project
    monkeypatch.setattr(fleet_check, "row_project", lambda of, row: (seen.append(row.name), read(of, row))[1])
    with pytest.raises(ProjectFileError) as error:
        fleet(tmp_path, out=tmp_path / "out")
    (fault,) = error.value.faults
    assert "there is no such data file" in fault.what
    assert "lines 2, 3, 4, 5, 6, …" in fault.where
    assert seen == ["s1", "s2", "s3", "s4", "s5", f"s{n}", ""]  # the last: the template by itself
