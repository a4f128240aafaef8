"""The history of a solid's material at its quadrature points: its memory, and rates through it.

The law's distortional stress is changed by the parts of the history; the volumetric part, which carries the pressure of
a mixed element, stays elastic. The memory of a term is that of its points, one after the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats
from softcal.materials.components import PAIRS
from softcal.materials.inelastic import Constants, History, Left, PointRates, Stressed
from softcal.materials.parameter import Parameter
from softcal.materials.stress_at import Deformation


class Passed(NamedTuple):
    """What a material goes through from one sample to the next.

    Attributes
    ----------
    deformation
        The law at the points, at the sample.
    values
        The law's constants, in its order.
    constants
        Those of the history, by name.
    memory
        What the sample before left (n_points * size,).
    elapsed
        Time since then [s]; infinity where it was long.
    """

    deformation: Deformation
    values: tuple[float, ...]
    constants: Constants
    memory: Floats
    elapsed: float


def constants_of(history: History) -> tuple[Parameter, ...]:
    """The constants of all parts."""
    return tuple(one for part in history.parts for one in part.parameters)


def elastic(passed: Passed, *, tangent: bool) -> Stressed:
    """The law alone."""
    F = passed.deformation.at.F
    S, D = passed.deformation.stress(passed.values, tangent=tangent)
    strain = 0.5 * (np.einsum("nki,nkj->nij", F, F) - np.eye(3))
    return Stressed(_doubled(strain), passed.deformation.energy(passed.values), S, D)


def respond(history: History, passed: Passed, *, tangent: bool) -> Left:
    """The material with its history."""
    memory = passed.memory.reshape(-1, history.size)
    return history.respond(elastic(passed, tangent=tangent), memory, passed.elapsed, passed.constants)


def rates(
    history: History,
    passed: Passed,
    dF: Floats | None = None,
    memory: Floats | None = None,
    constant: int | str | None = None,
) -> tuple[Floats, Floats]:
    """The rates of the stress (n, 6), and of the memory left (n_points * size,).

    dF: those of the deformation gradients (n, 3, 3); memory: of the one before; constant: the law's of this number, or
    the history's of this name, whose rate is one.
    """
    at = elastic(passed, tangent=dF is not None)
    by = PointRates(np.zeros_like(at.E), np.zeros_like(at.W), np.zeros_like(at.S))
    if dF is not None:
        half = np.einsum("nki,nkj->nij", passed.deformation.at.F, dF)
        strain = _doubled(0.5 * (half + np.swapaxes(half, 1, 2)))
        by = PointRates(strain, (at.S * strain).sum(axis=1), np.einsum("nab,nb->na", at.D, strain))
    changes: Mapping[str, float] = {}
    if isinstance(constant, int):
        energy = passed.deformation.energy_by_parameters(passed.values)[constant]
        stress = passed.deformation.stress_by_parameters(passed.values)[constant]
        by = PointRates(by.E, by.W + energy, by.S + stress)
    elif constant is not None:
        changes = {constant: 1.0}
    own = passed.memory.reshape(-1, history.size)
    change = np.zeros_like(own) if memory is None else memory.reshape(own.shape)
    at = at._replace(D=np.zeros((0, 6, 6)))
    after, left = history.rates(at, by, (own, change), passed.elapsed, (passed.constants, changes))
    return after.S, left.ravel()


def _doubled(strain: Floats) -> Floats:
    """The components (n, 6) of strains (n, 3, 3), with doubled shears."""
    return np.stack([strain[:, i, j] * (1.0 if i == j else 2.0) for i, j in PAIRS], axis=1)
