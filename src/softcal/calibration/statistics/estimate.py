"""A calibrated parameter with its interval, and remarks on how far it can be trusted."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from softcal.calibration.problem.parameters import Scale
from softcal.calibration.problem.uncertain import EACH
from softcal.calibration.statistics.budget import BOUNDS
from softcal.calibration.statistics.intervals import OFF_PRIOR
from softcal.calibration.statistics.noise import DRIFT
from softcal.declare import Checked
from softcal.display import displayed

if TYPE_CHECKING:
    from pydantic_core import CoreSchema

Tone = Literal["good", "note", "warning"]
BEYOND = 2.0  # standard errors
"""The data contradict a bound where the best value without it lies further beyond it than this."""

_SAME = 1e-6  # relative to the bounds; of places that were computed from them


@displayed
@dataclass(frozen=True)
class Remark(Checked):
    """A sentence on a result, as the terminal, pages and notebooks show it.

    Attributes
    ----------
    text
        The sentence.
    tone
        "warning" where the values may mislead: at a bound, too many of them, residuals beyond the noise; "good" where
        they were tested and hold; else "note".
    about
        Label of the calibration; "" where that is plain.
    """

    text: str
    tone: Tone = "note"
    about: str = ""

    def __str__(self) -> str:
        return self.text


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
    off_prior
        Distance of the estimate from the mean of its prior, in standard errors of this distance [-]; None without a
        prior, and where that is not known.
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
    off_prior: float | None = None

    @property
    def noise_error(self) -> float | None:
        """Standard error [unit] from the sources within one experiment: noise, priors, the range within the bounds that
        the data do not determine, and its own uncertain parameters; without differences between experiments and
        uncertain parameters that they share.
        """
        return self.error_by("noise", DRIFT, "prior", BOUNDS)

    def error_by(self, *sources: str) -> float | None:
        """Standard error [unit] by these sources and the uncertain parameters of each experiment, if there is any."""
        if self.standard_error is None:
            return None
        other = sum(part for name, part in self.shares.items() if name not in sources and not name.endswith(EACH))
        return self.standard_error * math.sqrt(max(1.0 - other, 0.0))

    @property
    def is_contradicted(self) -> bool:
        """Whether a bound contradicts the data: without it, the best value would lie beyond it by more than noise
        explains.
        """
        return self.beyond is not None and self.beyond > BEYOND

    @property
    def contradicts_prior(self) -> bool:
        """Whether data and prior contradict each other: chance does not explain their distance."""
        return self.off_prior is not None and self.off_prior > OFF_PRIOR

    def __post_init__(self) -> None:
        object.__setattr__(self, "of", tuple(self.of))
        if self.interval is not None:
            object.__setattr__(self, "interval", (self.interval[0], self.interval[1]))

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        """A schema that checks, for an estimate from a stored file, that its numbers agree with each other."""
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(_possible, handler(source))


def _possible(one: Estimate) -> Estimate:
    """The estimate, if its numbers can be those of a search."""
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
