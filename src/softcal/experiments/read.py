"""Bench files as instruments write them, read into a Dataset in SI with every fault of the file told at once."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault, InputError, UnitError, nearest
from softcal.experiments.columns import N_NAMED, Columns, Filter, Odd, cells_of, read_columns
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.names import ANGLES, CHANNEL_UNITS, QUATERNION, channel_unit
from softcal.experiments.orientation import plate_angles
from softcal.experiments.table import WHITESPACE, Table, bare_unit, is_unit, load_table, split_header
from softcal.units import unit_factor

_COLUMN_UNITS = {**CHANNEL_UNITS, **dict.fromkeys(QUATERNION, "1"), "mass": "kg"}
_N_VALUES = 10  # values of a column named in a fault


@dataclass(frozen=True)
class ColumnSpec:
    """Where a channel stands in a file.

    name: the column's header, with or without its unit. unit: of the numbers; None reads it from the file.
    scale: factor on the numbers, such as -1 for a machine that writes tension negative.
    """

    name: str
    unit: str | None = None
    scale: float = 1.0


def read_table(  # noqa: PLR0913 (one keyword for each thing in which files differ)
    path: str | Path,
    columns: Mapping[str, ColumnSpec],
    *,
    name: str = "",
    delimiter: str | None = None,
    decimal: str | None = None,
    header_row: int | None = None,
    units_row: int | None = None,
    skip_rows: int = 0,
    skip_footer: int = 0,
    where: Mapping[str, object] | None = None,
    axes: Sequence[str] = ("x", "y", "z"),
    rest_samples: int = 10,
    optional: Collection[str] = (),
    label: str | None = None,
) -> Dataset:
    """Read a CSV or TXT file of a testing machine, an IMU, or of markers.

    Parameters
    ----------
    path
        Text in UTF-8, Latin-1 or UTF-16. Lines that start with #, %, ! or // are comments; lines above the column
        names are skipped.
    columns
        Channel -> its column. Channels: time, shortening, tension, pitch, roll, yaw, x, y, z; the same but time of
        several cables, plates and markers, such as `cable1.tension` or `m4.x` (there an empty cell is a missing value),
        and their standard deviations, such as `m4.x_sd`; mass [kg] of what hangs from a cable. The four columns qw, qx,
        qy, qz become pitch, roll and yaw (`orientation.plate_angles`).
    name
        Name of the dataset; the file's stem where empty.
    delimiter, decimal
        comma, semicolon, tab or " " (any white space); "." or ",". Found from the file where None.
    header_row, units_row
        1-based line of the column names and of the units under them. Found from the file where None.
    skip_rows, skip_footer
        Lines to leave out at the top and at the bottom.
    where
        Column -> value, or list of values: only rows that hold it, compared as a number where both are numbers.
    axes, rest_samples
        For quaternions: the robot's x, y, z as seen by the sensor, and the samples at rest at the beginning.
    optional
        Channels that are left out where the file has no such column.
    label
        Column that names each row.

    Raises
    ------
    DatasetError
        Missing or doubled column, text or NaN in a number column, time that runs backwards, an empty file, a filter
        that leaves nothing: all that were found.
    UnitError
        Where all that is wrong is units: missing, unknown, of another dimension, or other than the file says.
    StorageError
        Where the file cannot be read.
    """
    path = Path(path)
    _check_channels(path, columns)
    table = load_table(
        path,
        [*(spec.name for spec in columns.values()), *(where or {}), *([label] if label else [])],
        delimiter=delimiter,
        header_row=header_row,
        units_row=units_row,
        skip_rows=skip_rows,
        skip_footer=skip_footer,
    )
    faults: list[Fault] = []
    unit_faults: list[Fault] = []
    columns = {key: spec for key, spec in columns.items() if key not in optional or table.find(spec.name)}
    found = {key: _find_column(table, spec.name, faults) for key, spec in columns.items()}
    places = {key: place for key, place in found.items() if place is not None}
    filters = _filters(table, where or {}, faults)
    named = None if label is None else _find_column(table, label, faults)
    held = read_columns(table, places, may_miss=lambda key: "." in key, filters=filters, label=named, decimal=decimal)
    faults += _unmet(table, filters, held)
    values: dict[str, Floats] = {}
    units: dict[str, str] = {}
    for key, place in places.items():
        factor = _unit_of(table, key, columns[key], place, units, unit_faults)
        if key in held.odd:
            faults.append(_not_numbers(table, place, held.odd[key], held.decimal))
        elif factor is not None:
            values[key] = held.numbers[key]
            values[key] *= factor * columns[key].scale
    if named is not None:
        faults += _doubled_labels(table, named, held)
    n_equal_times = _check_time(table, held, values, places, faults)
    if faults:
        raise DatasetError([*faults, *unit_faults])
    if unit_faults:
        raise UnitError(unit_faults)
    n_kept, n_rows, labels, used_decimal = len(held.lines), held.n_rows, held.labels, held.decimal
    del held  # its numbers are in `values`, and a table may be as large as the memory allows
    channels, notes = _channels(table, values, axes, rest_samples)
    if n_equal_times:
        notes.append(f"{n_equal_times} sample(s) share their time with the one before")
    settings: dict[str, Any] = {
        "file": path.name,
        "sha256": table.file.sha256,
        "columns": {key: {"name": spec.name, "unit": units[key], "scale": spec.scale} for key, spec in columns.items()},
        "delimiter": {"\t": "tab", WHITESPACE: "white space"}.get(table.delimiter, table.delimiter),
        "decimal": used_decimal,
        "encoding": table.file.encoding,
        "header_row": table.header_line,
    }
    if where:
        settings["where"] = {key: str(value) for key, value in where.items()}
    kept = f"{n_kept} of {n_rows} rows" if where else f"{n_rows} rows"
    units_read = ", ".join(f"{key} from '{spec.name}' in {units[key]}" for key, spec in columns.items())
    outcome = "; ".join([f"{kept} read: {units_read}", *notes])
    return Dataset(name or path.stem, channels, (Step("read_table", settings, outcome),), labels=labels)


def _column_unit(channel: str) -> str | None:
    """The SI unit of what a column may hold, None where no channel goes by the name."""
    if channel in _COLUMN_UNITS:
        return _COLUMN_UNITS[channel]
    owner, _, kind = channel.rpartition(".")
    return "kg" if owner and "." not in owner and kind == "mass" else channel_unit(channel)


def _doubled_labels(table: Table, place: int, held: Columns) -> list[Fault]:
    """A fault where two rows go by one label."""
    first: dict[str, int] = {}
    twice = [i for i, text in enumerate(held.labels) if first.setdefault(text, i) < i]
    if not twice:
        return []
    lines = _lines(held.lines[twice[:N_NAMED]].tolist(), len(twice))
    where = f"{table.path}, column '{table.headers[place]}', {lines}"
    return [Fault("two rows go by one label", where, got=f"'{held.labels[twice[0]]}'")]


def _check_channels(path: Path, columns: Mapping[str, ColumnSpec]) -> None:
    where = f"columns for {path.name}"
    faults = [
        Fault(
            f"no channel goes by the name '{key}'",
            where=where,
            allowed=", ".join(_COLUMN_UNITS) + "; with the part's name before it, such as cable1.tension or m4.x",
            attempt=nearest(key, _COLUMN_UNITS),
        )
        for key in columns
        if _column_unit(key) is None
    ]
    quaternion = [key for key in QUATERNION if key in columns]
    if quaternion and len(quaternion) < 4:
        missing = ", ".join(key for key in QUATERNION if key not in columns)
        faults.append(Fault("a quaternion needs all four columns", where=where, got=f"no {missing}"))
    if quaternion and any(key in columns for key in ANGLES):
        faults.append(Fault("angles and quaternions exclude each other", where=where))
    if not columns:
        faults.append(Fault("no column is asked for", where=where, allowed=", ".join(_COLUMN_UNITS)))
    if faults:
        raise DatasetError(faults)


def _find_column(table: Table, name: str, faults: list[Fault]) -> int | None:
    found = table.find(name)
    if len(found) == 1:
        return found[0]
    where = f"{table.path}, line {table.header_line}"
    if found:
        headers = ", ".join(f"'{table.headers[column]}' (column {column + 1})" for column in found)
        faults.append(Fault(f"{len(found)} columns go by the name '{name}'", where=where, got=headers))
        return None
    headers = [header for header in table.headers if header]
    alike = nearest(name, [*headers, *(split_header(header)[0] for header in headers)])
    faults.append(
        Fault(
            f"no column '{name}'",
            where=where,
            got="columns " + ", ".join(f"'{header}'" for header in headers),
            attempt=alike,
        )
    )
    return None


def _filters(table: Table, where: Mapping[str, object], faults: list[Fault]) -> list[Filter]:
    filters: list[Filter] = []
    for name, wanted in where.items():
        place = _find_column(table, name, faults)
        if place is not None:
            values = wanted if isinstance(wanted, list | tuple) else [wanted]
            filters.append(Filter(place, tuple(str(value) for value in values)))
    return filters


def _unmet(table: Table, filters: Sequence[Filter], held: Columns) -> list[Fault]:
    """The values of the first filter that no row holds: those that follow saw none for it."""
    if not held.unmet:
        return []
    i, (missing, seen) = next(iter(held.unmet.items()))
    shown = ", ".join(f"'{value}'" for value in seen[:_N_VALUES]) + (", …" if len(seen) > _N_VALUES else "")
    column = f"{table.path}, column '{table.headers[filters[i].column]}'"
    return [Fault(f"no row holds '{value}'", where=column, allowed=shown) for value in missing]


def _unit_of(
    table: Table, key: str, spec: ColumnSpec, place: int, units: dict[str, str], faults: list[Fault]
) -> float | None:
    """Factor to SI: from the project where it says, but never against what the file says."""
    si_unit = _column_unit(key) or "1"
    header = table.headers[place]
    where = f"{table.path}, line {table.header_line}, column '{header}'"
    in_file = bare_unit(table.unit_cells[place]) or split_header(header)[1]
    unit = spec.unit if spec.unit is not None else in_file
    if unit is None or (unit == "" and si_unit != "1"):
        if si_unit == "1":
            unit = "1"
        else:
            faults.append(
                Fault(
                    "the unit is missing",
                    where=where,
                    allowed=f"a unit that converts to {si_unit}, in the header, in a row under it, or in the project",
                    attempt=f"unit: {'mm' if si_unit == 'm' else si_unit}",
                )
            )
            return None
    if unit in ("", "-") and si_unit == "1":
        unit = "1"
    try:
        factor = unit_factor(unit, si_unit, where=where)
        if spec.unit is not None and in_file and is_unit(in_file):
            file_factor = unit_factor(in_file, si_unit, where=where)
            if not np.isclose(file_factor, factor, rtol=1e-9):
                faults.append(
                    Fault(
                        "the project and the file name different units",
                        where=where,
                        got=f"'{spec.unit}' in the project, '{in_file}' in the file",
                        attempt="leave the unit out of the project to use the file's",
                    )
                )
                return None
    except UnitError as error:
        faults.extend(error.faults)
        return None
    units[key] = unit
    return factor


def _not_numbers(table: Table, place: int, odd: Odd, decimal: str) -> Fault:
    shown = ", ".join(repr(_short(cell)) if cell else "nothing" for cell in odd.cells)
    return Fault(
        f"{odd.n} value(s) are not numbers",
        where=f"{table.path}, column '{table.headers[place]}', {_lines(odd.lines, odd.n)}",
        got=shown + (", …" if odd.n > len(odd.cells) else ""),
        allowed=f"numbers with a decimal {'comma' if decimal == ',' else 'point'}",
    )


def _short(cell: str) -> str:
    return cell if len(cell) <= 40 else cell[:39] + "…"


def _lines(first: Sequence[int], n: int) -> str:
    numbers = ", ".join(map(str, first[:N_NAMED]))
    return ("line " if n == 1 else "lines ") + numbers + (", …" if n > N_NAMED else "")


def _check_time(
    table: Table, held: Columns, values: Mapping[str, Floats], places: Mapping[str, int], faults: list[Fault]
) -> int:
    """A fault where time runs backwards; the number of samples whose time is that of the one before."""
    if "time" not in values:
        return 0
    steps = np.diff(values["time"])
    back = np.flatnonzero(steps < 0)
    if len(back):
        place, (i, *_) = places["time"], back.tolist()
        before, after = cells_of(table, place, held.lines[[i, i + 1]].tolist())
        lines = _lines(held.lines[back[:N_NAMED] + 1].tolist(), len(back))
        faults.append(
            Fault(
                f"time runs backwards {len(back)} time(s)",
                where=f"{table.path}, column '{table.headers[place]}', {lines}",
                got=f"'{after}' after '{before}'",
                allowed="times that never fall",
                attempt="a filter `where`, if the file holds several tests one after the other",
            )
        )
    return int(np.count_nonzero(steps == 0))


def _channels(
    table: Table, values: dict[str, Floats], axes: Sequence[str], rest_samples: int
) -> tuple[dict[str, Channel], list[str]]:
    notes: list[str] = []
    if QUATERNION[0] in values:
        quaternions = np.column_stack([values.pop(key) for key in QUATERNION])
        try:
            angles = plate_angles(quaternions, axes=axes, rest_samples=rest_samples)
        except InputError as error:
            raise DatasetError(
                [replace(fault, where=f"{table.path}, {fault.where}") for fault in error.faults]
            ) from error
        values.update(zip(ANGLES, angles, strict=True))
        notes.append(
            f"quaternions turned into pitch, roll and yaw about the mean pose of the first "
            f"{min(rest_samples, len(quaternions))} samples, robot axes {', '.join(axes)} of the sensor"
        )
    else:
        for key in ANGLES:
            if key in values:
                unwrapped = np.unwrap(values[key]) if (np.abs(np.diff(values[key])) >= np.pi).any() else values[key]
                if not np.array_equal(unwrapped, values[key]):
                    notes.append(f"jumps of a full turn taken out of {key}")
                values[key] = unwrapped
    for key, value in values.items():
        if np.isnan(value).any():
            notes.append(f"{key} is missing in {int(np.isnan(value).sum())} row(s)")
    # One after the other, since a channel is a copy.
    return {key: Channel(values.pop(key), _column_unit(key) or "1") for key in list(values)}, notes
