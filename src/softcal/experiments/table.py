"""From the bytes of an instrument's text file to cells with line numbers: encoding, delimiter, header, units row."""

from __future__ import annotations

import csv
import functools
import hashlib
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from softcal.errors import DatasetError, Fault, StorageError, UnitError
from softcal.units import SI_UNITS, unit_factor

WHITESPACE = " "
DELIMITERS = (";", "\t", ",", WHITESPACE)

_COMMENTS = ("#", "%", "!", "//")
_HEADER_SEARCH_LINES = 1000
_BRACKETED = re.compile(r"^(?P<base>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]$")
_AFTER_SLASH = re.compile(r"^(?P<base>.*?)\s*/\s*(?P<unit>\S+)$")
_NUMBER = re.compile(r"^[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?$")
_MARKED = re.compile(r"^[\[(](?P<unit>[^\[\]()]*)[\])]$")
# Written after an underscore or a slash; a closed list, because a name may end in anything ("force_max", "run/2").
_SUFFIX_UNITS = frozenset(
    "m cm mm um µm in inch N kN mN kgf gf lbf s sec ms us µs min rad mrad deg degree degrees °".split()
)


@dataclass(frozen=True)
class Table:
    """The cells of a text file below its header.

    headers: as written; unit_cells: the units row under them, "" where there is none. rows: one list of cells per
    data line, as long as `headers`; lines: the 1-based line in the file of each.
    """

    path: Path
    sha256: str
    encoding: str
    delimiter: str
    header_line: int
    headers: tuple[str, ...]
    unit_cells: tuple[str, ...]
    rows: tuple[list[str], ...]
    lines: tuple[int, ...]

    def find(self, name: str) -> list[int]:
        """Columns that go by `name`: as written, else with the unit left off, else in any case."""
        candidates = [(column, (header, split_header(header)[0])) for column, header in enumerate(self.headers)]
        wanted = " ".join(name.split())
        for level in range(2):
            found = [column for column, names in candidates if names[level] == wanted]
            if found:
                return found
        return [c for c, names in candidates if wanted.casefold() in (n.casefold() for n in names)]


def load_table(
    path: Path,
    wanted: Sequence[str],
    *,
    delimiter: str | None = None,
    header_row: int | None = None,
    units_row: int | None = None,
    skip_rows: int = 0,
    skip_footer: int = 0,
) -> Table:
    """Read a text table; the header is the line that names the most of the `wanted` columns.

    Raises
    ------
    StorageError
        Where the file cannot be read.
    DatasetError
        Where it is empty, has no column names, no data, or a row with more fields than names.
    """
    raw, text, encoding = _read_text(path)
    lines = text.splitlines()
    last = len(lines) - skip_footer
    body = [(number, line) for number, line in enumerate(lines[:last], start=1) if number > skip_rows and line.strip()]
    if not body:
        raise DatasetError(
            Fault(
                "the file is empty",
                where=str(path),
                got=f"{len(lines)} line(s)" + (f", {skip_rows + skip_footer} of them skipped" if lines else ""),
                allowed="a line of column names and rows of numbers",
            )
        )
    chosen = delimiter if delimiter is not None else _sniff_delimiter(body, wanted, header_row)
    header_line = _find_header(path, body, wanted, chosen, header_row)
    headers = _split(_uncomment(lines[header_line - 1]), chosen, header=True)
    below = [(n, _split(line, chosen)) for n, line in body if n > header_line and not _is_comment(line)]
    unit_cells, below = _take_units_row(below, units_row, path)
    while headers and not headers[-1]:
        headers.pop()
    below = [(n, cells) for n, cells in below if any(cells)]
    _check_rows(path, header_line, headers, below)
    width = len(headers)
    return Table(
        path=path,
        sha256=hashlib.sha256(raw).hexdigest(),
        encoding=encoding,
        delimiter=chosen,
        header_line=header_line,
        headers=tuple(" ".join(header.split()) for header in headers),
        unit_cells=tuple(_padded(unit_cells, width)),
        rows=tuple(_padded(cells, width) for _, cells in below),
        lines=tuple(n for n, _ in below),
    )


def split_header(header: str) -> tuple[str, str | None]:
    """Name and unit of a header such as "Force [N]", "Force (kN)", "Kraft / N" or "force_N"; unit None without one."""
    text = " ".join(header.split())
    match = _BRACKETED.match(text)
    if match and match["base"]:
        return match["base"], match["unit"].strip()
    match = _AFTER_SLASH.match(text)
    if match and match["base"] and match["unit"] in _SUFFIX_UNITS:
        return match["base"], match["unit"]
    base, _, suffix = text.rpartition("_")
    if base and suffix in _SUFFIX_UNITS:
        return base, suffix
    return text, None


def bare_unit(cell: str) -> str:
    """The unit of a cell of a units row, its brackets taken off."""
    match = _MARKED.match(cell.strip())
    return (match["unit"] if match else cell).strip()


@functools.cache
def is_unit(text: str) -> bool:
    """Whether `text` is a unit of any quantity that softcal knows."""
    for si_unit in SI_UNITS.values():
        try:
            unit_factor(text, si_unit)
        except UnitError:
            continue
        return True
    return False


