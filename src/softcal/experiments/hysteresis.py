"""Inelastic effects, cycle by cycle: energies of the loops, peaks, and the travel that is left without an effort."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.experiments.dataset import Dataset
from softcal.experiments.driven import driven
from softcal.experiments.steps.branches import cycle_rows

VANISHED = 0.02  # of the peak: an effort, such as a tension, below it has vanished


@dataclass(frozen=True)
class Loop:
    """Energies of one cycle of an actuator, and where its effort is largest and vanishes.

    Attributes
    ----------
    number
        Of the cycle, from 0.
    loading_energy
        Work of loading [J].
    lost_energy
        Energy dissipated in the loop [J].
    peak_effort
        Largest effort [SI], of a cable the tension [N]; of a cycle into a vacuum the lowest.
    travel
        Range of the coordinate [SI], of a cable the shortening [m].
    vanishes_at
        The coordinate [SI] at which the effort has vanished as the actuator is let go, slack and permanent set
        together; None where it does not.
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
    """Energies of every cycle, by the area under its branches over the coordinate of the driven actuator.

    An actuator that also acts the other way, such as a motor that turns to and fro, loads the robot on either side: its
    work of loading is that of both.

    Raises
    ------
    DatasetError
        If there is no coordinate, effort or cycle.
    """
    of = driven(dataset)
    sign, travel, effort = of.sign(dataset), of.rising(dataset, of.coordinate), of.rising(dataset, of.effort)
    found: list[Loop] = []
    for cycle in cycle_rows(dataset):
        # The dwell at the turning point is part of the loop, though of neither branch.
        rows = np.arange(cycle.loading[0], cycle.unloading[-1] + 1)
        if of.is_cable:
            loading = _area(travel, effort, cycle.loading)
        else:
            loading = _area(travel, np.maximum(effort, 0.0), cycle.loading)
            loading += _area(travel, np.minimum(effort, 0.0), cycle.unloading)
        let_go, force = travel[cycle.unloading], effort[cycle.unloading]
        least, vanishes_at = VANISHED * float(force.max()), None
        below = np.flatnonzero(force <= least)
        if below.size and below[0] > 0:
            pair = slice(int(below[0]) - 1, int(below[0]) + 1)
            vanishes_at = sign * float(np.interp(-least, -force[pair], let_go[pair]))
        found.append(
            Loop(
                number=cycle.number,
                loading_energy=loading,
                lost_energy=_area(travel, effort, rows),
                peak_effort=sign * float(effort[rows].max()),
                travel=float(np.ptp(travel[rows])),
                vanishes_at=vanishes_at,
            )
        )
    return tuple(found)


def _area(travel: Floats, effort: Floats, rows: np.ndarray) -> float:
    return float(np.trapezoid(effort[rows], travel[rows]))
