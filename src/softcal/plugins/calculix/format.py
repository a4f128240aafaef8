"""CalculiX's syntax: numbers, names, lists, equations, and the cards of the laws that it has."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from softcal.checks import Floats, Ints
from softcal.materials.catalogue import LAWS

# The deck's units [m], [N], with seconds, grams and Pa: CalculiX takes a residual below 1e-6 of its unit of force, and
# a displacement below 1e-8 of its unit of length, for zero.
MM, MICRONEWTON = 1e-3, 1e-6


def number(value: float) -> str:
    """A number in at most twenty characters: CalculiX ignores the rest, possibly an exponent."""
    return f"{value:.12e}"


def place(at: Floats) -> str:
    """The coordinates of a point (3,) [m]."""
    return ", ".join(number(value / MM) for value in at)


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


ISOCHORIC = "neo-hooke-isochoric"
# 1/D of the powers (J - 1)^4 and (J - 1)^6, which softcal's laws do not have, is as good as zero.
NO_POWER = 1e30
PER_LINE = 8  # numbers on a line of a deck

Constants = Mapping[str, float]


def _named(names: tuple[str, ...], powers: int) -> Callable[[Constants], list[float]]:
    def values(theta: Constants) -> list[float]:
        return [*(theta[name] for name in names), 2.0 / theta["bulk_modulus"], *([NO_POWER] * (powers - 1))]

    return values


def _ogden(terms: int) -> Callable[[Constants], list[float]]:
    def values(theta: Constants) -> list[float]:
        pairs = [(theta[f"mu{p}"], theta[f"alpha{p}"]) for p in range(1, terms + 1)]
        own = [value for mu, alpha in pairs for value in (0.5 * mu * alpha, alpha)]
        return [*own, 2.0 / theta["bulk_modulus"], *([NO_POWER] * (terms - 1))]

    return values


# Law -> what follows *HYPERELASTIC, and its numbers by softcal's constants. The volumetric part is (J - 1)^2 / D1.
CARDS: Mapping[str, tuple[str, Callable[[Constants], list[float]]]] = {
    ISOCHORIC: (
        "NEO HOOKE",
        lambda theta: [0.5 * LAWS[ISOCHORIC].shear_modulus(theta), 2.0 / LAWS[ISOCHORIC].bulk_modulus(theta)],
    ),
    "mooney-rivlin": ("MOONEY-RIVLIN", _named(("C10", "C01"), 1)),
    "mooney-rivlin-5": ("POLYNOMIAL, N=2", _named(("C10", "C01", "C20", "C11", "C02"), 2)),
    "yeoh": ("YEOH", _named(("C10", "C20", "C30"), 3)),
    "arruda-boyce": ("ARRUDA-BOYCE", _named(("chain_modulus", "locking_stretch"), 1)),
    **{f"ogden-{n}": (f"OGDEN, N={n}", _ogden(n)) for n in (1, 2, 3)},
}


def law_lines(law: str, theta: Constants) -> list[str]:
    """The lines of a material's law [SI] in a deck; law: one of `CARDS`."""
    card, of = CARDS[law]
    values = [number(value) for value in of(theta)]
    lines = [", ".join(values[at : at + PER_LINE]) for at in range(0, len(values), PER_LINE)]
    return [f"*HYPERELASTIC, {card}", *lines]
