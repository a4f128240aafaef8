"""Inelastic effects, cycle by cycle: energies of the loops, peaks, and the travel that is left without an effort."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.experiments.dataset import Dataset
from softcal.experiments.steps.branches import cycle_rows
from softcal.sensing.channel import driven_pair

VANISHED = 0.02  # of the peak: an effort below it has vanished


@dataclass(frozen=True)
class Loop:
    """Energies of one cycle: work of loading [J], energy dissipated in the loop [J]; peak of the effort and travel of
    the coordinate [SI], such as tension and shortening of a cable.

    hysteresis [-]: dissipated energy over the work of loading. vanishes_at: the coordinate at which the effort has
    vanished as the actuator is let go, slack and permanent set together; None where it does not.
    """

    number: int
    loading_energy: float
    lost_energy: float
    peak_effort: float
    travel: float
    vanishes_at: float | None = None

    @property
    def hysteresis(self) -> float:
        """Dissipated energy over the work of loading [-]."""
        return self.lost_energy / self.loading_energy if self.loading_energy > 0.0 else 0.0


def loops(dataset: Dataset) -> tuple[Loop, ...]:
    """Energies of every cycle, by the area under its branches over the coordinate.

    Raises
    ------
    DatasetError
        If there is no cycle, or no actuator of coordinate and effort; see `driven_pair`.
    """
    coordinate, effort = map(dataset.values, driven_pair(dataset.channels) or ("shortening", "tension"))
    found: list[Loop] = []
    for cycle in cycle_rows(dataset):
        # The dwell at the turning point is part of the loop, though of neither branch.
        rows = np.arange(cycle.loading[0], cycle.unloading[-1] + 1)
        loading = _area(coordinate, effort, cycle.loading)
        driven, answers = coordinate[cycle.unloading], effort[cycle.unloading]
        least, vanishes_at = VANISHED * float(answers.max()), None
        below = np.flatnonzero(answers <= least)
        if below.size and below[0] > 0:
            pair = slice(int(below[0]) - 1, int(below[0]) + 1)
            vanishes_at = float(np.interp(-least, -answers[pair], driven[pair]))
        found.append(
            Loop(
                number=cycle.number,
                loading_energy=loading,
                lost_energy=_area(coordinate, effort, rows),
                peak_effort=float(effort[rows].max()),
                travel=float(np.ptp(coordinate[rows])),
                vanishes_at=vanishes_at,
            )
        )
    return tuple(found)


def _area(coordinate: Floats, effort: Floats, rows: np.ndarray) -> float:
    return float(np.trapezoid(effort[rows], coordinate[rows]))
