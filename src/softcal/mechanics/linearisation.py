"""The result of an assembly at a state: the gradient, and the tangent with its border."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.term import Controls


@dataclass(frozen=True)
class Border:
    """Columns and rows (n_unknowns - n_actuators, k) around the sparse tangent K, with a corner (k, k):

        [ K     columns ]
        [ rows^T corner ]

    The first ones belong to the efforts of `driven` actuators (corner diagonal without couplings, zero without
    stretch), the others to parts of the tangent that are products of columns and rows, such as friction (corner -1).
    has_moments: whether dead moments are among these.
    """

    driven: Ints
    columns: Floats
    rows: Floats
    corner: Floats
    has_moments: bool = False


NO_BORDER = Border(np.zeros(0, dtype=np.int64), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)))


@dataclass(frozen=True)
class Linearisation:
    """Gradient and tangent at a state.

    Attributes
    ----------
    controls
        The controls.
    known
        Per term, its `Term.kinematics` at the state.
    why_not
        Why the state is inadmissible, in words, and then all below is empty; "" where it is admissible.
    full, reduced
        Gradient on all entities (n_components,), without forces of motion, and on the unknowns (n_unknowns,).
    forces
        Norm of the nodal forces before they cancel [N].
    data
        Upper triangle of the sparse tangent (nnz,), or None where it was not requested.
    border
        Columns and rows added by unknown efforts and by losses.
    touch
        Part of the tangent outside its pattern (sparse, upper triangle), such as contacts, or None.
    near
        The entries of that part where all that is near touches (sparse, upper triangle, of zeros), or None.
    is_convex
        Whether ridges between triangles in contact count as flat in the tangent, which is then not the exact one.
    """

    controls: Controls
    known: tuple[Any, ...]
    why_not: str = ""
    full: Floats = field(default_factory=lambda: np.zeros(0))
    reduced: Floats = field(default_factory=lambda: np.zeros(0))
    forces: float = 0.0
    data: Floats | None = None
    border: Border = NO_BORDER
    touch: Any = None
    near: Callable[[], Any] = lambda: None
    is_convex: bool = False

    @property
    def is_admissible(self) -> bool:
        """Whether the state is admissible: no element is inverted, no rod turns by half a revolution between
        two nodes.
        """
        return not self.why_not
