"""The search space: the free parameters, their bounds, and the unit box in which the optimisers search."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from softcal.calibration.problem.scope import ScopedParameter, doubled, expanded, resolved
from softcal.checks import Floats
from softcal.declare import OrInfinite
from softcal.display import displayed
from softcal.errors import Fault, ParameterError, unknown
from softcal.twin.parameters import ParameterInfo
from softcal.units import format_quantity, format_range

Scale = Literal["linear", "log"]
TWICE = "the parameter is free twice"
_ROUNDING = 1e-14  # of the search range


@displayed
@dataclass(frozen=True)
class FreeParameter(ScopedParameter):
    """A parameter to be found.

    Attributes
    ----------
    lower, upper
        Bounds [unit].
    scale
        "log" searches the logarithm.
    start
        Initial value of a local search [unit]; None for the robot's own value.
    prior_mean, prior_sd
        A normal prior [unit], counted by the likelihood loss; None without one.
    floor, ceiling
        Limits that the parameter may never reach [unit], such as 0.5 for Poisson's ratio.

    Raises
    ------
    ParameterError
        For bounds, a start or a prior that make no sense; all faults at once.
    """

    lower: float
    upper: float
    scale: Scale = "linear"
    start: float | None = None
    prior_mean: float | None = None
    prior_sd: float | None = None
    ceiling: OrInfinite = math.inf
    floor: OrInfinite = -math.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        faults: list[Fault] = []
        bounds = format_range(self.lower, self.upper, self.unit)
        if self.lower >= self.upper:
            faults.append(Fault("the bounds are reversed or equal", self.label, bounds, "lower < upper"))
        else:
            inside = {"start": (self.start, ""), "prior's mean": (self.prior_mean, "wider bounds, or another mean")}
            faults += [
                Fault(
                    f"the {what} is outside the bounds", self.label, format_quantity(value, self.unit), bounds, attempt
                )
                for what, (value, attempt) in inside.items()
                if value is not None and not self.lower <= value <= self.upper
            ]
        if self.scale == "log" and self.lower <= 0:
            what, attempt = "a log scale needs bounds above zero", "a linear scale, or a higher bound"
            faults.append(Fault(what, self.label, bounds, attempt=attempt))
        if (self.prior_mean is None) != (self.prior_sd is None):
            faults.append(Fault("a prior needs both a mean and an sd", self.label))
        if self.prior_sd is not None and self.prior_sd <= 0:
            got = format_quantity(self.prior_sd, self.unit)
            faults.append(Fault("the prior's sd must be above zero", self.label, got))
        if faults:
            raise ParameterError(faults)

    def value_at(self, z: float) -> float:
        """The value [unit] at a place in the unit interval of the search."""
        # The bounds themselves are hit exactly: exp(log(x)) may step over them by one unit in the last place, and a
        # step to a bound may end short of it by as much.
        if z <= _ROUNDING:
            return self.lower
        if z >= 1 - _ROUNDING:
            return self.upper
        if self.scale == "log":
            return self.lower * math.exp(z * math.log(self.upper / self.lower))
        return self.lower + z * (self.upper - self.lower)


@displayed
@dataclass(frozen=True)
class SearchSpace:
    """The free parameters, expanded per experiment and set-up. `z` is the point in the unit box, `theta` [SI] by label.

    Raises
    ------
    ParameterError
        For no free parameter, or two of one name.
    """

    parameters: tuple[FreeParameter, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(self.parameters))
        faults = doubled(self.parameters, TWICE)
        if not self.parameters:
            faults.append(Fault("there is no free parameter", "free parameters", allowed="at least one"))
        if faults:
            raise ParameterError(faults)

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(parameter.label for parameter in self.parameters)

    @property
    def size(self) -> int:
        return len(self.parameters)

    def to_model(self, z: Sequence[float] | Floats) -> dict[str, float]:
        """theta [SI] by label at a point of the unit box."""
        return {p.label: p.value_at(float(value)) for p, value in zip(self.parameters, z, strict=True)}

    @property
    def start(self) -> dict[str, float]:
        """Initial point of a search [SI], by label: a parameter's start, or the middle of its range."""
        middle = self.to_model(np.full(self.size, 0.5))
        return {p.label: middle[p.label] if p.start is None else p.start for p in self.parameters}

    def to_search(self, theta: Mapping[str, float]) -> Floats:
        """The point of the unit box for theta [SI]."""
        return np.array(
            [
                math.log(theta[p.label] / p.lower) / math.log(p.upper / p.lower)
                if p.scale == "log"
                else (theta[p.label] - p.lower) / (p.upper - p.lower)
                for p in self.parameters
            ]
        )

    def jacobian(self, z: Sequence[float] | Floats) -> Floats:
        """d theta / d z, the diagonal, shape (size,)."""
        theta = self.to_model(z)
        return np.array(
            [
                theta[p.label] * math.log(p.upper / p.lower) if p.scale == "log" else p.upper - p.lower
                for p in self.parameters
            ]
        )

    def restricted(self, *experiments: str) -> SearchSpace:
        """The space of some experiments alone: the shared parameters, and their own nuisances."""
        return SearchSpace(tuple(p for p in self.parameters if p.serves(*experiments)))

    def without(self, names: Collection[str]) -> SearchSpace:
        """The space in which some parameters of the robot and the rig are not free."""
        kept = [(p, tuple(t for t in p.targets if t not in names)) for p in self.parameters]
        return SearchSpace(tuple(replace(p, of=t if p.of else ()) for p, t in kept if t))

    def values_for(self, experiment: str, theta: Mapping[str, float]) -> dict[str, float]:
        """The values [SI] that one experiment uses, by the name of the robot's or the rig's parameter."""
        return {t: theta[p.label] for p in self.parameters if p.serves(experiment) for t in p.targets}

    @property
    def targets(self) -> tuple[str, ...]:
        """Every parameter of the robot and the rig that is free, alone or with others."""
        return tuple(dict.fromkeys(target for p in self.parameters for target in p.targets))

    def serving(self, experiments: Iterable[str]) -> dict[str, np.ndarray]:
        """Experiment -> whether each parameter (size,) has an effect on it."""
        return {name: np.array([p.serves(name) for p in self.parameters]) for name in experiments}

    def free_in(self, experiment: str) -> set[str]:
        """The parameters of the robot and the rig that are free in one experiment."""
        return {target for p in self.parameters if p.serves(experiment) for target in p.targets}

    def at_bound(self, theta: Mapping[str, float], *, within: float = 1e-3) -> dict[str, bool]:
        """Whether each parameter lies within that share of its range from a bound, by label."""
        z = self.to_search(theta)
        return {label: bool(min(value, 1 - value) <= within) for label, value in zip(self.labels, z, strict=True)}


