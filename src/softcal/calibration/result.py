"""What a calibration found: frozen, hashed, with every trial's state and reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from softcal.checks import Floats

TrialState = Literal["COMPLETE", "FAILED"]


@dataclass(frozen=True)
class Trial:
    """One evaluation of the loss: theta [SI] by parameter name, loss where COMPLETE, reason where FAILED."""

    number: int
    theta: Mapping[str, float]
    state: TrialState
    loss: float | None
    reason: str = ""
    seconds: float = 0.0
    n_factorisations: int = 0
    experiment_losses: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Estimate:
    """A calibrated parameter: value [unit, SI], whether it stands at a bound, and the bounds it had."""

    value: float
    unit: str
    at_bound: bool
    lower: float
    upper: float
    standard_error: float | None = None


@dataclass(frozen=True)
class ExperimentFit:
    """How well one experiment is met: SI root-mean-square errors, None for a channel it does not have.

    `measured`: every channel of the dataset; `simulated`: the compared ones, as the bench would have read them;
    "detrended" removes the best straight line of the error over the samples (paper A, Table II).
    response: the twin's own channels by dotted name (`front.tension`), without the rig. units: of all three.
    """

    rmse: Mapping[str, float]  # channel ("tension", "pitch", "shortening") -> RMSE
    rmse_detrended: Mapping[str, float]
    measured: Mapping[str, Floats]
    simulated: Mapping[str, Floats]
    units: Mapping[str, str]
    response: Mapping[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True)
class CalibrationResult:
    """The outcome of one calibration (one experiment, or several jointly)."""

    parameters: Mapping[str, Estimate]
    loss: float
    loss_name: str
    method: str
    seed: int
    n_solves: int
    n_factorisations: int
    wall_s: float
    status: str
    experiments: Mapping[str, ExperimentFit]
    importance: Mapping[str, float]
    trials: tuple[Trial, ...]
    n_failed_trials: int
    hashes: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)
