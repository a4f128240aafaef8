"""What a result is compared with: the nominal values, and configurations of the twin in one state. Frozen; SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.analysis.nominal import Nominal
from softcal.checks import Floats
from softcal.report.twin_view import TwinView


@dataclass(frozen=True)
class Configuration:
    """One configuration of the twin: its name, its parameters [SI] by label, its shape, and what was measured.

    measured: marker or plate -> where it was measured (3,) [m], in the robot's frame, in the state of `twin.bent`.
    """

    name: str
    parameters: Mapping[str, float]
    twin: TwinView
    measured: Mapping[str, Floats]

    @property
    def simulated(self) -> dict[str, Floats]:
        """Where the twin has what was measured (3,) [m]."""
        shape = self.twin.bent
        there = {**{name: at for name, (at, _) in shape.plates.items()}, **shape.markers}
        return {name: there[name] for name in self.measured if name in there}

    @property
    def distance(self) -> float:
        """The root mean square of the distances of all markers and plates from where they were measured [m]."""
        squares = [float(np.sum((at - self.measured[name]) ** 2)) for name, at in self.simulated.items()]
        return float(np.sqrt(np.mean(squares)))


@dataclass(frozen=True)
class Compared:
    """What a result is compared with; None and none where it cannot be.

    configurations: in one state, that of the strongest pull, to be drawn side by side. units: of their parameters.
    length [m]: what distances are told in per cent of, or None. state: what is done to the robot in it.
    """

    nominal: Nominal | None
    configurations: tuple[Configuration, ...]
    units: Mapping[str, str]
    length: float | None = None
    state: str = ""
