"""Reading bench files of instruments into a Dataset in SI; all faults of a file are reported together."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault, InputError, unknown
from softcal.experiments.columns import N_NAMED, Columns, cells_of, read_columns
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.header import column_unit, raise_faults, read_layout
from softcal.experiments.orientation import QUATERNION, plate_angles
from softcal.experiments.table import WHITESPACE, Table, load_table, split_header
from softcal.experiments.table_format import ColumnSpec, TableFormat
from softcal.sensing.channel import TIME
from softcal.sensing.sensors.pose import ANGLES

_N_VALUES = 10  # values of a column listed in a fault
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:[.,' ]\d{3})+(?:[.,]\d*)?")
_FOOTER = 5  # lines at the end of a file, which may be no rows of its table


def read_table(
    path: str | Path,
    columns: Mapping[str, ColumnSpec],
    written: TableFormat | None = None,
    *,
    name: str = "",
    where: Mapping[str, object] | None = None,
    optional: Collection[str] = (),
    label: str | None = None,
    complete: Collection[str] = (),
) -> Dataset:
    """Read a CSV or TXT file of a testing machine, an IMU or a marker measurement.

    Parameters
    ----------
    path
        Text in UTF-8, Latin-1 or UTF-16. Lines that start with #, %, ! or // are comments; lines above the column
        names are skipped.
    columns
        Channel -> its column. Channels: time, shortening, tension, pitch, roll, yaw, x, y, z; all but time also for
        several cables, plates and markers, such as `cable1.tension` or `m4.x`, and
        their standard deviations, such as `m4.x_sd`; hanging mass of a cable [kg]. The four columns qw, qx, qy, qz
        become pitch, roll and yaw (`orientation.plate_angles`).
    written
        The format of the table; default: detected from the file.
    name
        Name of the dataset; default: the file's stem.
    where
        Column -> value, or list of values: keeps only matching rows, compared as numbers if both are numbers.
    optional
        Channels that are omitted if the file has no such column.
    label
        Column that names each row.
    complete
        Channels that need a value in every row, as time and quaternions do; of all others an empty cell is a missing
        value.

    Raises
    ------
    DatasetError
        With all faults: missing or duplicate column, text in a number column, a value of `complete` that is missing,
        descending time, an empty file, a filter without a matching row.
    UnitError
        If all faults are of units: missing, unknown, of another dimension, or contradicting the file.
    StorageError
        Where the file cannot be read.
    """
    written = written or TableFormat()
    layout = read_layout(Path(path), columns, written, where=where, optional=optional, label=label)
    table, columns, places = layout.table, layout.columns, layout.places
    faults = list(layout.faults)
    held = read_columns(
        table,
        places,
        may_miss=lambda key: key not in (TIME.name, *QUATERNION, *complete),
        filters=layout.filters,
        label=layout.label,
        decimal=written.decimal,
    )
    for i, (missing, seen) in list(held.unmet.items())[:1]:  # later filters saw only the rows of the first
        shown = ", ".join(f"'{value}'" for value in seen[:_N_VALUES]) + (", …" if len(seen) > _N_VALUES else "")
        column = f"{table.path}, column '{table.headers[layout.filters[i].column]}'"
        faults += [Fault(f"no row holds '{value}'", where=column, allowed=shown) for value in missing]
    faults += not_numbers(table, places, held)
    values: dict[str, Floats] = {}
    for key in places:
        if key not in held.odd and key in layout.factors:
            values[key] = held.numbers[key]
            values[key] *= layout.factors[key] * columns[key].factor
    if layout.label is not None:
        column, first = f"{table.path}, column '{table.headers[layout.label]}'", dict[str, int]()
        nameless = [i for i, text in enumerate(held.labels) if not text]
        twice = [i for i, text in enumerate(held.labels) if first.setdefault(text, i) < i]
        if nameless:
            place = f"{column}, {line_numbers(held.lines[nameless[:N_NAMED]].tolist(), len(nameless))}"
            attempt = "skip_footer or where, to leave them out"
            faults.append(Fault(f"{len(nameless)} row(s) have no label", place, attempt=attempt))
        elif twice:
            place = f"{column}, {line_numbers(held.lines[twice[:N_NAMED]].tolist(), len(twice))}"
            faults.append(Fault("two rows have the same label", place, got=f"'{held.labels[twice[0]]}'"))
    steps = np.diff(values.get("time", np.zeros(0)))
    if len(back := np.flatnonzero(steps < 0)):
        before, after = cells_of(table, places["time"], held.lines[back[0] : back[0] + 2].tolist())
        lines = line_numbers(held.lines[back[:N_NAMED] + 1].tolist(), len(back))
        faults.append(
            Fault(
                f"time runs backwards {len(back)} time(s)",
                where=f"{table.path}, column '{table.headers[places['time']]}', {lines}",
                got=f"'{after}' after '{before}'",
                allowed="times that never fall",
                attempt="a filter `where`, if the file holds several tests one after the other",
            )
        )
    n_equal_times = int(np.count_nonzero(steps == 0))
    raise_faults(faults, layout.unit_faults)
    n_kept, n_rows, labels, used_decimal = len(held.lines), held.n_rows, held.labels, held.decimal
    del held  # its numbers are in `values`; frees memory of large tables
    notes: list[str] = []
    if QUATERNION[0] in values:
        quaternions = np.column_stack([values.pop(key) for key in QUATERNION])
        try:
            angles = plate_angles(quaternions, axes=written.axes, rest_samples=written.rest_samples)
        except InputError as error:
            raise DatasetError(
                [replace(fault, where=f"{table.path}, {fault.where}") for fault in error.faults]
            ) from error
        values.update(zip((angle.name for angle in ANGLES), angles, strict=True))
        notes.append(
            f"quaternions turned into pitch, roll and yaw about the mean pose of the first "
            f"{min(written.rest_samples, len(quaternions))} samples, robot axes {', '.join(written.axes)} of the sensor"
        )
    else:
        for key in (angle.name for angle in ANGLES):
            if key in values:
                known = np.isfinite(values[key])
                as_read = values[key][known]
                unwrapped = np.unwrap(as_read) if (np.abs(np.diff(as_read)) >= np.pi).any() else as_read
                if not np.array_equal(unwrapped, as_read):
                    notes.append(f"jumps of a full turn taken out of {key}")
                values[key][known] = unwrapped
    for key, value in values.items():
        if np.isnan(value).any():
            notes.append(f"{key} is missing in {int(np.isnan(value).sum())} row(s)")
    # One after the other, since a channel is a copy.
    channels = {key: Channel(values.pop(key), column_unit(key) or "1") for key in list(values)}
    if n_equal_times:
        notes.append(f"{n_equal_times} sample(s) share their time with the one before")
    settings: dict[str, Any] = {
        "file": table.path.name,
        "sha256": table.file.sha256,
        "columns": {
            key: {
                "name": spec.name,
                "header": f"{table.headers[places[key]]} {table.unit_cells[places[key]]}".strip(),
                "unit": layout.units[key],
                "scale": spec.scale,
            }
            for key, spec in columns.items()
        },
        "delimiter": {"\t": "tab", WHITESPACE: "white space"}.get(table.delimiter, table.delimiter),
        "decimal": used_decimal,
        "encoding": table.file.encoding,
        "header_row": table.header_line,
    }
    if where:
        settings["where"] = {key: str(value) for key, value in where.items()}
    kept = f"{n_kept} of {n_rows} rows" if where else f"{n_rows} rows"
    units_read = ", ".join(f"{key} from '{spec.name}' in {layout.units[key]}" for key, spec in columns.items())
    outcome = "; ".join([f"{kept} read: {units_read}", *notes])
    return Dataset(name or Path(path).stem, channels, (Step("read_table", settings, outcome),), labels=labels)


def read_channels(path: Path, known: Collection[str]) -> Dataset:
    """Every column of a table whose headers are names of channels with their units, such as `tip.x [mm]`.

    Parameters
    ----------
    path
        The table, with a column `time` or without.
    known
        Names of all channels.

    Raises
    ------
    DatasetError
        For a column of any other name, a value that is missing, and as `read_table`.
    UnitError, StorageError
        See `read_table`.
    """
    names = [TIME.name, *known]
    table = load_table(path, names, TableFormat())
    given = [split_header(header)[0] for header in table.headers]
    where = f"{path}, line {table.header_line}"
    if others := [name for name in given if name not in names]:
        raise DatasetError([unknown("there is no such channel", where, name, names) for name in others])
    read = read_table(path, {name: ColumnSpec(name) for name in given})
    raise_faults([Fault("a value is missing", str(path), f"column {name}") for name in read.incomplete], [])
    return read


def not_numbers(table: Table, places: Mapping[str, int], held: Columns) -> list[Fault]:
    """Faults of cells that are not numbers, one for all columns that have them in the same lines.

    Parameters
    ----------
    table
        The table, with its format and column names.
    places
        Name -> number of its column, from 0.
    held
        The columns as read.
    """
    faults: list[Fault] = []
    for n_lines, *lines in dict.fromkeys((one.n, *one.lines) for one in held.odd.values()):
        odd = {name: one for name, one in held.odd.items() if [one.n, *one.lines] == [n_lines, *lines]}
        n, cells = n_lines * len(odd), [cell for one in odd.values() for cell in one.cells]
        n_left = table.last_line - lines[0] + 1  # lines from the first of them to the end
        attempt = ""
        if lines[0] == table.first_line and n_lines == 1:
            names = f", or header_row: {lines[0]}, if it has the names" if len(odd) == len(places) else ""
            attempt = f"units_row: {lines[0]}, if it has the units{names}"
        if not any(cells):
            attempt = "a file without these lines, or with values there: time and what drives the robot need one a row"
        elif all(_THOUSANDS.fullmatch(cell) for cell in cells):
            attempt = "numbers without a mark between thousands"
        elif n_left <= _FOOTER and sum(i >= lines[0] for numbers, _ in table.rows() for i in numbers) == n_lines:
            attempt = f"skip_footer: {n_left}, to leave the end of the file out"
        some = list(dict.fromkeys(cells))[:N_NAMED]
        shown = ", ".join(repr(cell if len(cell) <= 40 else cell[:39] + "…") if cell else "nothing" for cell in some)
        columns = ", ".join(f"'{table.headers[places[name]]}'" for name in odd)
        place = f"{table.path}, {'columns' if len(odd) > 1 else 'column'} {columns}, {line_numbers(lines, n_lines)}"
        allowed = f"numbers with a decimal {'comma' if held.decimal == ',' else 'point'}"
        more = ", …" if n > len(cells) or len(set(cells)) > len(some) else ""
        faults.append(Fault(f"{n} value(s) are not numbers", place, shown + more, allowed, attempt))
    return faults


def line_numbers(first: Sequence[int], n: int) -> str:
    """Text such as "lines 3, 7, …": the first numbers of n lines."""
    numbers = ", ".join(map(str, first[:N_NAMED]))
    return ("line " if n == 1 else "lines ") + numbers + (", …" if n > N_NAMED else "")
