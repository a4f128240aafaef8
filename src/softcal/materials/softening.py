"""Mullins' effect after Ogden and Roxburgh: softer below the largest energy so far.

    eta S,    eta = 1 - erf((W_max - W) / (m + b W_max)) / r

W is the energy of the law, W_max its largest value at a sample so far. So the first loading is that of the law, and
loading again up to the same energy is softer, as letting go. r above one, m [Pa] and b fit how much and how soon.

Ogden and Roxburgh, Proc. R. Soc. Lond. A 455 (1999) 2861; b as in Abaqus' and CalculiX's *MULLINS EFFECT.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.materials.inelastic import Constants, Inelastic, Left, PointRates, Stressed
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

AMOUNT, ENERGY, RANGE = "softening_amount", "softening_energy", "softening_range"


@dataclass(frozen=True)
class Softening(Inelastic):
    """Its memory at a point: W_max."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(AMOUNT, "r", "r", QUANTITIES["softening amount"], typical=2.0),
            Parameter(ENERGY, "m", "m", QUANTITIES["modulus"], typical=1e4),
            Parameter(RANGE, "b", "b", QUANTITIES["softening range"], typical=0.1, default=0.0),
        )

    @property
    def size(self) -> int:
        return 1

    def respond(self, at: Stressed, memory: Floats, elapsed: float, constants: Constants) -> Left:
        """The response of the material softened by eta. Arguments: see `Inelastic.respond`."""
        most = np.maximum(memory[:, 0], at.W)
        r, m, b = (constants[name] for name in (AMOUNT, ENERGY, RANGE))
        width = m + b * most
        x = (most - at.W) / width
        eta = 1.0 - _erf(x) / r
        # d eta / dW at a given W_max; on the first loading W_max is W, and eta stays one.
        slope = np.where(at.W < memory[:, 0], _bell(x) / (r * width), 0.0)
        W = at.W + _integral(x) * width / r
        tangent = at.D
        if len(tangent):
            tangent = eta[:, None, None] * tangent + slope[:, None, None] * at.S[:, :, None] * at.S[:, None, :]
        return Left(at._replace(W=W, S=eta[:, None] * at.S, D=tangent), most[:, None])

    def rates(
        self,
        at: Stressed,
        by: PointRates,
        memory: tuple[Floats, Floats],
        elapsed: float,
        constants: tuple[Constants, Constants],
    ) -> tuple[PointRates, Floats]:
        """See `Inelastic.rates`."""
        values, changes = constants
        r, m, b = (values[name] for name in (AMOUNT, ENERGY, RANGE))
        dr, dm, db = (changes.get(name, 0.0) for name in (AMOUNT, ENERGY, RANGE))
        first = at.W >= memory[0][:, 0]
        most = np.where(first, at.W, memory[0][:, 0])
        dmost = np.where(first, by.W, memory[1][:, 0])
        width, dwidth = m + b * most, dm + db * most + b * dmost
        x = (most - at.W) / width
        dx = (dmost - by.W - x * dwidth) / width
        eta, deta = 1.0 - _erf(x) / r, -_bell(x) * dx / r + _erf(x) * dr / r**2
        below = _integral(x)
        W = by.W + (_erf(x) * dx * width + below * dwidth) / r - below * width * dr / r**2
        return PointRates(by.E, W, deta[:, None] * at.S + eta[:, None] * by.S), dmost[:, None]


def _erf(x: Floats) -> Floats:
    from scipy.special import erf  # slow to import

    return erf(x)


def _bell(x: Floats) -> Floats:
    """The slope of erf."""
    return 2.0 / np.sqrt(np.pi) * np.exp(-(x**2))


def _integral(x: Floats) -> Floats:
    """The integral of erf from zero to x."""
    return x * _erf(x) + (np.exp(-(x**2)) - 1.0) / np.sqrt(np.pi)
