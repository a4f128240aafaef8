"""What a calibration found: frozen, hashed, with every trial's state and reason."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from softcal.calibration.parameters import Scale
from softcal.checks import Floats

BEYOND = 2.0  # standard errors
"""A parameter at a bound that is further than this from what the data want is held there by it."""

TrialState = Literal["COMPLETE", "FAILED"]


@dataclass(frozen=True)
class Trial:
    """One evaluation of the loss: theta [SI] by parameter name, loss where COMPLETE, reason where FAILED.

    errors: experiment -> marker, plate or channel -> the root mean square of its distance [m] or error [SI].
    """

    number: int
    theta: Mapping[str, float]
    state: TrialState
    loss: float | None
    reason: str = ""
    seconds: float = 0.0
    n_factorisations: int = 0
    experiment_losses: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, Mapping[str, float]] = field(default_factory=dict[str, Mapping[str, float]])


@dataclass(frozen=True)
class Estimate:
    """A calibrated parameter: value [unit, SI], whether it stands at a bound, and the bounds it had.

    interval: 95 %, within the bounds; also of a parameter at a bound, which has no standard error. of: the parameters
    that were tied to have this value; none where the name says which it is. beyond: of a parameter at a bound, how many
    standard errors the bound is from the value that fits best without it; None where that is not known. scale: on which
    it was searched.
    """

    value: float
    unit: str
    at_bound: bool
    lower: float
    upper: float
    standard_error: float | None = None
    interval: tuple[float, float] | None = None
    of: tuple[str, ...] = ()
    beyond: float | None = None
    scale: Scale = "linear"

    @property
    def is_held(self) -> bool:
        """Whether its bound keeps it from the value that the data want, beyond what noise explains.

        Not of one whose interval is all of its range: the data do not tell one value in it from another.
        """
        whole = self.interval is not None and self.interval[0] <= self.lower and self.interval[1] >= self.upper
        return self.beyond is not None and self.beyond > BEYOND and not whole

    def __post_init__(self) -> None:
        object.__setattr__(self, "of", tuple(self.of))
        if self.interval is not None:
            object.__setattr__(self, "interval", (self.interval[0], self.interval[1]))


@dataclass(frozen=True)
class Distance:
    """How far a marker or plate of the twin is from where it was measured [m], over n states."""

    mean: float
    max: float
    rms: float
    n: int


@dataclass(frozen=True)
class ExperimentFit:
    """How well one experiment is met: SI root-mean-square errors of the channels that are compared.

    `measured`: every channel of the dataset, NaN where a value is missing; `simulated`: the compared ones, as the bench
    would have read them; "detrended" removes the best straight line of the error over the samples (paper A, Table II).
    response: the twin's own channels by dotted name (`front.tension`), without the rig. units: of all three.
    distances: by marker or plate; length [m]: what they are told in per cent of, or None. missing: how many states were
    left out, by marker, plate or channel.
    """

    rmse: Mapping[str, float]  # channel ("tension", "pitch", "m4.x") -> RMSE
    rmse_detrended: Mapping[str, float]
    measured: Mapping[str, Floats]
    simulated: Mapping[str, Floats]
    units: Mapping[str, str]
    response: Mapping[str, Floats] = field(default_factory=dict)
    distances: Mapping[str, Distance] = field(default_factory=dict[str, Distance])
    length: float | None = None
    missing: Mapping[str, int] = field(default_factory=dict[str, int])

    @property
    def n_values(self) -> int:
        """How many measured values were compared."""
        return sum(int(np.isfinite(self.measured[c]).sum()) for c in self.simulated if c in self.measured)

    @property
    def distance(self) -> Distance | None:
        """The distance over all markers and plates; None where no positions are compared."""
        held = list(self.distances.values())
        n = sum(d.n for d in held)
        if not n:
            return None
        mean = sum(d.n * d.mean for d in held) / n
        rms = math.sqrt(sum(d.n * d.rms**2 for d in held) / n)
        return Distance(mean, max(d.max for d in held), rms, n)


@dataclass(frozen=True)
class HeldOut:
    """An experiment that was predicted, not fitted: its loss, its errors, and its own nuisances [SI] by label.

    The nuisances (a frame, a slack) belong to its set-up alone and were fitted to it; nothing else was.
    """

    loss: float
    fit: ExperimentFit
    own: Mapping[str, float] = field(default_factory=dict[str, float])


@dataclass(frozen=True)
class CalibrationResult:
    """The outcome of one calibration (one experiment, or several jointly).

    converged: whether the search came to a minimum of the loss; None of a method that looks for none (tpe, grid).
    """

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
    held_out: Mapping[str, HeldOut] = field(default_factory=dict[str, HeldOut])
    converged: bool | None = None

    @property
    def is_saturated(self) -> bool:
        """Whether as many parameters as measured values were fitted, or more: these are met whatever the truth is."""
        return sum(fit.n_values for fit in self.experiments.values()) <= len(self.parameters)

    @property
    def is_sweep(self) -> bool:
        """Whether every cell of a grid over given values was looked at, rather than a best value for."""
        return "axes" in self.extra
