"""The coil of a helical spring, whether its wire is a rod or solid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from softcal.declare import Declared, require_one
from softcal.errors import Fault
from softcal.geometry.centreline import Centreline, helix
from softcal.quantities import Size, Turns


@dataclass(frozen=True, kw_only=True)
class Coil(Declared):
    """The winding of a helical spring's wire.

    Attributes
    ----------
    coil_diameter : From wire centre to wire centre [m]
    turns : Number of turns [-], not necessarily whole
    pitch, height : Rise per turn, and in all [m]; one of the two
    left_handed : Whether the wire rises clockwise, viewed against the axis
    """

    coil_diameter: Size
    turns: Turns
    pitch: Size | None = None
    height: Size | None = None
    left_handed: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        allowed = "one of pitch, per turn, and height, in all"
        require_one(self, ("pitch", "height"), "the height of the spring is not specified", allowed=allowed)

    @property
    def rise(self) -> float:
        """Rise per turn [m]."""
        return self.pitch if self.pitch is not None else (self.height or 0.0) / self.turns

    @property
    def coil_distance(self) -> float:
        """Distance between adjacent turns of the wire's axis, normal to it [m]."""
        return self.rise / math.hypot(1.0, self.rise / (math.pi * self.coil_diameter))

    @property
    def wire_length(self) -> float:
        """Arc length of the wire's axis [m]."""
        return self.turns * math.hypot(math.pi * self.coil_diameter, self.rise)

    def wire(
        self,
        at: int | ArrayLike,
        *,
        base: Sequence[float] = (0.0, 0.0, 0.0),
        axis: Sequence[float] = (0.0, 0.0, 1.0),
        towards: Sequence[float] | None = (1.0, 0.0, 0.0),
    ) -> Centreline:
        """Centreline of the wire; see `softcal.geometry.centreline.helix`.

        Parameters
        ----------
        at
            Number of elements, or arc lengths (n,) [m] of the nodes.
        base
            Start of the helix's axis (3,) [m].
        axis
            Direction of the axis (3,).
        towards
            Direction (3,) from the axis to the wire's start; chosen by default.
        """
        return helix(
            base,
            axis,
            diameter=self.coil_diameter,
            pitch=self.rise,
            turns=self.turns,
            at=at,
            towards=towards,
            left_handed=self.left_handed,
        )

    def wire_faults(self, wire_diameter: float) -> list[Fault]:
        """The faults of a wire [m] that is too thick for the coil."""
        wire = f"{1e3 * wire_diameter:.4g} mm"
        if wire_diameter >= self.coil_diameter:
            allowed = f"below the coil's diameter of {1e3 * self.coil_diameter:.4g} mm"
            return [Fault("the wire fills the coil", "", f"a wire of {wire}", allowed)]
        apart = self.coil_distance
        if self.turns <= 1.0 or apart >= wire_diameter:
            return []
        got = f"{1e3 * apart:.4g} mm from wire to wire, {1e3 * (wire_diameter - apart):.3g} mm deep"
        attempt = "a larger pitch, fewer turns or a thinner wire"
        return [Fault("the coils of the spring overlap at rest", "", got, f"at least the wire's {wire}", attempt)]
