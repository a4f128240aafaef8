"""Inelastic effects, cycle by cycle: energies of the loops, peaks, and the travel that is left without a force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.experiments.dataset import Dataset
from softcal.experiments.steps.branches import cycle_rows

VANISHED = 0.02  # of the peak: a tension below it has vanished


@dataclass(frozen=True)
class Loop:
    """Energies of one cycle: work of loading [J], energy dissipated in the loop [J]; peak tension [N], travel [m].

    hysteresis [-]: dissipated energy over the work of loading. vanishes_at: the shortening [m] at which the tension has
    vanished as the cable is let go, slack and permanent set together; None where it does not.
    """

    number: int
    loading_energy: float
    lost_energy: float
    peak_tension: float
    travel: float
    vanishes_at: float | None = None

    @property
    def hysteresis(self) -> float:
        """Dissipated energy over the work of loading [-]."""
        return self.lost_energy / self.loading_energy if self.loading_energy > 0.0 else 0.0


def loops(dataset: Dataset) -> tuple[Loop, ...]:
    """Energies of every cycle, by the area under its branches over the shortening.

    Raises
    ------
    DatasetError
        If there is no shortening, tension or cycle.
    """
    shortening, tension = dataset.values("shortening"), dataset.values("tension")
    found: list[Loop] = []
    for cycle in cycle_rows(dataset):
        # The dwell at the turning point is part of the loop, though of neither branch.
        rows = np.arange(cycle.loading[0], cycle.unloading[-1] + 1)
        loading = _area(shortening, tension, cycle.loading)
        pulled, force = shortening[cycle.unloading], tension[cycle.unloading]
        least, vanishes_at = VANISHED * float(force.max()), None
        below = np.flatnonzero(force <= least)
        if below.size and below[0] > 0:
            pair = slice(int(below[0]) - 1, int(below[0]) + 1)
            vanishes_at = float(np.interp(-least, -force[pair], pulled[pair]))
        found.append(
            Loop(
                number=cycle.number,
                loading_energy=loading,
                lost_energy=_area(shortening, tension, rows),
                peak_tension=float(tension[rows].max()),
                travel=float(np.ptp(shortening[rows])),
                vanishes_at=vanishes_at,
            )
        )
    return tuple(found)


def _area(shortening: Floats, tension: Floats, rows: np.ndarray) -> float:
    return float(np.trapezoid(tension[rows], shortening[rows]))
