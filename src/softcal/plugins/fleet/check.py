"""Every fault of a fleet's table and of all its specimens' projects, before any specimen is calibrated."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from softcal.errors import Fault, InputError, ProjectFileError
from softcal.executors.each import results
from softcal.executors.executor import Executor
from softcal.experiments.read import line_numbers
from softcal.limits import JOINT
from softcal.plugins.fleet.table import FleetRow, FleetTable, merged, missing_files, row_project
from softcal.project.yaml_file import read_document
from softcal.workflows.calibration import plan

_NAMED = 5  # specimens, and values found, of a fault of many


@dataclass(frozen=True)
class FleetOrder:
    """Data that all specimens share: the template, the fleet's folder, and the changes of `calibrate`."""

    template: Path
    folder: Path
    settings: Mapping[str, Any]


def check_fleet(
    table: FleetTable,
    order: FleetOrder,
    known: Sequence[Fault],
    executor: Executor,
    show: Callable[[str, int, int, int], None],
) -> None:
    """Raise with the faults of the table and of all specimens' projects.

    Parameters
    ----------
    table
        The fleet's table and template.
    order
        Settings of the calibrations.
    known
        Faults of the table by itself.
    executor
        Where the projects are read.
    show
        Called with "checked", and the numbers of specimens in all, checked, and failed (0).

    Raises
    ------
    ProjectFileError
        With every fault, each with the rows that have it.
    """
    absent = {row.line: faults for row in table.rows if (faults := missing_files(order.template, row))}
    # A look at a whole project takes long: of those without their files at some alone.
    late = set(list(absent)[_NAMED:])
    calls = results(executor, checked_row, order, [(row,) for row in table.rows if row.line not in late])
    found: list[tuple[FleetRow, Fault]] = []
    for k, row in enumerate(table.rows, 1):
        found += [(row, one) for one in (absent[row.line] if row.line in late else next(calls))]
        show("checked", len(table.rows), k, 0)
    if known or found:
        alone = checked_row(order, FleetRow("", {}, {}, {})) if found else ()
        raise ProjectFileError(merged([*known, *_placed(table, found, alone)]))


def checked_row(order: FleetOrder, row: FleetRow) -> tuple[Fault, ...]:
    """Every fault of a specimen's project, or of the settings for it."""
    try:
        _, problems = plan(row_project(order.template, row), **order.settings)
    except InputError as error:
        return error.faults
    if len(problems) > 1 and JOINT not in problems:
        given = "fit" in order.settings
        where = "--option fit" if given else read_document(order.template).where(("calibration", "fit"))
        what = "a fleet compares one result of each specimen, and this makes one of each experiment"
        return (Fault(what, where, "'each'", "'joint' or 'both'"),)
    return ()


def _placed(table: FleetTable, found: Sequence[tuple[FleetRow, Fault]], alone: Collection[Fault]) -> list[Fault]:
    """The specimens' faults, those without a place in the table with the rows that have them; alone: the template's own
    faults, which are those of no row where all rows have them.
    """
    alike: dict[tuple[str, ...], list[tuple[FleetRow, Fault]]] = {}
    placed: list[Fault] = []
    for row, one in found:
        if one.where.startswith((f"{table.path}, ", "--")):
            placed.append(one)
        else:
            alike.setdefault((one.where, one.what, one.allowed, one.attempt), []).append((row, one))
    for held in alike.values():
        first = held[0][1]
        got = dict.fromkeys(one.got for _, one in held)
        rows = {row.line: row.name for row, _ in held}
        if len(got) == 1 and first in alone and len(rows) == len(table.rows):
            placed.append(first)
            continue
        lines = line_numbers(list(rows), len(rows))
        names = ", ".join(list(rows.values())[:_NAMED]) + (", …" if len(rows) > _NAMED else "")
        where = f"{table.path}, {lines} ({names})" + (f": {first.where}" if first.where else "")
        shown = ", ".join(list(got)[:_NAMED]) + (", …" if len(got) > _NAMED else "")
        placed.append(replace(first, where=where, got=shown))
    return placed
