"""Merging of a table's faults that differ only in the row."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

from softcal.errors import Fault
from softcal.experiments.read import line_numbers

_LINE = re.compile(r", line (\d+)$")
_N_LINES = 5  # named in a fault of many rows


def merged(faults: Iterable[Fault]) -> list[Fault]:
    """Merge faults that differ only in the row into one that names the rows; other faults appear once each."""
    groups: dict[tuple[str, ...], list[tuple[int, Fault]]] = {}
    for one in dict.fromkeys(faults):
        match = _LINE.search(one.where)
        line = int(match[1]) if match else 0
        where = one.where[: match.start()] if match else one.where
        got = "" if match else one.got
        groups.setdefault((where, one.what, one.allowed, got), []).append((line, one))
    found: list[Fault] = []
    for (where, *_), held in groups.items():
        first = held[0][1]
        if len(held) > 1:
            lines = line_numbers([line for line, _ in held[:_N_LINES]], len(held))
            got = ", ".join(dict.fromkeys(one.got for _, one in held[:_N_LINES]))
            first = replace(first, where=f"{where}, {lines}", got=got)
        found.append(first)
    return found
