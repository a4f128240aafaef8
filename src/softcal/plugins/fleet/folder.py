"""A fleet's folder. A reader can follow it while the fleet runs; every file is replaced as a whole.

fleet.json                     what was asked, with the names of all specimens; at the end with what they say together
table.csv                      the table as it was
specimens/<name>/              the specimen's run folder, from its beginning on (see `run_folder`)
specimens/<name>.json          from its end on: {"format", "specimen", "state": "DONE" or "FAILED", "reason", "seconds",
                               "loss", "factors", "parameters", "warnings", "hashes" of the files where DONE}
specimens/<name>.failed-<n>/   with its .json: a run that FAILED and was tried again in a new one (n from 1 on)
specimens/<name>.changed-<n>/  a run that was in work when the specimen's files were changed, so that it began anew
fleet.csv                      at the end: a row for each specimen and parameter
live.json                      how many are finished, and the workers (see `calibration.search.live`)
report.html, figures, tables   at the end
report.old-<n>/                an earlier report, moved here where the specimens are other ones now (n from 1 on)
fleet.lock                     held by the process that calibrates; empty

A specimen with a .json file is finished; one with a folder and without the file is in work, or was when the fleet was
stopped; any other waits. A resumed fleet begins a specimen that failed, or whose files have changed, anew, and keeps
what there was of it.
"""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from softcal.calibration.results.file_lock import hold_in
from softcal.calibration.results.store import write_text
from softcal.calibration.results.stored import Amount, Record, read_bytes, read_record, sealed
from softcal.calibration.search.outcome import installed_versions
from softcal.calibration.statistics.estimate import Estimate
from softcal.csv_text import csv_text
from softcal.errors import Fault, StorageError
from softcal.plugins.fleet.specimen import Factor, Specimen, State
from softcal.plugins.fleet.statement import FleetStatement
from softcal.plugins.fleet.table import FleetTable
from softcal.project.files import sha256
from softcal.regular_file import require_inside
from softcal.workflows.output import new_folder, require_free_folder, require_writable, unwritable

FORMAT = 1
FLEET, SPECIMENS, TABLE_COPY, CSV, LOCK = "fleet.json", "specimens", "table.csv", "fleet.csv", "fleet.lock"
REPORT = ("report.html", "figures", "tables")
_AGAIN = "another --out, or --resume to go on with the fleet in it"
_RESTORE = "restore it, or use another --out without --resume"


class _FleetRecord(Record):
    specimens: list[str]
    settings: dict[str, Any]
    hashes: dict[str, str]
    created: str


class _SpecimenRecord(Record):
    specimen: str
    state: State
    reason: str
    seconds: Amount
    loss: float | None
    factors: dict[str, str | float | None]
    parameters: dict[str, Estimate] = Field(default_factory=dict[str, Estimate])
    warnings: tuple[str, ...]
    hashes: dict[str, str]


def _specimen_file(folder: Path, name: str) -> Path:
    return folder / SPECIMENS / f"{name}.json"


def _of_another(folder: Path, name: str, got: str, allowed: str = "") -> StorageError:
    attempt = "remove the record, and the specimen is calibrated again"
    where = str(_specimen_file(folder, name))
    return StorageError(Fault("this is the record of another specimen", where, got, allowed or f"'{name}'", attempt))


def specimen_folder(folder: Path, name: str) -> Path:
    """The run folder of a specimen."""
    return folder / SPECIMENS / name


def require_new_fleet(folder: Path) -> None:
    """Check that a folder is new or empty, and that it can be written.

    Raises
    ------
    StorageError
        If it holds a fleet or other files, or cannot be written.
    """
    if (folder / FLEET).is_file():
        raise StorageError(Fault("the folder has a fleet, and nothing is overwritten", str(folder), attempt=_AGAIN))
    require_free_folder(folder)


def begin_fleet(table: FleetTable, settings: Mapping[str, Any], folder: Path) -> None:
    """Write a new folder with what is to be done.

    Parameters
    ----------
    table
        The fleet's table and template.
    settings
        Arguments of `calibrate`, the same for all specimens.
    folder
        New or empty.

    Raises
    ------
    StorageError
        Where the folder holds files, or cannot be written.
    """
    with new_folder(folder, _AGAIN) as part:
        try:
            shutil.copyfile(table.path, part / TABLE_COPY)
            (part / SPECIMENS).mkdir()
        except OSError as error:
            raise unwritable(folder, error) from error
        write_text(part / FLEET, sealed(_plan(table, settings, datetime.now(UTC).isoformat(timespec="seconds"))))


