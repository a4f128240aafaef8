"""A hyperelastic law is one energy; everything else is derived from it.

    psi(F; theta) = psi_d(F; theta) + kappa(theta)/2 g(J)^2

per undeformed volume, where psi_d is a text in the invariants I1 = tr C, I2 = (I1^2 - tr C^2)/2, J = det F with
C = F^T F, and of a law with a direction a in I4 = a . C a, with a second one b in I6 = b . C b; or in the principal
stretches lambda1, lambda2, lambda3, the roots of the eigenvalues of C, and in J, their product. The volumetric part is
separate so that it can enter unchanged, or as p g(J) - p^2 / (2 kappa) with a pressure p as an unknown, which has no
large number as nu -> 0.5.

For that element's sake a law may shift a part s/2 g(J)^2 of its energy from psi_d to the volumetric part, kappa then
including s. Nothing elastic depends on s. A history acts on psi_d + s/2 g^2, the law's own first part; since it may
soften that, it needs a smaller s (`with_least_shift`).
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.materials.expression import limited, to_sympy
from softcal.materials.parameter import Parameter

INVARIANTS = ("I1", "I2", "J")
ALONG = ("I4", "I6")  # squared stretches along the directions of a law that has one, or two
STRETCHES = ("lambda1", "lambda2", "lambda3")
AT_REST = {"I1": 3.0, "I2": 3.0, "J": 1.0, **dict.fromkeys((*ALONG, *STRETCHES), 1.0)}
SOME_INVARIANTS, SOME_STRETCHES = (3.2, 3.3, 1.05, 1.1, 1.07), (0.1, -0.06, 0.03)  # of a deformation like any other
PLAIN = 100  # largest denominator of a number in a formula
COMPLEX_STEP = 1e-20  # of a constant: no difference is taken, so nothing is lost


@displayed
@dataclass(frozen=True)
class Law(Checked):
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
        psi_d [J/m^3], text in I1, I2, J, I4 and I6, or in lambda1, lambda2, lambda3 and J; the constants' symbols and
        the abbreviations. Symmetric in the stretches.
    volumetric_strain
        g(J) [-], text in J.
    bulk
        kappa [Pa] of the volumetric part, text in the symbols.
    shifted
        s [Pa], text in the symbols.
    reference
        Where the law is from.
    """

    name: str
    parameters: tuple[Parameter, ...]
    symbols: Mapping[str, str]
    distortional: str
    volumetric_strain: str
    bulk: str
    reference: str = ""
    shifted: str = "0"

    def __hash__(self) -> int:
        return hash((self.name, self.distortional, self.volumetric_strain, self.bulk, self.shifted))

    @functools.cached_property
    def variables(self) -> tuple[str, ...]:
        """The variables of psi_d by which its derivatives are: the invariants, with I4 and I6 where they occur, or
        the principal stretches.
        """
        found = set(re.findall(r"[A-Za-z_]\w*", " ".join([self.distortional, *self.symbols.values()])))
        if found & set(STRETCHES):
            return STRETCHES
        return (*INVARIANTS, *ALONG[: max((i + 1 for i, name in enumerate(ALONG) if name in found), default=0)])

    @property
    def is_directed(self) -> bool:
        """Whether it has a direction, or two."""
        return self.n_directions > 0

    @property
    def n_directions(self) -> int:
        """Number of its directions."""
        return len(set(ALONG) & set(self.variables))

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

    def youngs_modulus_rates(self, theta: Mapping[str, float]) -> dict[str, float]:
        """Derivatives of the small-strain Young's modulus by each constant at theta [SI], by a complex step: exact."""
        compiled, values = compile_law(self), self._ordered(theta)
        rates: dict[str, float] = {}
        for i, name in enumerate(self.names):
            step = COMPLEX_STEP * max(abs(values[i]), 1.0)
            at = [*values[:i], complex(values[i], step), *values[i + 1 :]]
            mu, K = compiled.shear(*at), compiled.compressed(*at)
            rates[name] = float(np.imag(9.0 * K * mu / (3.0 * K + mu)) / step)
        return rates

    def poissons_ratio(self, theta: Mapping[str, float]) -> float:
        """Small-strain Poisson's ratio at constants theta [SI]."""
        mu, K = self.shear_modulus(theta), self._compressed(theta)
        return (3.0 * K - 2.0 * mu) / (2.0 * (3.0 * K + mu))

    def at_small_strain(self, theta: Mapping[str, float]) -> dict[str, float]:
        """Young's modulus [Pa] and Poisson's ratio at small strain, as rods have them, at constants theta [SI]."""
        return {"youngs_modulus": self.youngs_modulus(theta), "poissons_ratio": self.poissons_ratio(theta)}

    @functools.cached_property
    def shear_formula(self) -> str:
        """The shear modulus at small strain by the names of the constants, such as "alpha1 mu1/2"."""
        import sympy

        with limited(f"law {self.name}, distortional"):
            letters, variables, scope = _scope(self)
            shear = sympy.expand_mul(_shear_at_rest(to_sympy(self.distortional, scope), variables))
            named = {letters[one.symbol]: sympy.Symbol(one.name) for one in self.parameters}
            # Series have fractions that nobody reads.
            rounded = {one: sympy.Float(one, 4) for one in shear.atoms(sympy.Rational) if one.q > PLAIN}
            text = str(sympy.factor_terms(shear.xreplace(rounded), fraction=False).xreplace(named))
        return text.replace("**", "^").replace("*", " ")

    def is_proportional(self, theta: Mapping[str, float]) -> bool:
        """Whether the energy is proportional to all moduli among its constants together, at constants theta [SI]."""
        compiled = compile_law(self)
        twice = {p.name: (2.0 if p.quantity.unit == "Pa" else 1.0) * theta[p.name] for p in self.parameters}
        of = SOME_STRETCHES if self.variables == STRETCHES else SOME_INVARIANTS[: len(self.variables)]

        def sizes(at: Mapping[str, float]) -> Floats:
            values = self._ordered(at)
            parts = (compiled.rows(*of, *values), compiled.bulk(*values), compiled.shifted(*values)[0])
            return np.concatenate([np.ravel(part).astype(float) for part in parts])

        return bool(np.allclose(sizes(twice), 2.0 * sizes(theta), rtol=1e-12, atol=0.0))

    def _compressed(self, theta: Mapping[str, float]) -> float:
        """The small-strain bulk modulus [Pa], of both parts of the energy."""
        return float(compile_law(self).compressed(*self._ordered(theta)))

    def _ordered(self, theta: Mapping[str, float]) -> tuple[float, ...]:
        return tuple(theta[name] for name in self.names)


