"""Coupon tests for the tests: stresses by textbook formulas, and files of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from softcal.checks import Floats
from softcal.plugins.coupons.coupon import Coupon

# Mooney and Rivlin: nominal stress by the test, at C10, C01 and the stretch (or the amount of shear).
MOONEY_RIVLIN: Mapping[str, Callable[[float, float, Floats], Floats]] = {
    "uniaxial": lambda a, b, x: 2 * (x - x**-2) * (a + b / x),
    "planar": lambda a, b, x: 2 * (a + b) * (x - x**-3),
    "equibiaxial": lambda a, b, x: 2 * (x - x**-5) * (a + b * x**2),
    "shear": lambda a, b, x: 2 * (a + b) * x,
}
# Ogden: nominal stress of one term, at mu, alpha and the stretch (or the amount of shear).
OGDEN: Mapping[str, Callable[[float, float, Floats], Floats]] = {
    "uniaxial": lambda m, a, x: m * (x ** (a - 1) - x ** (-a / 2 - 1)),
    "planar": lambda m, a, x: m * (x ** (a - 1) - x ** (-a - 1)),
    "equibiaxial": lambda m, a, x: m * (x ** (a - 1) - x ** (-2 * a - 1)),
    "shear": lambda m, a, x: m * (_longer(x) ** a - _longer(x) ** -a) / (_longer(x) + 1 / _longer(x)),
}


def _longer(shear: Floats) -> Floats:
    """The largest principal stretch in simple shear."""
    return shear / 2 + np.sqrt(1 + shear**2 / 4)


def strains_of(test: str, largest: float = 3.0, n: int = 25) -> Floats:
    """Strains of a test (n, 1)."""
    return np.linspace(0.05 if test == "shear" else 1.05, largest, n)[:, None]


def mooney_coupon(name: str, test: str, constants: tuple[float, float], noise: Floats | float = 0.0) -> Coupon:
    """A test of Mooney's and Rivlin's law with noise [Pa]."""
    strain = strains_of(test)
    return Coupon(name, test, strain, MOONEY_RIVLIN[test](*constants, strain) + np.reshape(noise, (-1, 1)))


def write_coupon(path: Path, columns: Mapping[str, Sequence[object] | Floats]) -> Path:
    """A table with these columns."""
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(str(cell) for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
