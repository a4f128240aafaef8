"""A cell of a fleet's table: the value that replaces the template's, or the value of a factor."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from softcal.experiments.table import is_unit, uses_decimal_comma

_NUMBER = re.compile(r"([-+−]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?)(.*)", re.DOTALL)
_SERIAL = re.compile(r"0\d")  # begins what is a name and no number, such as 007


@dataclass(frozen=True)
class CellReader:
    """Reads the cells of a table; comma: true if its numbers have decimal commas."""

    comma: bool

    @staticmethod
    def of(cells: Iterable[str]) -> CellReader:
        """The reader of a table with these cells."""
        return CellReader(uses_decimal_comma([match[1] for cell in cells if (match := _NUMBER.fullmatch(cell))]))

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
