"""Cables driven in length together whose lengths depend on each other (redundant constraints)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.checks import Floats, Ints

# Sine, squared, of the angle between a cable's gradient and those of the others below which it lies in their span.
_IN_SPAN = 1e-12
_TAKES_PART = 1e-3

DEPENDENT = "depend on each other here"


def redundant(gradients: Floats) -> Ints:
    """Which columns take part in a combination that is zero; none where all are independent.

    gradients: of each cable's length by the unknowns, (n_unknowns, n_cables).
    """
    # From the few products alone: this is computed at every Newton step.
    products = gradients.T @ gradients
    sizes = np.sqrt(products.diagonal())
    sizes[sizes == 0.0] = 1.0
    values, combinations = np.linalg.eigh(products / sizes / sizes[:, None])
    none = np.abs(combinations[:, values < _IN_SPAN])
    return np.flatnonzero(none.max(axis=1, initial=0.0) > _TAKES_PART)


def redundant_sentence(names: Sequence[str]) -> str:
    """Sentence on why there is no such state, and on how to avoid it."""
    if len(names) == 1:
        return f"Nothing that can move changes the length of cable {names[0]}: it cannot be driven in length."
    together = f"{', '.join(names[:-1])} and {names[-1]}"
    return (
        f"The lengths of cables {together} {DEPENDENT}: they cannot all be given, and their tensions "
        "cannot be told apart. Drive one of them by its tension, or leave it slack."
    )
