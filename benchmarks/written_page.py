"""Numbers on a page of the documents, each between marks that readers do not see: `<!--{load}-->12 %<!--/-->`.

A command writes the values; all else of the page is edited where it stands.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

_PLACE = re.compile(r"<!--\{(.*?)\}-->(.*?)<!--/-->", re.DOTALL)


def written_page(page: Path, values: Mapping[str, str]) -> str:
    """The text of a page with these values between its marks.

    Raises
    ------
    KeyError
        With every mark that has no value, and every value that has no mark.
    """
    text = page.read_text(encoding="utf-8")
    if others := set(page_values(text)) ^ set(values):
        raise KeyError(f"{page.name}: {', '.join(sorted(others))}")
    return _PLACE.sub(lambda place: marked(place[1], values[place[1]]), text)


def page_values(text: str) -> dict[str, str]:
    """Name -> value of every mark of a page."""
    return {place[1]: place[2].strip("\n") for place in _PLACE.finditer(text)}


def marked(name: str, value: str) -> str:
    """A value between its marks; one of several lines, such as a table, is a paragraph of its own."""
    between = "\n\n" if "\n" in value else ""
    return f"<!--{{{name}}}-->{between}{value}{between}<!--/-->"
