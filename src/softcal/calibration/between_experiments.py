"""How the experiments of a joint fit differ in the parameters that they share, from the jacobians at its minimum.

In experiment i alone, the shared parameter p and the experiment's own parameters (its slack, its offsets) move by

    step_i = -(sum J_i^T W J_i)^-1 sum J_i^T W r_i

from the joint minimum, with the other shared parameters at their joint values. Nothing is simulated again. The steps
are compared as random effects (`random_effects.py`). The parameter in which the experiments differ most clearly comes
first; it is then each experiment's own when the others are compared, since one difference must not count as two. Where
several parameters are compared, the chance of each counts as many times (Holm, Scandinavian Journal of Statistics 6,
1979), so that alike experiments are called different in any of them one time in twenty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.noise import (
    PRIOR,
    Noise,
    ScaledBlock,
    Source,
    refitted,
    sources,
    systematic_sources,
    white_noise,
)
from softcal.calibration.random_effects import Kind, RandomEffects, random_effects
from softcal.calibration.uncertain import UncertainParameter
from softcal.checks import Floats

_NULL = 1e-9  # singular value over the largest below which an experiment alone does not identify a direction
_BLURRED = 1e3  # an experiment whose step is so many times as uncertain as the clearest one's is left out


@dataclass(frozen=True)
class Between:
    """How experiments differ in one shared parameter, in the unit box of the search.

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
        What is compared: "experiments", or "set-ups", of which is then said all that is said of experiments here.
    """

    column: int
    steps: Mapping[str, float]
    effects: RandomEffects
    variances: Mapping[str, float]
    responses: Mapping[str, Floats]
    kind: Kind = "experiments"

    @property
    def weights(self) -> Mapping[str, float]:
        """Experiment -> weight of its step in the mean, sum 1."""
        weights = {name: 1 / (variance + self.effects.spread**2) for name, variance in self.variances.items()}
        return {name: weight / sum(weights.values()) for name, weight in weights.items()}

    @property
    def has_interval(self) -> bool:
        """Whether the experiments are enough to say where the mean of more of them would be: three or more."""
        return len(self.steps) > 2


@dataclass(frozen=True)
class Alone:
    """One experiment: its residuals, which parameters have an effect on it, and the sources of error in it."""

    name: str
    parts: Sequence[ScaledBlock]
    serves: np.ndarray
    sources: Sequence[Source]


@dataclass(frozen=True)
class OwnStep:
    """One experiment's own step, its variance by the noise within the experiment, and that variance's dof.

    response: of the step to the pull of the experiment's residuals, shape (size,).
    """

    value: float
    variance: float
    dof: float
    response: Floats


def between_experiments(
    parts: Sequence[ScaledBlock],
    serves: Mapping[str, np.ndarray],
    z: Floats,
    uncertain: Sequence[UncertainParameter] = (),
    members: Mapping[str, Sequence[str]] | None = None,
) -> tuple[Between, ...]:
    """The shared parameters that can be compared between two experiments or more, those that differ first.

    A parameter cannot be what differs where an experiment's own value of it would lie outside the search box.

    Parameters
    ----------
    parts
        The residuals at the joint minimum, with their answers and pulls.
    serves
        Experiment -> whether each parameter (size,) has an effect on it.
    z
        The joint minimum in the unit box (size,).
    uncertain
        Those of the parts' `systematic`: an error that an experiment has alone can be why it differs.
    members
        Set-up -> its experiments, where it is set-ups that are compared, and that the other arguments name.
    """
    left = [int(j) for j in np.flatnonzero(np.sum(list(serves.values()), axis=0) > 1)]
    own = np.sum(list(serves.values()), axis=0) == 1
    held = members or {name: (name,) for name in serves}
    errs = {name: _own_errors(name, uncertain, held) for name in serves}
    by_experiment = [
        one for name, on in serves.items() if (one := _alone(name, parts_alone(name, parts, on & own), on, errs[name]))
    ]
    found: list[Between] = []
    while True:
        compared = [one for j in left if (one := _compared(by_experiment, own, j)) is not None]
        compared = [one for one in compared if all(0.0 <= z[one.column] + step <= 1.0 for step in one.steps.values())]
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
    apart = [(name, between.column) for between in differing for name in between.steps]
    wide: list[ScaledBlock] = []
    for part in parts:
        own = np.array([name == part.experiment for name, _ in apart], dtype=float)
        columns = [column for _, column in apart]
        answer, pull = (np.hstack([held, held[:, columns] * own]) for held in (part.answer, part.pull))
        wide.append(replace(part, answer=answer, pull=pull))
    inverse = _least_inverse(wide, range(wide[0].pull.shape[1]))
    return white_noise(refitted(wide, inverse), inverse)


def parts_alone(name: str, parts: Sequence[ScaledBlock], own: np.ndarray) -> list[ScaledBlock]:
    """The parts of an experiment, with the priors of its own parameters."""
    return [p for p in parts if p.experiment == name or (p.group == PRIOR and np.all(own[np.any(p.answer, axis=0)]))]


def _own_errors(
    name: str, uncertain: Sequence[UncertainParameter], members: Mapping[str, Sequence[str]]
) -> dict[int, tuple[str, str]]:
    """The uncertain parameters of one experiment, or set-up, alone."""
    alone = {k: p for k, p in enumerate(uncertain) if [own for own, es in members.items() if p.serves(*es)] == [name]}
    return {k: (p.source, p.label) for k, p in alone.items()}


def _alone(
    name: str, parts: Sequence[ScaledBlock], serves: np.ndarray, errs: Mapping[int, tuple[str, str]]
) -> Alone | None:
    """An experiment with the errors in it; None where its noise cannot be told from what it determines."""
    inverse = _least_inverse(parts, [int(k) for k in np.flatnonzero(serves)])
    noise, spent = white_noise(refitted(parts, inverse), inverse)
    found = (*sources(parts, noise), *systematic_sources(parts, errs))
    return None if spent else Alone(name, parts, serves, found)


def _compared(by_experiment: Sequence[Alone], own: np.ndarray, j: int) -> Between | None:
    steps = {one.name: step for one in by_experiment if one.serves[j] and (step := own_step(one, own, j)) is not None}
    clearest = min((step.variance for step in steps.values()), default=0.0)
    steps = {name: step for name, step in steps.items() if step.variance < _BLURRED**2 * clearest}
    if len(steps) < 2:
        return None
    values, variances, dof = (np.array([getattr(s, k) for s in steps.values()]) for k in ("value", "variance", "dof"))
    return Between(
        j,
        {name: step.value for name, step in steps.items()},
        random_effects(values, variances, dof),
        {name: step.variance for name, step in steps.items()},
        {name: step.response for name, step in steps.items()},
    )


def own_step(alone: Alone, own: np.ndarray, j: int) -> OwnStep | None:
    """An experiment's own step in parameter j; None where it does not determine it."""
    inverse = _inverse(alone.parts, [j, *(int(k) for k in np.flatnonzero(alone.serves & own) if k != j)])
    if inverse is None:
        return None
    response = inverse[:, j]
    variance = scatter = 0.0
    for source in alone.sources:
        answers = [(one.pull if one.alone is None else one.alone) @ response[:, None] for one in source.records]
        variance += float(source.variances(answers)[0])
        scatter += float(source.scatter(answers)[0])
    value = -float(response @ sum(part.pull.T @ part.residual for part in alone.parts))
    return (
        OwnStep(value, variance, 2 * variance**2 / scatter if scatter > 0 else np.inf, response) if variance else None
    )


def _inverse(parts: Sequence[ScaledBlock], columns: Sequence[int]) -> Floats | None:
    """The inverse (size, size) of the normal equations in some columns, zero in the others; None where singular."""
    scaled, _ = _normal_equations(parts, columns)
    return None if np.linalg.eigvalsh(scaled)[0] < _NULL else _least_inverse(parts, columns)


def _least_inverse(parts: Sequence[ScaledBlock], columns: Sequence[int]) -> Floats:
    """As `_inverse`, with the pseudoinverse where the normal equations are singular."""
    scaled, scale = _normal_equations(parts, columns)
    out = np.zeros((parts[0].pull.shape[1],) * 2)
    out[np.ix_(columns, columns)] = np.linalg.pinv(scaled, rcond=_NULL, hermitian=True) / np.outer(scale, scale)
    return out


def _normal_equations(parts: Sequence[ScaledBlock], columns: Sequence[int]) -> tuple[Floats, Floats]:
    """Their matrix in some columns with a diagonal of ones, and the scale of each column."""
    matrix = np.sum([part.answer[:, columns].T @ part.pull[:, columns] for part in parts], axis=0)
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale[scale == 0.0] = np.inf
    return matrix / np.outer(scale, scale), scale
