"""Reference values and configurations that a result is compared with. Frozen; SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.analysis.nominal import Nominal
from softcal.checks import Floats
from softcal.report.twin_view import TwinView


@dataclass(frozen=True)
class Configuration:
    """One configuration of the twin: name, parameters [SI] by label, shape, and measured positions.

    measured: marker or plate -> measured position (3,) [m] in the robot's frame, in the state of `twin.bent`.
    """

    name: str
    parameters: Mapping[str, float]
    twin: TwinView
    measured: Mapping[str, Floats]

    @property
    def simulated(self) -> dict[str, Floats]:
        """Simulated position of each measured marker or plate (3,) [m]."""
        shape = self.twin.bent
        there = {**{name: at for name, (at, _) in shape.plates.items()}, **shape.markers}
        return {name: there[name] for name in self.measured if name in there}

    @property
    def distance(self) -> float:
        """Root mean square distance of all markers and plates from their measured positions [m]."""
        squares = [float(np.sum((at - self.measured[name]) ** 2)) for name, at in self.simulated.items()]
        return float(np.sqrt(np.mean(squares)))


@dataclass(frozen=True)
class Compared:
    """Reference values and configurations; None or empty if unavailable.

    Attributes
    ----------
    nominal
        Errors at the nominal values, or None.
    configurations
        Configurations in one state, that of the strongest pull, drawn side by side.
    units
        Units of their parameters.
    length
        Reference length [m] of distances in per cent, or None.
    state
        Loads and pulls of that state, in words.
    """

    nominal: Nominal | None
    configurations: tuple[Configuration, ...]
    units: Mapping[str, str]
    length: float | None = None
    state: str = ""
