"""Branches that forget: what each keeps of a quantity y that it once followed.

    dh_i/dt + h_i / tau_i = dy/dt

Where y changes at a constant rate from one sample to the next, a time dt later, h_i is exactly

    h_i -> e_i h_i + a_i (y - y_n),    e_i = exp(-dt / tau_i),    a_i = (1 - e_i) tau_i / dt

Simo, Comput. Methods Appl. Mech. Engrg. 60 (1987) 153.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats
from softcal.materials.inelastic import Constants


class Kept(NamedTuple):
    """Branches at points, as functions of y: h_i = a_i y + past_i.

    Attributes
    ----------
    a
        a_i of each branch (b,) [-].
    past
        past_i, which does not depend on y (n, b, 6).
    h
        h_i at y (n, b, 6).
    memory
        y, then h_i of each branch (n, 6 (1 + b)).
    """

    a: Floats
    past: Floats
    h: Floats
    memory: Floats


@dataclass(frozen=True)
class Branches:
    """Branches with relaxation times of these names."""

    times: tuple[str, ...]

    @property
    def size(self) -> int:
        """Numbers in the memory of each point."""
        return 6 * (1 + len(self.times))

    def follow(self, y: Floats, memory: Floats, elapsed: float, constants: Constants) -> Kept:
        """The branches at the end of a step.

        Parameters
        ----------
        y
            What they follow (n, 6).
        memory
            Memory of the sample before (n, size).
        elapsed
            Time since then [s].
        constants
            Constants by name [SI].
        """
        before, h = self._parted(memory)
        e, a = factors(elapsed, stacked(constants, self.times))
        past = e[:, None] * h - a[:, None] * before[:, None, :]
        now = past + a[:, None] * y[:, None, :]
        return Kept(a, past, now, _joined(y, now))

    def rates(
        self,
        y: tuple[Floats, Floats],
        memory: tuple[Floats, Floats],
        elapsed: float,
        constants: tuple[Constants, Constants],
    ) -> Kept:
        """The rates of the branches of `follow`; `past`: of all but `a y`.

        Parameters
        ----------
        y
            What they follow (n, 6), and its rates.
        memory
            Memory of the sample before (n, size), and its rates.
        elapsed
            Time since then [s].
        constants
            Constants by name [SI], and their rates.
        """
        (before, h), (before_rate, h_rate) = (self._parted(one) for one in memory)
        tau = stacked(constants[0], self.times)
        e, a = factors(elapsed, tau)
        de, da = factor_rates(elapsed, tau, stacked(constants[1], self.times))
        past = (
            de[..., None] * h
            + e[:, None] * h_rate
            - da[..., None] * before[:, None, :]
            - a[:, None] * before_rate[:, None, :]
        )
        now = past + da[..., None] * y[0][:, None, :] + a[:, None] * y[1][:, None, :]
        return Kept(da, past, now, _joined(y[1], now))

    def _parted(self, memory: Floats) -> tuple[Floats, Floats]:
        parts = memory.reshape(len(memory), 1 + len(self.times), 6)
        return parts[:, 0], parts[:, 1:]


def stacked(constants: Constants, names: Sequence[str]) -> Floats:
    """Constants, or their rates, of these names (..., b); those that are missing zero."""
    return np.stack(np.broadcast_arrays(*(np.asarray(constants.get(name, 0.0)) for name in names)), axis=-1)


def _joined(y: Floats, h: Floats) -> Floats:
    return np.concatenate([y[:, None, :], h], axis=1).reshape(len(y), -1)


def factors(elapsed: float, tau: Floats) -> tuple[Floats, Floats]:
    """e and a after a time, with relaxation times tau (b,)."""
    if np.isinf(elapsed):
        return np.zeros_like(tau), np.zeros_like(tau)
    x = elapsed / tau
    at = np.where(x == 0.0, 1.0, x)
    return np.exp(-x), np.where(x == 0.0, 1.0, -np.expm1(-at) / at)


def factor_rates(elapsed: float, tau: Floats, change: Floats) -> tuple[Floats, Floats]:
    """The rates of the factors e and a.

    Parameters
    ----------
    elapsed
        Time since the sample before [s].
    tau
        Relaxation times (b,) [s].
    change
        Their rates (..., b).
    """
    if np.isinf(elapsed):
        return np.zeros_like(change), np.zeros_like(change)
    x = elapsed / tau
    dx = -x / tau * change
    small = np.abs(x) < 1e-4
    at = np.where(small, 1.0, x)
    slope = np.where(small, -0.5 + x / 3.0, (np.exp(-at) * (1.0 + at) - 1.0) / at**2)
    return -np.exp(-x) * dx, slope * dx
