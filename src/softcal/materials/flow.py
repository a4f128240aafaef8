"""A branch that flows: what is left of a deformation that lasted, or was large, a permanent set.

Beside the law stands a branch with the deviatoric stress s = 2 mu_f dev(E - E_p) of the Green-Lagrange strain. Where
its equivalent stress q = sqrt(3/2 s : s) is above the threshold Y, what is beyond it relaxes,

    q -> Y + (q - Y) exp(-dt / tau)

at a fixed direction, and E_p, the strain at which the branch is free of stress, follows (radial return). With tau = 0
the branch is an elastic and then plastic one; with a long tau a slow viscoplastic flow. A part of its stress remains
when the robot is let go, and keeps it from its shape.

After Perzyna, Quart. Appl. Math. 20 (1963) 321, with the return of Simo and Hughes, Computational Inelasticity (1998).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats
from softcal.materials.components import TWICE
from softcal.materials.inelastic import Constants, Inelastic, Left, PointRates, Stressed
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

MODULUS, THRESHOLD, TIME = "flow_modulus", "flow_threshold", "flow_time"
_TRACE: Floats = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
# s over 2 mu_f, of strains with doubled shears.
_DEVIATOR: Floats = np.diag(1.0 / TWICE) - np.outer(_TRACE, _TRACE) / 3.0


@dataclass(frozen=True)
class Flow(Inelastic):
    """Its memory at a point: E_p, with doubled shears (6)."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(MODULUS, "mu_f", "μ_f", QUANTITIES["modulus"], typical=2e5),
            Parameter(THRESHOLD, "Y", "Y", QUANTITIES["threshold"], typical=1e4),
            Parameter(TIME, "tau_f", "τ_f", QUANTITIES["time"], typical=10.0, default=0.0),
        )

    @property
    def size(self) -> int:
        return 6

    @property
    def needs_time(self) -> bool:
        return True

    def respond(self, at: Stressed, memory: Floats, elapsed: float, constants: Constants) -> Left:
        mu, Y = constants[MODULUS], constants[THRESHOLD]
        one = _returned(at.E - memory, elapsed, constants)
        tangent = at.D
        if len(tangent):
            bend = np.where(one.flows, (1.0 - one.d) * Y * 3.0 * mu / one.above**3, 0.0)
            tangent = tangent + 2.0 * mu * one.rho[:, None, None] * _DEVIATOR
            tangent = tangent - bend[:, None, None] * one.s[:, :, None] * one.s[:, None, :]
        strain = one.s * TWICE / (2.0 * mu)  # the deviator of E - E_p, with doubled shears
        left = memory + (1.0 - one.rho)[:, None] * strain
        W, S = at.W + one.stored / (3.0 * mu), at.S + one.rho[:, None] * one.s
        return Left(Stressed(at.E, W, S, tangent), left)

    def rates(
        self,
        at: Stressed,
        by: PointRates,
        memory: tuple[Floats, Floats],
        elapsed: float,
        constants: tuple[Constants, Constants],
    ) -> tuple[PointRates, Floats]:
        values, changes = constants
        mu, Y = values[MODULUS], values[THRESHOLD]
        dmu, dY, dtau = (np.asarray(changes.get(name, 0.0)) for name in (MODULUS, THRESHOLD, TIME))
        dd = _decay_rate(elapsed, values[TIME]) * dtau
        strain, dstrain = at.E - memory[0], by.E - memory[1]
        s, q, flows, above, d, rho, stored = _returned(strain, elapsed, values)
        ds = 2.0 * (dmu[..., None] * strain + mu * dstrain) @ _DEVIATOR
        dq = 1.5 * (s * ds * TWICE).sum(axis=1) / np.where(q > 0.0, q, 1.0)
        drho = np.where(flows, dd * (1.0 - Y / above) + (1.0 - d) * (dY - Y * dq / above) / above, 0.0)
        S = by.S + drho[:, None] * s + rho[:, None] * ds
        beyond = d * q * dq + 0.5 * dd * q**2 - dd * (Y * q - 0.5 * Y**2) + (1.0 - d) * (dY * (q - Y) + Y * dq)
        W = by.W + (np.where(flows, beyond, q * dq) - stored * dmu / mu) / (3.0 * mu)
        dev, ddev = strain @ _DEVIATOR * TWICE, dstrain @ _DEVIATOR * TWICE
        left = memory[1] + (1.0 - rho)[:, None] * ddev - drho[:, None] * dev
        return PointRates(by.E, W, S), left


class _Returned(NamedTuple):
    """The radial return at points.

    Attributes
    ----------
    s, q
        The branch's stress (n, 6) [Pa] were nothing to flow, and its equivalent stress (n,).
    flows, above
        Whether that is above the threshold, and it where it is, else one (n,).
    d
        What is left of the rest after the time [-].
    rho
        Share of s that remains (n,) [-].
    stored
        3 mu_f times the potential (n,) [Pa^2].
    """

    s: Floats
    q: Floats
    flows: np.ndarray
    above: Floats
    d: float
    rho: Floats
    stored: Floats


def _returned(strain: Floats, elapsed: float, constants: Constants) -> _Returned:
    """For strains E - E_p (n, 6) with doubled shears."""
    Y, d = constants[THRESHOLD], _decay(elapsed, constants[TIME])
    s = 2.0 * constants[MODULUS] * strain @ _DEVIATOR
    q = np.sqrt(1.5 * (s**2 * TWICE).sum(axis=1))
    flows = q > Y
    above = np.where(flows, q, 1.0)
    rho = np.where(flows, d + (1.0 - d) * Y / above, 1.0)
    stored = np.where(flows, 0.5 * d * q**2 + (1.0 - d) * (Y * q - 0.5 * Y**2), 0.5 * q**2)
    return _Returned(s, q, flows, above, d, rho, stored)


def _decay(elapsed: float, time: float) -> float:
    """exp(-dt / tau), of what is beyond the threshold; it is gone at once where tau is zero."""
    if elapsed == 0.0:
        return 1.0
    return 0.0 if time == 0.0 or np.isinf(elapsed) else float(np.exp(-elapsed / time))


def _decay_rate(elapsed: float, time: float) -> float:
    if elapsed == 0.0 or time == 0.0 or np.isinf(elapsed):
        return 0.0
    return float(np.exp(-elapsed / time)) * elapsed / time**2