@contextmanager
def held_fleet(folder: Path) -> Generator[None]:
    """Hold a fleet's folder within this block, so that no other process calibrates in it.

    Raises
    ------
    StorageError
        Where another process holds it, or it cannot be written.
    """
    try:
        lock = hold_in(folder / LOCK, "fleet", "softcal fleet")
    except OSError as error:
        raise unwritable(folder, error) from error
    with lock:
        yield


def reopen_fleet(table: FleetTable, settings: Mapping[str, Any], folder: Path) -> None:
    """Check that a fleet can be resumed.

    Parameters
    ----------
    table, settings
        See `begin_fleet`.
    folder
        That of the fleet.

    Raises
    ------
    StorageError
        If the folder holds no fleet, or one of another table, template or settings, files of finished specimens have
        changed, or the folder cannot be written.
    """
    require_inside(folder, (FLEET, SPECIMENS, *REPORT))
    record = _record(folder)
    faults: list[Fault] = []
    for name, digest in table.hashes.items():
        if name in record.hashes:
            if record.hashes[name] != digest:
                faults.append(Fault("the file was changed after the fleet began", name, attempt=_RESTORE))
            continue
        before = [other for other, held in record.hashes.items() if held == digest]
        what = "the fleet began with this file under another name" if before else "the fleet began with other files"
        faults.append(Fault(what, name, allowed=" and ".join(f"'{one}'" for one in before or record.hashes)))
    if record.settings != json.loads(json.dumps(dict(settings))):
        got, allowed = _typed(settings), _typed(record.settings)
        faults.append(Fault("the fleet began with other settings", str(folder), got, allowed))
    if not faults:
        faults = _changed_files(table, folder)
    if faults:
        raise StorageError(faults)
    require_writable(folder)


def _typed(settings: Mapping[str, Any]) -> str:
    """Settings as options of the command."""
    given = {name: json.dumps(value) if isinstance(value, bool) else str(value) for name, value in settings.items()}
    typed = [
        f"--method {shlex.quote(value)}" if name == "method" else f"--option {shlex.quote(f'{name}={value}')}"
        for name, value in given.items()
        if (name, value) != ("mesh_error", "false")  # without an option
    ]
    return " ".join(typed) or "no options"


def _changed_files(table: FleetTable, folder: Path) -> list[Fault]:
    """A fault for each file that was changed after calibrations with it, with the names of their specimens."""
    of: dict[str, list[str]] = {}
    now: dict[str, str] = {}
    units: dict[str, str] = {}
    for row in table.rows:
        one = read_specimen(folder, row.name)
        if one is None or one.state != "DONE":
            continue
        if not one.hashes.keys() >= set(row.measured):
            raise _of_another(folder, row.name, f"its files are {', '.join(one.hashes)}")
        if dict(one.factors) != dict(row.factors):
            raise _of_another(folder, row.name, _listed(one.factors), _listed(row.factors))
        for label, estimate in one.parameters.items():
            if (unit := units.setdefault(label, estimate.unit)) != estimate.unit:
                raise _of_another(folder, row.name, f"{label} in {estimate.unit}", unit)
        for written, digest in one.hashes.items():
            if written not in now:
                path = table.template.parent / Path(written).expanduser()
                try:
                    now[written] = sha256(path)
                except OSError:
                    now[written] = ""
            if now[written] != digest:
                of.setdefault(written, []).append(row.name)
    return [
        Fault(
            "the file was changed after specimens were calibrated with it"
            if now[written]
            else "the file cannot be read",
            written,
            "results of " + ", ".join(f"'{name}'" for name in names),
            attempt=_RESTORE,
        )
        for written, names in of.items()
    ]


def _listed(factors: Mapping[str, Factor]) -> str:
    return ", ".join(f"{name} {value}" for name, value in factors.items()) or "no factors"


def set_aside(name: str, folder: Path, why: Literal["failed", "changed"]) -> None:
    """Move the run of a specimen, and its record, to a free NAME.failed-N or NAME.changed-N, so that it can begin anew.

    Parameters
    ----------
    name
        Name of the specimen.
    folder
        That of the fleet.
    why
        Word of the new name.

    Raises
    ------
    StorageError
        Where they cannot be moved.
    """
    run, record = specimen_folder(folder, name), _specimen_file(folder, name)
    aside = next(
        place
        for n in count(1)
        if not (place := run.with_name(f"{name}.{why}-{n}")).exists()
        and not place.with_name(f"{place.name}.json").exists()
    )
    try:
        # The record last: stopped in between, the specimen still counts as one that failed.
        if run.is_dir():
            run.rename(aside)
        if record.is_file():
            record.rename(aside.with_name(f"{aside.name}.json"))
    except OSError as error:
        raise unwritable(folder, error) from error


