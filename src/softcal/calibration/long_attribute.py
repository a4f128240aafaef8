"""Attributes of Optuna's of any length: a column of MySQL's holds 64 KB, so that longer values are several attributes.

The pieces are written before the attribute that says how many there are, so that a value is there whole or not at all.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

_LONGEST = 60_000  # [characters, each a byte] of a value
_PIECE = _LONGEST // 2  # as the text of a text, in which a quotation mark is two characters
_PIECES = "pieces"


def set_attribute(set_one: Callable[[str, Any], None], key: str, value: Any) -> None:
    """Set an attribute of a study or a trial. set_one: Optuna's `set_user_attr` of it."""
    text = json.dumps(value)
    if len(text) <= _LONGEST:
        set_one(key, value)
        return
    pieces = [text[begin : begin + _PIECE] for begin in range(0, len(text), _PIECE)]
    for index, piece in enumerate(pieces):
        set_one(f"{key} {index}", piece)
    set_one(key, {_PIECES: len(pieces)})


def attribute(attributes: Mapping[str, Any], key: str) -> Any:
    """The value of an attribute; None where it was not set, or its pieces are not there."""
    held = attributes.get(key)
    if not isinstance(held, dict) or held.keys() != {_PIECES}:
        return held
    try:
        return json.loads("".join(attributes[f"{key} {index}"] for index in range(held[_PIECES])))
    except (LookupError, TypeError, ValueError):
        return None
