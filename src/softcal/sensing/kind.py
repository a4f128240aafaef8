"""The kind of a channel, such as tension or pitch, of any part of a robot."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Literal

from softcal.display import displayed
from softcal.quantities import Quantity


@displayed
@dataclass(frozen=True)
class ChannelKind:
    """The quantity that a channel measures.

    Attributes
    ----------
    name
        Last part of the channels' names, such as `tension` of `front.tension`.
    unit
        SI unit; "" of a kind that is not known.
    label
        In charts, such as "Cable force"; by default the name.
    axis
        Coordinate of a position: 0, 1 or 2 for x, y or z; None of all else.
    drives
        "coordinate" or "effort" of an actuator that can be driven by it; "" of all else.
    compared
        Place among the channels with short names that are compared unless a project names others; 0: not among them.
    offset
        Last part of the name of the rig's parameter that is added to what the twin reads, and its kind of quantity;
        None where there is none.
    gain
        As offset, of the parameter by which what the twin reads is multiplied.
    drift
        As offset, of the parameter by which the reading has changed at the end of a record, in proportion to time.
    slope
        Of an effort: the plausible range [SI] of its slope over the coordinate; None where there is none.
    most, mistake
        Largest plausible magnitude [unit], and what a larger one suggests, such as "mm read as m".
    paper_weight
        Weight [1/unit] in the cost of paper A; None where that has none.
    noise
        Standard deviation [unit] of a common instrument, for tests that were not made yet; None where there is none.
    """

    name: str
    unit: str
    label: str = ""
    axis: int | None = None
    drives: Literal["", "coordinate", "effort"] = ""
    compared: int = 0
    offset: tuple[str, Quantity] | None = None
    gain: tuple[str, Quantity] | None = None
    drift: tuple[str, Quantity] | None = None
    slope: tuple[float, float] | None = None
    most: float = inf
    mistake: str = "the wrong unit"
    paper_weight: float | None = None
    noise: float | None = None

    @property
    def is_position(self) -> bool:
        """True for a coordinate."""
        return self.axis is not None

    @property
    def is_angle(self) -> bool:
        """True for an angle that is read of a rotation, whose values jump by a turn where it passes half of one."""
        return self.unit == "rad" and not self.drives

    @property
    def is_force(self) -> bool:
        """True if proportional to moduli, as forces are; positions and angles are not."""
        return self.unit in ("N", "N*m", "Pa")
