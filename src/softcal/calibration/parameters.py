"""The search space: what is free, between which bounds, and the unit interval in which the optimisers walk."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault, ParameterError
from softcal.twin.parameters import ParameterInfo, unknown_name

Scale = Literal["linear", "log"]


@dataclass(frozen=True)
class FreeParameter:
    """A parameter to be found: dotted name, SI unit, lower and upper bound [unit].

    scale: "log" searches the logarithm. start [unit]: where a local search begins; None for the robot's own value.
    per_experiment: a nuisance with a value of its own in every experiment.
    prior_mean, prior_sd [unit]: a normal prior, counted by the likelihood loss. experiment: whose value it is once
    expanded, "" when shared. ceiling [unit]: what the parameter may never reach, such as 0.5 for Poisson's ratio.
    """

    name: str
    unit: str
    lower: float
    upper: float
    scale: Scale = "linear"
    start: float | None = None
    per_experiment: bool = False
    prior_mean: float | None = None
    prior_sd: float | None = None
    experiment: str = ""
    ceiling: float = math.inf

    @property
    def label(self) -> str:
        """The name in results: `front.slack`, or `front.slack[20mm]` for one experiment's own."""
        return f"{self.name}[{self.experiment}]" if self.experiment else self.name


@dataclass(frozen=True)
class SearchSpace:
    """The free parameters, expanded per experiment. `z` is the point in the unit box, `theta` [SI] by label.

    Raises
    ------
    ParameterError
        For no free parameter, two of one name, or bounds, start or prior that make no sense; all faults at once.
    """

    parameters: tuple[FreeParameter, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(self.parameters))
        faults = [fault for parameter in self.parameters for fault in _faults(parameter)]
        labels = self.labels
        faults += [
            Fault("the parameter is free twice", label) for label in sorted(set(labels)) if labels.count(label) > 1
        ]
        if not labels:
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
        return {p.label: _to_model(p, float(value)) for p, value in zip(self.parameters, z, strict=True)}

    def to_search(self, theta: Mapping[str, float]) -> Floats:
        """The point of the unit box for theta [SI]."""
        return np.array([_to_search(p, theta[p.label]) for p in self.parameters])

    def jacobian(self, z: Sequence[float] | Floats) -> Floats:
        """d theta / d z, the diagonal, shape (size,)."""
        theta = self.to_model(z)
        return np.array(
            [
                theta[p.label] * math.log(p.upper / p.lower) if p.scale == "log" else p.upper - p.lower
                for p in self.parameters
            ]
        )

    def restricted(self, experiment: str) -> SearchSpace:
        """The space of one experiment alone: what is shared, and its own nuisances."""
        return SearchSpace(tuple(p for p in self.parameters if p.experiment in ("", experiment)))

    def values_for(self, experiment: str, theta: Mapping[str, float]) -> dict[str, float]:
        """The values [SI] that one experiment uses, by plain parameter name."""
        return {p.name: theta[p.label] for p in self.parameters if p.experiment in ("", experiment)}

    def at_bound(self, theta: Mapping[str, float], *, within: float = 1e-3) -> dict[str, bool]:
        """Whether each parameter stands within that share of its range from a bound, by label."""
        z = self.to_search(theta)
        return {label: bool(min(value, 1 - value) <= within) for label, value in zip(self.labels, z, strict=True)}


