"""Detection of a text table's format (delimiter, header, units row), and its cells with line numbers."""

from __future__ import annotations

import csv
import functools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from softcal.csv_text import plain
from softcal.errors import DatasetError, Fault, UnitError
from softcal.experiments.table_format import TableFormat
from softcal.experiments.text_file import TextFile, open_text
from softcal.units import SI_UNITS, unit_factor

WHITESPACE = " "
DELIMITERS = (";", "\t", ",", WHITESPACE)

_COMMENTS = ("#", "%", "!", "//")
# Of a spreadsheet, in the first cell of a row: "#N/A", "#DIV/0!", "#NAME?", "#WERT!". The row is no comment.
_ERROR = re.compile(r"#(?:N/[AD]|NV|[A-ZÀ-Ý0-9/_¡¿]+[!?])\s*[,;\t]")
_HEADER_SEARCH_LINES = 1000
_BEGINNING = 2000  # non-empty lines used to detect the format
_CELL = re.compile(r'"[^"]*"|\S+')
# A unit in brackets belongs to the preceding word, with or without a blank. Without a limit on its length, each of many
# open brackets would be looked for to the line's end.
_UNIT_CELL = r"[\[(][^\])]{0,200}[\])]"
_HEADER_CELL = re.compile(rf'"[^"]*"|[^\s\[(]+(?:\s*{_UNIT_CELL})?|{_UNIT_CELL}')
_BRACKETED = re.compile(r"^(?P<base>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]$")
_BEFORE_UNIT = re.compile(r"^(?P<base>.*?)(?:\s*/\s*|\s+in\s+)(?P<unit>\S+)$")
_NUMBER = re.compile(r"^[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?$")
_MARKED = re.compile(r"^[\[(](?P<unit>[^\[\]()]*)[\])]$")
# Written after "_", "/" or "in"; a closed list, because a name may end in anything ("force_max", "run/2").
_SUFFIX_UNITS = frozenset(
    "m cm mm um µm in inch N kN mN kgf gf lbf kg g Pa kPa MPa bar mbar psi mmHg Torr ml s sec ms us µs min "
    "rad mrad deg degree degrees °".split()
)


@dataclass(frozen=True)
class Table:
    """The cells of a text file below its header, read on demand.

    headers: as written; unit_cells: the units row below, "" if there is none. first_line, last_line: line numbers of
    the first and last row (from 1).
    """

    file: TextFile
    delimiter: str
    header_line: int
    headers: tuple[str, ...]
    unit_cells: tuple[str, ...]
    first_line: int
    last_line: int

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.file.path

    def find(self, name: str) -> list[int]:
        """Columns with this name: as written, else without the unit, else ignoring case, else as `M1 X` of `M1.x`."""
        candidates = [(column, (header, split_header(header)[0])) for column, header in enumerate(self.headers)]
        wanted = " ".join(name.split())
        for level in range(2):
            found = [column for column, names in candidates if names[level] == wanted]
            if found:
                return found
        for pattern in (" ", r"[\s._:-]+"):
            folded = [(c, [re.sub(pattern, ".", name.casefold()) for name in names]) for c, names in candidates]
            found = [column for column, names in folded if re.sub(pattern, ".", wanted.casefold()) in names]
            if found:
                break
        return found

    def rows(self) -> Iterator[tuple[list[int], list[list[str]]]]:
        """The rows in blocks: line numbers and cells, one per header; empty rows are skipped.

        Raises
        ------
        DatasetError
            If there is no row, or rows have more fields than column names (between white space, also fewer): their
            number, and the first one.
        """
        width, n_rows, n_odd = len(self.headers), 0, 0
        first_odd = (0, 0)
        for number, lines in self.file.blocks():
            if number > self.last_line:
                break
            numbers: list[int] = []
            rows: list[list[str]] = []
            for i, line in enumerate(lines, start=number):
                if i < self.first_line or i > self.last_line or not line or _is_comment(line):
                    continue
                cells = _cells(self.path, i, line, self.delimiter)
                if not any(cells):
                    continue
                if len(cells) != width:
                    # Between white space an empty cell is not seen: the ones behind it would move to its place.
                    if any(cells[width:]) or (len(cells) < width and self.delimiter == WHITESPACE):
                        first_odd = first_odd if n_odd else (i, len(cells))
                        n_odd += 1
                    cells = _padded(cells, width)
                numbers.append(i)
                rows.append(cells)
            n_rows += len(rows)
            if rows and not n_odd:
                yield numbers, rows
        if n_odd:
            which = "more" if first_odd[1] > width else "fewer"
            raise DatasetError(
                Fault(
                    f"{n_odd} row(s) have {which} fields than there are column names",
                    where=f"{self.path}, line {first_odd[0]}",
                    got=f"{first_odd[1]} fields",
                    allowed=f"{width}, as in line {self.header_line}",
                    attempt="another delimiter; quotes around names with blanks; a decimal comma needs a delimiter "
                    "other than the comma, or quotes",
                )
            )
        if not n_rows:
            where = f"{self.path}, line {self.header_line}"
            raise DatasetError(Fault("no data below the column names", where=where, allowed="at least one row"))


