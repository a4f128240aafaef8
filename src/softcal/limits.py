"""Limits of all counted inputs in one table, so that a typing error cannot exhaust time or memory; and rules for names
of experiments, of parts, and of all else that names a file, a column or a parameter.

Each limit is far above useful values, and below values that take hours or exceed the memory.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sized
from dataclasses import dataclass
from numbers import Integral
from typing import TYPE_CHECKING, Any

from softcal.declare import Check, Reading, shown
from softcal.display import displayed
from softcal.errors import Fault, InputError, ParameterError

if TYPE_CHECKING:
    from pydantic_core import CoreSchema


@displayed
@dataclass(frozen=True)
class Limit:
    """Allowed range of a count: least to most of `of`; attempt: suggestion if there are more; is_count: false of a
    number that counts nothing.

    It annotates counts that a project file can give: `Annotated[int, LIMITS["tets"]]`.
    """

    of: str
    most: int
    least: int = 1
    attempt: str = ""
    is_count: bool = True

    @property
    def allowed(self) -> str:
        """The range in words."""
        return f"{self.least} to {self.most}" + f" {self.of}" * self.is_count

    def fault(self, count: float, where: str = "") -> Fault | None:
        """The fault of a count, or None."""
        if self.least <= count <= self.most:
            return None
        few = count < self.least
        got = f"{int(count)}" if abs(count) < 1e15 else "a number of more than 15 digits"
        what = f"there are too {'few' if few else 'many'} {self.of}" if self.is_count else "this number is out of range"
        return Fault(what, where, got, self.allowed, "" if few else self.attempt)

    def check(self, count: float, *, where: str = "") -> None:
        """Raise if there are too many or too few.

        Raises
        ------
        InputError
            With the count and the limit.
        """
        if fault := self.fault(count, where):
            raise InputError(fault)

    def checked(self, value: Any, *, where: str = "") -> int:
        """A count within the range.

        Raises
        ------
        InputError
            Where it is no whole number, or there are too many or too few.
        """
        if isinstance(value, bool) or not isinstance(value, Integral):
            raise InputError(Fault("this is of the wrong kind", where, shown(value), "a whole number"))
        self.check(int(value), where=where)
        return int(value)

    def read(self, value: object, *, where: str = "") -> int:
        """As `checked`: a count has no unit."""
        return self.checked(value, where=where)

    @property
    def entries(self) -> Check:
        """For lists and mappings with so many entries, or none: `Annotated[list[str], LIMITS["markers"].entries]`."""

        def counted(value: Sized, where: str) -> Sized:
            if value:
                self.check(len(value), where=where)
            return value

        return Check(counted)

    def __get_pydantic_core_schema__(self, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        return Reading(self.checked).__get_pydantic_core_schema__(source, handler)


LIMITS: Mapping[str, Limit] = {
    limit.of: limit
    for limit in (
        # Files
        Limit("bytes of a YAML file", 1_000_000, 0, "only what it may hold; data belong into CSV files"),
        Limit("values in a YAML file", 20_000, 0, "fewer nested anchors"),
        Limit("levels of a YAML file", 30, 0),
        Limit("bytes of a mesh file", 300_000_000, 0, "a coarser mesh"),
        Limit("characters in a name", 60, 1, "a shorter name"),
        # The robot
        Limit("parts of a robot", 1000),
        Limit("points of a line", 2000, 2),
        Limit("holes on a ring", 200),
        Limit("pulleys", 100),
        Limit("sections of a manipulator", 100),
        Limit("cables at an end", 100),
        Limit("elements of a rod", 5000, 1, "fewer elements: 100 are plenty for most rods"),
        Limit("elements in a turn", 1000, 4),
        Limit("layers in a turn", 1000, 6),  # with fewer, the curved tets of a tight coil are inverted
        Limit("layers of elements", 10_000),
        Limit("rings of elements", 20),
        Limit("bells", 50),
        Limit("sectors", 360, 4),
        Limit("edges around a bore", 100, 3),
        Limit("tets", 1_000_000, 1, "check the unit of the model and of the size, or a larger size"),
        # The bench
        Limit("specimens", 10_000),
        Limit("columns of a fleet", 1000),
        Limit("experiments", 1000, 0),
        Limit("files of an experiment", 1000),
        Limit("rows to skip", 1_000_000, 0),
        Limit("lines before the data", 10_000),
        Limit("samples", 1_000_000),
        Limit("repeats", 100),
        Limit("cycles", 100_000, 0),
        Limit("markers", 1000),
        # Searches
        Limit("trials", 100_000),
        Limit("starts", 1000),
        Limit("seeds", 2**32 - 1, 0, is_count=False),
        Limit("workers", 256, 1, "as many as there are cores"),
        Limit("values on an axis", 10_000, 1),
        Limit("factorisations", 10_000_000),
        Limit("cells of a grid", 100_000, 1, "fewer values on each axis"),
        Limit("shapes of a film", 2000, 2),
        # Motion in time, and other engines
        Limit("time steps", 10_000_000, 1, "a longer time step, or a shorter time"),
        Limit("time steps to try", 20),
        Limit("modes", 200),
        Limit("states", 10_000, 2),
        Limit("nodes along each cable", 200, 2),
    )
}


def require_at_least(**counts: tuple[int, int]) -> None:
    """Raise for options below their least; counts: option = (value, least).

    Raises
    ------
    ParameterError
        With every option that is too small.
    """
    faults = [
        Fault("there are too few", name, got=str(value), allowed=f"{least} or more")
        for name, (value, least) in counts.items()
        if value < least
    ]
    if faults:
        raise ParameterError(faults)


# The label of the joint calibration, beside the labels of single experiments.
JOINT = "joint"
# Names that a file system, a run folder or the rig's own parameters take.
_DEVICES = ("con", "prn", "aux", "nul", *(f"{port}{k}" for port in ("com", "lpt") for k in range(1, 10)))
RESERVED_OF_TESTS = frozenset((JOINT, *_DEVICES))
RESERVED_OF_PARTS = frozenset(("frame", "gravity", "pulleys", "rig", *_DEVICES))
_NAME = re.compile(r"\w([\w .+()-]*[\w+()-])?")
ALLOWED = "letters, digits, and _ - + . ( ) or blanks between them"


def name_fault(name: str, reserved: Iterable[str] = ()) -> Fault | None:
    """Fault of a name that is to name a file or to be typed on the command line; None if it is allowed."""
    if fault := LIMITS["characters in a name"].fault(len(name)):
        return fault
    if _NAME.fullmatch(name) is None or not name.isprintable():
        return Fault("this cannot be a name", got=repr(name), allowed=ALLOWED)
    if folded(name) in reserved:
        return Fault("the name is reserved by softcal", got=repr(name), attempt=f"{name}_1")
    return None


def part_name_fault(name: str) -> Fault | None:
    """Fault of a name of a robot's part, after which parameters and channels are named; None if it is allowed."""
    if not name.isidentifier():
        return Fault("this cannot be a name", got=shown(name), allowed="letters, digits and _, no digit first")
    return name_fault(name, RESERVED_OF_PARTS)


def folded(name: str) -> str:
    """The name as stored by a file system that ignores case."""
    return unicodedata.normalize("NFC", name).casefold()
