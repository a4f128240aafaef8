"""Fields that are arrays: of quantities, and of numbers of nodes. A project file or Python gives lists or arrays, which
are kept as read-only arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from softcal.checks import Floats, Ints, frozen_floats, frozen_ints
from softcal.declare import Check, Reading, as_annotated
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
        plain = value if isinstance(value, list | tuple) else frozen_floats(value, name=where)
        return frozen_floats(as_annotated(plain, self.of, where), name=where)

    def __get_pydantic_core_schema__(self, source: object, handler: Any) -> CoreSchema:
        def kept(value: Any) -> Floats:
            return frozen_floats(value, name="")

        return Reading(kept, "after").__get_pydantic_core_schema__(self.of, handler.generate_schema)


def _unit(value: Floats, where: str) -> Floats:
    return frozen_floats(value / float(np.linalg.norm(value)), name=where)


@dataclass(frozen=True)
class Array:
    """Annotates an array of numbers by its shape, None for any length: `Annotated[Floats, Array((None, 3))]`.

    missing: whether NaN is allowed for missing values.
    """

    shape: tuple[int | None, ...]
    missing: bool = False

    def checked(self, value: Any, *, where: str = "") -> Floats:
        """The array.

        Raises
        ------
        InputError
            See `softcal.checks.frozen_floats`.
        """
        return frozen_floats(value, name=where, shape=self.shape, missing=self.missing)


def _numbers(*shape: None) -> Check:
    """For numbers that count from zero, in an array of such a shape, or none."""

    def checked(value: Any, where: str) -> Ints:
        numbers = frozen_ints(value, name=where, below=np.inf)
        return frozen_ints(numbers, name=where, shape=shape) if numbers.size else numbers

    return Check(checked)


Position = Annotated[Floats, ArrayOf(Point)]
UnitVector = Annotated[Floats, ArrayOf(Direction), Check(_unit)]
ForceVector = Annotated[Floats, ArrayOf(tuple[Force, Force, Force])]
MomentVector = Annotated[Floats, ArrayOf(tuple[Moment, Moment, Moment])]
Traction = Annotated[Floats, ArrayOf(tuple[Pressure, Pressure, Pressure])]
Gravity = Annotated[Floats, ArrayOf(tuple[Acceleration, Acceleration, Acceleration])]
# Values (n,), and such with NaN for missing ones.
Series = Annotated[Floats, Array((None,))]
Measured = Annotated[Floats, Array((None,), missing=True)]
# Numbers of the nodes of some triangles (k, 3 or 6), and of some nodes or tets (n,).
Triangles = Annotated[Ints, _numbers(None, None)]
Numbers = Annotated[Ints, _numbers(None)]
