"""The last equilibria of a robot that is moved in small steps, and the next one as a polynomial of the commands.

    z(c) = sum of w_i (z_i + (dz/dcommand) (c - c_i)),    sum of w_i m(c_i - c) = m(0) for every monomial m

Where the equilibria do not suffice for all monomials, those of low degree come first; then the tangent's dz/dcommand
leaves errors of second order. Where they are more than enough, the weights w_i are the smallest, against rounding.
"""

from __future__ import annotations

from functools import cache
from itertools import combinations_with_replacement

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.layout import Layout
from softcal.mechanics.state import State, difference, moved

MOST = 8  # equilibria
DEGREE = 4  # of the polynomial
PRIORITY = 100.0  # weight of a degree over that of the next one


class Trail:
    """Equilibria with the same actuators driven, each at commands (n_actuators,)."""

    def __init__(self, layout: Layout, commands: Floats, state: State) -> None:
        self._layout, self._origin = layout, state
        self._commands = commands[None]
        self._steps = np.zeros((1, layout.n_unknowns))  # dz from the origin

    def add(self, commands: Floats, state: State) -> Floats:
        """Go on to a state; its distance dz (n_unknowns,) from the first one."""
        step = difference(self._layout, state, self._origin)
        self._commands = np.vstack([self._commands[1 - MOST :], commands])
        self._steps = np.vstack([self._steps[1 - MOST :], step])
        return step

    def beyond(self, commands: Floats, by_command: Floats) -> State:
        """The state predicted at other commands, with dz/dcommand (n_unknowns, n_actuators) of a tangent nearby."""
        away = self._commands - commands
        weights = _weights(away * np.linalg.norm(by_command, axis=0))
        return moved(self._layout, self._origin, weights @ self._steps - by_command @ (weights @ away))


def _weights(away: Floats) -> Floats:
    """Weights (k,) of values at points (k, m) for the value at the origin of a polynomial through them."""
    away = away[:, away.any(axis=0)]
    away = away / np.abs(away).max(initial=1e-300)
    moments = [
        PRIORITY ** (DEGREE - d) * away[:, each].prod(axis=2) for d, each in enumerate(_monomials(away.shape[1]))
    ]
    first = np.zeros(sum(block.shape[1] for block in moments))
    first[0] = PRIORITY**DEGREE
    weights = np.linalg.lstsq(np.hstack(moments).T, first, rcond=None)[0]
    return weights / weights.sum()


@cache
def _monomials(m: int) -> tuple[Ints, ...]:
    """By degree d, the factors (n_monomials, d) of all monomials of m variables."""
    each = (list(combinations_with_replacement(range(m), d)) for d in range(DEGREE + 1))
    return tuple(np.array(factors, dtype=np.int64).reshape(len(factors), d) for d, factors in enumerate(each))
