"""The header of a bench file: columns of the requested channels, and their units."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from softcal.errors import DatasetError, Fault, UnitError, nearest, unknown
from softcal.experiments.columns import Filter
from softcal.experiments.orientation import QUATERNION
from softcal.experiments.table import Table, bare_unit, is_unit, is_unit_of, load_table, split_header
from softcal.experiments.table_format import ColumnSpec, TableFormat
from softcal.sensing.channel import channel_name, channel_unit, kinds
from softcal.sensing.sensors.pose import ANGLES
from softcal.units import sensor_factor, unit_factor

MASS = "mass"  # a mass that hangs from a cable: its weight is the tension


@dataclass
class ColumnLayout:
    """Columns of the channels in a table.

    Attributes
    ----------
    table
        The table.
    columns
        Channel -> column specification, without optional columns that are missing.
    places
        Channel -> column number.
    units
        Channel -> unit as written.
    factors
        Channel -> factor to SI.
    filters
        Filters of rows.
    label
        Column of row labels, or None.
    faults, unit_faults
        Faults of the header.
    """

    table: Table
    columns: Mapping[str, ColumnSpec]
    places: dict[str, int] = field(default_factory=dict[str, int])
    units: dict[str, str] = field(default_factory=dict[str, str])
    factors: dict[str, float] = field(default_factory=dict[str, float])
    filters: list[Filter] = field(default_factory=list[Filter])
    label: int | None = None
    faults: list[Fault] = field(default_factory=list[Fault])
    unit_faults: list[Fault] = field(default_factory=list[Fault])


def read_layout(
    path: Path,
    columns: Mapping[str, ColumnSpec],
    written: TableFormat,
    *,
    where: Mapping[str, object] | None = None,
    optional: Collection[str] = (),
    label: str | None = None,
) -> ColumnLayout:
    """Find the columns of a file without reading its rows.

    Parameters
    ----------
    path
        The file.
    columns
        Channel -> its column.
    written
        Format of the table, as far as it is stated.
    where
        Column -> value, or list of values, of the rows to keep.
    optional
        Channels that are omitted if the file has no such column.
    label
        Column that names each row.

    Raises
    ------
    DatasetError
        For missing channels, or a file without a header.
    StorageError
        Where the file cannot be read.
    """
    asked = f"columns for {path.name}"
    allowed = [*kinds(), *QUATERNION, MASS]
    faults = [
        unknown(
            f"no channel has the name '{key}'",
            asked,
            key,
            allowed,
            got="",
            more="; with the part's name before it, such as cable1.tension or m4.x",
        )
        for key in columns
        if column_unit(key) is None
    ]
    quaternion = [key for key in QUATERNION if key in columns]
    if quaternion and len(quaternion) < 4:
        missing = ", ".join(key for key in QUATERNION if key not in columns)
        faults.append(Fault("a quaternion needs all four columns", where=asked, got=f"no {missing}"))
    if quaternion and any(angle.name in columns for angle in ANGLES):
        faults.append(Fault("angles and quaternions exclude each other", where=asked))
    if not columns:
        faults.append(Fault("no column is requested", where=asked, allowed=", ".join(allowed)))
    if faults:
        raise DatasetError(faults)
    table = load_table(
        path,
        [*(spec.name for spec in columns.values()), *(where or {}), *([label] if label else [])],
        written,
    )
    layout = ColumnLayout(table, {k: spec for k, spec in columns.items() if k not in optional or table.find(spec.name)})
    names = [*(spec.name for spec in layout.columns.values()), *(where or {}), *([label] if label else [])]
    if missing := [name for name in dict.fromkeys(names) if not table.find(name)]:
        layout.faults.append(_no_columns(table, missing))
    for key, spec in layout.columns.items():
        if spec.name not in missing and (place := find_column(table, spec.name, layout.faults)) is not None:
            layout.places[key] = place
    for name, wanted in (where or {}).items():
        if name not in missing and (place := find_column(table, name, layout.faults)) is not None:
            values = wanted if isinstance(wanted, list | tuple) else [wanted]
            layout.filters.append(Filter(place, tuple(str(value) for value in values)))
    layout.label = None if label is None or label in missing else find_column(table, label, layout.faults)
    for key, place in layout.places.items():
        si_unit = column_unit(key) or "1"
        spec = layout.columns[key]
        constant = spec.scale if isinstance(spec.scale, str) else ""
        common = "counts" if constant else "mm" if si_unit == "m" else si_unit
        attempt = f"unit: {common}, in the project"
        found = unit_of_column(table, place, si_unit, layout.unit_faults, spec.unit, attempt, constant)
        if found is not None:
            layout.units[key], layout.factors[key] = found
    return layout


def raise_faults(faults: list[Fault], unit_faults: list[Fault]) -> None:
    """Raise the collected faults.

    Raises
    ------
    DatasetError
        With all faults, if any is not a unit's.
    UnitError
        If all faults are of units.
    """
    if faults:
        raise DatasetError([*faults, *unit_faults])
    if unit_faults:
        raise UnitError(unit_faults)


def column_unit(channel: str) -> str | None:
    """SI unit of a column's channel; None for an unknown channel."""
    if channel in QUATERNION:
        return "1"
    name = channel_name(channel)
    is_mass = name.kind.name == MASS and "." not in name.carrier and not name.is_deviation
    return "kg" if is_mass else channel_unit(channel)


