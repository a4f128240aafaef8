"""Reading selected columns and filtered rows of a table of any length as numbers, block by block."""

from __future__ import annotations

import contextlib
import functools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import DatasetError, Fault
from softcal.experiments.table import Table, uses_decimal_comma

N_NAMED = 5  # lines and cells named in a fault
_N_VALUES = 10  # values of a filter's column listed in a fault
_GAPS = ("", "nan", "-", "--", "n/a", "na")  # cells of a value that is missing, in small letters
_SNIFFED = 2000  # rows used to detect the decimal sign
_EITHER = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
MOST_VALUES = 100_000_000  # numbers kept of one file: 0.8 GB


@dataclass(frozen=True)
class Filter:
    """Keeps the rows whose column has one of the values, compared as numbers if both are numbers."""

    column: int
    values: tuple[str, ...]


@dataclass
class Odd:
    """Cells that are not numbers: their count, and the first ones with their lines."""

    n: int = 0
    lines: list[int] = field(default_factory=list[int])
    cells: list[str] = field(default_factory=list[str])


@dataclass(frozen=True)
class Columns:
    """Values of the kept rows.

    Attributes
    ----------
    numbers
        Column -> values as in the file (n_kept), NaN if missing.
    odd
        Column -> cells that are not numbers and must not be missing.
    labels
        Labels of the rows (n_kept).
    lines
        Line numbers in the file (n_kept).
    n_rows
        Number of all rows, kept or not.
    decimal
        Decimal sign of the numbers, "." or ",".
    unmet
        Number of a filter -> its values that no row has, and values that rows have.
    """

    numbers: Mapping[str, Floats]
    odd: Mapping[str, Odd]
    labels: tuple[str, ...]
    lines: Ints
    n_rows: int
    decimal: str
    unmet: Mapping[int, tuple[list[str], list[str]]]


def read_columns(
    table: Table,
    places: Mapping[str, int],
    *,
    may_miss: Callable[[str], bool],
    filters: Sequence[Filter] = (),
    label: int | None = None,
    decimal: str | None = None,
) -> Columns:
    """Read columns of a table.

    Parameters
    ----------
    places
        Name -> number of the column.
    may_miss
        True for the name of a column whose cells may be empty.
    filters, label
        Filters of rows, and the column of row labels.
    decimal
        "." or ","; None detects it from the first rows.

    Raises
    ------
    DatasetError
        For rows of another length than the header, no rows, or too many rows.
    """
    parts: dict[str, list[Floats]] = {name: [] for name in places}
    odd = {name: Odd() for name in places}
    lines: list[Ints] = []
    labels: list[str] = []
    sieves = [_Sieve(one) for one in filters]
    n_rows = n_kept = 0
    for numbers, rows in table.rows():
        if decimal is None:
            decimal = "," if uses_decimal_comma([row[c] for row in rows[:_SNIFFED] for c in places.values()]) else "."
            if decimal == "," and (fault := decimals_fault(table, [row[c] for row in rows for c in places.values()])):
                raise DatasetError(replace(fault, attempt=f"decimal: ',' in the project, or {fault.attempt}"))
        n_rows += len(rows)
        for sieve in sieves:
            numbers, rows = sieve.kept(numbers, rows)
        n_kept += len(rows)
        if n_kept * max(1, len(places)) > MOST_VALUES:
            raise DatasetError(
                Fault(
                    "the table is too long",
                    str(table.path),
                    f"more than {n_kept} rows of {len(places)} columns",
                    f"at most {MOST_VALUES} numbers",
                    "a filter `where`, skip_rows, or a file of fewer samples",
                )
            )
        lines.append(np.array(numbers, dtype=np.int64))
        for name, column in places.items():
            cells = [row[column] for row in rows]
            # With a decimal comma a point is a thousands separator or a typing error: the number is ambiguous.
            plain = cells if decimal == "." else ["" if "." in cell else cell.replace(",", ".") for cell in cells]
            parts[name].append(_floats(plain))
            gaps = _GAPS if may_miss(name) else ()
            strange = [i for i in np.flatnonzero(~np.isfinite(parts[name][-1])) if cells[i].casefold() not in gaps]
            odd[name].n += len(strange)
            for i in strange[: N_NAMED - len(odd[name].lines)]:
                odd[name].lines.append(numbers[i])
                odd[name].cells.append(cells[i])
        if label is not None:
            labels += [row[label] for row in rows]
    unmet = {i: (missing, sieve.seen) for i, sieve in enumerate(sieves) if (missing := sieve.missing)}
    return Columns(
        numbers={name: np.concatenate(parts.pop(name)) for name in places},
        odd={name: one for name, one in odd.items() if one.n},
        labels=tuple(labels),
        lines=np.concatenate(lines),
        n_rows=n_rows,
        decimal=decimal or ".",
        unmet=unmet,
    )


def decimals_fault(table: Table, cells: Sequence[str]) -> Fault | None:
    """Fault of numbers, some with a comma, whose every comma may as well stand between thousands."""
    commas = [cell for cell in cells if "," in cell]
    if not all(_EITHER.fullmatch(cell) for cell in commas):
        return None
    what = "a comma may be the decimal sign, or stand between thousands"
    got, allowed = f"'{commas[0]}' and {len(commas) - 1} like it", "a number that tells which, such as 0,5 or 12,34"
    return Fault(what, str(table.path), got, allowed, "numbers without a comma")


def cells_of(table: Table, column: int, lines: Sequence[int]) -> list[str]:
    """Cells of a column in some lines of the file, in order.

    Parameters
    ----------
    table
        The table, with its format and column names.
    column
        Number of the column, from 0.
    lines
        Numbers of the lines, from 1, ascending.
    """
    found: dict[int, str] = {}
    for numbers, rows in table.rows():
        found |= {number: row[column] for number, row in zip(numbers, rows, strict=True) if number in lines}
    return [found[line] for line in lines]


class _Sieve:
    """A filter, and the values that matched so far."""

    def __init__(self, one: Filter) -> None:
        self._filter = one
        self._met: set[str] = set()
        self.seen: list[str] = []
        self._match = functools.lru_cache(maxsize=4096)(self._matches)

    @property
    def missing(self) -> list[str]:
        """Values of the filter that no row has."""
        return [value for value in self._filter.values if value not in self._met]

    def kept(self, numbers: list[int], rows: list[list[str]]) -> tuple[list[int], list[list[str]]]:
        """The matching rows and their line numbers."""
        kept = [i for i, row in enumerate(rows) if self._match(row[self._filter.column])]
        if len(self.seen) <= _N_VALUES:
            cells = (row[self._filter.column] for row in rows)
            self.seen = list(dict.fromkeys((*self.seen, *cells)))[: _N_VALUES + 1]
        return [numbers[i] for i in kept], [rows[i] for i in kept]

    def _matches(self, cell: str) -> bool:
        number = number_in(cell.replace(",", "."))
        met = {v for v in self._filter.values if cell == v.strip() or number == number_in(v.replace(",", "."))}
        self._met |= met
        return bool(met)


def _floats(cells: list[str]) -> Floats:
    """The cells as by `number_in`."""
    text = "".join(cells)
    if text.isascii() and "_" not in text:
        with contextlib.suppress(ValueError):
            return np.array(cells, dtype=np.float64)
    return np.array([number_in(cell) for cell in cells], dtype=np.float64)


def number_in(cell: str) -> float:
    """The number in a cell, NaN if not a number: Python's syntax without underscores and non-ASCII digits."""
    try:
        return float(cell) if cell.isascii() and "_" not in cell else math.nan
    except ValueError:
        return math.nan
