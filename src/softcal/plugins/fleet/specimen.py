"""One specimen of a fleet: its row of the table, and the result of its calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from softcal.calibration.statistics.between_markers import MARKERS
from softcal.calibration.statistics.budget import BOUNDS
from softcal.calibration.statistics.estimate import Estimate
from softcal.calibration.statistics.noise import DRIFT, MISFIT
from softcal.display import displayed

State = Literal["DONE", "FAILED"]
Factor = str | float | None
"""The value of a factor: text, a number [SI], or None where the table has none."""

_OWN = ("noise", DRIFT, MISFIT, "prior", "experiments", "set-ups", MARKERS, BOUNDS)
"""Sources of error that are drawn anew for every specimen."""


@displayed
@dataclass(frozen=True)
class Specimen:
    """A specimen of a fleet, calibrated or not.

    Attributes
    ----------
    name
        Its name.
    state
        DONE or FAILED.
    factors
        Factor -> its value.
    parameters
        Label -> estimate, where DONE.
    loss
        The lowest loss, where DONE.
    reason
        Why it FAILED, a sentence; "" where DONE.
    warnings
        Warnings of its calibration.
    seconds
        Wall time [s] of its calibration.
    hashes
        SHA-256 of the files that it was calibrated with, by their paths as the template has them, where DONE.
    """

    name: str
    state: State
    factors: Mapping[str, Factor] = field(default_factory=dict[str, Factor])
    parameters: Mapping[str, Estimate] = field(default_factory=dict[str, Estimate])
    loss: float | None = None
    reason: str = ""
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    hashes: Mapping[str, str] = field(default_factory=dict[str, str])


def own_error(estimate: Estimate) -> float | None:
    """Standard error [unit] by causes that differ between specimens even if these are alike: without the error of the
    mesh, and without uncertain parameters that all share; None without a standard error.
    """
    return estimate.error_by(*_OWN)
