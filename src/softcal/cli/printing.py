"""Printing of tables and warnings, shared by the commands."""

from __future__ import annotations

import codecs
import errno
import os
import re
import sys
import unicodedata
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from softcal.errors import Fault

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from softcal.report.tables import ReportTable

LOG_WIDTH = 160  # a log does not wrap
NO_OUTPUT = 1  # the exit code where the output cannot be written
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
_ASCII = "softcal_ascii"
_NOTHING_LEFT = (errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM)  # such as open files, processes, memory
# Codes of the terminal, and marks that change the direction of letters; not the ends of lines and tabs.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
# What stands for the signs of messages where the terminal cannot write them.
_SIGNS = {
    "±": "+/-", "–": "-", "—": "-", "−": "-", "×": "x", "·": "*", "⋅": "*", "→": "->", "≥": ">=", "≤": "<=", "≈": "~",
    "°": "deg", "µ": "u", "∞": "inf", "’": "'", "‘": "'", "“": '"', "”": '"', "′": "'", "″": '"', "©": "(c)",
}  # fmt: skip


@contextmanager
def any_terminal() -> Generator[None]:
    """Output to a terminal or file of any encoding, or none: what it cannot write is written in other characters, and
    where there is no room for it the program ends with a sentence.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed before Python began; its number would be that of the next file
            setattr(sys, name, open(os.devnull, mode))
    codecs.register_error("softcal", _plain)
    codecs.register(_ascii)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            is_ascii = codecs.lookup(stream.encoding).name == "ascii"
            stream.reconfigure(encoding=_ASCII if is_ascii else None, errors="softcal")
    try:
        yield
    except OSError as error:
        if error.errno in _NOTHING_LEFT:
            what = "the system has nothing left for this"
        elif error.filename is None and error.errno in _NO_ROOM:
            what = "the output cannot be written"
        else:
            raise
        with suppress(OSError):
            echo(f"Error: {what}: {error.strerror}.", err=True)
        with suppress(OSError):  # what is left of the output would be an error again at the end
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        raise SystemExit(NO_OUTPUT) from None


def _ascii(name: str) -> codecs.CodecInfo | None:
    """ASCII by another name: Typer writes UTF-8 to a stream whose encoding is ASCII, as if that were a mistake."""
    if name != _ASCII:
        return None
    own = codecs.lookup("ascii")
    return codecs.CodecInfo(own.encode, own.decode, incrementalencoder=own.incrementalencoder, name=_ASCII)


def _plain(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_in_ascii, error.object[error.start : error.end])), error.end


def _in_ascii(sign: str) -> str:
    """A sign, a letter of Greek by its name, any other without its accent; else a question mark."""
    if sign in _SIGNS:
        return _SIGNS[sign]
    greek = re.match(r"GREEK (SMALL|CAPITAL) LETTER (\w+)", unicodedata.name(sign, ""))
    if greek:
        name = greek[2].replace("LAMDA", "LAMBDA")  # Unicode's spelling
        return name.lower() if greek[1] == "SMALL" else name.capitalize()
    return unicodedata.normalize("NFKD", sign).encode("ascii", "ignore").decode() or "?"


def shown_path(path: Path) -> str:
    """A path as it is typed in the present folder, without `a/../b`; absolute where that is shorter."""
    absolute = os.path.abspath(path)
    try:
        return min(os.path.relpath(path), absolute, key=len)
    except ValueError:  # it lies on another drive
        return absolute


def printable(text: str) -> str:
    """The text with control characters by their codes: those of a stranger's file would command the terminal."""
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def echo(text: str = "", *, err: bool = False) -> None:
    """Print a line to the output, or to the error stream."""
    typer.echo(printable(text), err=err)


def print_table(table: Table) -> None:
    """Print a table of texts without markup, in the width of the terminal or of a log.

    A wider table is printed in parts below each other, each with the first column, which names the rows, and some of
    the others, so that no number is cut off or wrapped if one column fits beside the names.
    """
    from rich.console import Console

    class Plain(Console):
        """Names may hold brackets and colons, which are no marks of Rich's."""

        def render_str(self, text: str, **options: Any) -> Text:
            return super().render_str(printable(text), **options)

    console = Plain(markup=False, emoji=False)
    if not console.is_terminal:
        console = Plain(markup=False, emoji=False, width=LOG_WIDTH)
    for part in _parts(table, console.width):
        console.print(part)


def print_report_table(table: ReportTable) -> None:
    """Print a table of a report."""
    from rich.table import Table

    shown = Table(*(column.header for column in table.columns), caption=table.note or None)
    for row in table.shown():
        shown.add_row(*row)
    print_table(shown)


def print_warnings(warnings: Iterable[str | Fault]) -> None:
    """Print each warning to the error stream."""
    for warning in warnings:
        echo(f"Warning: {warning}", err=True)


def _parts(table: Table, width: int) -> list[Table]:
    """Divide a table into tables within the width."""
    from rich.table import Table

    names, *columns = [[str(column.header), *map(str, column.cells)] for column in table.columns]
    sections = [row.end_section for row in table.rows]
    if _frame(len(columns)) + sum(max(map(_width, column)) for column in [names, *columns]) <= width:
        return [table]
    # Dotted names of parameters may break at their dots.
    columns = [[re.sub(r"(?<=[a-z0-9])\.(?=[a-z])", ".\n", header), *cells] for header, *cells in columns]
    narrowest = max(_width(word) for name in names for word in name.split() or [""])
    parts: list[Table] = []
    first = 0
    while first < len(columns):
        last = first + 1
        while last < len(columns) and _room(columns[first : last + 1], width) >= narrowest:
            last += 1
        shown = columns[first:last]
        room = _room(shown, width)
        narrow = room < narrowest
        part = Table()  # its rows are those that are not empty in these columns
        part.add_column(names[0], overflow="fold", width=None if narrow else min(room, max(map(_width, names))))
        for header, *_ in shown:
            part.add_column(header, overflow="fold", no_wrap=not narrow)
        for i, name in enumerate(names[1:], 1):
            cells = [column[i] for column in shown]
            if any(cells):
                part.add_row(name, *cells)
            if sections[i - 1] and part.row_count:
                part.add_section()
        parts.append(part)
        first = last
    return parts


def _room(columns: Sequence[Sequence[str]], width: int) -> int:
    """Width left by these columns for the names of the rows."""
    return width - _frame(len(columns)) - sum(max(map(_width, column)) for column in columns)


def _frame(n_columns: int) -> int:
    """Width of lines and margins of a table with `n_columns` columns besides the names."""
    return 3 * (n_columns + 1) + 1


def _width(text: str) -> int:
    from rich.cells import cell_len

    return max(map(cell_len, text.split("\n")))