@dataclass(frozen=True)
class CompiledLaw:
    """Vectorised functions of a law: of psi_d by its variables, each (n,), then the constants; of g by J.

    Of a law in principal stretches, the variables of these functions are their logarithms. `rows` are the first
    derivatives of psi_d by the variables, then the second ones: the upper triangle by its rows.
    """

    parameters: tuple[str, ...]
    variables: tuple[str, ...]
    is_simple: bool  # whether only the derivatives psi_1, psi_J and psi_JJ are not zero
    shear: Callable[..., Any]
    bulk: Callable[..., Any]
    compressed: Callable[..., Any]  # the small-strain bulk modulus
    energy: Callable[..., Any]
    energy_by_parameter: Callable[..., Any]  # of each constant
    rows: Callable[..., Any]
    first_by_parameter: Callable[..., Any]  # the first derivatives by the variables, of each constant
    strain: Callable[..., Any]  # g, g', g''
    compliance: Callable[..., Any]  # 1/kappa and its derivatives by the parameters
    shifted: Callable[..., Any]  # s and its derivatives by the parameters


def _scope(law: Law) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """The constants by their letters, the variables by name, and both with all else that the law's texts may name."""
    import sympy

    letters = {one.symbol: sympy.Symbol(one.symbol, real=True) for one in law.parameters}
    variables = {name: sympy.Symbol(name, positive=True) for name in law.variables}
    J = variables["J"] if "J" in variables else sympy.Mul(*variables.values())
    return letters, variables, _with_symbols(law, {**letters, **variables, "J": J, "pi": sympy.pi})


def _with_symbols(law: Law, scope: dict[str, Any]) -> dict[str, Any]:
    for symbol, text in law.symbols.items():
        scope[symbol] = to_sympy(text, scope)
    return scope