def search_space(
    parameters: Iterable[FreeParameter], experiments: Sequence[str], known: Mapping[str, ParameterInfo]
) -> SearchSpace:
    """Expand the per-experiment nuisances, and check every parameter against those that exist.

    A start that is not given is the parameter's present value where that lies within the bounds.

    Raises
    ------
    ParameterError
        As `SearchSpace`, and for names that do not exist (with the nearest that does), a wrong unit, or bounds outside
        what the parameter may ever be (such as a Poisson's ratio of 0.5).
    """
    given = tuple(parameters)
    faults: list[Fault] = []
    expanded: list[FreeParameter] = []
    for parameter in given:
        if parameter.name not in known:
            faults += [unknown_name(parameter.name, known), *_faults(parameter)]
            continue
        info = known[parameter.name]
        faults += [*_faults(parameter), *_limit_faults(parameter, info)]
        started = replace(parameter, ceiling=info.upper)
        if parameter.start is None and parameter.lower <= info.value <= parameter.upper:
            started = replace(started, start=info.value)
        if parameter.per_experiment and not parameter.experiment:
            expanded += [replace(started, experiment=experiment) for experiment in experiments]
        else:
            expanded.append(started)
    labels = [parameter.label for parameter in expanded]
    faults += [Fault("the parameter is free twice", label) for label in sorted(set(labels)) if labels.count(label) > 1]
    if faults:
        raise ParameterError(faults)
    return SearchSpace(tuple(expanded))


def _faults(parameter: FreeParameter) -> list[Fault]:
    label, unit = parameter.label, parameter.unit
    numbers = {"lower bound": parameter.lower, "upper bound": parameter.upper, "start": parameter.start}
    numbers |= {"prior mean": parameter.prior_mean, "prior sd": parameter.prior_sd}
    faults = [
        Fault(f"the {what} is not finite", label, got=str(value))
        for what, value in numbers.items()
        if value is not None and not math.isfinite(value)
    ]
    if faults:
        return faults
    bounds = f"{parameter.lower:.6g} to {parameter.upper:.6g} {unit}"
    if parameter.lower >= parameter.upper:
        faults.append(Fault("the bounds are reversed or equal", label, got=bounds, allowed="lower < upper"))
    elif parameter.start is not None and not parameter.lower <= parameter.start <= parameter.upper:
        faults.append(
            Fault("the start is outside the bounds", label, got=f"{parameter.start:.6g} {unit}", allowed=bounds)
        )
    if parameter.scale == "log" and parameter.lower <= 0:
        faults.append(
            Fault("a log scale needs bounds above zero", label, got=bounds, attempt="a linear scale, or a higher bound")
        )
    if (parameter.prior_mean is None) != (parameter.prior_sd is None):
        faults.append(Fault("a prior needs both a mean and an sd", label))
    if parameter.prior_sd is not None and parameter.prior_sd <= 0:
        faults.append(Fault("the prior's sd must be above zero", label, got=f"{parameter.prior_sd:.6g} {unit}"))
    return faults


def _limit_faults(parameter: FreeParameter, info: ParameterInfo) -> list[Fault]:
    faults: list[Fault] = []
    if parameter.unit != info.unit:
        faults.append(Fault("the unit is not the parameter's", parameter.label, parameter.unit, info.unit))
    for what, bound in (("lower bound", parameter.lower), ("upper bound", parameter.upper)):
        if not info.lower < bound < info.upper:
            faults.append(
                Fault(
                    f"the {what} is outside what the parameter may be",
                    parameter.label,
                    got=f"{bound:.6g} {info.unit}",
                    allowed=f"{'0 <=' if info.lower == -1e-300 else f'{info.lower:.4g} <'} bound < {info.upper:.4g}",
                    attempt="0.4999 instead of 0.5" if info.name.endswith("poissons_ratio") and bound >= 0.5 else "",
                )
            )
    return faults


def _to_model(parameter: FreeParameter, z: float) -> float:
    # The bounds themselves are hit exactly: exp(log(x)) may step over them by one unit in the last place.
    if z <= 0:
        return parameter.lower
    if z >= 1:
        return parameter.upper
    if parameter.scale == "log":
        return parameter.lower * math.exp(z * math.log(parameter.upper / parameter.lower))
    return parameter.lower + z * (parameter.upper - parameter.lower)


def _to_search(parameter: FreeParameter, value: float) -> float:
    if parameter.scale == "log":
        return math.log(value / parameter.lower) / math.log(parameter.upper / parameter.lower)
    return (value - parameter.lower) / (parameter.upper - parameter.lower)
