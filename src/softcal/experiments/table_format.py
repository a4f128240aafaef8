"""Format of a bench table, as far as it is stated and not detected, and the sensor that wrote it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

from softcal.declare import Check, Declared, Reading
from softcal.errors import Fault, InputError, UnitError
from softcal.limits import LIMITS
from softcal.quantities import QUANTITIES
from softcal.units import has_unit

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Line = Annotated[int, LIMITS["lines before the data"]]
Skipped = Annotated[int, LIMITS["rows to skip"]]


def _scale(value: object, where: str = "") -> float | str:
    """The constant of a sensor, a quotient, as it is; any other scale as a number."""
    if isinstance(value, str) and "/" in value and has_unit(value):
        return value
    try:
        return QUANTITIES["scale factor"].read(value, where=where)
    except UnitError as error:
        allowed = "a plain number, %, or the constant of a sensor, such as 4096 counts/turn or 1.2 N*m/A"
        raise UnitError([replace(fault, allowed=allowed) for fault in error.faults]) from error


Scale = Annotated[float | str, Reading(_scale, "instead"), Check(_scale)]


@dataclass(frozen=True)
class ColumnSpec(Declared):
    """Column of a channel in a file.

    Attributes
    ----------
    name : The column's header, with or without its unit
    unit : Unit of the numbers; None: that in the file
    scale : Factor on the numbers, such as -1 for a machine that writes tension negative; or the constant of a sensor
        that writes another quantity, such as 4096 counts/turn, 1.2 N*m/A or 2 mV/N
    """

    name: str
    unit: str | None = None
    scale: Scale = 1.0

    @property
    def factor(self) -> float:
        """The factor on the numbers in the channel's unit; one where a sensor's constant leads to that."""
        return 1.0 if isinstance(self.scale, str) else self.scale


@dataclass(frozen=True, kw_only=True)
class TableFormat(Declared):
    """The format of a table.

    Attributes
    ----------
    delimiter, decimal
        Comma, semicolon, tab or " " (any white space); "." or ",". None detects them from the file.
    header_row, units_row
        1-based line of the column names and of the units below. None detects them from the file.
    skip_rows, skip_footer
        Lines to skip at the top and at the bottom.
    axes, rest_samples
        For quaternions: the robot's x, y, z in sensor axes, and the number of samples at rest at the beginning.
    """

    delimiter: str | None = None
    decimal: Literal[".", ","] | None = None
    header_row: Line | None = None
    units_row: Line | None = None
    skip_rows: Skipped = 0
    skip_footer: Skipped = 0
    axes: tuple[Axis, Axis, Axis] = ("x", "y", "z")
    rest_samples: Annotated[int, LIMITS["samples"]] = 10

    def __post_init__(self) -> None:
        super().__post_init__()
        mark = self.delimiter
        if mark is not None and (
            len(mark) != 1 or mark.isalnum() or mark in "\"'.+-_\r\n" or not (mark.isprintable() or mark == "\t")
        ):
            allowed = 'one character, such as ",", ";" or "\\t"'
            raise InputError(Fault("this character cannot separate columns", "delimiter", repr(mark), allowed))