@functools.cache
def compile_law(law: Law) -> CompiledLaw:
    """The derivatives of the energy as NumPy functions: those of softcal's own laws as they were written out beforehand
    (`LAW_SOURCES`), of any other law by SymPy; cached.

    Raises
    ------
    InputError
        Where a derivative is not a finite real function, or takes too long to work out.
    """
    source = _written_out().get(fingerprint(law))
    if source is None:
        with limited(f"law {law.name}, distortional"):
            source = law_source(law)
    functions: dict[str, Callable[..., Any]] = {}  # of NumPy's arrays
    for name, text in source.items():
        scope = dict(vars(np))
        exec(text, scope)
        functions[name] = scope[SOURCE_NAME]
    is_simple = functions.pop("is_simple")()
    return CompiledLaw(parameters=law.names, variables=law.variables, is_simple=is_simple, **functions)


LAW_SOURCES = Path(__file__).with_name("law_sources.json")
"""The functions of softcal's own laws, written by `python -m scripts.law_sources`."""


@functools.cache
def _written_out() -> dict[str, dict[str, str]]:
    return json.loads(LAW_SOURCES.read_text(encoding="utf-8"))


def fingerprint(law: Law) -> str:
    """A hash of all that the functions of a law are made of."""
    symbols = [parameter.symbol for parameter in law.parameters]
    texts = (symbols, list(law.symbols.items()), law.distortional, law.volumetric_strain, law.bulk, law.shifted)
    return hashlib.sha256(repr(texts).encode()).hexdigest()[:32]


SOURCE_NAME = "_lambdifygenerated"  # SymPy's, of a function that it makes


def law_source(law: Law) -> dict[str, str]:
    """The sources of a law's functions, differentiated by SymPy: those of `CompiledLaw`, and `is_simple`.

    Raises
    ------
    InputError
        Where a derivative is not a finite real function.
    """
    import sympy

    letters, variables, scope = _scope(law)
    psi_d, kappa, shifted = (to_sympy(text, scope) for text in (law.distortional, law.bulk, law.shifted))
    volume = sympy.Symbol("J", positive=True)
    g = to_sympy(law.volumetric_strain, _with_symbols(law, {**scope, "J": volume}))

    of, theta, energy = list(variables.values()), list(letters.values()), psi_d
    if law.variables == STRETCHES:
        of = [sympy.Symbol(f"ln_{name}", real=True) for name in STRETCHES]
        energy = psi_d.subs({one: sympy.exp(log) for one, log in zip(variables.values(), of, strict=True)})
    first = [energy.diff(a) for a in of]
    second = [slope.diff(b) for i, slope in enumerate(first) for b in of[i:]]
    smooth = (sympy.log, sympy.exp, sympy.sinh, sympy.cosh, sympy.tanh, sympy.Abs, sympy.sign)
    nowhere = (sympy.zoo, sympy.oo, -sympy.oo, sympy.nan, sympy.I, sympy.Derivative, sympy.Subs)

    def finite(what: str, expression: Any) -> Any:
        for one in map(sympy.sympify, sympy.flatten([expression])):
            if one.has(*nowhere) or not all(isinstance(part, smooth) for part in one.atoms(sympy.Function)):
                raise InputError(replace(_not_finite(law, what, psi_d), where=f"law {law.name}, {what}"))
        return expression

    def function(what: str, args: list[Any], expression: Any) -> str:
        return inspect.getsource(sympy.lambdify(args, finite(what, expression), modules="numpy", cse=True))

    def of_energy(args: list[Any], expression: Any) -> str:
        return function("distortional", args, expression)

    shear, bulk = _shear_at_rest(psi_d, variables), _bulk_at_rest(psi_d, variables)
    slope_at_rest = finite("volumetric_strain", g.diff(volume).subs(volume, 1))
    is_simple = law.variables == INVARIANTS and not any([psi_d.diff(variables["I2"]), *second[:-1]])
    return dict(
        is_simple=inspect.getsource(sympy.lambdify([], is_simple)),
        strain=function("volumetric_strain", [volume], [g, g.diff(volume), g.diff(volume, 2)]),
        bulk=function("bulk", theta, kappa),
        compliance=function("bulk", theta, [1 / kappa, [(1 / kappa).diff(t) for t in theta]]),
        shear=of_energy(theta, shear),
        compressed=of_energy(theta, bulk + kappa * slope_at_rest**2),
        energy=of_energy([*of, *theta], energy),
        energy_by_parameter=of_energy([*of, *theta], [energy.diff(t) for t in theta]),
        rows=of_energy([*of, *theta], first + second),
        first_by_parameter=of_energy([*of, *theta], [[slope.diff(t) for slope in first] for t in theta]),
        shifted=function("shifted", theta, [shifted, [shifted.diff(t) for t in theta]]),
    )


