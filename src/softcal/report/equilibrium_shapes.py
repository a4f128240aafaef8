"""Equilibrium shapes of the calibrated twin by experiment. Frozen; lengths in m."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from softcal.checks import Ints
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot


@dataclass(frozen=True)
class EquilibriumShapes:
    """The calibrated twin undeformed, and in the last state of experiments with positions.

    Attributes
    ----------
    robot
        The robot at the calibrated values.
    undeformed
        Its shape without loads.
    shapes
        Experiment -> equilibrium shape of its last state.
    tets
        Body -> connectivity of `Snapshot.points` (n_tets, 4 or 10).
    """

    robot: Robot
    undeformed: Snapshot
    shapes: Mapping[str, Snapshot]
    tets: Mapping[str, Ints]

    def __post_init__(self) -> None:
        object.__setattr__(self, "shapes", dict(self.shapes))
        object.__setattr__(self, "tets", dict(self.tets))
