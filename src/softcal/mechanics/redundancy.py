"""Actuators driven together to coordinates that depend on each other (redundant constraints)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.actuator import Actuator

# Sine, squared, of the angle between a coordinate's gradient and those of the others below which it is in their span.
_IN_SPAN = 1e-12
_TAKES_PART = 1e-3

DEPENDENT = "depend on each other here"


def redundant(gradients: Floats) -> Ints:
    """Which columns take part in a combination that is zero; none where all are independent.

    gradients: of each coordinate by the unknowns, (n_unknowns, n_driven).
    """
    # From the few products alone: this is computed at every Newton step.
    products = gradients.T @ gradients
    sizes = np.sqrt(products.diagonal())
    sizes[sizes == 0.0] = 1.0
    values, combinations = np.linalg.eigh(products / sizes / sizes[:, None])
    none = np.abs(combinations[:, values < _IN_SPAN])
    return np.flatnonzero(none.max(axis=1, initial=0.0) > _TAKES_PART)


def redundant_sentence(actuators: Sequence[Actuator]) -> str:
    """Sentence on why there is no such state, and on how to avoid it."""
    names = [actuator.name for actuator in actuators]
    if len(actuators) == 1:
        return f"Nothing that can move changes the {actuators[0].coordinate} of {names[0]}: it cannot be prescribed."
    coordinates = " and ".join(dict.fromkeys(f"{one.coordinate}s" for one in actuators))
    efforts = " and ".join(dict.fromkeys(f"{one.effort}s" for one in actuators))
    return (
        f"The {coordinates} of {', '.join(names[:-1])} and {names[-1]} {DEPENDENT}: they cannot all be prescribed, and "
        f"their {efforts} cannot be told apart. Drive one of them by its {actuators[-1].effort}, or not at all."
    )
