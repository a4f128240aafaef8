"""Differences between the experiments of a joint fit in their shared parameters, by the jacobians at its minimum.

In experiment i alone, the shared parameter p and the experiment's own parameters (its slack, its offsets) move by

    step_i = -(sum J_i^T W J_i)^-1 sum J_i^T W r_i

from the joint minimum, with the other shared parameters at their joint values. Nothing is simulated again. The steps
are compared as random effects (`random_effects.py`). The parameter in which the experiments differ most clearly comes
first; it is then each experiment's own when the others are compared, since one difference must not count as two. Where
several parameters are compared, the chance of each counts as many times (Holm, Scandinavian Journal of Statistics 6,
1979), so that alike experiments are called different in any of them one time in twenty.

Experiments of one set-up, such as the weights that one printed specimen carries, share the errors of that specimen.
Where the set-ups differ, ten experiments on one specimen are one sample of the specimens, not ten. The set-ups are then
compared, and the mean is that over set-ups; the parts of the residuals have the set-up's name instead of the
experiment's.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.statistics.noise import (
    PRIOR,
    Noise,
    ScaledBlock,
    Source,
    Sums,
    by_experiment,
    refitted,
    sources,
    systematic_sources,
    white_noise,
)
from softcal.calibration.statistics.random_effects import Kind, RandomEffects, random_effects
from softcal.checks import Floats, Ints

_NULL = 1e-9  # singular value over the largest below which an experiment alone does not identify a direction
_BLURRED = 1e3  # an experiment whose step is so many times as uncertain as the clearest one's is left out


@dataclass(frozen=True)
class Between:
    """The differences of the experiments in one shared parameter, in the unit box of the search.

    Attributes
    ----------
    column
        The parameter's place in the search space.
    steps
        Experiment -> its own value less the joint one.
    effects
        Mean and spread of the steps.
    variances
        Experiment -> variance of its step by the noise within the experiment.
    responses
        Experiment -> response (size,) of its step to the pull of its residuals.
    kind
        "experiments" or "set-ups"; for set-ups, read "set-up" in the place of "experiment" everywhere here.
    """

    column: int
    steps: Mapping[str, float]
    effects: RandomEffects
    variances: Mapping[str, float]
    responses: Mapping[str, Floats]
    kind: Kind = "experiments"

    @cached_property
    def weights(self) -> Mapping[str, float]:
        """Experiment -> weight of its step in the mean, sum 1."""
        weights = {name: 1 / (variance + self.effects.spread**2) for name, variance in self.variances.items()}
        total = sum(weights.values())
        return {name: weight / total for name, weight in weights.items()}

    @property
    def has_interval(self) -> bool:
        """Whether the experiments are enough for an interval of their population's mean: three or more."""
        return len(self.steps) > 2


@dataclass(frozen=True, eq=False)
class Alone:
    """One experiment: its residuals, which parameters have an effect on it, and the sources of error in it."""

    name: str
    parts: Sequence[ScaledBlock]
    serves: np.ndarray
    sources: Sequence[Source]


@dataclass(frozen=True)
class OwnStep:
    """One experiment's own step, its variance by the noise within the experiment, and that variance's dof.

    response: response (size,) of the step to the pull of the experiment's residuals; beside: the steps (size,) of all
    parameters together with it.
    """

    value: float
    variance: float
    dof: float
    response: Floats
    beside: Floats


class Apart:
    """Cache of the results of single experiments, which do not depend on the other experiments."""

    def __init__(self) -> None:
        self.alone = cache(_alone)
        self.own_step = cache(_own_step)


