"""The shapes in which a robot settled, experiment by experiment. Frozen; lengths in m."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from softcal.checks import Ints
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot


@dataclass(frozen=True)
class EquilibriumShapes:
    """The calibrated twin undeformed, and at the last state of experiments in which positions were compared.

    shapes: by experiment. tets: body -> connectivity of `Snapshot.points`.
    """

    robot: Robot
    undeformed: Snapshot
    shapes: Mapping[str, Snapshot]
    tets: Mapping[str, Ints]

    def __post_init__(self) -> None:
        object.__setattr__(self, "shapes", dict(self.shapes))
        object.__setattr__(self, "tets", dict(self.tets))
