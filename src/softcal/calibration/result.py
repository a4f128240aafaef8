"""The result of a search: frozen, hashed, with the state of every trial and the reason of every failure."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import numpy as np
from pydantic import AfterValidator

from softcal.calibration.budget import BOUNDS
from softcal.calibration.left_out import LeftOut
from softcal.calibration.noise import DRIFT
from softcal.calibration.parameters import Scale
from softcal.calibration.random_effects import Spread
from softcal.calibration.residuals import ResidualRecord
from softcal.calibration.stored import IN_TABLE, PERHAPS_IN_TABLE, Amount, Count, Schema
from softcal.calibration.uncertain import EACH
from softcal.checks import Floats, ReadOnly
from softcal.display import displayed
from softcal.experiments.hysteresis import Loop
from softcal.sensing.channel import channel_name

if TYPE_CHECKING:
    from pydantic_core import CoreSchema

BEYOND = 2.0  # standard errors
"""The data contradict a bound where the best value without it lies further beyond it than this."""

_SAME = 1e-6  # relative to the bounds; of places that were computed from them
_SETTINGS = {"importance_kind": str, "method": str, "hold_out": list, "trials": int, "seed": int, "batch": int}


def _of_its_kind(settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """Validate the settings of a search; the options of its optimiser are numbers."""
    for key, value in settings.items():
        kind = _SETTINGS.get(key, (int, float))
        if not isinstance(value, kind) or (kind is int and cast("int", value) < 0):
            raise ValueError(f"{key}: input is of another kind")
    return settings


TrialState = Literal["COMPLETE", "FAILED"]


@displayed
@dataclass(frozen=True)
class Note:
    """A remark on how far a result can be trusted.

    Attributes
    ----------
    text
        A sentence.
    level
        "warning" where the values may mislead: at a bound, too many of them, residuals beyond the noise; else "note".
    """

    text: str
    level: Literal["note", "warning"] = "note"

    def __str__(self) -> str:
        return self.text


@displayed
@dataclass(frozen=True)
class Trial:
    """One evaluation of the loss.

    Attributes
    ----------
    number
        Its number in the search.
    theta
        Label of the free parameter -> value [SI].
    state
        COMPLETE or FAILED.
    loss
        Value of the joint loss; None where FAILED.
    reason
        Why it FAILED, a sentence; "" where COMPLETE.
    seconds
        Wall time of the evaluation [s].
    n_factorisations
        Factorisations of the tangent that it took.
    experiment_losses
        Experiment -> its loss taken alone.
    errors
        Experiment -> marker, plate or channel -> root mean square of its distance [m] or error [SI].
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


