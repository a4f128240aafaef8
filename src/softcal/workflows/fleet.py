"""Many specimens by one template: each calibrated in a run folder of its own, and what they say together.

A worker reads and writes the specimens' folders itself, so that a run that is killed loses the specimens in work alone:
on a cluster all workers must see the folder.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from softcal.analysis.fleet_statement import FleetStatement, fleet_statement
from softcal.analysis.specimen import Specimen
from softcal.calibration.interrupts import stoppable
from softcal.errors import InputError, ProjectFileError, SoftcalError
from softcal.project.fleet_table import FleetRow, FleetTable, merged, read_fleet, row_faults
from softcal.project.project import load
from softcal.workflows.calibration import calibrate, plan
from softcal.workflows.fleet_folder import (
    begin_fleet,
    finish_fleet,
    read_specimen,
    reopen_fleet,
    specimen_folder,
    write_specimen,
)
from softcal.workflows.fleet_workers import Lost, each

Observer = Callable[[str, int, int, int], None]
"""Told what is done, of how many specimens, how many are finished, and how many of those failed."""


@dataclass(frozen=True)
class Fleet:
    """The specimens of a fleet, and what they say together.

    Attributes
    ----------
    table
        The table and its template.
    specimens
        Those that were calibrated, or failed, in the table's order.
    statement
        What they say together.
    folder
        Where all is kept.
    stopped_by
        What stopped it before its end; the specimens that were finished by then are there.
    """

    table: FleetTable
    specimens: tuple[Specimen, ...]
    statement: FleetStatement
    folder: Path
    stopped_by: KeyboardInterrupt | None = None

    @property
    def interrupted(self) -> bool:
        """Whether the fleet was stopped before its end."""
        return self.stopped_by is not None


@dataclass(frozen=True)
class _Order:
    """What all calls of a worker share."""

    template: Path
    folder: Path
    settings: Mapping[str, Any]


def fleet(
    source: str | Path,
    *,
    template: str | Path | None = None,
    out: str | Path,
    resume: bool = False,
    workers: int = 1,
    by: Sequence[str] = (),
    progress: Observer | None = None,
    **changes: object,
) -> Fleet:
    """Calibrate every specimen of a table, and state what they say together.

    Parameters
    ----------
    source
        The table (`softcal.project.fleet_table`), or a folder with it as fleet.csv.
    template
        The project file of all specimens; project.yaml beside the table by default.
    out
        Folder of the fleet, new or empty.
    resume
        Go on with the fleet in `out`: specimens that are done are kept, those that failed are tried again.
    workers
        Processes; a specimen is calibrated by one.
    by
        Factors by which the specimens are compared; by default all that the table has.
    progress
        Told how many specimens are done.
    changes
        Any of the template's `calibration` section, as of `softcal.workflows.calibration.calibrate`.

    Raises
    ------
    InputError
        With every fault of the table and of every specimen's project, before any is calibrated; for a folder that
        cannot be used.
    """
    table, folder = read_fleet(source, template, by), Path(out).absolute()
    given = {key: value for key, value in changes.items() if value is not None}
    settings = {"mesh_error": False, **given}
    show = progress or (lambda *_: None)
    n = len(table.rows)
    if resume:
        reopen_fleet(table, settings, folder)
    else:
        _check(table, settings, workers, show)
        begin_fleet(table, settings, folder)
    found = (
        {} if not resume else {row.name: s for row in table.rows if (s := read_specimen(folder, row.name)) is not None}
    )
    found = {name: one for name, one in found.items() if one.state == "DONE"}
    left = [row for row in table.rows if row.name not in found]
    with stoppable() as stop:
        try:
            show("specimens", n, len(found), 0)
            calls = each(
                workers, calibrated_specimen, _Order(table.template, folder, settings), [(row,) for row in left]
            )
            for row, answer in zip(left, calls, strict=False):
                if isinstance(answer, Lost):
                    answer = Specimen(row.name, "FAILED", row.factors, reason=answer.sentence)
                    write_specimen(answer, folder)
                found[row.name] = answer
                show("specimens", n, len(found), sum(one.state == "FAILED" for one in found.values()))
        except KeyboardInterrupt:
            if stop.by is None:
                raise
    for row in left:  # a worker may have finished more than was told
        if row.name not in found and (one := read_specimen(folder, row.name)) is not None:
            found[row.name] = one
    specimens = tuple(found[row.name] for row in table.rows if row.name in found)
    statement = fleet_statement(specimens, list(table.factors))
    result = Fleet(table, specimens, statement, folder, stop.by)
    finish_fleet(table, settings, specimens, statement, folder)
    return result


def calibrated_specimen(order: _Order, row: FleetRow) -> Specimen:
    """Calibrate one specimen in its folder, and keep what was found; a failure is a state."""
    began = time.perf_counter()
    run = specimen_folder(order.folder, row.name)
    try:
        project = load(order.template, changes=row.changes, values=row.values)
        found = calibrate(project, out=run, resume=run.is_dir(), **order.settings)
    except SoftcalError as error:
        return _kept(
            Specimen(row.name, "FAILED", row.factors, reason=str(error), seconds=time.perf_counter() - began), order
        )
    if found.stopped_by is not None:
        raise found.stopped_by
    best = found.headline
    warnings = tuple(note.text for note in best.notes if note.level == "warning")
    seconds = time.perf_counter() - began
    return _kept(Specimen(row.name, "DONE", row.factors, best.parameters, best.loss, "", warnings, seconds), order)


def _kept(one: Specimen, order: _Order) -> Specimen:
    write_specimen(one, order.folder)
    return one


def checked_row(order: _Order, row: FleetRow) -> tuple[Any, ...]:
    """Every fault of a specimen's project and of the settings for it."""
    if faults := row_faults(order.template, row):
        return faults
    try:
        plan(load(order.template, changes=row.changes, values=row.values), **order.settings)
    except InputError as error:
        return error.faults
    return ()


def _check(table: FleetTable, settings: Mapping[str, Any], workers: int, show: Observer) -> None:
    """Raise with the faults of all specimens' projects."""
    order, n = _Order(table.template, Path(), settings), len(table.rows)
    faults: list[Any] = []
    for k, found in enumerate(each(workers, checked_row, order, [(row,) for row in table.rows])):
        faults += found if not isinstance(found, Lost) else ()
        show("checked", n, k + 1, 0)
    if faults:
        raise ProjectFileError(merged(faults))