def write_specimen(one: Specimen, folder: Path) -> None:
    """Write the result of a specimen into the fleet's folder.

    Raises
    ------
    StorageError
        Where it cannot be written.
    """
    held = {
        "format": FORMAT,
        "specimen": one.name,
        "state": one.state,
        "reason": one.reason,
        "seconds": one.seconds,
        "loss": one.loss,
        "factors": dict(one.factors),
        "parameters": {label: asdict(estimate) for label, estimate in one.parameters.items()},
        "warnings": list(one.warnings),
        "hashes": dict(one.hashes),
    }
    write_text(_specimen_file(folder, one.name), sealed(held))


def read_specimen(folder: Path, name: str) -> Specimen | None:
    """The result of a specimen; None where its calibration has not finished.

    Raises
    ------
    StorageError
        Where its record is damaged, or another specimen's.
    """
    path = _specimen_file(folder, name)
    if not path.is_file():
        return None
    held = read_record(_SpecimenRecord, path, "the record of the specimen", FORMAT)
    if held.specimen != name:
        raise _of_another(folder, name, f"'{held.specimen}'")
    return Specimen(
        name,
        held.state,
        held.factors,
        held.parameters,
        held.loss,
        held.reason,
        held.warnings,
        held.seconds,
        held.hashes,
    )


def finish_fleet(
    table: FleetTable,
    settings: Mapping[str, Any],
    specimens: Sequence[Specimen],
    statement: FleetStatement,
    folder: Path,
) -> None:
    """Write what the specimens say together; fleet.json last.

    Parameters
    ----------
    table, settings
        See `begin_fleet`.
    specimens
        All of them, as calibrated.
    statement
        What they say together.
    folder
        That of the fleet.

    Raises
    ------
    StorageError
        Where a file cannot be written.
    """
    text = fleet_csv(specimens, list(table.factors))
    told = sealed({**_plan(table, settings, _record(folder).created), "statement": asdict(statement)})
    if (folder / REPORT[0]).is_file():
        before = json.loads(read_bytes(folder / FLEET, "the record of the fleet")).get("statement")
        same = (folder / CSV).is_file() and read_bytes(folder / CSV, "the table of the fleet") == text.encode()
        if not same or before != json.loads(told)["statement"]:
            aside = next(place for n in count(1) if not (place := folder / f"report.old-{n}").exists())
            try:
                aside.mkdir()
                for name in reversed(REPORT):  # the page last: stopped in between, it is moved by the next one
                    if (folder / name).exists():
                        (folder / name).rename(aside / name)
            except OSError as error:
                raise unwritable(folder, error) from error
    write_text(folder / CSV, text)
    write_text(folder / FLEET, told)


def fleet_csv(specimens: Sequence[Specimen], factors: Sequence[str]) -> str:
    """A row for each specimen and parameter [SI]; one row for a specimen that failed."""
    header = ["specimen", "state", *factors, "loss", "seconds [s]", "parameter", "unit", "value", "standard error"]
    header += ["lower", "upper", "at bound", "reason"]
    rows: list[list[object]] = []
    for one in specimens:
        own = [one.factors.get(name) for name in factors]
        first: list[object] = [one.name, one.state, *own, one.loss, round(one.seconds, 3)]
        for label, e in one.parameters.items():
            ends = e.interval or (None, None)
            rows.append([*first, label, e.unit, e.value, e.standard_error, *ends, int(e.at_bound), one.reason])
        if not one.parameters:
            rows.append([*first, *[None] * 7, one.reason])
    return csv_text(header, rows)


def _plan(table: FleetTable, settings: Mapping[str, Any], created: str) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "table": str(table.path),
        "template": str(table.template),
        "specimens": [row.name for row in table.rows],
        "factors": dict(table.factors),
        "settings": dict(settings),
        "hashes": dict(table.hashes),
        "versions": installed_versions(),
        "created": created,
    }


def _record(folder: Path) -> _FleetRecord:
    path = folder / FLEET
    if not path.is_file():
        raise StorageError(Fault("there is no fleet here", str(folder), f"no {FLEET}", "a folder of softcal fleet"))
    return read_record(_FleetRecord, path, "the record of the fleet", FORMAT)
