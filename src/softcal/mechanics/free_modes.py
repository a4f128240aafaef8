"""Modes of motion without force at an equilibrium: a buckled round column turns freely about its axis.

The tangent is singular along them up to rounding, whose size and sign are arbitrary. They are found by inverse
iteration, and solutions are constrained to have no part along them.
"""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.statics import FREE, NO_MODES, Statics
from softcal.mechanics.system import Linearisation

INVERSE_ITERATIONS = 3
MOST_MODES = 6


def exclude_free_modes(statics: Statics, at: Linearisation) -> Floats:
    """Find the free modes of an equilibrium, linearised and factorised last, and exclude them from later solutions.

    Returns them as arguments of `Statics.exclude`, (n_unknowns - n_actuators, k).
    """
    if not statics.tangent.is_factorised:
        statics.factorise(at)
    moving = slice(statics.system.layout.first_pressure_unknown)
    force = statics.force_scale(at)
    random = np.random.default_rng(2)
    scaled = np.zeros((len(statics.unit), 0))
    while scaled.shape[1] < MOST_MODES:
        mode, load, motion = np.zeros(len(statics.unit)), np.zeros(0), np.zeros(0)
        mode[moving] = random.standard_normal(len(mode[moving]))
        for _ in range(INVERSE_ITERATIONS):
            mode -= scaled @ (scaled.T @ mode)
            load = np.zeros(statics.system.layout.n_unknowns)
            load[: len(mode)] = mode / (np.linalg.norm(mode) * statics.unit)
            motion = statics.solve(load)  # the displacement by this load
            mode[moving] = (motion[: len(mode)] / statics.unit)[moving]
        if statics.measured(load, force) * statics.length > FREE * statics.reach(motion):
            break
        mode -= scaled @ (scaled.T @ mode)
        scaled = np.column_stack([scaled, mode / np.linalg.norm(mode)])
    if scaled.shape[1] == 0:
        return NO_MODES
    modes = scaled / statics.unit[:, None]
    statics.exclude(modes)
    return modes