@displayed
@dataclass(frozen=True)
class Estimate:
    """A calibrated parameter.

    Attributes
    ----------
    value
        The estimate [unit].
    unit
        Its SI unit.
    at_bound
        Whether the estimate is at a bound of the search.
    lower, upper
        The bounds of the search [unit].
    standard_error
        [unit]; None at a bound, and where none can be computed.
    interval
        Ends (lower, upper) of the 95 % interval [unit], within the bounds; given at a bound too. None where none can be
        computed.
    of
        Names of the parameters that were tied to have this value; empty where the label itself names the parameter.
    beyond
        At a bound: the distance from the bound to the value that fits best without it, in standard errors [-]; None
        where that is not known.
    scale
        Scale on which the parameter was searched, such as "linear" or "log".
    shares
        Source of error -> its share of the estimate's variance [-], sum 1: "noise" of the measurements, "drift" of
        their instruments, "misfit" of the model, "prior", "experiments", "set-ups" or "markers" (differences between
        them), "mesh", and uncertain parameters by their names; empty where the variance is not known.
    dof
        Degrees of freedom of the variance [-]; None where there is none, or the noise is known.
    profile
        Pairs of a value [unit] and the least loss there over all other parameters, by the derivatives at the best point
        (`loss_profiles`), ascending; empty where a search is without derivatives, and for most rig parameters.
    moved_by
        Systematic error of an instrument, such as `front.tension_gain`, on which nothing is stated -> its size [SI]
        that moves the estimate by half its interval; of each instrument the smallest. Of parameters of the robot.
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
    shares: Mapping[str, float] = field(default_factory=dict[str, float])
    dof: float | None = None
    profile: tuple[tuple[float, float], ...] = ()
    moved_by: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def noise_error(self) -> float | None:
        """Standard error [unit] by what one experiment has by itself: noise, priors, what its data leave open within
        bounds, and uncertain parameters of its own; without differences between experiments and what is uncertain in
        all of them alike.
        """
        if self.standard_error is None:
            return None
        own = ("noise", DRIFT, "prior", BOUNDS)
        other = sum(one for source, one in self.shares.items() if source not in own and not source.endswith(EACH))
        return self.standard_error * math.sqrt(max(1.0 - other, 0.0))

    @property
    def is_contradicted(self) -> bool:
        """Whether model and bounds contradict the data here: without the bound the best value would lie beyond it by
        more than noise explains.
        """
        return self.beyond is not None and self.beyond > BEYOND

    def __post_init__(self) -> None:
        object.__setattr__(self, "of", tuple(self.of))
        if self.interval is not None:
            object.__setattr__(self, "interval", (self.interval[0], self.interval[1]))

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        """Whatever stored file it is read from, its numbers agree with each other."""
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(_possible, handler(source))


def _possible(one: Estimate) -> Estimate:
    """The estimate, where a search may have found it."""
    from pydantic_core import PydanticCustomError

    slack = _SAME * (one.lower if one.scale == "log" else one.upper - one.lower)
    low, high = one.lower - slack, one.upper + slack
    begin, end = one.interval or (one.value, one.value)
    why = next(
        (
            why
            for is_wrong, why in (
                (not one.lower <= one.value <= one.upper, f"{one.value:g} is outside its bounds"),
                (one.scale == "log" and not one.lower > 0, f"its bound {one.lower:g} has no logarithm"),
                (not low <= begin <= one.value <= end <= high, f"{begin:g} to {end:g} is no interval of {one.value:g}"),
                (one.standard_error is not None and one.interval is None, "it has a standard error and no interval"),
                ((one.standard_error or 0.0) < 0.0, "its standard error is below zero"),
                (one.dof is not None and not one.dof > 0.0, "its degrees of freedom are not above zero"),
                (not all(-_SAME <= s <= 1 + _SAME for s in one.shares.values()), "its shares are no parts of one"),
                (not all(low <= place <= high for place, _ in one.profile), "its profile is outside its bounds"),
            )
            if is_wrong
        ),
        "",
    )
    if why:
        raise PydanticCustomError("impossible", "{why}", {"why": why})
    return one


@dataclass(frozen=True)
class Distance:
    """Distance between the simulated and the measured position of a marker or plate, over the samples of an experiment.

    Attributes
    ----------
    mean, max, rms
        Mean, largest and root-mean-square distance [m].
    n
        Number of measured positions.
    """

    mean: float
    max: float
    rms: float
    n: int


@dataclass(frozen=True)
class CycleFit:
    """One whole load-unload cycle of the compared samples, measured and simulated."""

    measured: Loop
    simulated: Loop


@displayed
@dataclass(frozen=True)
class ExperimentFit(ReadOnly):
    """Goodness of fit of one experiment: errors of the compared channels and distances of markers and plates.

    Attributes
    ----------
    rmse
        Channel ("tension", "pitch", "m4.x") -> root-mean-square error [SI].
    rmse_detrended
        As rmse, with the best straight line of the error over the samples removed (paper A, Table II).
    measured
        Every channel of the dataset -> values (n_samples,) [SI], NaN where a value is missing.
    simulated
        Every compared channel -> predicted measurement (n_samples,) [SI]: the twin's response seen through the rig.
    units
        Channel of `measured`, `simulated` and `response` -> its SI unit.
    response
        The twin's own channels by dotted name (`front.tension`), without the rig -> values (n_samples,) [SI].
    distances
        Marker or plate -> its distances [m].
    length
        Length [m] of which reports give distances in per cent; None where not given.
    missing
        Marker, plate or channel -> number of samples without a measured value.
    bands
        Compared channel -> half the width (n_samples,) [SI] of the 95 % band of a further experiment, on a new set-up,
        NaN where a value is missing; empty where the estimates have no intervals.
    repeats
        The same of a further sample of the same experiment: same specimen, set-up and instruments.
    cycles
        The whole cycles of the samples, where they go both ways (`find_cycles`).
    """

    rmse: Mapping[str, float]  # channel ("tension", "pitch", "m4.x") -> RMSE
    rmse_detrended: Mapping[str, float]
    measured: Annotated[Mapping[str, Floats], IN_TABLE]
    simulated: Annotated[Mapping[str, Floats], IN_TABLE]
    units: Annotated[Mapping[str, str], IN_TABLE]
    response: Annotated[Mapping[str, Floats], PERHAPS_IN_TABLE] = field(default_factory=dict)
    distances: Mapping[str, Distance] = field(default_factory=dict[str, Distance])
    length: Amount | None = None
    missing: Mapping[str, Count] = field(default_factory=dict[str, int])
    bands: Annotated[Mapping[str, Floats], PERHAPS_IN_TABLE] = field(default_factory=dict[str, Floats])
    repeats: Annotated[Mapping[str, Floats], PERHAPS_IN_TABLE] = field(default_factory=dict[str, Floats])
    cycles: tuple[CycleFit, ...] = ()

    @property
    def alone(self) -> tuple[str, ...]:
        """The compared channels that are no coordinate of a distance."""
        return tuple(channel for channel in self.rmse if channel_name(channel).point not in self.distances)

    @property
    def n_values(self) -> int:
        """Number of measured values that were compared."""
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


@displayed
@dataclass(frozen=True)
class HeldOut:
    """An experiment that was predicted, not fitted.

    Attributes
    ----------
    loss
        Its loss, taken alone.
    fit
        Its errors.
    own
        Label -> value [SI] of its own nuisances (a frame, a slack): they belong to its set-up alone and were fitted to
        it; nothing else was.
    """

    loss: float
    fit: ExperimentFit
    own: Mapping[str, float] = field(default_factory=dict[str, float])


@dataclass(frozen=True, repr=False)
class SearchResult(Schema, ABC):
    """The outcome of a search: the theta of the lowest loss, the twin there, and every evaluation.

    Attributes
    ----------
    parameters
        Label -> value of each searched parameter where the loss is lowest, with its bounds and what is known of it.
    loss, loss_name
        Lowest loss found, and the name of the loss.
    method, seed
        Name of the optimiser, and the seed of its random numbers.
    n_solves
        Number of simulated trajectories.
    n_factorisations
        Number of factorisations of the tangent.
    wall_s
        Wall time [s].
    status
        How the search ended, a sentence.
    experiments
        Experiment -> goodness of fit at the values found.
    importance
        Label -> share of the parameter [-], sum 1; `extra["importance_kind"]` names the measure.
    trials
        Every evaluation, in order.
    n_failed_trials
        Number of those without a loss.
    hashes
        What identifies the run: name of the input -> hash.
    versions
        Package -> version.
    notes
        Remarks on how far the result can be trusted.
    extra
        Settings of the search, and the kind of the importances.
    held_out
        Experiment -> its prediction at the values found, for those that did not count in the loss.
    spreads
        Label of a shared parameter -> its comparison between the experiments, where two of them can be compared.
    left_out
        Experiment -> how well the other ones predict it, of three or more.
    residuals
        Experiment -> compared channel -> how its residuals are correlated along the record.
    """

    parameters: Mapping[str, Estimate]
    loss: float
    loss_name: str
    method: str
    seed: Count
    n_solves: Count
    n_factorisations: Count
    wall_s: Amount
    status: str
    experiments: Mapping[str, ExperimentFit]
    importance: Mapping[str, float]
    trials: Annotated[tuple[Trial, ...], IN_TABLE]
    n_failed_trials: Count
    hashes: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    extra: Annotated[Mapping[str, str | int | float | list[str]], AfterValidator(_of_its_kind)] = field(
        default_factory=dict
    )
    held_out: Mapping[str, HeldOut] = field(default_factory=dict[str, HeldOut])
    spreads: Mapping[str, Spread] = field(default_factory=dict[str, Spread])
    left_out: Mapping[str, LeftOut] = field(default_factory=dict[str, LeftOut])
    residuals: Mapping[str, Mapping[str, ResidualRecord]] = field(
        default_factory=dict[str, Mapping[str, ResidualRecord]]
    )

    def __repr__(self) -> str:
        from softcal.calibration.result_html import result_text

        return result_text(self)

    def _repr_html_(self) -> str:
        from softcal.calibration.result_html import result_html

        return result_html(self)

    @property
    @abstractmethod
    def missed_minimum(self) -> bool:
        """Whether the search was for a minimum of the loss, and ended before it reached one."""

    @property
    def is_saturated(self) -> bool:
        """Whether at least as many parameters as measured values were fitted: the fit is then exact whatever the true
        values.
        """
        return sum(fit.n_values for fit in self.experiments.values()) <= len(self.parameters)


@displayed
@dataclass(frozen=True, repr=False)
class CalibrationResult(SearchResult):
    """The outcome of one calibration (one experiment, or several jointly).

    Attributes
    ----------
    converged
        Whether the search reached a minimum of the loss; None for a method that looks for none (tpe, grid).
    """

    converged: bool | None = None

    @property
    def missed_minimum(self) -> bool:
        return self.converged is False


@displayed
@dataclass(frozen=True, kw_only=True, repr=False)
class SweepResult(SearchResult):
    """The outcome of a sweep: the loss in every cell of a grid. Its `parameters` are those of the best cell.

    Attributes
    ----------
    axes
        Label of each parameter -> its values [SI], in the order of the cells; the last parameter changes fastest.
    """

    axes: Mapping[str, tuple[float, ...]]

    @property
    def losses(self) -> Floats:
        """The loss of every cell, with a dimension for each axis; NaN where it could not be, or was not, simulated."""
        grid = np.full([len(values) for values in self.axes.values()], np.nan)
        for cell in self.trials:
            grid.flat[cell.number] = np.nan if cell.loss is None else cell.loss
        return grid

    @property
    def best(self) -> Trial:
        """The cell with the lowest loss, the first of several."""
        return min((cell for cell in self.trials if cell.loss is not None), key=lambda cell: cell.loss or 0.0)

    @property
    def missed_minimum(self) -> bool:
        return False
