"""Pages of the documents that a command writes: a text with places such as {{load}}, and what stands there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

_PLACE = re.compile(r"\{\{(.*?)\}\}")


def written_page(text: Path, values: Mapping[str, str]) -> str:
    """The text with its places filled.

    Raises
    ------
    KeyError
        With every place that has no value, and every value that has no place.
    """
    held = text.read_text(encoding="utf-8")
    if others := set(_PLACE.findall(held)) ^ set(values):
        raise KeyError(f"{text.name}: {', '.join(sorted(others))}")
    return _PLACE.sub(lambda place: values[place[1]], held)