def between_experiments(
    parts: Sequence[ScaledBlock],
    serves: Mapping[str, np.ndarray],
    z: Floats,
    uncertain: Sequence[UncertainParameter] = (),
    members: Mapping[str, Sequence[str]] | None = None,
    apart: Apart | None = None,
) -> tuple[Between, ...]:
    """The shared parameters that can be compared between two experiments or more, with differing parameters first.

    A parameter cannot be what differs where an experiment's own value of it, or of one in which they differ already,
    would lie outside the search box.

    Parameters
    ----------
    parts
        The residuals at the joint minimum, with their answers and pulls.
    serves
        Experiment -> whether each parameter (size,) has an effect on it.
    z
        The joint minimum in the unit box (size,).
    uncertain
        Parameters of the parts' `systematic`: an error of one experiment alone can be the reason why it differs.
    members
        Set-up -> its experiments, where set-ups are compared; the other arguments then have names of set-ups.
    apart
        Cached results of the same parts from other comparisons.
    """
    apart = apart or Apart()
    left = [int(j) for j in np.flatnonzero(np.sum(list(serves.values()), axis=0) > 1)]
    own = np.sum(list(serves.values()), axis=0) == 1
    held = members or {name: (name,) for name in serves}
    errs: dict[str, dict[int, tuple[str, str]]] = {}
    for k, p in enumerate(uncertain):
        serving = [own for own, experiments in held.items() if p.serves(*experiments)]
        if len(serving) == 1:
            errs.setdefault(serving[0], {})[k] = p.source, p.label
    of, names, owners = by_experiment(parts), list(serves), np.argmax(np.array(list(serves.values())), axis=0)
    for prior in of.pop(PRIOR, []):  # of an experiment's own parameters
        columns = prior.sums.columns
        if np.all(own[columns]) and len(owner := set(owners[columns])) == 1:
            of.setdefault(names[owner.pop()], []).append(prior)
    every = [
        one
        for name, on in serves.items()
        if (one := apart.alone(name, tuple(of.get(name, ())), _columns(on), tuple(errs.get(name, {}).items())))
    ]
    found: list[Between] = []
    while True:
        among = [one.column for one in found]
        compared = [one for j in left if (one := _compared(every, own, j, apart, z, among)) is not None]
        compared = [replace(one, effects=one.effects.among(len(compared))) for one in compared]
        clearest = min(compared, key=lambda one: one.effects.chance, default=None)
        if clearest is None or not clearest.effects.differs:
            return tuple(replace(one, kind="set-ups" if members else "experiments") for one in (*found, *compared))
        found.append(clearest)
        left.remove(clearest.column)
        own = own.copy()
        own[clearest.column] = True


def white_noise_within(
    parts: Sequence[ScaledBlock], differing: Sequence[Between]
) -> tuple[dict[str, Noise], tuple[str, ...]]:
    """The white noise of every group, and the groups whose noise cannot be estimated, where every experiment has its
    own value of the parameters in which they differ.
    """
    size = parts[0].pull.shape[1]
    columns = np.array([between.column for between in differing for _ in between.steps], dtype=int)
    of: dict[str, list[int]] = {}
    for place, name in enumerate(name for between in differing for name in between.steps):
        of.setdefault(name, []).append(place)
    places = [np.array(of.get(part.experiment, []), dtype=int) for part in parts]
    wide: list[Sums] = []  # with some of the columns a second time, in other places
    for part, own in zip(parts, places, strict=True):
        sums = part.sums
        again = np.flatnonzero(np.isin(columns[own], sums.columns))
        at = np.concatenate([np.arange(len(sums.columns)), np.searchsorted(sums.columns, columns[own][again])])
        twice = np.concatenate([sums.columns, (size + own)[again]])
        wide.append(replace(sums, columns=twice, products=sums.products[:, at[:, None], at]))
    inverse = _least_inverse(wide, np.arange(size + len(columns)), size + len(columns))
    pulled = np.zeros(len(inverse))
    for part, own in zip(parts, places, strict=True):
        pulled[:size] += part.pulled
        pulled[size + own] += part.pulled[columns[own]]
    step = -inverse @ pulled
    left: list[Sums] = []
    for part, own, one in zip(parts, places, wide, strict=True):
        moved = step[:size].copy()
        moved[columns[own]] += step[size + own]
        residual = part.residual + part.answer @ moved
        left.append(replace(one, square=float(residual @ residual)))
    return white_noise(parts, inverse, left)


def parts_alone(name: str, parts: Sequence[ScaledBlock], own: np.ndarray) -> list[ScaledBlock]:
    """The parts of an experiment, with the priors of its own parameters.

    Parameters
    ----------
    name, parts
        The experiment, and the parts of all.
    own
        Whether each parameter (size,) belongs to that experiment alone.
    """
    return [p for p in parts if p.experiment == name or (p.group == PRIOR and np.all(own[np.any(p.answer, axis=0)]))]


def _columns(on: np.ndarray) -> tuple[int, ...]:
    return tuple(int(k) for k in np.flatnonzero(on))


def _alone(
    name: str, parts: tuple[ScaledBlock, ...], serves: tuple[int, ...], errs: tuple[tuple[int, tuple[str, str]], ...]
) -> Alone | None:
    """An experiment with the errors in it; None where its noise cannot be distinguished from its own parameters."""
    size = parts[0].pull.shape[1]
    inverse = _least_inverse([part.sums for part in parts], np.array(serves), size)
    noise, spent = white_noise(refitted(parts, inverse), inverse)
    found = (*sources(parts, noise), *systematic_sources(parts, dict(errs)))
    on = np.zeros(size, dtype=bool)
    on[list(serves)] = True
    return None if spent else Alone(name, parts, on, found)


