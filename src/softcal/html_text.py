"""Small tables and pictures as HTML, for notebooks, and text in Markdown; every text is escaped."""

from __future__ import annotations

import base64
import html
import math
import re
from collections.abc import Iterable, Sequence

MOST_ROWS = 60  # of a table
_WIDTH, _HEIGHT, _MOST_POINTS = 120, 24, 120
_CELL = 'style="text-align: left; padding: 2px 10px 2px 0; vertical-align: middle"'


class Markup(str):
    """Text that is HTML already, made by this module."""

    __slots__ = ()


def html_table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table of at most 60 rows; how many more there are is said below it."""
    head = "".join(f"<th {_CELL}>{_escaped(name)}</th>" for name in header)
    body = "".join(
        "<tr>" + "".join(f"<td {_CELL}>{_escaped(cell)}</td>" for cell in row) + "</tr>" for row in rows[:MOST_ROWS]
    )
    rest = len(rows) - MOST_ROWS
    more = paragraph(f"and {rest} more") if rest > 0 else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


def summary(title: str, header: Sequence[str], rows: Sequence[Sequence[object]], sentences: Iterable[str] = ()) -> str:
    """A heading, a table, and sentences below it.

    Parameters
    ----------
    title
        Text of the heading.
    header
        Head of each column.
    rows
        Cells of each row.
    sentences
        Paragraphs below the table.
    """
    return "".join([heading(title), html_table(header, rows), *map(paragraph, sentences)])


def heading(text: str) -> str:
    """A line in bold."""
    return f"<div><b>{_escaped(text)}</b></div>"


def paragraph(text: str) -> str:
    """A line, such as a note."""
    return f'<div style="max-width: 60em">{_escaped(text)}</div>'


def curve(values: Iterable[float]) -> Markup:
    """The course of some values as a small picture; nothing where fewer than two are finite."""
    held = [float(value) for value in values]
    held = held[:: max(1, math.ceil(len(held) / _MOST_POINTS))]
    known = [value for value in held if math.isfinite(value)]
    if len(known) < 2:
        return Markup()
    low, high = min(known), max(known)
    span = high - low or 1.0
    points = " ".join(
        f"{_WIDTH * k / (len(held) - 1):.1f},{_HEIGHT - 1 - (_HEIGHT - 2) * (value - low) / span:.1f}"
        for k, value in enumerate(held)
        if math.isfinite(value)
    )
    line = f'<polyline points="{points}" fill="none" stroke="#0072b2" stroke-width="1.5"/>'
    return Markup(f'<svg width="{_WIDTH}" height="{_HEIGHT}" role="img">{line}</svg>')


def picture(png: bytes, what: str) -> Markup:
    """A picture in line; what: what it shows, for those who do not see it."""
    data = base64.b64encode(png).decode("ascii")
    return Markup(f'<img src="data:image/png;base64,{data}" alt="{html.escape(what, quote=True)}"/>')


# What Markdown, with its tables and formulas, takes for a mark; an underscore within a word is none.
_MARKS = re.compile(r"[\\`*\[\]|~$]|(?<!\w)_|_(?!\w)|^[-+=#]")


def markdown(text: object) -> str:
    """Any text as one line of Markdown that shows it as it is."""
    return _MARKS.sub(r"\\\g<0>", html.escape(" ".join(str(text).split()), quote=False))


def _escaped(value: object) -> str:
    return value if isinstance(value, Markup) else html.escape("" if value is None else str(value))
