"""Fields that are arrays: of quantities, and of numbers of nodes. A project file or Python gives lists or arrays, which
are kept as read-only arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from softcal.checks import Floats, Ints, frozen_floats, frozen_ints
from softcal.declare import Check, Reading, as_annotated, shown
from softcal.errors import Fault, InputError
from softcal.quantities import Acceleration, Direction, Force, Moment, Point, Pressure

if TYPE_CHECKING:
    from pydantic_core import CoreSchema


@dataclass(frozen=True)
class ArrayOf:
    """Annotates an array by the kind of its entries: `Annotated[Floats, ArrayOf(Point)]`."""

    of: Any

    def checked(self, value: Any, *, where: str = "") -> Floats:
        """The array.

        Raises
        ------
        InputError
            Where it is of another shape, or an entry of another kind or out of range.
        """
        return frozen_floats(as_annotated(value, self.of, where), name=where)

    def __get_pydantic_core_schema__(self, source: object, handler: Any) -> CoreSchema:
        def kept(value: Any) -> Floats:
            return frozen_floats(value, name="")

        return Reading(kept, "after").__get_pydantic_core_schema__(self.of, handler.generate_schema)


def _unit(value: Floats, where: str) -> Floats:
    return frozen_floats(value / float(np.linalg.norm(value)), name=where)


def _numbers(axes: int) -> Check:
    """For numbers that count from zero, in an array of so many axes."""

    def checked(value: Any, where: str) -> Ints:
        try:
            given = np.asarray(value)
        except ValueError:  # rows of different lengths
            given = np.asarray("")
        if given.size and (given.dtype.kind not in "iu" or given.min() < 0 or given.ndim != axes):
            allowed = "whole numbers from 0 on, " + ("in rows" if axes == 2 else "in one list")
            attempt = "numpy.flatnonzero of the mask" if given.dtype.kind == "b" else ""
            raise InputError(Fault("these are not numbers of nodes or tets", where, shown(value), allowed, attempt))
        return frozen_ints(given, name=where)

    return Check(checked)


Position = Annotated[Floats, ArrayOf(Point)]
UnitVector = Annotated[Floats, ArrayOf(Direction), Check(_unit)]
ForceVector = Annotated[Floats, ArrayOf(tuple[Force, Force, Force])]
MomentVector = Annotated[Floats, ArrayOf(tuple[Moment, Moment, Moment])]
Traction = Annotated[Floats, ArrayOf(tuple[Pressure, Pressure, Pressure])]
Gravity = Annotated[Floats, ArrayOf(tuple[Acceleration, Acceleration, Acceleration])]
# Numbers of the nodes of some triangles (k, 3 or 6), and of some nodes or tets (n,).
Triangles = Annotated[Ints, _numbers(2)]
Numbers = Annotated[Ints, _numbers(1)]
