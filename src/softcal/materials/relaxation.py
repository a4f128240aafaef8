"""Finite linear viscoelasticity: stresses that relax, a Prony series of branches.

With S the stress of the law, which is the one after a long time, and g_i the shares of the stress at once that relax,

    S + sum_i H_i,    dH_i/dt + H_i / tau_i = beta_i dS/dt,    beta_i = g_i / (1 - sum_j g_j)

exact where S changes at a constant rate from one sample to the next (`branches.py`). Simo, Comput. Methods Appl. Mech.
Engrg. 60 (1987) 153; Holzapfel, Nonlinear Solid Mechanics (2000), section 6.10.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.materials.branches import Branches, stacked
from softcal.materials.inelastic import Constants, Inelastic, Left, PointRates, Stressed
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES


@dataclass(frozen=True)
class Relaxation(Inelastic):
    """A Prony series. branches: their number.

    Its memory at a point: the stress S of the previous sample, then H_i / beta_i of each branch.
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
        return self._kept.size

    @property
    def needs_time(self) -> bool:
        return True

    def faults(self, constants: Constants) -> str:
        total = float(stacked(constants, self._shares).sum())
        return "" if total < 1.0 else f"the shares that relax add up to {total:.4g}, and must be below 1 together"

    def respond(self, at: Stressed, memory: Floats, elapsed: float, constants: Constants) -> Left:
        """The response of the material with the stresses that relax. Arguments: see `Inelastic.respond`."""
        g = stacked(constants, self._shares)
        beta = g / (1.0 - g.sum())
        kept = self._kept.follow(at.S, memory, elapsed, constants)
        more, past = float(beta @ kept.a), np.einsum("b,nbm->nm", beta, kept.past)
        W = (1.0 + more) * at.W + (past * at.E).sum(axis=1)
        S = (1.0 + more) * at.S + past
        return Left(at._replace(W=W, S=S, D=(1.0 + more) * at.D), kept.memory)

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
        g, dg = stacked(values, self._shares), stacked(changes, self._shares)
        rest = 1.0 - g.sum()
        beta, dbeta = g / rest, dg / rest + g * dg.sum(axis=-1, keepdims=True) / rest**2
        kept = self._kept.follow(at.S, memory[0], elapsed, values)
        rates = self._kept.rates((at.S, by.S), memory, elapsed, constants)
        S = by.S + (dbeta[..., None] * kept.h + beta[:, None] * rates.h).sum(axis=1)
        more, dmore = float(beta @ kept.a), (dbeta * kept.a + beta * rates.a).sum(axis=-1)
        past = np.einsum("b,nbm->nm", beta, kept.past)
        past_rate = (dbeta[..., None] * kept.past + beta[:, None] * rates.past).sum(axis=1)
        W = (1.0 + more) * by.W + dmore * at.W + (past_rate * at.E + past * by.E).sum(axis=1)
        return PointRates(by.E, W, S), rates.memory

    @property
    def _kept(self) -> Branches:
        return Branches(tuple(time_of(i) for i in range(1, self.branches + 1)))

    @property
    def _shares(self) -> list[str]:
        return [share_of(i) for i in range(1, self.branches + 1)]


def share_of(branch: int) -> str:
    """The name of the share of a branch, counted from 1."""
    return f"relaxing_share{branch}"


def time_of(branch: int) -> str:
    """The name of the relaxation time of a branch, counted from 1."""
    return f"relaxation_time{branch}"
