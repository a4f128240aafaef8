"""The constants of a law that tests of incompressible coupons determine, and its other constants.

At constant volume the pressure takes the place of the volumetric part. A constant without effect there, such as a bulk
modulus, and Poisson's ratio, which only scales the stresses, are stated and not fitted. A law whose stresses Poisson's
ratio changes otherwise, such as Saint-Venant's and Kirchhoff's, has no incompressible form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.checks import Floats
from softcal.errors import Fault, ParameterError
from softcal.materials.histories import history_of
from softcal.materials.inelastic import History
from softcal.materials.law import Law
from softcal.materials.parameter import Parameter
from softcal.plugins.coupons.kind import LawResponse, principal_states
from softcal.quantities import QUANTITIES

POISSONS_RATIO = 0.499
"""Default Poisson's ratio of what coupons leave open: nearly incompressible, as elastomers are."""
_NU = QUANTITIES["Poisson's ratio"].name
_WIDE = 1e4  # bounds over the typical size of a positive constant, and of one of either sign its square root
_STEEPEST = 20.0
"""Largest magnitude of an exponent: the stress of a steeper term is felt by the last rows of a test alone."""
_NONE = 1e-9  # of the largest derivative
_PROBES = np.array([[1.1, 1.0], [1.3, 0.9], [1.2, 1.2], [1.5, 0.8], [0.9, 1.0], [0.8, 1.3]])


@dataclass(frozen=True)
class FreeConstants:
    """The constants of a law in an incompressible coupon.

    Attributes
    ----------
    law
        The law.
    fitted
        The constants that the tests determine.
    poissons_ratio
        Poisson's ratio of the body, which is stated [-].
    parts
        Parts of the material's history, names of `softcal.materials.histories`: all its constants are fitted.
    """

    law: Law
    fitted: tuple[Parameter, ...]
    poissons_ratio: float
    parts: tuple[str, ...] = ()

    @cached_property
    def history(self) -> History:
        """The history of the material, beyond its law."""
        return history_of(self.parts)

    @property
    def elastic(self) -> FreeConstants:
        """The free constants of the law alone."""
        return replace(self, fitted=tuple(p for p in self.fitted if p in self.law.parameters), parts=())

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the fitted constants."""
        return tuple(parameter.name for parameter in self.fitted)

    @property
    def columns(self) -> list[int]:
        """Indices of the law's fitted constants among all its constants."""
        return [self.law.names.index(name) for name in self.elastic.names]

    def of_history(self, values: Sequence[float] | Floats) -> dict[str, float]:
        """The constants of the history [SI] by name."""
        given = dict(zip(self.names, (float(value) for value in values), strict=True))
        return {p.name: given[p.name] for p in self.history.parameters}

    def theta(self, values: Sequence[float] | Floats) -> dict[str, float]:
        """All constants [SI] by name, at values of the fitted ones."""
        given = dict(zip(self.names, (float(value) for value in values), strict=True))
        every = (*self.law.parameters, *self.history.parameters)
        theta = {p.name: given.get(p.name, _stated(p, self.poissons_ratio)) for p in every}
        nu, mu = self.poissons_ratio, self.law.shear_modulus(theta)
        wanted = 2.0 * mu * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
        bulky = [p for p in self.law.parameters if p not in self.fitted and p.quantity.unit == "Pa"]
        if bulky and mu > 0.0:
            factor = wanted / self.law.bulk_modulus(theta)
            theta |= {p.name: theta[p.name] * factor for p in bulky}
        return theta

    def ordered(self, values: Sequence[float] | Floats) -> tuple[float, ...]:
        """The values of all constants in the law's order, where only stresses at constant volume are wanted."""
        given = dict(zip(self.names, values, strict=True))
        # As NumPy's numbers, which a division by zero makes infinite where Python's raise.
        return tuple(np.float64(given.get(p.name, _stated(p, self.poissons_ratio))) for p in self.law.parameters)

    def space(self, modulus: float) -> SearchSpace:
        """The fitted constants with bounds far beyond any rubber-like body of that modulus [Pa]."""
        free: list[FreeParameter] = []
        for p in self.fitted:
            quantity, size = p.quantity, _size(p, modulus)
            if quantity.lower >= 0.0:
                lower = max(quantity.lower if quantity.ends[0] == "[" else quantity.lower * (1 + 1e-3), size / _WIDE)
                upper = min(quantity.upper, size * _WIDE)
                free.append(FreeParameter(p.name, quantity.unit, lower, upper, "log"))
            else:
                wide = _STEEPEST if quantity is QUANTITIES["exponent of stretches"] else size * _WIDE**0.5
                lower, upper = max(quantity.lower, -wide), min(quantity.upper, wide)
                free.append(FreeParameter(p.name, quantity.unit, lower, upper))
        return SearchSpace(tuple(free))


def free_constants(law: Law, poissons_ratio: float = POISSONS_RATIO, history: Sequence[str] = ()) -> FreeConstants:
    """The constants of a law that tests of incompressible coupons determine, and those of a history.

    Parameters
    ----------
    law
        Law of the material.
    poissons_ratio
        That of the body, which coupons do not determine [-].
    history
        Parts of the material's history, such as `softening`.

    Raises
    ------
    ParameterError
        Where the law has a direction, or no incompressible form, or the history has no such part.
    """
    if law.is_directed:
        raise ParameterError(
            Fault(
                "a law with a direction needs coupons that state theirs, which softcal does not read",
                law.name,
                attempt="a law without direction for coupons of one build direction",
            )
        )
    values = tuple(_stated(p, poissons_ratio) for p in law.parameters)
    states = principal_states(_PROBES[:, 0], _PROBES[:, 1], 2)
    slopes = LawResponse(law, states).by_constants(values).reshape(-1, len(values))
    slopes = slopes * np.array([_size(p, 1.0) for p in law.parameters])
    sizes = np.abs(slopes).max(axis=0)
    fitted = [k for k, p in enumerate(law.parameters) if p.quantity.name != _NU and sizes[k] > _NONE * sizes.max()]
    for k, p in enumerate(law.parameters):
        others = slopes[:, fitted]
        left = slopes[:, k] - others @ np.linalg.lstsq(others, slopes[:, k], rcond=None)[0]
        if k not in fitted and np.abs(left).max() > 1e-6 * sizes[k] + _NONE * sizes.max():
            raise ParameterError(
                Fault(
                    f"the law has no incompressible form: its stresses at constant volume depend on {p.name} by more "
                    "than a factor",
                    law.name,
                    attempt="neo-hooke",
                )
            )
    own = history_of(history, "--history").parameters
    return FreeConstants(law, (*(law.parameters[k] for k in fitted), *own), poissons_ratio, tuple(history))


def _stated(parameter: Parameter, poissons_ratio: float) -> float:
    return poissons_ratio if parameter.quantity.name == _NU else parameter.typical


def _size(parameter: Parameter, modulus: float) -> float:
    """A typical magnitude of a constant."""
    return modulus if parameter.quantity.unit == "Pa" else abs(parameter.typical)
