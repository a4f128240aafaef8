"""Derivatives of the sensitivities along a path, needed for a cubic interpolation between two nodes.

K z_theta = -r_theta holds all along the path z(c); differentiated by c,

    K z_theta_c = -d/dc r_theta - (dK/dc) z_theta,

and the right-hand side, at fixed z_theta, is a central difference of two nearby assemblies: no factorisation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.state import State, moved
from softcal.mechanics.system import System
from softcal.mechanics.term import Controls

STEP = 1e-5  # of the robot's extent, or radians: the step to either side


class Solved(Protocol):
    """A system at parameters theta whose tangent is factorised."""

    @property
    def system(self) -> System: ...
    @property
    def theta(self) -> Mapping[str, float]: ...
    @property
    def length(self) -> float: ...
    def solve(self, b: Floats) -> Floats: ...


def mixed_derivatives(
    statics: Solved, controls: Controls, state: State, slope: Floats, by_parameter: Floats, names: tuple[str, ...]
) -> Floats:
    """d2z / dc dtheta (n_unknowns, k) at a node with dz/dc and dz/dtheta, by the tangent factorised last."""
    if not names:
        return np.zeros_like(by_parameter)
    h, *beside = neighbours_along(statics, state, slope)

    def gradient_rate(state: State) -> Floats:
        at = statics.system.linearise(state, controls, statics.theta)
        fixed = statics.system.gradient_by_parameters(state, at, statics.theta, names)
        return fixed + statics.system.tangent_times(at, by_parameter)

    before, after = (gradient_rate(state) for state in beside)
    return -statics.solve((after - before) / (2.0 * h))


def neighbours_along(statics: Solved, state: State, slope: Floats) -> tuple[float, State, State]:
    """A small step h of c, and the states at -h and h along a path with this slope."""
    layout = statics.system.layout
    frames = slope[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)
    moves = max(
        float(np.abs(slope[: layout.first_frame_unknown]).max(initial=0.0)),
        float(np.abs(frames[:, :3]).max(initial=0.0)),
        statics.length * float(np.abs(frames[:, 3:]).max(initial=0.0)),
    )
    h = STEP * statics.length / max(moves, 1.0)
    return h, moved(layout, state, -h * slope), moved(layout, state, h * slope)
