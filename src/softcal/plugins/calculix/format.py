"""CalculiX's syntax of numbers, names, lists and equations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from softcal.checks import Ints


def number(value: float) -> str:
    """A number in at most twenty characters: CalculiX ignores the rest, possibly an exponent."""
    return f"{value:.12e}"


def set_name(name: str) -> str:
    """The name of a set or a material."""
    return name.upper().replace(".", "__")


def listed(numbers: Ints) -> Iterator[str]:
    """Node numbers, twelve per line."""
    for i in range(0, len(numbers), 12):
        yield ", ".join(str(n) for n in numbers[i : i + 12]) + ","


def weighted_sum(node: int, terms: Sequence[tuple[int, float]]) -> Iterator[str]:
    """Constraint equations: a node's displacement is a weighted sum of others."""
    for axis in (1, 2, 3):
        yield "*EQUATION"
        yield str(1 + len(terms))
        written = [f"{node}, {axis}, 1.0", *(f"{other}, {axis}, {number(-weight)}" for other, weight in terms)]
        for i in range(0, len(written), 4):
            yield ", ".join(written[i : i + 4])
