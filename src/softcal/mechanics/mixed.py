"""Derivatives of the sensitivities along a path, needed for a cubic interpolation between two nodes.

K z_theta = -r_theta holds all along the path z(c); differentiated by c,

    K z_theta_c = -d/dc r_theta - (dK/dc) z_theta,

and the right-hand side, at fixed z_theta, is a central difference of two nearby assemblies: no factorisation.
"""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.state import State, moved
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls

STEP = 1e-5  # of the robot's extent, or radians: the step to either side


def mixed_derivatives(
    statics: Statics, controls: Controls, state: State, slope: Floats, by_parameter: Floats, names: tuple[str, ...]
) -> Floats:
    """d2z / dc dtheta (n_unknowns, k) at a node, by the tangent factorised last.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    controls
        The controls.
    state
        The equilibrium.
    slope
        dz/dc there (n_unknowns,).
    by_parameter
        dz/dtheta there (n_unknowns, k).
    names
        Parameters (k,) by dotted name.
    """
    if not names:
        return np.zeros_like(by_parameter)
    h, *beside = neighbours_along(statics, state, slope)

    def gradient_rate(state: State) -> Floats:
        at = statics.system.linearise(state, controls, statics.theta)
        given = statics.system.given(state, at.controls, statics.theta, at.known)
        fixed = statics.system.gradient_by_parameters(given, names)
        return fixed + statics.system.tangent_times(at, by_parameter)

    before, after = (gradient_rate(state) for state in beside)
    return -statics.solve((after - before) / (2.0 * h))


def neighbours_along(statics: Statics, state: State, slope: Floats) -> tuple[float, State, State]:
    """A small step h of c, and the states at -h and h along a path.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    state
        The state at h = 0.
    slope
        dz/dc there (n_unknowns,).
    """
    layout = statics.system.layout
    h = STEP * statics.length / max(statics.reach(slope), 1.0)
    return h, moved(layout, state, -h * slope), moved(layout, state, h * slope)
