"""Actuators driven together to coordinates that depend on each other (redundant constraints)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import SimulationError
from softcal.mechanics.actuator import ActuatorLimits
from softcal.mechanics.system import Border, System

# Sine, squared, of the angle between a coordinate's gradient and those of the others below which it is in their span.
_IN_SPAN = 1e-12
_TAKES_PART = 1e-3
# Of what a coordinate changes by its effort: a share of line and machine that is as small tells no efforts apart.
_RIGID = 1e-9

DEPENDENT = "depend on each other here"


def require_independent(system: System, border: Border, unit: Floats, solved: Floats) -> None:
    """Refuse driven actuators whose efforts only rounding would determine.

    Parameters
    ----------
    system
        The discretised robot.
    border
        The border of the tangent.
    unit
        Units of the unknowns (n_unknowns - n_actuators,).
    solved
        The inverse of the tangent without border times the border's columns (n_unknowns - n_actuators, k).

    Raises
    ------
    SimulationError
        Where some are driven to coordinates that depend on each other.
    """
    # What no motion of the robot changes by itself, as the angle of a pulley, its couplings determine.
    which = [k for k, i in enumerate(border.driven.tolist()) if i not in system.coupled]
    # Of one coordinate alone that is all: this is computed at every Newton step.
    if not which or (len(which) == 1 and np.linalg.norm(border.rows[:, which[0]]) > 0.0):
        return
    rows, own = border.rows[:, which], np.abs(border.corner.diagonal()[which])
    whole = np.abs((rows * solved[:, which]).sum(axis=0)) + own
    elastic = np.divide(own, whole, out=np.zeros(len(which)), where=whole > 0.0)
    together = redundant(unit[:, None] * rows, elastic)
    if len(together):
        raise SimulationError(redundant_sentence([system.actuators[border.driven[which[i]]] for i in together]))


def redundant(gradients: Floats, elastic: Floats) -> Ints:
    """The columns that take part in a combination that is zero; none where all are independent.

    gradients: of each coordinate by the unknowns, (n_unknowns, n_driven). elastic (n_driven,): the share of line and
    machine in what a coordinate changes by its effort, zero without stretch. Elastic lines share a load.
    """
    products = gradients.T @ gradients
    sizes = np.sqrt(products.diagonal())
    sizes[sizes == 0.0] = 1.0
    cosines = products / sizes / sizes[:, None]
    # Gershgorin's bound on the smallest eigenvalue: one coordinate alone, or nearly orthogonal ones, need no more.
    if (2.0 * cosines.diagonal() - np.abs(cosines).sum(axis=0)).min() > _IN_SPAN:
        return np.zeros(0, dtype=np.int64)
    values, combinations = np.linalg.eigh(cosines)
    none = np.abs(combinations[:, (values < _IN_SPAN) & (elastic @ combinations**2 < _RIGID)])
    return np.flatnonzero(none.max(axis=1, initial=0.0) > _TAKES_PART)


def redundant_sentence(actuators: Sequence[ActuatorLimits]) -> str:
    """Sentence on why the coordinates of actuators cannot all be prescribed, and on how to avoid this."""
    names = [actuator.name for actuator in actuators]
    if len(actuators) == 1:
        return f"Nothing that can move changes the {actuators[0].coordinate} of {names[0]}: it cannot be prescribed."
    coordinates = " and ".join(dict.fromkeys(f"{one.coordinate}s" for one in actuators))
    efforts = " and ".join(dict.fromkeys(f"{one.effort}s" for one in actuators))
    return (
        f"The {coordinates} of {', '.join(names[:-1])} and {names[-1]} {DEPENDENT}: they cannot all be prescribed, and "
        f"their {efforts} cannot be told apart. Drive one of them by its {actuators[-1].effort}, or not at all."
    )
