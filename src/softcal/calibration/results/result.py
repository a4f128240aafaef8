"""The result of a search: frozen, hashed, with the state of every trial and the reason of every failure."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import AfterValidator

from softcal.calibration.results.digits import ESTIMATE, estimate_cells
from softcal.calibration.results.result_plots import ResultPlots
from softcal.calibration.results.stored import IN_TABLE, PERHAPS_IN_TABLE, Amount, Count, Schema, Share
from softcal.calibration.statistics.estimate import Estimate, Remark
from softcal.calibration.statistics.left_out import LeftOut
from softcal.calibration.statistics.random_effects import Spread
from softcal.calibration.statistics.residuals import ResidualRecord
from softcal.checks import Floats, ReadOnly
from softcal.display import MOST, displayed, pictures_of
from softcal.experiments.driven import DrivenChannels
from softcal.experiments.hysteresis import Loop
from softcal.html_text import heading, html_table, paragraph, picture
from softcal.sensing.channel import channel_name

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
    driven
        The actuator whose coordinate and effort go through the cycles; None without cycles.
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
    driven: DrivenChannels | None = None

    @property
    def alone(self) -> tuple[str, ...]:
        """The compared channels other than the coordinates of points, which are compared by their distances."""
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
class SearchResult(Schema, ResultPlots, ABC):
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
    robot_errors
        Parameter of the robot -> standard deviation [SI] of the error in its description that the intervals include.
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
    importance: Mapping[str, Share]
    trials: Annotated[tuple[Trial, ...], IN_TABLE]
    n_failed_trials: Count
    hashes: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[Remark, ...] = ()
    extra: Annotated[Mapping[str, str | int | float | list[str]], AfterValidator(_of_its_kind)] = field(
        default_factory=dict
    )
    held_out: Mapping[str, HeldOut] = field(default_factory=dict[str, HeldOut])
    spreads: Mapping[str, Spread] = field(default_factory=dict[str, Spread])
    left_out: Mapping[str, LeftOut] = field(default_factory=dict[str, LeftOut])
    residuals: Mapping[str, Mapping[str, ResidualRecord]] = field(
        default_factory=dict[str, Mapping[str, ResidualRecord]]
    )
    robot_errors: Mapping[str, Amount] = field(default_factory=dict[str, float])

    def __repr__(self) -> str:
        parts: list[str] = []
        for name, one in self.parameters.items():
            value, interval, _ = estimate_cells(one)
            parts.append(f"{name} = {value}" + (f" ({interval})" if one.interval is not None else ""))
        shown = parts if len(parts) <= MOST else [*parts[:MOST], f"{len(parts) - MOST} more"]
        return f"{type(self).__name__}({', '.join([*shown, f'loss = {self.loss:.5g}'])})"

    def _repr_html_(self) -> str:
        return result_html(self)

    @property
    @abstractmethod
    def missed_minimum(self) -> bool:
        """Whether the search was to minimise the loss, and ended before a minimum."""

    @property
    def is_saturated(self) -> bool:
        """Whether at least as many parameters as measured values were fitted: the fit is then exact for any true
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


def result_html(result: SearchResult) -> str:
    """For notebooks: the parameters with their intervals, the loss, the sentence on its end, and the notes."""
    rows = [[name, *estimate_cells(one)] for name, one in result.parameters.items()]
    told = f"loss ({result.loss_name}) {result.loss:.5g}, {result.method}, {len(result.trials)} trials"
    failed = f", {result.n_failed_trials} of them failed" if result.n_failed_trials else ""
    parts = [heading(told + failed), html_table(["parameter", *ESTIMATE], rows)]
    parts += [paragraph(result.status), *(paragraph(f"{note.tone.capitalize()}: {note}") for note in result.notes)]
    parts += [picture(png, "loss and fit") for png in pictures_of(result)]
    return "".join(parts)
