"""Project files for the tests: a text that is right, with pieces of it replaced."""

from __future__ import annotations

from collections.abc import Iterable


def changed(text: str, changes: Iterable[tuple[str, str]]) -> str:
    """The text with each (old, new) replaced, one after the other; every old one must be there."""
    for old, new in changes:
        assert old in text, f"'{old}' is not in the project"
        text = text.replace(old, new)
    return text
