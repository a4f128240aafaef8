"""The mesh of an Abaqus deck (.inp), as Abaqus reads it; what makes or moves nodes in it is refused.

meshio's own reader takes a comment for the end of a list and the last of several sets of a name for the whole, and
leaves out, without a word, numbers with a blank before the comma, names of sets of nodes, and what moves nodes.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from softcal.checks import Ints

# Keywords that make or move nodes or elements, and all options of those that list them which do not.
_MAKERS = frozenset(
    ("INCLUDE", "IMPORT", "IMPERFECTION", "SYSTEM", "NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "MODEL CHANGE")
)
_OF_SETS = frozenset(("GENERATE", "UNSORTED", "INSTANCE", "INTERNAL"))
_OPTIONS = {
    "NODE": {"NSET"},
    "ELEMENT": {"TYPE", "ELSET"},
    "NSET": _OF_SETS | {"NSET"},
    "ELSET": _OF_SETS | {"ELSET"},
}


class DeckError(Exception):
    """A fault of a mesh file, or a feature of it that softcal does not support."""


@dataclass
class _Card:
    """A keyword with its options and the lines below it; table: numbers of nodes, or of elements and their nodes."""

    line: int
    name: str
    options: dict[str, str]
    rows: list[str] = field(default_factory=list[str])
    table: Ints = field(default_factory=lambda: np.zeros((0, 1), dtype=np.int64))

    def __str__(self) -> str:
        return f"*{self.name} in line {self.line}"

    def words(self) -> list[str]:
        """The cells of its lines."""
        return [word for row in self.rows for word in map(str.strip, row.split(",")) if word]


def read_deck(path: Path) -> Any:
    """A mesh of meshio, with the sets of nodes and elements.

    Raises
    ------
    DeckError
        For what is wrong, or not followed, with its line.
    ValueError, LookupError
        For rows that are no numbers, or too short.
    """
    meshio: Any = import_module("meshio")
    kinds: dict[str, str] = import_module("meshio.abaqus._abaqus").abaqus_to_meshio_type
    cards = _cards(path)
    instances = [card for card in cards if card.name == "INSTANCE"]
    makers = (
        [card for card in cards if card.name in _MAKERS] + [card for card in instances if card.rows] + instances[1:]
    )
    options = [
        f"{key} of {card}" for card in cards for key in card.options.keys() - _OPTIONS.get(card.name, card.options)
    ]
    for what in (*makers, *options):
        raise DeckError(f"{what}, which is not followed: list all nodes and elements, where they are")
    nodes, elements = ([card for card in cards if card.name == name] for name in ("NODE", "ELEMENT"))
    for card in (*nodes, *elements):
        text = "".join(card.rows)
        if "_" in text or not text.isascii():  # which Python takes for digits
            raise DeckError(f"letters in the place of numbers under {card}")
    points: list[list[str]] = []
    for card in nodes:
        cells = [row.split(",") for row in card.rows]
        card.table = np.array([row[:1] for row in cells], dtype=np.int64)
        points += [row[1:] for row in cells]
    of_nodes = numbers_of([card.table[:, 0] for card in nodes], "nodes")
    blocks: list[tuple[str, Ints]] = []
    for card in elements:
        kind = kinds.get(card.options["TYPE"].upper(), "").replace("tetra4", "tetra")
        if not kind:
            raise DeckError(f"elements of type {card.options['TYPE']} in line {card.line}")
        n, values = meshio._common.num_nodes_per_cell[kind], np.array(card.words(), dtype=np.int64)  # noqa: SLF001
        if len(values) % (n + 1):
            raise DeckError(f"{len(values)} numbers under {card}, each with {n} nodes")
        card.table = values.reshape(-1, n + 1)
        blocks.append((kind, places_of(of_nodes, card.table[:, 1:], f"{card}, which no node has")))
    of_elements = numbers_of([card.table[:, 0] for card in elements], "elements")
    ends = np.cumsum([len(card.table) for card in elements])[:-1]
    cell_sets: dict[str, list[Ints]] = {}
    for name, places in _sets(cards, "ELEMENT", of_elements).items():
        parts = np.split(places, np.searchsorted(places, ends))
        cell_sets[name] = [part - start for part, start in zip(parts, (0, *ends), strict=True)]
    return meshio.Mesh(
        np.array(points, dtype=np.float64), blocks, point_sets=_sets(cards, "NODE", of_nodes), cell_sets=cell_sets
    )


def _cards(path: Path) -> list[_Card]:
    """The keywords of a deck in order; one whose line ends in a comma goes on in the next."""
    cards: list[_Card] = []
    keyword = ""
    for number, line in enumerate(map(str.strip, path.read_text(encoding="utf-8-sig").split("\n")), start=1):
        if not line or line.startswith("**"):
            continue
        goes_on = keyword.endswith(",")
        if goes_on or line.startswith("*"):
            keyword = keyword + line if goes_on else line
            name, *options = (word.strip() for word in keyword.removeprefix("*").rstrip(",").split(","))
            pairs = (option.partition("=") for option in options)
            card = _Card(number, name.upper(), {key.strip().upper(): value.strip() for key, _, value in pairs})
            cards[len(cards) - goes_on :] = [card]
        elif cards:
            cards[-1].rows.append(line.rstrip(","))
    return cards


def numbers_in(text: str, kind: type[np.int64 | np.float64]) -> Any:
    """The numbers of a text.

    Raises
    ------
    ValueError
        For a word that is none.
    OverflowError
        For a whole number beyond 64 bits.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            numbers = np.fromstring(text, dtype=kind, sep=" ") if text.strip() else np.zeros(0, dtype=kind)
        except DeprecationWarning as error:
            raise ValueError(str(error)) from error
    if kind is np.int64 and (abs(numbers) == np.iinfo(np.int64).max).any():  # also of any beyond
        raise OverflowError
    return numbers