def _not_finite(law: Law, what: str, psi_d: Any) -> Fault:
    """Why an expression of a law, or a derivative of it, is not finite."""
    import sympy

    rest = {symbol: sympy.Rational(AT_REST[symbol.name]) for symbol in psi_d.free_symbols if symbol.name in AT_REST}
    powers = [one for one in psi_d.atoms(sympy.Pow) if sympy.simplify(one.base.subs(rest)) == 0]
    powers = [one for one in powers if not (one.exp.is_number and (one.exp == 1 or one.exp >= 2))]
    if what != "distortional" or not powers:
        return Fault("this, its inverse or a derivative is not a finite real function", got=getattr(law, what))
    return Fault(
        "this power has, or may have, infinite derivatives at rest, where its base is 0",
        got=str(powers[0]),
        allowed="a number as its exponent: 1, or 2 and more",
        attempt="a sum of such powers with free factors, as yeoh has, or a constant that is no exponent, as gent has",
    )


def with_least_shift(law: Law) -> Law:
    """The same energy with as small an s' in the place of s as keeps kappa' = kappa - s + s' well above zero.

    Where psi_d + s/2 g^2 softens, the shifted part -s/2 g^2 does not, and displacements that the pressure does not see
    would become unstable. With b = kappa - s, s' = (sqrt(b^2 + (s/4)^2) - b)/2: s/8 at b = 0, next to nothing where b
    is larger than s.
    """
    if law.shifted == "0":
        return law
    symbols = {
        "shifted": law.shifted,
        "bulk": f"{law.bulk} - shifted",
        "least": "(sqrt(bulk**2 + (shifted/4)**2) - bulk)/2",
    }
    return replace(
        law,
        symbols={**law.symbols, **symbols},
        distortional=f"{law.distortional} + (shifted - least)/2*({law.volumetric_strain})**2",
        bulk="bulk + least",
        shifted="least",
    )


def _bulk_at_rest(psi: Any, variables: Mapping[str, Any]) -> Any:
    """d2 psi / d(3 lnlambda)2 of an even stretch lambda, at 1."""
    import sympy

    stretch = sympy.Symbol("stretch", positive=True)
    even = {"I1": 3 * stretch**2, "I2": 3 * stretch**4, "J": stretch**3, **dict.fromkeys(ALONG, stretch**2)}
    even |= dict.fromkeys(STRETCHES, stretch)
    energy = psi.subs({symbol: even[name] for name, symbol in variables.items()})
    return energy.diff(stretch, 2).subs(stretch, 1) / 9


def _shear_at_rest(psi: Any, variables: Mapping[str, Any]) -> Any:
    """d2 psi / ds2 / 4 of the stretches e^s and e^-s, across the directions of a law that has some, at 0."""
    import sympy

    s = sympy.Dummy("s", real=True)  # a constant may be called s
    longer, shorter = sympy.exp(s), sympy.exp(-s)
    square = longer**2 + shorter**2 + 1
    sheared = {"I1": square, "I2": square, "J": 1, **dict.fromkeys(ALONG, 1)}
    sheared |= dict(zip(STRETCHES, (longer, shorter, sympy.Integer(1)), strict=True))
    energy = psi.subs({symbol: sheared[name] for name, symbol in variables.items()})
    return energy.diff(s, 2).subs(s, 0) / 4


def stacked(rows: list[Any], n: int) -> Floats:
    """Rows that may be numbers or arrays of shape (n,) -> one array (len(rows), n)."""
    out = np.empty((len(rows), n))
    for i, row in enumerate(rows):
        out[i] = row
    return out
