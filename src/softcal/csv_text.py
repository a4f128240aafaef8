"""Tables as CSV text.

A spreadsheet takes text that begins as a formula does for one, wherever it came from, such as the name of a specimen in
a table of someone else. It is written behind an apostrophe, as spreadsheets mark text, and read without it.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from types import SimpleNamespace
from typing import Any

_FORMULA = re.compile("'*[=+@\\-\t\r\n＝＋＠－].", re.DOTALL)  # behind apostrophes, so that names with some stay apart


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table as CSV with one header line; None is an empty cell, and a number is written in full."""
    lines: list[str] = []
    # With both characters at the end of its lines, it quotes either in a cell.
    file: Any = SimpleNamespace(write=lines.append)
    writer = csv.writer(file, lineterminator="\r\n")
    writer.writerows(
        [f"'{c}" if isinstance(c, str) and _FORMULA.match(c) and not _is_number(c) else c for c in row]
        for row in (header, *rows)
    )
    return "".join(line.removesuffix("\r\n") + "\n" for line in lines)


def plain(cell: str) -> str:
    """The text of a cell as it was before it was written."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
