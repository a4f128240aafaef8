"""A branch that flows: what is left of a deformation that lasted, or was large, a permanent set.

Beside the law stands a branch of an incompressible material of shear modulus mu_f, in a solid with the deviatoric
stress s = 2 mu_f dev(E - E_p) of the Green-Lagrange strain. Where its equivalent stress

    q = sqrt(3 mu_f s : (E - E_p)),    in a solid sqrt(3/2 s : s)

is above the threshold Y, what is beyond it relaxes,

    q -> Y + (q - Y) exp(-dt / tau)

at a fixed direction, and E_p, the strain at which the branch is free of stress, follows (radial return). With tau = 0
the branch is an elastic and then plastic one; with a long tau a slow viscoplastic flow. A part of its stress remains
when the robot is let go, and keeps it from its shape.

In a rod the branch has the forces and moments of its sections, and q, by the energy, is the root mean square of the
equivalent stress over a section: that of a bending moment M is M / sqrt(I A), half of the largest in a round bar.

After Perzyna, Quart. Appl. Math. 20 (1963) 321, with the return of Simo and Hughes, Computational Inelasticity (1998).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats
from softcal.materials.inelastic import Constants, Inelastic, Left, PointRates, Stressed
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

MODULUS, THRESHOLD, TIME = "flow_modulus", "flow_threshold", "flow_time"


@dataclass(frozen=True)
class Flow(Inelastic):
    """Its memory at a point: E_p (6). at_once: whether it has no time, as dry friction."""

    at_once: bool = False

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        constants = (
            Parameter(MODULUS, "mu_f", "μ_f", QUANTITIES["modulus"], typical=2e5),
            Parameter(THRESHOLD, "Y", "Y", QUANTITIES["threshold"], typical=1e4),
            Parameter(TIME, "tau_f", "τ_f", QUANTITIES["time"], typical=10.0, default=0.0),
        )
        return constants[:2] if self.at_once else constants

    @property
    def size(self) -> int:
        return 6

    @property
    def needs_time(self) -> bool:
        return not self.at_once

    def respond(self, at: Stressed, memory: Floats, elapsed: float, constants: Constants) -> Left:
        mu, Y = constants[MODULUS], constants[THRESHOLD]
        strain = at.E - memory
        one = _returned(strain, _form(at), elapsed, constants)
        tangent = at.D
        if len(tangent):
            bend = np.where(one.flows, (1.0 - one.d) * Y * 3.0 * mu / one.above**3, 0.0)
            tangent = tangent + mu * one.rho[:, None, None] * _form(at)
            tangent = tangent - bend[:, None, None] * one.s[:, :, None] * one.s[:, None, :]
        left = memory + (1.0 - one.rho)[:, None] * strain
        W, S = at.W + one.stored / (3.0 * mu), at.S + one.rho[:, None] * one.s
        return Left(at._replace(W=W, S=S, D=tangent), left)

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
        dd = _decay_rate(elapsed, values.get(TIME, 0.0)) * dtau
        strain, dstrain = at.E - memory[0], by.E - memory[1]
        s, q, flows, above, d, rho, stored = _returned(strain, _form(at), elapsed, values)
        ds = dmu[..., None] / mu * s + mu * _times(_form(at), dstrain)
        dq = q * dmu / mu + 3.0 * mu * (s * dstrain).sum(axis=1) / np.where(q > 0.0, q, 1.0)
        drho = np.where(flows, dd * (1.0 - Y / above) + (1.0 - d) * (dY - Y * dq / above) / above, 0.0)
        S = by.S + drho[:, None] * s + rho[:, None] * ds
        beyond = d * q * dq + 0.5 * dd * q**2 - dd * (Y * q - 0.5 * Y**2) + (1.0 - d) * (dY * (q - Y) + Y * dq)
        W = by.W + (np.where(flows, beyond, q * dq) - stored * dmu / mu) / (3.0 * mu)
        left = memory[1] + (1.0 - rho)[:, None] * dstrain - drho[:, None] * strain
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


def _returned(strain: Floats, form: Floats, elapsed: float, constants: Constants) -> _Returned:
    """For strains E - E_p (n, 6), with `Stressed.isochoric` (n, 6, 6)."""
    mu, Y, d = constants[MODULUS], constants[THRESHOLD], _decay(elapsed, constants.get(TIME, 0.0))
    s = mu * _times(form, strain)
    q = np.sqrt(np.maximum(3.0 * mu * (s * strain).sum(axis=1), 0.0))
    flows = q > Y
    above = np.where(flows, q, 1.0)
    rho = np.where(flows, d + (1.0 - d) * Y / above, 1.0)
    stored = np.where(flows, 0.5 * d * q**2 + (1.0 - d) * (Y * q - 0.5 * Y**2), 0.5 * q**2)
    return _Returned(s, q, flows, above, d, rho, stored)


def _form(at: Stressed) -> Floats:
    return np.broadcast_to(at.isochoric, (len(at.E), 6, 6))


def _times(form: Floats, strain: Floats) -> Floats:
    return np.einsum("nij,nj->ni", form, strain)


def _decay(elapsed: float, time: float) -> float:
    """exp(-dt / tau), of what is beyond the threshold; it is gone at once where tau is zero."""
    return 0.0 if time == 0.0 or np.isinf(elapsed) else float(np.exp(-elapsed / time))


def _decay_rate(elapsed: float, time: float) -> float:
    if time == 0.0 or np.isinf(elapsed):
        return 0.0
    return float(np.exp(-elapsed / time)) * elapsed / time**2
