"""The compliance of an equilibrium in a direction of its unknowns, and its derivative along a load path.

The robot yields by w = K^-1 g to a unit load g: a force on a point, a moment on a plate, or a unit of an actuator's
coordinate, all other commands staying. The work of the load over that motion is the compliance c = g^T K^-1 g. Along a
path with the rates dz of the unknowns

    dc = 2 dg^T w - w^T dK w,

the change of 2 g^T w - w^T K w with w as it is. Assembled at two states beside the equilibrium, without another
factorisation, the difference is off by the square of their distance (`small_motions.BESIDE`), and by rounding over
that: some 1e-9 of dc.
K is symmetric for this: without friction or dead moments.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.small_motions import rates_along, require_linear
from softcal.mechanics.state import State
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls


def compliances(
    statics: Statics, state: State, controls: Controls, loads: Callable[[State], Floats], ways: Floats
) -> tuple[Floats, Floats]:
    """The compliances (n,) of unit loads at an equilibrium, and their derivatives (n, k) along k ways.

    Parameters
    ----------
    statics
        The system at its parameters.
    state, controls
        The equilibrium.
    loads
        The loads on the unknowns (n_unknowns, n) at a state, which turn as it does.
    ways
        Rates of the unknowns (n_unknowns, k) along paths of equilibria.

    Raises
    ------
    SimulationError
        Where there is no linear form, as with friction, or the tangent is singular.
    """
    system = statics.system
    at = system.linearise(state, controls, statics.theta)
    require_linear(statics, at, state)
    statics.factorise(at)
    g = loads(state)
    w = statics.solve(g)
    w[system.layout.first_effort_unknown :][controls.is_held] = 0.0

    def energy(there: State) -> Floats:
        """2 g^T w - w^T K w (n,) at a state."""
        own = replace(controls, effort=np.where(controls.is_held, there.effort, controls.effort))
        stiff = system.tangent_times(system.linearise(there, own, statics.theta), w)
        return np.einsum("nk,nk->k", 2.0 * loads(there) - stiff, w)

    rates = [rates_along(energy, statics, state, way) for way in ways.T]
    return np.einsum("nk,nk->k", g, w), np.reshape(rates, (-1, g.shape[1])).T
