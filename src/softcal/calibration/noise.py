"""The errors of the measurements as the estimator sees them: groups of channels, and the sources of error in them.

White noise has one size within a group of channels (`Loss.noise_group`), estimated from the group's residuals without
bias:

    E |r_g|^2 = sum_h s_h^2 |M_gh|^2,    M = I - J A^-1 J^T W

Where the loss states the noise, the estimate is at least the stated one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from softcal.calibration.correlation import FEWEST, ErrorRecord, Process, process, record
from softcal.checks import Floats

PRIOR = ""
"""The group of the priors."""
DRIFT = "drift"
_CONCEALED = 2.0 / np.sqrt(3.0)
"""Standard deviation of a drift in standard errors of its own estimate from a record, where up to two of them are as
likely as none."""
_ITERATIONS = 200
_FEWEST_DOF = 3.0  # of a process that a record of any length shows
_SPENT = 0.5  # degrees of freedom below which a group's noise cannot be estimated


@dataclass(frozen=True)
class Noise:
    """The noise of a group of channels.

    Attributes
    ----------
    size
        Its standard deviation: over the stated one [-] where that is known, else in the channels' unit [SI].
    dof
        Degrees of freedom of its estimate [-], infinite where the stated noise is used.
    stated
        Whether the noise of the group is stated.
    """

    size: float
    dof: float
    stated: bool


@dataclass(frozen=True)
class ScaledBlock:
    """A block of n samples in units of its noise v.

    Attributes
    ----------
    experiment
        Its experiment; "" for a prior.
    group
        The group of channels that have this noise.
    stated
        Whether v is the stated noise; else it is one.
    answer
        J / v (n, size).
    pull
        W v J (n, size).
    residual
        Over v (n,).
    systematic
        Change of the residual (n, k) over v by one standard deviation of each uncertain parameter.
    curving
        As systematic, without the direction in which the loss is straight: what pulls on the joint minimum.
    drift
        How far a drift of the instrument has come (n,), over v; None where it has none, or something is stated on it.
    """

    experiment: str
    group: str
    stated: bool
    answer: Floats
    pull: Floats
    residual: Floats
    systematic: Floats
    curving: Floats
    drift: Floats | None = None


@dataclass(frozen=True)
class Source:
    """One independent source of error.

    Attributes
    ----------
    kind
        "noise", "drift", "prior", "experiments" or "set-ups" (differences between them), or the uncertain parameter
        that errs.
    name
        The group of channels, or the parameter.
    records
        Where it pulls on the minimum.
    size, dof
        Of white noise: its standard deviation, and the degrees of freedom of that.
    process
        Of correlated noise; None where it is white.
    in_common
        Whether the records err together, by one error of an uncertain parameter, and not each by itself.
    """

    kind: str
    name: str
    records: tuple[ErrorRecord, ...]
    size: float
    dof: float
    process: Process | None = None
    in_common: bool = False

    def times(self, factor: float) -> Source:
        """The source with errors that are so many times as large."""
        larger = None if self.process is None else replace(self.process, variance=factor**2 * self.process.variance)
        return replace(self, size=factor * self.size, process=larger)

    def rows(self, responses: Sequence[Floats]) -> list[Floats]:
        """Rows whose squares sum to the covariance of what answers to the records by responses (m, k) each."""
        if self.in_common:
            return [self.size * np.sum(responses, axis=0)]
        if self.process is None:
            return [self.size * one for one in responses]
        return [np.linalg.cholesky(self.process.covariance(len(one))).T @ one for one in responses]

    def variances(self, responses: Sequence[Floats]) -> Floats:
        """Variances (k,) of what answers to the records by responses (m, k) each."""
        return np.sum([np.sum(rows**2, axis=0) for rows in self.rows(responses)], axis=0)

    def scatter(self, responses: Sequence[Floats]) -> Floats:
        """Variance (k,) of the estimate of `variances`."""
        if self.process is None:
            return 2 * self.variances(responses) ** 2 / self.dof
        # The likelihood's curvature describes the scatter of a process that is known well; of another it says too much.
        return np.minimum(self.process.scatter_of(responses), 2 * self.variances(responses) ** 2 / _FEWEST_DOF)


def refitted(parts: Sequence[ScaledBlock], inverse: Floats) -> list[ScaledBlock]:
    """The parts with the residuals that are left at the minimum of the linear model with this inverse Hessian."""
    step = -inverse @ sum(part.pull.T @ part.residual for part in parts)
    return [replace(part, residual=part.residual + part.answer @ step) for part in parts]


def sources(parts: Sequence[ScaledBlock], noise: Mapping[str, Noise]) -> list[Source]:
    """The sources of error in parts of one experiment or more: by group, correlated along the records or white."""
    found: list[Source] = []
    for group, held in noise.items():
        own = [part for part in parts if part.group == group]
        averaged = [record(part.residual, part.answer, part.pull, part.experiment) for part in own]
        correlated = None if group == PRIOR else process(averaged)
        if correlated is None:
            averaged = [ErrorRecord(part.residual, part.answer, part.pull, part.experiment) for part in own]
        kind = "prior" if group == PRIOR else "noise"
        found.append(Source(kind, group, tuple(averaged), held.size, held.dof, correlated))
    return found


def drift_sources(parts: Sequence[ScaledBlock], noise: Sequence[Source]) -> list[Source]:
    """Drifts of the instruments, in proportion to time, that the noise of their records conceals."""
    found: list[Source] = []
    for part in parts:
        drift = part.drift
        if drift is None or len(drift) < FEWEST or np.ptp(drift) == 0.0:
            continue
        of = next(s for s in noise if s.name == part.group and part.experiment in {one.experiment for one in s.records})
        values = drift if of.process is None else record(drift, part.answer, part.pull).residual
        along = values - values.mean()
        error = np.sqrt(of.variances([along[:, None]])[0]) / (along @ along)
        pull = _CONCEALED * error * (drift @ part.pull)[None, :]
        held = ErrorRecord(np.zeros(1), np.zeros_like(pull), pull, part.experiment)
        found.append(Source(DRIFT, part.group, (held,), 1.0, np.inf))
    return found


def systematic_sources(parts: Sequence[ScaledBlock], uncertain: Mapping[int, tuple[str, str]]) -> list[Source]:
    """The errors of uncertain parameters as sources; uncertain: column of `ScaledBlock.systematic` -> source, label."""
    found: list[Source] = []
    for k, (source, label) in uncertain.items():
        records: list[ErrorRecord] = []
        for name in dict.fromkeys(part.experiment for part in parts):
            own = [part for part in parts if part.experiment == name]
            pull, alone = (
                np.sum([changes(part)[:, k : k + 1].T @ part.pull for part in own], axis=0)
                for changes in (attrgetter("curving"), attrgetter("systematic"))
            )
            records.append(ErrorRecord(np.zeros(1), np.zeros_like(pull), pull, name, alone))
        found.append(Source(source, label, tuple(records), 1.0, np.inf, in_common=True))
    return found


def white_noise(parts: Sequence[ScaledBlock], inverse: Floats) -> tuple[dict[str, Noise], tuple[str, ...]]:
    """The noise of every group, and the groups whose noise cannot be estimated."""
    groups = list(dict.fromkeys(part.group for part in parts if part.group != PRIOR))
    held = {group: [part for part in parts if part.group == group] for group in groups}
    answers = {g: sum(part.answer.T @ part.answer for part in held[g]) for g in groups}
    pulls = {g: sum(part.pull.T @ part.pull for part in held[g]) for g in groups}
    counts = np.array([sum(len(part.residual) for part in held[g]) for g in groups], dtype=float)
    used = np.array([np.trace(inverse @ sum(part.pull.T @ part.answer for part in held[g])) for g in groups])
    squares = np.array([sum(float(part.residual @ part.residual) for part in held[g]) for g in groups])
    mixing = np.array([[np.trace(inverse @ pulls[h] @ inverse @ answers[g]) for h in groups] for g in groups])
    mixing += np.diag(counts - 2 * used)
    by_priors = sum((part.pull.T @ part.pull for part in parts if part.group == PRIOR), np.zeros_like(inverse))
    priors = np.array([np.trace(inverse @ by_priors @ inverse @ answers[g]) for g in groups])
    dof = counts - used
    free = dof > _SPENT
    stated = np.array([held[g][0].stated for g in groups], dtype=bool)
    sizes = np.where(free, squares / np.where(free, dof, 1.0), stated.astype(float))
    for _ in range(_ITERATIONS):
        expected = mixing @ sizes + priors
        factor = np.where(free & (expected > 0), squares / np.where(expected > 0, expected, 1.0), 1.0)
        sizes = sizes * factor
        if np.all(np.abs(factor - 1.0) < 1e-9):
            break
    at_statement = stated & ~(sizes > 1.0)
    sizes = np.where(at_statement, 1.0, sizes)
    dof = np.where(at_statement | ~free, np.inf, dof)
    noise = {
        g: Noise(float(np.sqrt(size)), float(n), bool(known))
        for g, size, n, known in zip(groups, sizes, dof, stated, strict=True)
    }
    spent = tuple(g for g, known, has in zip(groups, stated, free, strict=True) if not (known or has))
    if any(part.group == PRIOR for part in parts):
        noise[PRIOR] = Noise(1.0, np.inf, stated=True)
    return noise, spent
