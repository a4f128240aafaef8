"""Coupon tests from text tables; all faults of a file are reported together.

The names of the columns state what was measured: `stretch` or `engineering_strain`, and `nominal_stress` or
`true_stress`; in a biaxial test `stretch_1`, `nominal_stress_1` and so on; in simple shear `amount_of_shear` and
`shear_stress`. A column `specimen` tells the specimens of one file apart. With a column `time` the rows are a way in
their order.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softcal.declare import checked_arguments
from softcal.errors import DatasetError, Fault, ParameterError, UnitError, unknown
from softcal.experiments.columns import N_NAMED, read_columns
from softcal.experiments.header import find_column, unit_of_column
from softcal.experiments.read import line_numbers, not_numbers
from softcal.experiments.table import Table, load_table
from softcal.experiments.table_format import TableFormat
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.kind import KINDS, CouponKind

SPECIMEN, TIME = "specimen", "time"
FEWEST = 5  # rows of a specimen
_LARGEST = 100.0  # stretch, or amount of shear
_STRESSES = (1e-2, 1e12)  # Pa, of the largest of a specimen
_WITH_MEMORY = ("relaxation", "cyclic", "creep")


@dataclass(frozen=True)
class _Column:
    """A measured column: the name of what it has, its number, and the factor to SI."""

    measure: str
    place: int
    factor: float


def coupon_kind(name: str) -> CouponKind:
    """The kind of test of a name.

    Raises
    ------
    ParameterError
        Where there is none.
    """
    if name in KINDS:
        return KINDS[name]
    what = "there is no such kind of test"
    if name in _WITH_MEMORY:
        what = "the kind of test says how the coupon is strained; how it goes on in time is in a column 'time'"
    raise ParameterError(unknown(what, "--test", name, KINDS))


@checked_arguments
def read_coupons(path: str | Path, test: str, *, needs_stress: bool = True) -> list[Coupon]:
    """Read the tests of one file, by specimen, each in the order of its rows.

    Parameters
    ----------
    path
        Text in UTF-8, Latin-1 or UTF-16, as of bench tables.
    test
        Kind of test: uniaxial, planar, equibiaxial, biaxial or shear.
    needs_stress
        Whether the stresses must be there; where they need not and are not, they are NaN.

    Raises
    ------
    ParameterError
        For an unknown kind of test.
    DatasetError
        With all faults: missing or doubled columns, cells that are not numbers, stretches at or below zero, times that
        go back, too few rows.
    UnitError
        If all faults are of units.
    StorageError
        Where the file cannot be read.
    """
    path, kind = Path(path), coupon_kind(test)
    wanted = [measure + axis for axis in kind.axes for measure in (*kind.strains, *kind.stresses)]
    table = load_table(path, [*wanted, SPECIMEN, TIME], TableFormat())
    faults: list[Fault] = []
    unit_faults: list[Fault] = []
    has_stress = needs_stress or any(table.find(m + axis) for m in kind.stresses for axis in kind.axes)
    measured = [
        _column(table, kind, measures, axis, si_unit, faults, unit_faults)
        for measures, si_unit in ((kind.strains, "1"), (kind.stresses if has_stress else (), "Pa"))
        for axis in kind.axes
        if measures
    ]
    columns = [column for column in measured if column is not None]
    clock = _column(table, kind, [TIME], "", "s", faults, unit_faults) if table.find(TIME) else None
    label = find_column(table, SPECIMEN, faults) if table.find(SPECIMEN) else None
    every = columns if clock is None else [*columns, clock]
    places = {str(c.place): c.place for c in every}
    held = read_columns(table, places, may_miss=lambda _: False, label=label)
    faults += not_numbers(table, places, held)
    if faults:
        raise DatasetError([*faults, *unit_faults])
    if unit_faults:
        raise UnitError(unit_faults)
    k = len(kind.axes)
    with np.errstate(over="ignore"):  # what is infinite is out of range
        values = [held.numbers[str(column.place)] * column.factor for column in columns]
        strain = np.column_stack([kind.strains[c.measure](v) for c, v in zip(columns[:k], values[:k], strict=True)])
    for i in range(strain.shape[1]):
        low = -_LARGEST if kind.smallest is None else kind.smallest
        out = np.flatnonzero(~((strain[:, i] > low) & (strain[:, i] <= _LARGEST)))
        if len(out):
            strains = "% as the unit, if these are in per cent"
            attempt = (
                "the name engineering_strain, if these are strains" if columns[i].measure == "stretch" else strains
            )
            what = "the amount of shear" if kind.smallest is None else "the stretch"
            lines = line_numbers([int(line) for line in held.lines[out[:N_NAMED]]], len(out))
            faults.append(
                Fault(
                    f"{what} is out of range in {len(out)} row(s)",
                    f"{table.path}, column '{table.headers[columns[i].place]}', {lines}",
                    ", ".join(f"{value:.6g}" for value in strain[out[:N_NAMED], i]),
                    f"above {low:g}, to {_LARGEST:g}",
                    attempt,
                )
            )
    names = list(held.labels or (path.stem,) * len(strain))
    faults += [
        Fault("there are too few rows", f"{table.path}, specimen '{name}'", str(n), f"{FEWEST} or more")
        for name in dict.fromkeys(names)
        if (n := names.count(name)) < FEWEST
    ]
    time = None if clock is None else held.numbers[str(clock.place)] * clock.factor
    if time is not None:
        # Times of a specimen that go back, or begin before it was at rest.
        last: dict[str, float] = {}
        back: list[int] = []
        for row, name in enumerate(names):
            if time[row] < last.get(name, 0.0):
                back.append(row)
            last[name] = float(time[row])
        if back:
            lines = line_numbers([int(held.lines[row]) for row in back[:N_NAMED]], len(back))
            attempt = (
                "the rows in the order in which they were measured, and a column 'specimen' where there are several"
            )
            faults.append(
                Fault(
                    f"the time goes back in {len(back)} row(s)",
                    f"{table.path}, {lines}",
                    ", ".join(f"{time[row]:.6g} s" for row in back[:N_NAMED]),
                    "times from 0 on, at which the specimen is at rest, that grow",
                    attempt,
                )
            )
    if faults:
        raise DatasetError(faults)
    stress = np.full_like(strain, np.nan)
    for i, (c, v) in enumerate(zip(columns[k:], values[k:], strict=True)):
        with np.errstate(over="ignore"):
            stress[:, i] = kind.stresses[c.measure](v, strain[:, i])
    found: list[Coupon] = []
    for name in dict.fromkeys(names):
        own = np.array([one == name for one in names])
        where = f"{path}, specimen '{name}'"
        if np.all(strain[own] == kind.at_rest):
            faults.append(Fault("the coupon is never strained", where, attempt="the column of its strain"))
        largest = float(np.nanmax(np.abs(stress[own]), initial=0.0))
        if has_stress and not largest:
            faults.append(Fault("every stress is zero", where, attempt="the column of the stress that was measured"))
        elif has_stress and not _STRESSES[0] <= largest <= _STRESSES[1]:
            low, high = _STRESSES
            allowed = f"a largest one from {low:g} to {high:g} Pa"
            attempt = "the unit in the column's header"
            faults.append(Fault("no material has such stresses", where, f"up to {largest:.4g} Pa", allowed, attempt))
            continue  # of what is infinite there is no coupon
        found.append(Coupon(name, kind.name, strain[own], stress[own], None if time is None else time[own]))
    if faults:
        raise DatasetError(faults)
    return found


def _column(
    table: Table,
    kind: CouponKind,
    measures: Iterable[str],
    axis: str,
    si_unit: str,
    faults: list[Fault],
    unit_faults: list[Fault],
) -> _Column | None:
    """The one column that has any of the measures along an axis."""
    names = [measure + axis for measure in measures]
    where = f"{table.path}, line {table.header_line}"
    present = [measure for measure in measures if table.find(measure + axis)]
    if len(present) != 1:
        shown = ", ".join(f"'{header}'" for header in table.headers if header)
        what = "two columns have the same quantity" if present else f"a {kind.name} test needs another column"
        faults.append(Fault(what, where, f"columns {shown}", f"one of {', '.join(names)}, with its unit in brackets"))
        return None
    place = find_column(table, present[0] + axis, faults)
    unit = None if place is None else unit_of_column(table, place, si_unit, unit_faults)
    return None if place is None or unit is None else _Column(present[0], place, unit[1])
