"""Many specimens by one template: each calibrated in a run folder of its own, and what they say together.

A worker reads and writes the specimens' folders itself, so that a run that is killed loses the specimens in work alone:
on a cluster all workers must see the folder.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path

from softcal.calibration.results.digits import value_text
from softcal.calibration.search.interrupts import stoppable
from softcal.calibration.search.live import told_live
from softcal.calibration.search.search import Progress
from softcal.declare import checked_arguments
from softcal.display import displayed
from softcal.errors import ProjectFileError, SoftcalError, StorageError
from softcal.executors.each import LostCall, Workers, each, executor_of
from softcal.executors.executor import Executor
from softcal.html_text import summary
from softcal.plugins.fleet.check import FleetOrder, check_fleet
from softcal.plugins.fleet.folder import (
    begin_fleet,
    finish_fleet,
    held_fleet,
    read_specimen,
    reopen_fleet,
    require_new_fleet,
    set_aside,
    specimen_folder,
    write_specimen,
)
from softcal.plugins.fleet.specimen import Specimen, State
from softcal.plugins.fleet.statement import FleetStatement, fleet_statement
from softcal.plugins.fleet.table import FleetRow, FleetTable, merged, parse_fleet, row_project
from softcal.plugins.fleet.verdict import fleet_sentences
from softcal.workflows.calibration import calibrate
from softcal.workflows.run import Outcome
from softcal.workflows.run_folder import inputs_changed

Observer = Callable[[str, int, int, int], None]
"""Told what is done, of how many specimens, how many are finished, and how many of those failed."""


@displayed
@dataclass(frozen=True)
class Fleet(Outcome):
    """The specimens of a fleet, and what they say together.

    Attributes
    ----------
    table
        The table and its template.
    specimens
        Those that were calibrated, or failed, in the table's order.
    statement
        What they say together.
    """

    table: FleetTable
    specimens: tuple[Specimen, ...]
    statement: FleetStatement
    _: KW_ONLY
    folder: Path

    def _repr_html_(self) -> str:
        labels = dict.fromkeys(label for one in self.specimens for label in one.parameters)
        rows = [
            [
                one.name,
                one.state if one.state == "DONE" else f"FAILED: {one.reason}",
                *(value_text(one.parameters[label]) if label in one.parameters else "–" for label in labels),
            ]
            for one in self.specimens
        ]
        told = [sentence.text for sentence in fleet_sentences(self.specimens, self.statement)]
        title = f"{len(self.specimens)} specimens, kept in {self.folder}"
        return summary(title, ["specimen", "state", *labels], rows, told)


@checked_arguments
def fleet(
    source: str | Path,
    *,
    template: str | Path | None = None,
    out: str | Path,
    resume: bool = False,
    workers: Workers = 1,
    by: Sequence[str] = (),
    progress: Observer | None = None,
    **changes: object,
) -> Fleet:
    """Calibrate every specimen of a table, and state what they say together.

    Parameters
    ----------
    source
        The table (`softcal.plugins.fleet.table`), or a folder with it as fleet.csv.
    template
        The project file of all specimens; project.yaml beside the table by default.
    out
        Folder of the fleet, new or empty.
    resume
        Go on with the fleet in `out`: specimens that are done are kept; those that failed, or whose files have changed
        since they were begun, begin anew.
    workers
        Processes, or an executor; a specimen is calibrated by one process.
    by
        Factors by which the specimens are compared; by default all that the table has.
    progress
        Told how many specimens are done.
    changes
        Any of the template's `calibration` section, as of `softcal.workflows.calibration.calibrate`.

    Raises
    ------
    ProjectFileError
        With every fault of the table and of every specimen's project, before any is calibrated.
    InputError
        For a folder that cannot be used, or where the data of a finished specimen have changed.
    """
    (table, faults), folder = parse_fleet(source, template, by), Path(out).absolute()
    given = {key: value for key, value in changes.items() if value is not None}
    order = FleetOrder(table.template.absolute(), folder, {"mesh_error": False, **given})
    with executor_of(workers) as executor, stoppable() as stop:
        if resume:
            reopen_fleet(table, order.settings, folder)
            if faults:  # the table is the same: of the factors to compare by
                raise ProjectFileError(merged(faults))
        else:
            require_new_fleet(folder)
            check_fleet(table, order, faults, executor, progress or _unseen)
            begin_fleet(table, order.settings, folder)
        with held_fleet(folder):
            try:
                _calibrate(table, order, executor, progress or _unseen)
            except KeyboardInterrupt:
                if stop.by is None:
                    raise
            specimens = tuple(one for row in table.rows if (one := read_specimen(folder, row.name)) is not None)
            statement = fleet_statement(specimens, list(table.factors), {row.name: row.measured for row in table.rows})
            finish_fleet(table, order.settings, specimens, statement, folder)
    return Fleet(table, specimens, statement, folder=folder, stopped_by=stop.by)


def _unseen(what: str, of: int, done: int, failed: int) -> None:
    """Progress that nobody looks at."""


def _calibrate(table: FleetTable, order: FleetOrder, executor: Executor, show: Observer) -> None:
    """Calibrate the specimens that are not done; each keeps its own record."""
    kept = {row.name: read_specimen(order.folder, row.name) for row in table.rows}
    left = [row for row in table.rows if (one := kept[row.name]) is None or one.state == "FAILED"]
    n, failed = len(table.rows), 0
    done = n - len(left)
    with told_live(order.folder, executor) as tell_live:
        calls = each(executor, calibrated_specimen, order, [(row,) for row in left])
        for row in (None, *left):
            if row is not None:
                state = next(calls)
                if isinstance(state, LostCall):
                    write_specimen(Specimen(row.name, "FAILED", row.factors, reason=state.why), order.folder)
                done, failed = done + 1, failed + (state != "DONE")
            tell_live(Progress(done, n, failed, None, None, "specimens"))
            show("specimens", n, done, failed)


def calibrated_specimen(order: FleetOrder, row: FleetRow) -> State:
    """Calibrate one specimen in its folder, and store the result; a failure is a state.

    Raises
    ------
    OSError
        Where this machine cannot keep it, such as for a full disk: another may, and the specimen is none that failed.
    """
    began = time.perf_counter()
    run = specimen_folder(order.folder, row.name)
    try:
        before = read_specimen(order.folder, row.name)
        if before is not None and before.state == "FAILED":
            set_aside(row.name, order.folder, "failed")
        try:
            project = row_project(order.template, row)
            if run.is_dir() and inputs_changed(project, run):
                set_aside(row.name, order.folder, "changed")
            found = calibrate(project, out=run, resume=run.is_dir(), **order.settings)
            if found.stopped_by is not None:
                raise found.stopped_by
            best = found.headline
            warnings = tuple(note.text for note in best.notes if note.tone == "warning")
            one = Specimen(
                row.name, "DONE", row.factors, best.parameters, best.loss, "", warnings, hashes=project.hashes
            )
        except SoftcalError as error:
            if isinstance(error.__cause__, OSError):
                raise
            one = Specimen(row.name, "FAILED", row.factors, reason=str(error))
        write_specimen(replace(one, seconds=time.perf_counter() - began), order.folder)
    except StorageError as error:
        if isinstance(error.__cause__, OSError):
            raise OSError(str(error)) from error
        raise
    return one.state
