"""A branch that flows: what is left of a deformation that lasted, or was large, a permanent set.

Beside the law stands a branch of an incompressible material of shear modulus mu_f, in a solid with the deviatoric
stress s = 2 mu_f dev(E - E_p) of the Green-Lagrange strain. Where its equivalent stress

    q = sqrt(3 mu_f s : (E - E_p)),    in a solid sqrt(3/2 s : s)

is above the threshold Y, what is beyond it relaxes at a fixed direction (radial return), and E_p, the strain at which
the branch is free of stress, follows:

    dq/dt = -(q - Y) / tau

With tau = 0 the branch is an elastic and then plastic one; with a long tau a slow viscoplastic flow. A part of its
stress remains when the robot is let go, and keeps it from its shape.

From one sample to the next, a time dt later, what is beyond Y relaxes by a factor e/a at the strain of the first, then
the strain changes, and what is beyond Y then relaxes by a, with e and a as of `branches.py`. Both together are exact
where q is above Y and the strain changes at a constant rate in a fixed direction, and elsewhere of second order in dt
(Strang's splitting); in the second step, stress and tangent are those of a potential of the strain.

In a rod the branch has the forces and moments of its sections, and q, by the energy, is the root mean square of the
equivalent stress over a section: that of a bending moment M is M / sqrt(I A), half of the largest in a round bar.

After Perzyna, Quart. Appl. Math. 20 (1963) 321, with the return of Simo and Hughes, Computational Inelasticity (1998).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats
from softcal.materials.branches import factor_rates, factors, stacked
from softcal.materials.inelastic import Constants, Inelastic, Left, PointRates, Stressed
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

MODULUS, THRESHOLD, TIME = "flow_modulus", "flow_threshold", "flow_time"


@dataclass(frozen=True)
class Flow(Inelastic):
    """Its memory at a point: E_p and E of the previous sample (12). at_once: without a time, as dry friction."""

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
        return 12

    @property
    def needs_time(self) -> bool:
        return not self.at_once

    def respond(self, at: Stressed, memory: Floats, elapsed: float, constants: Constants) -> Left:
        """The response of the material with the branch parallel to the law. Arguments: see `Inelastic.respond`."""
        mu, Y, form = constants[MODULUS], constants[THRESHOLD], _form(at)
        set_before, before = memory[:, :6], memory[:, 6:]
        first, last = _decays(elapsed, constants)
        begun = _returned(before - set_before, form, first, constants)
        strain = at.E - before + begun.remains
        one = _returned(strain, form, last, constants)
        tangent = at.D
        if len(tangent):
            bend = np.where(one.flows, (1.0 - last) * Y * 3.0 * mu / one.above**3, 0.0)
            tangent = tangent + mu * one.rho[:, None, None] * form
            tangent = tangent - bend[:, None, None] * one.s[:, :, None] * one.s[:, None, :]
        W, S = at.W + one.stored / (3.0 * mu), at.S + one.rho[:, None] * one.s
        return Left(at._replace(W=W, S=S, D=tangent), np.concatenate([at.E - one.remains, at.E], axis=1))

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
        mu, form = values[MODULUS], _form(at)
        (set_before, before), (set_rate, before_rate) = ((one[:, :6], one[:, 6:]) for one in memory)
        first, last = _decays(elapsed, values)
        de, da = factor_rates(*_time(elapsed, values), stacked(changes, [TIME]))
        first_rate, last_rate = ((de - first * da) / last if last > 0.0 else de)[..., 0], da[..., 0]
        begun = _returned(before - set_before, form, first, values)
        begun_rate = _returned_rates(begun, before_rate - set_rate, form, first_rate, constants)
        one = _returned(at.E - before + begun.remains, form, last, values)
        rate = _returned_rates(one, by.E - before_rate + begun_rate.remains, form, last_rate, constants)
        dmu = np.asarray(changes.get(MODULUS, 0.0))
        S = by.S + rate.rho[:, None] * one.s + one.rho[:, None] * rate.s
        W = by.W + (rate.stored - one.stored * dmu / mu) / (3.0 * mu)
        return PointRates(by.E, W, S), np.concatenate([by.E - rate.remains, by.E], axis=1)


class _Returned(NamedTuple):
    """The radial return at points.

    Attributes
    ----------
    strain
        Of the branch, were nothing to flow (n, 6).
    s, q
        Its stress there (n, 6) [Pa], and its equivalent stress (n,).
    flows, above
        Whether that is above the threshold, and it where it is, else one (n,).
    d
        What is left of the rest [-].
    rho
        Share of s that remains (n,) [-].
    remains
        The strain that remains (n, 6).
    stored
        3 mu_f times the potential (n,) [Pa^2].
    """

    strain: Floats
    s: Floats
    q: Floats
    flows: np.ndarray
    above: Floats
    d: float
    rho: Floats
    remains: Floats
    stored: Floats


class _ReturnedRates(NamedTuple):
    """The rates of the same quantities of a radial return."""

    s: Floats
    rho: Floats
    remains: Floats
    stored: Floats


def _returned(strain: Floats, form: Floats, d: float, constants: Constants) -> _Returned:
    """For strains of the branch (n, 6), with `Stressed.isochoric` (n, 6, 6)."""
    mu, Y = constants[MODULUS], constants[THRESHOLD]
    s = mu * _times(form, strain)
    q = np.sqrt(np.maximum(3.0 * mu * (s * strain).sum(axis=1), 0.0))
    flows = q > Y
    above = np.where(flows, q, 1.0)
    rho = np.where(flows, d + (1.0 - d) * Y / above, 1.0)
    stored = np.where(flows, 0.5 * d * q**2 + (1.0 - d) * (Y * q - 0.5 * Y**2), 0.5 * q**2)
    return _Returned(
        strain=strain,
        s=s,
        q=q,
        flows=flows,
        above=above,
        d=d,
        rho=rho,
        remains=rho[:, None] * strain,
        stored=stored,
    )


def _returned_rates(
    of: _Returned, dstrain: Floats, form: Floats, dd: Floats, constants: tuple[Constants, Constants]
) -> _ReturnedRates:
    """At rates of the strains (n, 6) and of d, with the constants and their rates."""
    values, changes = constants
    mu, Y = values[MODULUS], values[THRESHOLD]
    dmu, dY = (np.asarray(changes.get(name, 0.0)) for name in (MODULUS, THRESHOLD))
    strain, s, q, flows, above, d, rho, _, _ = of
    ds = dmu[..., None] / mu * s + mu * _times(form, dstrain)
    dq = q * dmu / mu + 3.0 * mu * (s * dstrain).sum(axis=1) / np.where(q > 0.0, q, 1.0)
    drho = np.where(flows, dd * (1.0 - Y / above) + (1.0 - d) * (dY - Y * dq / above) / above, 0.0)
    beyond = d * q * dq + 0.5 * dd * q**2 - dd * (Y * q - 0.5 * Y**2) + (1.0 - d) * (dY * (q - Y) + Y * dq)
    remains = drho[:, None] * strain + rho[:, None] * dstrain
    return _ReturnedRates(ds, drho, remains, np.where(flows, beyond, q * dq))


def _form(at: Stressed) -> Floats:
    return np.broadcast_to(at.isochoric, (len(at.E), 6, 6))


def _times(form: Floats, strain: Floats) -> Floats:
    return np.einsum("nij,nj->ni", form, strain)


def _decays(elapsed: float, constants: Constants) -> tuple[float, float]:
    """e/a and a: what is left of the rest before the strain changes, and after; nothing where there is no time."""
    e, a = factors(*_time(elapsed, constants))
    return (float(e[0] / a[0]), float(a[0])) if a[0] > 0.0 else (0.0, 0.0)


def _time(elapsed: float, constants: Constants) -> tuple[float, Floats]:
    """The time since the sample before, and the flow's own (1,); of one at once, the former is as good as infinite."""
    tau = stacked(constants, [TIME])
    return (elapsed, tau) if tau[0] > 0.0 else (np.inf, tau)
