"""The table of a fleet: a row for each specimen, which says by what its project differs from a template.

The template is any project file. A column sets what its name says, in this order:

specimen        the specimen's name; every row has one of its own
file            the measured file, where the template's experiments all read the same one
infill          the share of the print that is filled; a factor, and the abscissa of E = E_bulk phi^gamma
print.infill    the same, which sets it in the template too
a key of the template, such as `experiments.pull.file`, `rig.length` or `robot.cables.front.via[1].at`
a parameter, as by `--set`, such as `neck.youngs_modulus`: it is fixed at the specimen's value
any name without a dot      a factor, such as filament or printer: specimens are compared by it

A unit stands in the header (`robot.bodies.neck.mesh.outer_diameter [mm]`) or in the cell. An empty cell leaves what the
template says; of a factor it says that nothing is known, and as a measured file it is refused. Paths are relative to
the template, as those in it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from softcal.display import displayed
from softcal.errors import Fault, InputError, ProjectFileError, StorageError, nearest, unknown
from softcal.experiments.columns import decimals_fault
from softcal.experiments.read import line_numbers
from softcal.experiments.table import Table, is_unit, load_table, split_header, uses_decimal_comma
from softcal.experiments.table_format import TableFormat
from softcal.experiments.text_file import open_text
from softcal.limits import LIMITS, folded, name_fault
from softcal.project.document import Document, Entry, dotted, key_path
from softcal.project.files import InputFiles, sha256
from softcal.project.project import Project, load
from softcal.project.sections import SECTIONS
from softcal.project.yaml_file import read_document
from softcal.quantities import QUANTITIES
from softcal.regular_file import not_a_file
from softcal.units import parse_quantity

TABLE, TEMPLATE = "fleet.csv", "project.yaml"
SPECIMEN, FILE, INFILL = "specimen", "file", "infill"
_FILES = "files"
_TAKEN = re.compile(r"(\.json|\.json\.part|\.(failed|changed)-[0-9]+)$")  # see `workflows.fleet_folder`
_MEASURED = re.compile(r"experiments\..+\.files\[\d+\]\.path")
_NEAR = 0.85  # of a name to that of a key, from which on one may be meant for the other


@dataclass(frozen=True)
class FleetRow:
    """One specimen of a table.

    Attributes
    ----------
    name
        Name of the specimen.
    changes
        Key of the template -> what stands in its place.
    values
        Parameter -> the value at which it is fixed, as written.
    factors
        Factor -> its value: text, a number [SI], or None where the table has none.
    line
        Of the table.
    places
        Parameter of `values` -> where it is written.
    measured
        The measured files of all experiments, by their paths as the template has them.
    """

    name: str
    changes: Mapping[str, Entry]
    values: Mapping[str, str]
    factors: Mapping[str, str | float | None]
    line: int = 0
    places: Mapping[str, str] = field(default_factory=dict[str, str])
    measured: tuple[str, ...] = ()


@displayed
@dataclass(frozen=True)
class FleetTable:
    """A table of specimens without faults of its own.

    Attributes
    ----------
    path, template
        The table, and the project file that all specimens share.
    rows
        The specimens in order.
    sets
        Columns that set something in the template.
    factors
        Factor -> its unit as in a record: "1" of a number without one, "" of text.
    hashes
        SHA-256 of the table and of the template.
    """

    path: Path
    template: Path
    rows: tuple[FleetRow, ...]
    sets: tuple[str, ...]
    factors: Mapping[str, str]
    hashes: Mapping[str, str]


def read_fleet(source: str | Path, template: str | Path | None = None, by: Sequence[str] = ()) -> FleetTable:
    """Read the table of a fleet.

    Parameters
    ----------
    source
        The table, or a folder with it as fleet.csv.
    template
        The project file; project.yaml beside the table by default.
    by
        Columns that are factors, and no others; by default all whose name has no dot and is no key of the template.

    Raises
    ------
    ProjectFileError
        With every fault of the table by itself; what only a specimen's project shows is found by `row_project`.
    StorageError
        Where the table or the template cannot be read.
    """
    table, faults = parse_fleet(source, template, by)
    if faults:
        raise ProjectFileError(merged(faults))
    return table


def parse_fleet(
    source: str | Path, template: str | Path | None = None, by: Sequence[str] = ()
) -> tuple[FleetTable, list[Fault]]:
    """See `read_fleet`; returns the faults of the table beside its contents instead of raising them.

    Parameters
    ----------
    source
        The table, or a folder with it as fleet.csv.
    template
        The project file; project.yaml beside the table by default.
    by
        Columns that are factors, and no others; by default all whose name has no dot and is no key of the template.

    Raises
    ------
    StorageError
        Where the table or the template cannot be read.
    InputError
        For anything but paths.
    """
    path = Path(source)
    path = path / TABLE if path.is_dir() else path
    of = path.parent / TEMPLATE if template is None else Path(template)
    for one, kind, attempt in ((path, "table of the fleet", ""), (of, "template", "--template FILE")):
        if found := not_a_file(one):
            raise StorageError(Fault(f"the {kind} cannot be read", str(one), found, "a regular file", attempt))
    document = read_document(of)
    # The first line that is no comment has the names, since any other can be a row of names.
    numbered = ((i, line) for number, lines in open_text(path).blocks() for i, line in enumerate(lines, start=number))
    header = next((i for i, line in numbered if line.strip() and not line.lstrip().startswith("#")), None)
    table = load_table(path, [SPECIMEN, INFILL, FILE], TableFormat(header_row=header))
    reader = _RowReader(table, document, by)
    rows = reader.rows()
    sets = tuple(one.header for one in reader.columns if one.kind in ("key", "parameter"))
    factors = {one.name: one.unit for one in reader.columns if one.factor and (not by or one.name in by)}
    hashes = {path.name: sha256(path), of.name: sha256(of)}
    return FleetTable(path, of, rows, sets, factors, hashes), reader.faults


def row_project(template: Path, row: FleetRow) -> Project:
    """One specimen's project.

    Raises
    ------
    InputError
        With every fault of it, those of fixed parameters at their cells.
    """
    try:
        return load(template, changes=row.changes, values=row.values)
    except InputError as error:
        raise type(error)(replace(one, where=row.places.get(one.where, one.where)) for one in error.faults) from error


def missing_files(template: Path, row: FleetRow) -> list[Fault]:
    """Faults of a row's missing data files, as `row_project` has them, at their cells."""
    files, faults = InputFiles(template.parent), list[Fault]()
    for key, entry in row.changes.items():
        if _MEASURED.fullmatch(key):
            try:
                files.find(str(entry.value), "data file")
            except StorageError as error:
                faults += [replace(one, where=entry.place) for one in error.faults]
    return faults


