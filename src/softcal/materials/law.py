"""A hyperelastic law is one energy; everything else is derived from it.

    psi(F; theta) = psi_d(I1, I2, J; theta) + kappa(theta)/2 g(J)^2

with I1 = tr C, I2 = (I1^2 - tr C^2)/2, J = det F, C = F^T F, per undeformed volume. The volumetric part is separate so
that it can enter unchanged, or as p g(J) - p^2 / (2 kappa) with a pressure p as an unknown, which has no large number
as nu -> 0.5.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.materials.parameter import Parameter

# Rows of the coefficient arrays of a `CompiledLaw`.
FIRST = ("I1", "I2", "J")
SECOND = (("I1", "I1"), ("I1", "I2"), ("I1", "J"), ("I2", "I2"), ("I2", "J"), ("J", "J"))


@dataclass(frozen=True)
class Law:
    """An energy with named constants.

    Attributes
    ----------
    name
        What a project file calls it, such as `neo-hooke`.
    parameters
        Its constants, in the order in which the derivatives by them come.
    symbols
        Abbreviation -> text in the constants' symbols, for instance mu -> E/(2 (1 + nu)).
    distortional
        psi_d [J/m^3], text in I1, I2, J, the constants' symbols and the abbreviations.
    volumetric_strain
        g(J) [-], text in J.
    bulk
        kappa [Pa] of the volumetric part, text in the symbols.
    shear
        The shear modulus [Pa] at small strain, text in the symbols.
    reference
        Where the law is from.
    """

    name: str
    parameters: tuple[Parameter, ...]
    symbols: Mapping[str, str]
    distortional: str
    volumetric_strain: str
    bulk: str
    shear: str
    reference: str = ""

    def __hash__(self) -> int:
        return hash((self.name, self.distortional, self.volumetric_strain, self.bulk))

    @property
    def names(self) -> tuple[str, ...]:
        """The constants' names, in their order."""
        return tuple(parameter.name for parameter in self.parameters)

    def shear_modulus(self, theta: Mapping[str, float]) -> float:
        """Small-strain shear modulus [Pa] at constants theta [SI]."""
        return float(compile_law(self).shear(*self._ordered(theta)))

    def bulk_modulus(self, theta: Mapping[str, float]) -> float:
        """kappa [Pa] of the volumetric part at constants theta [SI]."""
        return float(compile_law(self).bulk(*self._ordered(theta)))

    def youngs_modulus(self, theta: Mapping[str, float]) -> float:
        """Small-strain Young's modulus [Pa] at constants theta [SI]."""
        mu, K = self.shear_modulus(theta), self._compressed(theta)
        return 9.0 * K * mu / (3.0 * K + mu)

    def poissons_ratio(self, theta: Mapping[str, float]) -> float:
        """Small-strain Poisson's ratio at constants theta [SI]."""
        mu, K = self.shear_modulus(theta), self._compressed(theta)
        return (3.0 * K - 2.0 * mu) / (2.0 * (3.0 * K + mu))

    def _compressed(self, theta: Mapping[str, float]) -> float:
        """The small-strain bulk modulus [Pa], of both parts of the energy."""
        return float(compile_law(self).compressed(*self._ordered(theta)))

    def _ordered(self, theta: Mapping[str, float]) -> tuple[float, ...]:
        return tuple(theta[name] for name in self.names)


@dataclass(frozen=True)
class CompiledLaw:
    """Vectorised derivatives of a law. Invariants have shape (n,); coefficient arrays (9, n): FIRST then SECOND."""

    parameters: tuple[str, ...]
    has_cross_terms: bool  # False where only psi_1, psi_J and psi_JJ are not zero
    shear: Callable[..., Any]
    bulk: Callable[..., Any]
    compressed: Callable[..., Any]  # the small-strain bulk modulus
    energy: Callable[..., Any]
    energy_distortional: Callable[..., Any]
    full: Callable[..., Any]
    distortional: Callable[..., Any]
    full_by_parameter: Callable[..., Any]
    distortional_by_parameter: Callable[..., Any]
    strain: Callable[..., Any]  # g, g', g''
    compliance: Callable[..., Any]  # 1/kappa and its derivatives by the parameters


@functools.cache
def compile_law(law: Law) -> CompiledLaw:
    """Differentiate the energy with SymPy and turn the derivatives into NumPy functions; cached."""
    import sympy

    letters = {letter: sympy.Symbol(letter, real=True) for letter in (parameter.symbol for parameter in law.parameters)}
    invariants = {name: sympy.Symbol(name, positive=True) for name in FIRST}
    scope: dict[str, Any] = {**letters, **invariants}
    for symbol, text in law.symbols.items():
        scope[symbol] = _parsed(text, scope)
    psi_d = _parsed(law.distortional, scope)
    g = _parsed(law.volumetric_strain, scope)
    kappa = _parsed(law.bulk, scope)
    psi = psi_d + kappa / 2 * g**2

    arguments = [*invariants.values(), *letters.values()]
    theta = list(letters.values())
    J = invariants["J"]

    def first(energy: Any) -> list[Any]:
        return [energy.diff(invariants[a]) for a in FIRST]

    def derivatives(energy: Any) -> list[Any]:
        return first(energy) + [energy.diff(invariants[a], invariants[b]) for a, b in SECOND]

    def by_parameter(energy: Any) -> list[list[Any]]:
        return [[d.diff(t) for d in first(energy)] for t in theta]

    def function(args: list[Any], expression: Any) -> Callable[..., Any]:
        return sympy.lambdify(args, expression, modules="numpy", cse=True)

    second = [sympy.simplify(psi.diff(invariants[a], invariants[b])) for a, b in SECOND[:-1]]
    has_cross_terms = any(d != 0 for d in second) or sympy.simplify(psi.diff(invariants["I2"])) != 0
    return CompiledLaw(
        parameters=law.names,
        has_cross_terms=has_cross_terms,
        shear=function(theta, _parsed(law.shear, scope)),
        bulk=function(theta, kappa),
        compressed=function(theta, _bulk_at_rest(psi, invariants)),
        energy=function(arguments, psi),
        energy_distortional=function(arguments, psi_d),
        full=function(arguments, derivatives(psi)),
        distortional=function(arguments, derivatives(psi_d)),
        full_by_parameter=function(arguments, by_parameter(psi)),
        distortional_by_parameter=function(arguments, by_parameter(psi_d)),
        strain=function([J], [g, g.diff(J), g.diff(J, 2)]),
        compliance=function(theta, [1 / kappa, [(1 / kappa).diff(t) for t in theta]]),
    )


def _bulk_at_rest(psi: Any, invariants: Mapping[str, Any]) -> Any:
    """d2 psi / d(3 lnlambda)2 of an even stretch lambda, at 1."""
    import sympy

    stretch = sympy.Symbol("stretch", positive=True)
    even = {"I1": 3 * stretch**2, "I2": 3 * stretch**4, "J": stretch**3}
    energy = psi.subs({invariants[name]: value for name, value in even.items()})
    return energy.diff(stretch, 2).subs(stretch, 1) / 9


def stacked(rows: list[Any], n: int) -> Floats:
    """Rows that may be numbers or arrays of shape (n,) -> one array (len(rows), n)."""
    out = np.empty((len(rows), n))
    for i, row in enumerate(rows):
        out[i] = row
    return out


def _parsed(text: str, scope: dict[str, Any]) -> Any:
    import sympy

    parse: Any = sympy.sympify
    return parse(text, locals=scope)