def _compared(
    every: Sequence[Alone], own: np.ndarray, j: int, apart: Apart, z: Floats, among: Sequence[int]
) -> Between | None:
    """The differences of experiments in parameter j; None where fewer than two determine it, or an experiment's own
    value of j or of one `among` the parameters would lie outside the box.
    """
    steps = {one.name: step for one in every if one.serves[j] and (step := own_step(one, own, j, apart)) is not None}
    clearest = min((step.variance for step in steps.values()), default=0.0)
    steps = {name: step for name, step in steps.items() if step.variance < _BLURRED**2 * clearest}
    within = [(0.0 <= z[k] + step.beside[k] <= 1.0) for step in steps.values() for k in (j, *among)]
    if len(steps) < 2 or not all(within):
        return None
    values, variances, dof = (np.array([getattr(s, k) for s in steps.values()]) for k in ("value", "variance", "dof"))
    return Between(
        j,
        {name: step.value for name, step in steps.items()},
        random_effects(values, variances, dof),
        {name: step.variance for name, step in steps.items()},
        {name: step.response for name, step in steps.items()},
    )


def own_step(alone: Alone, own: np.ndarray, j: int, apart: Apart | None = None) -> OwnStep | None:
    """An experiment's own step in parameter j; None where the experiment does not determine the parameter.

    Parameters
    ----------
    alone, j
        The experiment, and the number of the parameter.
    own
        Whether each parameter (size,) belongs to one experiment alone.
    apart
        Cached results of single experiments.
    """
    return (apart or Apart()).own_step(alone, j, _columns(alone.serves & own))


def _own_step(alone: Alone, j: int, own: tuple[int, ...]) -> OwnStep | None:
    size = len(alone.serves)
    sums = [part.sums for part in alone.parts]
    columns = np.array([j, *(k for k in own if k != j)])
    scaled, _ = _normal_equations(sums, columns, size)
    inverse = None if np.linalg.eigvalsh(scaled)[0] < _NULL else _least_inverse(sums, columns, size)
    if inverse is None:
        return None
    response = inverse[:, j]
    variance = scatter = 0.0
    for source in alone.sources:
        answers = [(one.pull if one.alone is None else one.alone) @ response[:, None] for one in source.records]
        variance += float(source.variances(answers)[0])
        scatter += float(source.scatter(answers)[0])
    steps = -inverse @ sum(part.pulled for part in alone.parts)
    dof = 2 * variance**2 / scatter if scatter > 0 else np.inf
    return OwnStep(float(steps[j]), variance, dof, response, steps) if variance else None


def _least_inverse(sums: Sequence[Sums], columns: Ints, size: int) -> Floats:
    """See `_inverse`; the pseudoinverse where the normal equations are singular."""
    scaled, scale = _normal_equations(sums, columns, size)
    out = np.zeros((size, size))
    out[np.ix_(columns, columns)] = np.linalg.pinv(scaled, rcond=_NULL, hermitian=True) / np.outer(scale, scale)
    return out


def _normal_equations(sums: Sequence[Sums], columns: Ints, size: int) -> tuple[Floats, Floats]:
    """Their matrix in some columns with a diagonal of ones, and the scale of each column."""
    every = np.zeros((size, size))
    for one in sums:
        every[np.ix_(one.columns, one.columns)] += one.normal
    matrix = every[np.ix_(columns, columns)]
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale[scale == 0.0] = np.inf
    return matrix / np.outer(scale, scale), scale


def set_ups_of(blocks: Iterable[Block]) -> dict[str, str]:
    """Experiment -> its set-up, one without being a set-up by itself; empty unless there are two set-ups or more, and
    one of them has several experiments.
    """
    found = {block.experiment: block.set_up or block.experiment for block in blocks if block.experiment}
    return found if 1 < len(set(found.values())) < len(found) else {}


def set_up_members(set_ups: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Set-up -> its experiments."""
    return {own: tuple(e for e, s in set_ups.items() if s == own) for own in dict.fromkeys(set_ups.values())}


def parts_by_set_up(parts: Iterable[ScaledBlock], set_ups: Mapping[str, str]) -> list[ScaledBlock]:
    """The parts with the name of the set-up in the place of the experiment's."""
    return [replace(part, experiment=set_ups.get(part.experiment, part.experiment)) for part in parts]


def serves_by_set_up(serves: Mapping[str, np.ndarray], set_ups: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Set-up -> whether each parameter (size,) has an effect on one of its experiments."""
    held: dict[str, list[np.ndarray]] = {}
    for experiment, on in serves.items():
        held.setdefault(set_ups.get(experiment, experiment), []).append(on)
    return {name: np.any(every, axis=0) for name, every in held.items()}


def of_other_set_ups(experiment: str, names: Iterable[str], set_ups: Mapping[str, str]) -> Sequence[str]:
    """The experiments that are not of an experiment's set-up.

    Parameters
    ----------
    experiment, names
        The experiment, and those among which the others are.
    set_ups
        Experiment -> its set-up.
    """
    own = set_ups.get(experiment, experiment)
    return [name for name in names if set_ups.get(name, name) != own]