def find_column(table: Table, name: str, faults: list[Fault]) -> int | None:
    """Number of the column of a name; None, with a fault, if there is none or more than one.

    Parameters
    ----------
    table
        The table, with its format and column names.
    name
        Name of the column, with or without its unit.
    faults
        Collects the faults.
    """
    found = table.find(name)
    if len(found) == 1:
        return found[0]
    where = f"{table.path}, line {table.header_line}"
    if found:
        headers = ", ".join(f"'{table.headers[column]}' (column {column + 1})" for column in found)
        faults.append(Fault(f"{len(found)} columns have the name '{name}'", where, headers, "", "rename one of them"))
        return None
    faults.append(_no_columns(table, [name]))
    return None


def _no_columns(table: Table, names: list[str]) -> Fault:
    headers = [header for header in table.headers if header]
    alike = (nearest(name, [*headers, *(split_header(header)[0] for header in headers)]) for name in names)
    return Fault(
        f"no column{'s' * (len(names) > 1)} " + ", ".join(f"'{name}'" for name in names),
        where=f"{table.path}, line {table.header_line}",
        got="columns " + ", ".join(f"'{header}'" for header in headers),
        attempt=", ".join(filter(None, dict.fromkeys(alike))),
    )


def unit_of_column(
    table: Table,
    place: int,
    si_unit: str,
    faults: list[Fault],
    stated: str | None = None,
    attempt: str = "the unit in brackets behind the name of the column",
    constant: str = "",
) -> tuple[str, float] | None:
    """Unit of a column and its factor to SI, from the project or the file; a contradiction of both is a fault.

    Parameters
    ----------
    table
        The table, with its format and column names.
    place
        Number of the column, from 0.
    si_unit
        SI unit of the channel.
    faults
        Collects the faults.
    stated
        Unit in the project; None to use that of the file.
    attempt
        Where to state a missing unit, for messages.
    constant
        Constant of a sensor that writes another quantity, see `sensor_factor`; "" of any other.
    """
    header = table.headers[place]
    where = f"{table.path}, line {table.header_line}, column '{header}'"
    in_row, in_name = bare_unit(table.unit_cells[place]), split_header(header)[1] or ""
    in_file = in_row or in_name or None
    factors = {u: unit_factor(u, si_unit) for u in (in_row, in_name) if u and is_unit_of(u, si_unit)}
    if len(factors) == 2 and not np.isclose(*factors.values(), rtol=1e-9):
        got, attempt = f"'{in_name}' in the name, '{in_row}' in the row below", "correct the file"
        faults.append(Fault("the file names two units of this column", where, got, attempt=attempt))
        return None
    unit = stated if stated is not None else in_file
    if unit is None or (unit == "" and si_unit != "1"):
        if si_unit == "1":
            unit = "1"
        else:
            leads = f"{constant} leads from" if constant else f"converts to {si_unit}"
            faults.append(
                Fault(
                    "the unit is missing",
                    where=where,
                    allowed=f"a unit that {leads}, in the header or in a row under it",
                    attempt=attempt,
                )
            )
            return None
    if unit in ("", "-") and si_unit == "1":
        unit = "1"
    try:
        if constant:
            return unit, sensor_factor(unit, constant, si_unit, where=where)
        factor = unit_factor(unit, si_unit, where=where)
        if stated is not None and in_file and is_unit(in_file):
            file_factor = unit_factor(in_file, si_unit, where=where)
            if not np.isclose(file_factor, factor, rtol=1e-9):
                faults.append(
                    Fault(
                        "the project and the file name different units",
                        where=where,
                        got=f"'{stated}' in the project, '{in_file}' in the file",
                        attempt="leave the unit out of the project to use the file's, or correct the header",
                    )
                )
                return None
    except UnitError as error:
        faults += error.faults if stated or is_unit(unit) else [replace(f, attempt=attempt) for f in error.faults]
        return None
    return unit, factor
