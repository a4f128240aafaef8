"""Finite linear viscoelasticity: stresses that relax, a Prony series of branches.

With S the stress of the law, which is the one after a long time, and g_i the shares of the stress at once that relax,

    S + sum_i H_i,    dH_i/dt + H_i / tau_i = beta_i dS/dt,    beta_i = g_i / (1 - sum_j g_j)

Where S changes at a constant rate from one sample to the next, a time dt later, H_i is exactly

    H_i -> e_i H_i + beta_i a_i (S - S_n),    e_i = exp(-dt / tau_i),    a_i = (1 - e_i) tau_i / dt

Simo, Comput. Methods Appl. Mech. Engrg. 60 (1987) 153; Holzapfel, Nonlinear Solid Mechanics (2000), section 6.10.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.materials.inelastic import Constants, Inelastic, Left, PointRates, Stressed
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES


@dataclass(frozen=True)
class Relaxation(Inelastic):
    """A Prony series. branches: their number.

    Its memory at a point: the stress S of the sample before, then H_i of each branch.
    """

    branches: int

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            parameter
            for i in range(1, self.branches + 1)
            for parameter in (
                Parameter(share_of(i), f"g{i}", f"g{i}", QUANTITIES["relaxing share"], typical=0.2 / i),
                Parameter(time_of(i), f"tau{i}", f"τ{i}", QUANTITIES["relaxation time"], typical=0.1 * 10.0**i),
            )
        )

    @property
    def size(self) -> int:
        return 6 * (1 + self.branches)

    @property
    def needs_time(self) -> bool:
        return True

    def faults(self, constants: Constants) -> str:
        total = sum(self._shares(constants))
        return "" if total < 1.0 else f"the shares that relax add up to {total:.4g}, and must be below 1 together"

    def respond(self, at: Stressed, memory: Floats, elapsed: float, constants: Constants) -> Left:
        before, H = self._parted(memory)
        e, a = self._factors(elapsed, constants)
        beta = self._weights(constants)
        more = float(beta @ a)
        past = np.einsum("b,nbm->nm", e, H) - more * before
        added = e[:, None] * H + (beta * a)[:, None] * (at.S - before)[:, None, :]
        W = (1.0 + more) * at.W + (past * at.E).sum(axis=1)
        S = (1.0 + more) * at.S + past
        return Left(
            Stressed(at.E, W, S, (1.0 + more) * at.D), np.concatenate([at.S[:, None, :], added], 1).reshape(len(S), -1)
        )

    def rates(
        self,
        at: Stressed,
        by: PointRates,
        memory: tuple[Floats, Floats],
        elapsed: float,
        constants: tuple[Constants, Constants],
    ) -> tuple[PointRates, Floats]:
        (before, H), (before_rate, H_rate) = (self._parted(one) for one in memory)
        values, changes = constants
        e, a = self._factors(elapsed, values)
        de, da = self._factor_rates(elapsed, values, changes)
        beta, dbeta = self._weights(values), self._weight_rates(values, changes)
        weight, dweight = (beta * a)[:, None], (dbeta * a + beta * da)[:, None]
        kept = (
            de[:, None] * H
            + e[:, None] * H_rate
            + dweight * (at.S - before)[:, None, :]
            + weight * (by.S - before_rate)[:, None, :]
        )
        S = by.S + kept.sum(axis=1)
        more, dmore = float(weight.sum()), float(dweight.sum())
        past = np.einsum("b,nbm->nm", e, H) - more * before
        past_rate = (
            np.einsum("b,nbm->nm", de, H) + np.einsum("b,nbm->nm", e, H_rate) - dmore * before - more * before_rate
        )
        W = (1.0 + more) * by.W + dmore * at.W + (past_rate * at.E + past * by.E).sum(axis=1)
        left = np.concatenate([by.S[:, None, :], kept], axis=1)
        return PointRates(by.E, W, S), left.reshape(len(S), -1)

    def _parted(self, memory: Floats) -> tuple[Floats, Floats]:
        parts = memory.reshape(len(memory), 1 + self.branches, 6)
        return parts[:, 0], parts[:, 1:]

    def _shares(self, constants: Constants) -> list[float]:
        return [constants.get(share_of(i), 0.0) for i in range(1, self.branches + 1)]

    def _weights(self, constants: Constants) -> Floats:
        g = np.array(self._shares(constants))
        return g / (1.0 - g.sum())

    def _weight_rates(self, constants: Constants, changes: Constants) -> Floats:
        g, dg = np.array(self._shares(constants)), np.array(self._shares(changes))
        rest = 1.0 - g.sum()
        return dg / rest + g * dg.sum() / rest**2

    def _times(self, constants: Constants) -> Floats:
        return np.array([constants.get(time_of(i), 0.0) for i in range(1, self.branches + 1)])

    def _factors(self, elapsed: float, constants: Constants) -> tuple[Floats, Floats]:
        if np.isinf(elapsed):
            return np.zeros(self.branches), np.zeros(self.branches)
        x = elapsed / self._times(constants)
        return np.exp(-x), _mean_of_decay(x)

    def _factor_rates(self, elapsed: float, constants: Constants, changes: Constants) -> tuple[Floats, Floats]:
        if np.isinf(elapsed):
            return np.zeros(self.branches), np.zeros(self.branches)
        tau = self._times(constants)
        x = elapsed / tau
        dx = -x / tau * self._times(changes)
        small = np.abs(x) < 1e-4
        at = np.where(small, 1.0, x)
        slope = np.where(small, -0.5 + x / 3.0, (np.exp(-at) * (1.0 + at) - 1.0) / at**2)
        return -np.exp(-x) * dx, slope * dx


def share_of(branch: int) -> str:
    """The name of the share of a branch, counted from 1."""
    return f"relaxing_share{branch}"


def time_of(branch: int) -> str:
    """The name of the relaxation time of a branch, counted from 1."""
    return f"relaxation_time{branch}"


def _mean_of_decay(x: Floats) -> Floats:
    """(1 - exp(-x)) / x, one at zero."""
    at = np.where(x == 0.0, 1.0, x)
    return np.where(x == 0.0, 1.0, -np.expm1(-at) / at)