def uses_decimal_comma(cells: Sequence[str]) -> bool:
    """Whether more of the cells are numbers with a decimal comma than with a decimal point."""
    numbers = [cell for cell in cells if _NUMBER.match(cell)]
    return sum("," in cell for cell in numbers) > sum("." in cell for cell in numbers)


def _read_text(path: Path) -> tuple[bytes, str, str]:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise StorageError(
            Fault("the data file cannot be read", where=str(path), got=error.strerror or str(error))
        ) from error
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    elif raw[:400].count(0) > len(raw[:400]) // 4:  # Latin text in UTF-16 is every second byte zero
        encodings = ["utf-16-be" if raw[:1] == b"\0" else "utf-16-le"]
    else:
        encodings = ["utf-8-sig", "latin-1"]
    for encoding in encodings:
        try:
            return raw, raw.decode(encoding), encoding
        except UnicodeDecodeError:
            continue
    raise DatasetError(
        Fault("the file is not text", where=str(path), allowed="UTF-8, Latin-1 or UTF-16 text such as CSV or TXT")
    )


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _uncomment(line: str) -> str:
    return line.lstrip().lstrip("#%!/").strip() if _is_comment(line) else line


def _split(line: str, delimiter: str, *, header: bool = False) -> list[str]:
    if delimiter.isspace() and delimiter != "\t":
        # In a header a unit in brackets belongs to the word before it, blank or no blank.
        pattern = r'"[^"]*"|[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?|[\[(][^\])]*[\])]' if header else r'"[^"]*"|\S+'
        return [cell.strip('"').strip() for cell in re.findall(pattern, line)]
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]


def _padded(cells: list[str], width: int) -> list[str]:
    return (cells + [""] * (width - len(cells)))[:width]


def _n_matched(cells: list[str], wanted: Sequence[str]) -> int:
    names = {name.casefold() for cell in cells for name in (" ".join(cell.split()), split_header(cell)[0])}
    return sum(" ".join(name.split()).casefold() in names for name in wanted)


def _best_header(body: list[tuple[int, str]], wanted: Sequence[str], delimiter: str) -> tuple[int, int]:
    """(columns matched, line number) of the best header; a commented line only where no other names any."""
    best = (0, 0)
    for commented in (False, True):
        for number, line in body[:_HEADER_SEARCH_LINES]:
            if _is_comment(line) == commented:
                matched = _n_matched(_split(_uncomment(line), delimiter, header=True), wanted)
                best = max(best, (matched, number), key=lambda entry: entry[0])
        if best[0]:
            break
    return best


def _sniff_delimiter(body: list[tuple[int, str]], wanted: Sequence[str], header_row: int | None) -> str:
    if header_row is not None:
        body_header = [entry for entry in body if entry[0] == header_row]
    else:
        body_header = body
    matched = {delimiter: _best_header(body_header, wanted, delimiter)[0] for delimiter in DELIMITERS}
    if any(matched.values()):
        return max(DELIMITERS, key=lambda delimiter: matched[delimiter])
    # No wanted name anywhere: the delimiter that cuts the most lines into the same number of cells.
    sample = [line for _, line in body[-50:] if not _is_comment(line)]

    def regularity(delimiter: str) -> int:
        counts = Counter(len(_split(line, delimiter)) for line in sample)
        counts.pop(1, None)
        return max(counts.values(), default=0)

    return max(DELIMITERS, key=regularity)


def _find_header(
    path: Path, body: list[tuple[int, str]], wanted: Sequence[str], delimiter: str, header_row: int | None
) -> int:
    numbers = [number for number, _ in body]
    if header_row is not None:
        if header_row not in numbers:
            raise DatasetError(
                Fault(
                    "the header row is not a line with text",
                    where=str(path),
                    got=f"line {header_row}",
                    allowed=f"a line from {numbers[0]} to {numbers[-1]}",
                )
            )
        return header_row
    matched, number = _best_header(body, wanted, delimiter)
    if matched:
        return number
    previous = 0
    for number, line in body:
        if _is_comment(line):
            continue
        cells = [cell for cell in _split(line, delimiter) if cell]
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
    below: list[tuple[int, list[str]]], units_row: int | None, path: Path
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    if units_row is not None:
        found = [cells for number, cells in below if number == units_row]
        if not found:
            raise DatasetError(
                Fault("the units row is not a line below the header", where=str(path), got=f"line {units_row}")
            )
        return found[0], [(number, cells) for number, cells in below if number > units_row]
    if not below:
        return [], below
    cells = [cell for cell in below[0][1] if cell]
    text_only = bool(cells) and not any(_NUMBER.match(cell) for cell in cells)
    if text_only and all(_MARKED.match(cell) or is_unit(cell) for cell in cells):
        return below[0][1], below[1:]
    return [], below


def _check_rows(path: Path, header_line: int, headers: list[str], below: list[tuple[int, list[str]]]) -> None:
    if not below:
        raise DatasetError(
            Fault("no data below the column names", where=f"{path}, line {header_line}", allowed="at least one row")
        )
    long = [(number, len(cells)) for number, cells in below if any(cells[len(headers) :])]
    if long:
        raise DatasetError(
            Fault(
                f"{len(long)} row(s) have more fields than there are column names",
                where=f"{path}, line {long[0][0]}",
                got=f"{long[0][1]} fields",
                allowed=f"{len(headers)}, as in line {header_line}",
                attempt="another delimiter; a decimal comma needs a delimiter other than the comma, or quotes",
            )
        )