def load_table(path: Path, wanted: Sequence[str], written: TableFormat) -> Table:
    """Detect the format of a text table; the header is the line with the most of the `wanted` column names.

    Parameters
    ----------
    path
        The file.
    wanted
        Names of columns; the header is the line with the most of them.
    written
        Format of the table, as far as it is stated.

    Raises
    ------
    StorageError
        Where the file cannot be read.
    DatasetError
        If it is empty, is not text, or has no column names.
    """
    file = open_text(path)
    last = file.n_lines - written.skip_footer
    # The first non-empty lines with their numbers: the header is among them.
    body: list[tuple[int, str]] = []
    least = max(written.header_row or 0, written.units_row or 0)
    for number, line in ((n, line) for first, lines in file.blocks() for n, line in enumerate(lines, start=first)):
        if number > last or (len(body) >= _BEGINNING and number > least):
            break
        if number > written.skip_rows and line.strip():
            body.append((number, line))
    if not body:
        skipped = min(written.skip_rows + written.skip_footer, file.n_lines)
        raise DatasetError(
            Fault(
                "the file is empty",
                where=str(path),
                got=f"{file.n_lines} line(s), {skipped} of them skipped",
                allowed="a line of column names and rows of numbers",
            )
        )
    chosen = written.delimiter or _sniff_delimiter(path, body, wanted, written.header_row)
    header_line = _find_header(path, body, wanted, chosen, written.header_row, last)
    header = next(line for number, line in body if number == header_line)
    headers = _cells(path, header_line, _uncomment(header), chosen, header=True)
    below = [(n, _cells(path, n, line, chosen)) for n, line in body if n > header_line and not _is_comment(line)]
    unit_cells, first = _take_units_row(below, header_line, written.units_row, path)
    while headers and not headers[-1]:
        headers.pop()
    return Table(
        file=file,
        delimiter=chosen,
        header_line=header_line,
        headers=tuple(" ".join(header.split()) for header in headers),
        unit_cells=tuple(_padded(unit_cells, len(headers))),
        first_line=first,
        last_line=last,
    )


def split_header(header: str) -> tuple[str, str | None]:
    """Name and unit of a header such as "Force [N]", "Force (kN)", "Kraft / N", "Weg in mm" or "force_N", else None."""
    text = " ".join(header.split())
    match = _BRACKETED.match(text)
    if match and match["base"]:
        return match["base"], match["unit"].strip()
    match = _BEFORE_UNIT.match(text)
    if match and match["base"] and match["unit"] in _SUFFIX_UNITS:
        return match["base"], match["unit"]
    base, _, suffix = text.rpartition("_")
    if base and suffix in _SUFFIX_UNITS:
        return base, suffix
    return text, None


def bare_unit(cell: str) -> str:
    """The unit of a cell of a units row, without brackets."""
    match = _MARKED.match(cell.strip())
    return (match["unit"] if match else cell).strip()


@functools.cache
def is_unit(text: str) -> bool:
    """True if `text` is a known unit."""
    return any(is_unit_of(text, si_unit) for si_unit in SI_UNITS.values())


@functools.cache
def is_unit_of(text: str, si_unit: str) -> bool:
    """True if `text` is a unit that converts to an SI unit."""
    try:
        unit_factor(text, si_unit)
    except UnitError:
        return False
    return True


def uses_decimal_comma(cells: Sequence[str]) -> bool:
    """True if more of the cells are numbers with a decimal comma than with a decimal point."""
    numbers = [cell for cell in cells if _NUMBER.match(cell)]
    return sum("," in cell for cell in numbers) > sum("." in cell for cell in numbers)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS) and not _ERROR.match(line.lstrip())


def _uncomment(line: str) -> str:
    return line.lstrip().lstrip("#%!/").strip() if _is_comment(line) else line