@dataclass(frozen=True)
class _TableColumn:
    """A column: its header, kind, name of its factor, the keys or the parameter that it sets, and its unit."""

    place: int
    header: str
    kind: str
    name: str = ""
    keys: tuple[str, ...] = ()
    unit: str = ""
    factor: bool = False


class _RowReader:
    """Reads the rows of a table; collects faults."""

    def __init__(self, table: Table, document: Document, by: Sequence[str]) -> None:
        self.table, self.document, self.by = table, document, by
        self.faults: list[Fault] = []
        self.keys = {dotted(path) for path in document.lines if path}
        self.measured = sorted(key for key in self.keys if _MEASURED.fullmatch(key))
        self.columns: list[_TableColumn] = []

    def rows(self) -> tuple[FleetRow, ...]:
        lines: list[tuple[int, list[str]]] = []
        for numbers, cells in self.table.rows():
            lines += zip(numbers, cells, strict=True)
        for of, count in {"specimens": len(lines), "columns of a fleet": len(self.table.headers)}.items():
            LIMITS[of].check(count, where=str(self.table.path))
        self.columns = [
            column
            for place, header in enumerate(self.table.headers)
            if (column := self._column(place, header, [cells[place] for _, cells in lines])) is not None
        ]
        where = f"{self.table.path}, line {self.table.header_line}"
        shown = ", ".join(f"'{header}'" for header in self.table.headers if header)
        if SPECIMEN not in [one.name for one in self.columns]:
            attempt = nearest(SPECIMEN, self.table.headers)
            attempt = attempt and f"'{SPECIMEN}' for {attempt}"
            what = "the column with the specimens' names is missing"
            self.faults.append(Fault(what, where, shown, f"'{SPECIMEN}'", attempt))
        set_by: dict[str, list[str]] = {}
        for one in self.columns:
            for key in (one.name, *one.keys) if one.factor else one.keys or (one.name,):
                parameter = re.sub(r"^robot\.\w+\.", "", key)  # bar.density of robot.bodies.bar.density
                set_by.setdefault(parameter, []).append(f"'{one.header}'")
        for headers in set_by.values():
            if len(headers) > 1:
                what = f"{'two' if len(headers) == 2 else 'several'} columns mean the same"
                self.faults.append(Fault(what, f"{self.table.path}, columns {' and '.join(headers)}", allowed="one"))
        known = [one.name for one in self.columns if one.factor]
        for name in self.by:
            if name not in known:
                what = "the table has no such factor"
                self.faults.append(unknown(what, "--by", name, known))
        numbers = [match[1] for _, cells in lines for cell in cells if (match := _NUMBER.fullmatch(cell))]
        self.cells = CellReader(uses_decimal_comma(numbers))
        if self.cells.comma and (fault := decimals_fault(self.table, numbers)):
            self.faults.append(fault)
        seen: dict[str, tuple[int, str]] = {}
        return tuple(self._row(line, cells, seen) for line, cells in lines)

    def _column(self, place: int, header: str, cells: Sequence[str]) -> _TableColumn | None:
        """The meaning of a column; None if it is empty or at fault."""
        if not header:
            if any(cells):
                where = f"{self.table.path}, line {self.table.header_line}, column {place + 1}"
                self.faults.append(Fault("the column has no name", where, f"'{next(filter(None, cells))}'"))
            return None
        name, unit = (header, None) if header in self.keys else split_header(header)
        unit = unit or self.table.unit_cells[place]
        keys = self._keys_of(name)
        if name == SPECIMEN:
            return _TableColumn(place, header, SPECIMEN, name)
        if name in (INFILL, f"print.{INFILL}"):
            own = ("print.infill",) if "." in name else ()
            return _TableColumn(place, header, "key" if own else "factor", INFILL, own, unit or "1", factor=True)
        if keys and ("." in name or name == FILE):
            return _TableColumn(place, header, "key", name, keys, unit)
        if "." in name:
            owner = name.partition(".")[0]
            if owner not in SECTIONS:
                return _TableColumn(place, header, "parameter", name, (name,), unit)
            self._unknown(header, name)
            return None
        leaf = [name]
        if not keys:  # the template's values whose last part equals, or nearly equals, the name
            values = [key for key in self.keys if not isinstance(self._value(key), (dict, list))]
            near = get_close_matches(name, {key.rpartition(".")[2] for key in values}, n=1, cutoff=_NEAR)
            leaf = sorted(key for key in values if key.rpartition(".")[2] in near)
        if (name == FILE or leaf) and name not in self.by:
            self._unknown(header, name, leaf)
            return None
        return _TableColumn(place, header, "factor", name, (), unit, factor=True)

    def _unknown(self, header: str, name: str, leaf: Sequence[str] = ()) -> None:
        where = f"{self.table.path}, column '{header}'"
        if name == FILE:
            files = sorted(key for key in (f"{e}.file" for e in self._experiments()) if self._keys_of(key))
            allowed = ", ".join(files) or "experiments.NAME.files[0].path"
            self.faults.append(
                Fault("it is not clear which experiment's file this column sets", where, f"'{header}'", allowed)
            )
            return
        attempt = f"'{leaf[0]}'" if leaf else nearest(name, self.keys)
        attempt = "another name" if leaf == [name] else attempt
        allowed = f"a key of {self.document.name}, a parameter, or the name of a factor, which has no dot"
        attempt += f", or --by {name} if it is a factor" if leaf else ""
        self.faults.append(Fault("this column sets nothing", where, f"'{header}'", allowed, attempt))

    def _experiments(self) -> list[str]:
        return [f"experiments.{name}" for name in self.document.mapping("experiments")]

    def _keys_of(self, name: str) -> tuple[str, ...]:
        """The keys of the template that a column's name refers to; empty if none."""
        if name in self.keys:
            return (name,)
        if name == FILE:
            held = {key: self._value(key) for e in self._experiments() for key in self._keys_of(f"{e}.{FILE}")}
            every = len(held) == len(self._experiments()) and len(set(map(str, held.values()))) == 1
            return tuple(held) if every else ()
        owner, _, last = name.rpartition(".")
        if last == FILE and isinstance(files := self._value(f"{owner}.{_FILES}"), list) and len(files) == 1:
            return (f"{owner}.{_FILES}[0].path",)
        # A key that the template leaves out, of a mapping that it has.
        return (name,) if name.partition(".")[0] in SECTIONS and isinstance(self._value(owner), dict) else ()

    def _value(self, key: str) -> Any:
        here: Any = self.document.data
        for part in key_path(key):
            if isinstance(here, dict) and part in here:
                here = here[part]
            elif isinstance(here, list) and isinstance(part, int) and part < len(here):
                here = here[part]
            else:
                return None
        return here

    def _row(self, line: int, cells: Sequence[str], seen: dict[str, tuple[int, str]]) -> FleetRow:
        name = ""
        changes: dict[str, Entry] = {}
        values: dict[str, str] = {}
        factors: dict[str, str | float | None] = {}
        places: dict[str, str] = {}
        for column in self.columns:
            cell = cells[column.place]
            where = f"{self.table.path}, column '{column.header}', line {line}"
            if column.kind == SPECIMEN:
                name = cell
                if not name:
                    self.faults.append(Fault("a specimen has no name", where))
                elif fault := name_fault(name):
                    self.faults.append(replace(fault, where=where))
                elif match := _TAKEN.search(folded(name)):
                    what = f"a specimen's name cannot end in '{match[0]}', as files of the fleet do"
                    self.faults.append(Fault(what, where, f"'{name}'", attempt=f"'{name[: match.start()]}'"))
                elif folded(name) in seen:
                    other, first = seen[folded(name)]
                    what = "two rows have the same name" if first == name else "two names differ only in capitals"
                    got = f"'{name}', and '{first}' in line {other}"
                    self.faults.append(Fault(what, where, got, "a name for each specimen"))
                else:
                    seen[folded(name)] = (line, name)
            if column.factor:
                factors[column.name] = self._factor(column, cell, where)
            if not cell and not set(column.keys).isdisjoint(self.measured):
                what = "the specimen has no measured file here: that of the template is another one's"
                self.faults.append(Fault(what, where, attempt="a file, or no row for this specimen"))
            if cell and column.kind == "key":
                changes |= {key: Entry(self.cells.written(cell, column.unit), where) for key in column.keys}
            elif cell and column.kind == "parameter":
                values[column.name] = str(self.cells.written(cell, column.unit))
                places[column.name] = where
        measured = tuple(str(changes[key].value if key in changes else self._value(key)) for key in self.measured)
        return FleetRow(
            name=name, changes=changes, values=values, factors=factors, line=line, places=places, measured=measured
        )

    def _factor(self, column: _TableColumn, cell: str, where: str) -> str | float | None:
        if not cell:
            return None
        if column.name != INFILL:
            return self.cells.factor(cell, column.unit)
        try:
            value = parse_quantity(self.cells.written(cell, column.unit), "1", where=where)
            return QUANTITIES[INFILL].checked(value, where=where)
        except InputError as error:
            self.faults.extend(replace(one, where=where) for one in error.faults)
            return None