def search_space(
    parameters: Iterable[FreeParameter],
    experiments: Sequence[str],
    known: Mapping[str, ParameterInfo],
    own: Mapping[str, Mapping[str, float]] | None = None,
    set_ups: Mapping[str, str] | None = None,
) -> SearchSpace:
    """Expand patterns of names and per-experiment nuisances, and check every parameter against those that exist.

    A start that is not stated is the present value where that lies within the bounds: of tied parameters the mean, and
    of a nuisance the experiment's own.

    Parameters
    ----------
    parameters, experiments
        Free parameters as a user states them, and the names of the experiments.
    known
        Name -> what is known of a parameter of the robot or the rig.
    own
        Experiment -> name -> value [SI]; a parameter for each experiment is made for those that have it.
    set_ups
        Experiment -> the set-up it was done in; one that has none, or "", is a set-up by itself.

    Raises
    ------
    ParameterError
        As `SearchSpace`, and for names that do not exist (with the nearest that does), a wrong unit, or bounds outside
        what the parameter may ever be (such as a Poisson's ratio of 0.5).
    """
    faults: list[Fault] = []
    found: list[FreeParameter] = []
    for given in parameters:
        parameter, wrong = resolved(given, known)
        faults += wrong
        if wrong:
            continue
        infos = [known[target] for target in parameter.targets]
        for info in infos:
            if parameter.unit != info.unit:
                of = f" ({info.name})" if info.name != parameter.name else ""
                faults.append(Fault("the parameter has another unit" + of, parameter.label, parameter.unit, info.unit))
            for what, bound in (("lower bound", parameter.lower), ("upper bound", parameter.upper)):
                if (fault := info.quantity.fault(bound, parameter.label)) is not None:
                    faults.append(replace(fault, what=f"the {what} is outside what the parameter may be"))
        floor, ceiling = max(info.floor for info in infos), min(info.ceiling for info in infos)
        present = sum(info.value for info in infos) / len(infos)
        for one in expanded(replace(parameter, floor=floor, ceiling=ceiling), experiments, own, set_ups):
            members = one.members or (one.experiment,)
            start = (own or {}).get(members[0], {}).get(one.targets[0], present)
            found.append(replace(one, start=start) if one.start is None and one.lower <= start <= one.upper else one)
    faults += doubled(found, TWICE)
    if faults:
        raise ParameterError(faults)
    return SearchSpace(tuple(found))


def split(space: SearchSpace, label: str, known: Mapping[str, ParameterInfo]) -> SearchSpace:
    """The space in which each of the parameters that are tied in `label` is free by itself.

    Parameters
    ----------
    space, label
        The search space, and the label of the tied parameters.
    known
        Name -> what is known of a parameter of the robot or the rig.

    Raises
    ------
    ParameterError
        Where nothing is tied under that label.
    """
    tied = [p.label for p in space.parameters if len(p.targets) > 1]
    if label not in tied:
        what, none = "no tied parameters have this name", "none is tied in this project"
        raise ParameterError(unknown(what, label, label, tied, got="", none=none))
    parts: list[FreeParameter] = []
    for p in space.parameters:
        if p.label != label:
            parts.append(p)
            continue
        parts += [replace(p, name=t, of=(), floor=known[t].floor, ceiling=known[t].ceiling) for t in p.targets]
    return SearchSpace(tuple(parts))
