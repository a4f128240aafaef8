"""The last equilibria of a robot that is moved in small steps, and the next one as a polynomial of the commands.

    z(c) = sum of w_i (z_i + (dz/dcommand) (c - c_i)),    sum of w_i m(c_i - c) = m(0) for every monomial m

Where the equilibria do not suffice for all monomials, those of low degree come first; then the tangent's dz/dcommand
leaves errors of second order. Where they are more than enough, the weights w_i are the smallest, against rounding.
The same weights predict dz/dcommand, from the states where it was computed.
"""

from __future__ import annotations

from functools import cache
from itertools import combinations_with_replacement

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.layout import Layout
from softcal.mechanics.state import State, difference, moved
from softcal.mechanics.term import Controls

MOST = 8  # equilibria
DEGREE = 4  # of the polynomial
SAME = 1e-9  # of the largest command: closer commands count as equal
PRIORITY = 100.0  # weight of a degree over that of the next one


class Trail:
    """Equilibria under controls with the same actuators driven."""

    def __init__(self, layout: Layout, controls: Controls, state: State) -> None:
        self._layout, self._is_held, self._origin = layout, controls.is_held, state
        self._commands = prescribed(controls)[None]
        self._steps = np.zeros((1, layout.n_unknowns))  # dz from the origin
        self._rates: list[Floats | None] = [None]

    def leads_to(self, controls: Controls) -> bool:
        """Whether these drive the same actuators."""
        return bool(np.all(self._is_held == controls.is_held))

    def add(self, controls: Controls, state: State) -> Floats:
        """Go on to a state, in place of the last one where it has the same commands; its dz (n_unknowns,) from the
        first one.
        """
        commands, step = prescribed(controls), difference(self._layout, state, self._origin)
        change = np.abs(commands - self._commands[-1]).max(initial=0.0)
        is_same = change <= SAME * np.abs(commands).max(initial=0.0)
        kept = slice(None, -1) if is_same else slice(1 - MOST, None)
        self._commands = np.vstack([self._commands[kept], commands])
        self._steps = np.vstack([self._steps[kept], step])
        self._rates = [*self._rates[kept], None]
        return step

    def add_rates(self, rates: Floats) -> None:
        """Add dz/dcommand (n_unknowns, k) at the last state."""
        self._rates[-1] = rates

    def beyond(self, controls: Controls, by_command: Floats) -> tuple[State, Floats | None]:
        """The state predicted at other commands, and dz/dcommand (n_unknowns, k) there; None where no state has it.

        by_command: dz/dcommand (n_unknowns, n_actuators) of a tangent nearby.
        """
        away = self._commands - prescribed(controls)
        far = away * np.linalg.norm(by_command, axis=0)
        weights = own = _weights(far)
        state = moved(self._layout, self._origin, weights @ self._steps - by_command @ (weights @ away))
        known = [k for k, rates in enumerate(self._rates) if rates is not None]
        if 0 < len(known) < len(weights):
            own = _weights(far[known])
        rates = [w * self._rates[k] for w, k in zip(own.tolist(), known, strict=False)]
        return state, np.sum(rates, axis=0) if rates else None


def _weights(far: Floats) -> Floats:
    """Weights (k,) of values at points (k, m) for the value at the origin of a polynomial through them."""
    far = far[:, far.any(axis=0)]
    far = far / np.abs(far).max(initial=1e-300)
    moments = [PRIORITY ** (DEGREE - d) * far[:, each].prod(axis=2) for d, each in enumerate(_monomials(far.shape[1]))]
    first = np.zeros(sum(block.shape[1] for block in moments))
    first[0] = PRIORITY**DEGREE
    weights = np.linalg.lstsq(np.hstack(moments).T, first, rcond=None)[0]
    return weights / weights.sum()


def prescribed(controls: Controls) -> Floats:
    """The prescribed values (n_actuators,), of each actuator its effort or its coordinate."""
    return np.where(controls.is_held, controls.effort, controls.coordinate)


@cache
def _monomials(m: int) -> tuple[Ints, ...]:
    """By degree d, the factors (n_monomials, d) of all monomials of m variables."""
    each = (list(combinations_with_replacement(range(m), d)) for d in range(DEGREE + 1))
    return tuple(np.array(factors, dtype=np.int64).reshape(len(factors), d) for d, factors in enumerate(each))