_NUMBER = re.compile(r"([-+−]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?)(.*)", re.DOTALL)
_SERIAL = re.compile(r"0\d")  # begins what is a name and no number, such as 007


@dataclass(frozen=True)
class CellReader:
    """Reads the cells of a table; comma: true if its numbers have decimal commas."""

    comma: bool

    def written(self, cell: str, unit: str) -> object:
        """A cell as a project file would have it: a finite number, with its unit, or text."""
        match = _NUMBER.fullmatch(cell)
        if match is None or (match[2].strip() and not is_unit(match[2].strip())):
            return {"true": True, "false": False}.get(cell, cell)
        number = match[1].replace("−", "-").replace(",", "." if self.comma else ",")
        if unit := match[2].strip() or unit:
            return f"{number} {unit}" if unit != "1" else number
        try:
            value = float(number)
            if not math.isfinite(value):
                return cell
            return int(number) if re.fullmatch(r"[-+]?\d+", number) else value
        except ValueError:
            return cell

    def factor(self, cell: str, unit: str) -> str | float:
        """The value of a factor: a number where the cell is one, else text."""
        written = cell if _SERIAL.match(cell) else self.written(cell, unit)
        return float(written) if isinstance(written, (int, float)) and not isinstance(written, bool) else str(written)


_LINE = re.compile(r", line (\d+)$")
_N_LINES = 5  # named in a fault of many rows


def merged(faults: Iterable[Fault]) -> list[Fault]:
    """Merge faults that differ only in the row into one that names the rows; other faults appear once each."""
    groups: dict[tuple[str, ...], list[tuple[int, Fault]]] = {}
    for one in dict.fromkeys(faults):
        match = _LINE.search(one.where)
        line = int(match[1]) if match else 0
        where = one.where[: match.start()] if match else one.where
        got = "" if match else one.got
        groups.setdefault((where, one.what, one.allowed, got), []).append((line, one))
    found: list[Fault] = []
    for (where, *_), held in groups.items():
        first = held[0][1]
        if len(held) > 1:
            lines = line_numbers([line for line, _ in held[:_N_LINES]], len(held))
            got = ", ".join(dict.fromkeys(one.got for _, one in held[:_N_LINES]))
            first = replace(first, where=f"{where}, {lines}", got=got)
        found.append(first)
    return found
