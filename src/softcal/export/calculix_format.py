"""Numbers, names, lists and equations as CalculiX reads them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from softcal.checks import Ints


def number(value: float) -> str:
    """At most the twenty characters that CalculiX reads of a number: the rest, an exponent maybe, it would drop."""
    return f"{value:.12e}"


def set_name(name: str) -> str:
    """The name of a set or a material."""
    return name.upper().replace(".", "__")


def listed(numbers: Ints) -> Iterator[str]:
    """Node numbers, twelve in a line."""
    for i in range(0, len(numbers), 12):
        yield ", ".join(str(n) for n in numbers[i : i + 12]) + ","


def weighted_sum(node: int, terms: Sequence[tuple[int, float]]) -> Iterator[str]:
    """Equations by which a node's displacement is a weighted sum of others'."""
    for axis in (1, 2, 3):
        yield "*EQUATION"
        yield str(1 + len(terms))
        written = [f"{node}, {axis}, 1.0", *(f"{other}, {axis}, {number(-weight)}" for other, weight in terms)]
        for i in range(0, len(written), 4):
            yield ", ".join(written[i : i + 4])