def numbers_of(parts: Sequence[Ints], what: str) -> Ints:
    """The numbers of all nodes or elements, in their order.

    Raises
    ------
    DeckError
        With the first number of two of them.
    """
    numbers = np.concatenate([np.zeros(0, dtype=np.int64), *parts])
    once, counts = np.unique(numbers, return_counts=True)
    for number in once[counts > 1]:
        raise DeckError(f"number {number} of two {what}")
    return numbers


def places_of(listed: Ints, numbers: Ints, where: str) -> Ints:
    """The places of numbers in a list of them.

    Parameters
    ----------
    listed
        The list.
    numbers
        Numbers of any shape.
    where
        Who names a number that the list does not have, for the message.

    Raises
    ------
    DeckError
        With the first number that the list does not have.
    """
    order = np.argsort(listed)
    places = order[np.searchsorted(listed, numbers, sorter=order).clip(max=len(listed) - 1)]
    for number in numbers[listed[places] != numbers]:
        raise DeckError(f"number {number} under {where}")
    return places


def _sets(cards: Sequence[_Card], lister: str, listed: Ints) -> dict[str, Ints]:
    """The sets of what a keyword lists, as places in the list; a name that is there again adds to its set."""
    sets: dict[str, Ints] = {}
    keyword = "NSET" if lister == "NODE" else "ELSET"
    for card in cards:
        if card.name not in (lister, keyword) or keyword not in card.options:
            continue
        numbers, plain = [card.table[:, 0]], list[int]()
        named = [sets.get(card.options[keyword], listed[:0])]
        if "GENERATE" in card.options:
            for first, last, *step in (map(int, row.split(",")) for row in card.rows):
                if last < first or min(step, default=1) < 1:
                    raise DeckError(f"numbers from {first} down to {last} under {card}")
                numbers.append(np.arange(first, last + 1, *step))
        elif card.name == keyword:
            for word in card.words():
                if re.fullmatch(r"[+-]?\d+", word):
                    plain.append(int(word))
                elif word in sets:
                    named.append(sets[word])
                else:
                    raise DeckError(f"'{word[:40]}' under {card}: only a number or a set above it is allowed")
        places = places_of(
            listed,
            np.concatenate([*numbers, np.array(plain, dtype=np.int64)]),
            f"{card}, which no {lister.lower()} has",
        )
        sets[card.options[keyword]] = np.unique(np.concatenate([*named, places]))
    return sets
