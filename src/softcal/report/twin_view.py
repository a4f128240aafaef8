"""The calibrated twin at rest and pulled, and its equilibrium shapes by experiment, for drawing. Frozen; SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from softcal.checks import Ints, frozen_ints
from softcal.errors import Fault, InputError
from softcal.mechanics.elements import ELEMENTS
from softcal.twin.loads import walls
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot


@dataclass(frozen=True)
class TwinView:
    """The calibrated twin in two states, drawn side by side.

    Attributes
    ----------
    robot
        The robot at the calibrated values.
    rest, bent
        The two states.
    tets
        Body -> connectivity of `Snapshot.points` (`Response.tets`), of order one or two.
    instabilities
        Sentence on instabilities along the load path (`Response.instabilities`), or "".
    crossings
        Sentence on bodies that penetrate themselves or each other (`Response.crossings`), or "".
    drawn_out
        Sentence on cables with friction that slide against the modelled direction (`Response.drawn_out`), or "".
    remarks
        Sentences on laws beyond their stability (`Response.remarks`), or "".
    """

    robot: Robot
    rest: Snapshot
    bent: Snapshot
    tets: Mapping[str, Ints]
    instabilities: str = ""
    crossings: str = ""
    drawn_out: str = ""
    remarks: str = ""

    @cached_property
    def walls(self) -> dict[str, dict[str, Ints]]:
        """Actuator -> body -> faces (n, 3 or 6) of the shapes that it acts on."""
        of = {body for part in self.robot.actuators for body in part.surfaces}
        return walls(self.robot, {b.name: ELEMENTS[b.element].mesh(b.mesh) for b in self.robot.bodies if b.name in of})

    def __post_init__(self) -> None:
        tets = {body: frozen_ints(cells, name=f"tets of {body}") for body, cells in self.tets.items()}
        object.__setattr__(self, "tets", tets)
        faults = [
            Fault("the snapshot lacks a body", where=f"snapshot '{snapshot.label}'", got=body, allowed=", ".join(tets))
            for snapshot in (self.rest, self.bent)
            for body in tets
            if body not in snapshot.points
        ]
        if faults:
            raise InputError(faults)


@dataclass(frozen=True)
class TwinFrame:
    """The twin along its pull: a page for a frame of the report, how many numbers it shows, and the sentences
    beneath it.
    """

    page: str
    n_measures: int
    caption: str
    kind: ClassVar[str] = "frame"


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
