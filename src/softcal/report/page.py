"""A page of results: self-contained HTML with embedded style and pictures, no external resources. It has no scripts of
its own; one that moves the twin is in a frame which the browser keeps apart, and the page is whole without it.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from softcal.report.figure import Picture
from softcal.report.statement import SOURCES, ErrorSource

_MOST_ROWS = 24  # of a table that is not folded
_COLOURS = 4  # for uncertain parameters
_LETTER = 0.022  # width of a letter over that of a bar, on the narrowest pages


@dataclass(frozen=True)
class KeyNumber:
    """A number of the first screen: its name, value, unit, and a small remark."""

    label: str
    value: str
    unit: str
    remark: str


TEMPLATES = Path(__file__).parent / "templates"


def render(template: Path, **values: object) -> str:
    """The page of a template as text, which may extend those of `TEMPLATES`; values: what it shows, escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader([template.parent, TEMPLATES]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"embedded": embedded, "unbroken": unbroken, "moment": moment}
    return environment.get_template(template.name).render(bar_text=bar_text, most_rows=_MOST_ROWS, **values)


def marks(sources: Sequence[ErrorSource]) -> dict[str, str]:
    """The style's class for each source of error; uncertain parameters share a few colours."""
    fixed = {source.kind for source in SOURCES}
    own = [source.kind for source in sources if source.kind not in fixed]
    return {kind: kind for kind in fixed} | {kind: f"uncertain-{i % _COLOURS}" for i, kind in enumerate(own)}


def bar_text(source: ErrorSource, share: float, words: str) -> str:
    """The text on a source's part of a bar: its name and its share, or what of them has room.

    Parameters
    ----------
    source
        The source of error.
    share
        Its share of the bar [-].
    words
        The share in words.
    """
    return next((text for text in (f"{source.short} {words}", words) if len(text) * _LETTER < share), "")


def moment(created: str) -> str:
    """A time of ISO 8601 to the minute: "2026-11-22 18:51 UTC"; any other text as it is."""
    try:
        at = datetime.fromisoformat(created)
    except ValueError:
        return created
    return f"{at:%Y-%m-%d %H:%M} {at.tzname() or ''}".rstrip()


def unbroken(text: str) -> str:
    """The text with exponents that no line break divides."""
    return re.sub(r"(?<=\de)-(?=\d)", "\N{NON-BREAKING HYPHEN}", text)


def embedded(picture: Picture) -> str:
    """The picture as a data URL."""
    data, kind = (picture.svg, "svg+xml") if picture.shown == "svg" else (picture.png, "png")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
