"""An engine's state of a robot, as the robot's sensors see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.export.engine import EngineState
from softcal.plugins.calculix.load_path import positions
from softcal.twin.build import twin_of
from softcal.twin.robot import Robot


@dataclass(frozen=True)
class EnginePosture:
    """An engine's state, for sensors to read.

    robot: the engine's robot; own: softcal's state, with the cables' commands.
    """

    robot: Robot
    state: EngineState
    own: EngineState

    def point(self, name: str) -> Floats:
        """Position (3,) [m] of a marker, or of a plate's reference."""
        twin = twin_of(self.robot)
        if name in twin.frame:
            return self._pose(name)[0]
        place = twin.markers[name]
        return place.position(positions(twin, self.state), self.rotation(place.marker.on) if place.turns else np.eye(3))

    def rotation(self, plate: str) -> Floats:
        """Rotation (3, 3) of a plate."""
        return self._pose(plate)[1]

    def shortening(self, cable: str) -> float:
        """Shortening [m] of a cable."""
        return self.state.shortenings.get(cable, self.own.shortenings[cable])

    def tension(self, cable: str) -> float:
        """Tension [N] of a cable."""
        return self.state.tensions.get(cable, self.own.tensions[cable])

    def _pose(self, plate: str) -> tuple[Floats, Floats]:
        (found,) = (one for one in self.robot.plates if one.name == plate)
        if plate not in self.state.plates and not found.fixed:
            raise SimulationError(f"The engine gives no pose of {plate}, which a sensor reads.")
        return self.state.plates.get(plate, (found.reference, np.eye(3)))