def _cells(path: Path, number: int, line: str, delimiter: str, *, header: bool = False) -> list[str]:
    try:
        if delimiter.isspace() and delimiter != "\t":
            cells = [cell.strip('"').strip() for cell in (_HEADER_CELL if header else _CELL).findall(line)]
        elif '"' in line:
            row = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
            cells = [cell.strip() for cell in row]
        else:
            cells = line.split(delimiter)
            if not (line.isascii() and line.isprintable() and " " not in line):
                cells = [cell.strip() for cell in cells]
        return [plain(cell) for cell in cells] if "'" in line else cells
    except csv.Error as error:
        raise DatasetError(Fault("the line cannot be cut into cells", f"{path}, line {number}", str(error))) from error


def _padded(cells: list[str], width: int) -> list[str]:
    return (cells + [""] * (width - len(cells)))[:width]


def _best_header(path: Path, body: list[tuple[int, str]], wanted: Sequence[str], delimiter: str) -> tuple[int, int]:
    """(columns matched, line number) of the best header; a commented line only if no other line matches."""
    best = (0, 0)
    for commented in (False, True):
        for number, line in body[:_HEADER_SEARCH_LINES]:
            if _is_comment(line) == commented:
                cells = _cells(path, number, _uncomment(line), delimiter, header=True)
                names = {name.casefold() for cell in cells for name in (" ".join(cell.split()), split_header(cell)[0])}
                matched = sum(" ".join(name.split()).casefold() in names for name in wanted)
                best = max(best, (matched, number), key=lambda entry: entry[0])
        if best[0]:
            break
    return best


def _sniff_delimiter(path: Path, body: list[tuple[int, str]], wanted: Sequence[str], header_row: int | None) -> str:
    if header_row is not None:
        body_header = [entry for entry in body if entry[0] == header_row]
    else:
        body_header = body
    matched = {delimiter: _best_header(path, body_header, wanted, delimiter)[0] for delimiter in DELIMITERS}
    if any(matched.values()):
        return max(DELIMITERS, key=lambda delimiter: matched[delimiter])
    # No wanted name anywhere: take the delimiter that splits the most lines into the same number of cells.
    sample = [(number, line) for number, line in body[-50:] if not _is_comment(line)]

    def regularity(delimiter: str) -> int:
        counts = Counter(len(_cells(path, number, line, delimiter)) for number, line in sample)
        counts.pop(1, None)
        return max(counts.values(), default=0)

    return max(DELIMITERS, key=regularity)


def _find_header(
    path: Path, body: list[tuple[int, str]], wanted: Sequence[str], delimiter: str, header_row: int | None, last: int
) -> int:
    numbers = [number for number, _ in body]
    if header_row is not None:
        if header_row not in numbers:
            raise DatasetError(
                Fault(
                    "the header row is not a line with text",
                    where=str(path),
                    got=f"line {header_row}",
                    allowed=f"a line with text, from {numbers[0]} to {last}",
                )
            )
        return header_row
    matched, number = _best_header(path, body, wanted, delimiter)
    if matched:
        return number
    previous = 0
    for number, line in body:
        if _is_comment(line):
            continue
        cells = [cell for cell in _cells(path, number, line, delimiter) if cell]
        if sum(bool(_NUMBER.match(cell)) for cell in cells) > len(cells) / 2:
            break
        if not all(is_unit(bare_unit(cell)) for cell in cells):
            previous = number
    if not previous:
        raise DatasetError(
            Fault(
                "no line with column names",
                where=str(path),
                got=f"line {body[0][0]}: {body[0][1].strip()[:60]!r}",
                allowed="a line that names the columns " + ", ".join(f"'{name}'" for name in wanted),
            )
        )
    return previous


def _take_units_row(
    below: list[tuple[int, list[str]]], header_line: int, units_row: int | None, path: Path
) -> tuple[list[str], int]:
    """The cells of the units row, most of them known units, and the first line of the rows."""
    if units_row is not None:
        found = [cells for number, cells in below if number == units_row]
        if not found:
            raise DatasetError(
                Fault("the units row is not a line below the header", where=str(path), got=f"line {units_row}")
            )
        return found[0], units_row + 1
    if not below:
        return [], header_line + 1
    number, row = below[0]
    cells = [cell for cell in row if cell]
    text_only = bool(cells) and not any(_NUMBER.match(cell) for cell in cells)
    if text_only and 2 * sum(bool(_MARKED.match(cell)) or is_unit(cell) for cell in cells) > len(cells):
        return row, number + 1
    return [], header_line + 1
