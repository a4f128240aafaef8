"""The errors of the measurements as the estimator sees them: groups of channels, and the sources of error in them.

White noise has one size within a group of channels (`Loss.noise_group`), estimated from the group's residuals without
bias:

    E |r_g|^2 = sum_h s_h^2 |M_gh|^2,    M = I - J A^-1 J^T W

Where the loss states the noise, the estimate is at least the stated one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter

import numpy as np

from softcal.calibration.statistics.correlation import FEWEST, ErrorRecord, Process, process, record
from softcal.checks import Floats, Ints

PRIOR = ""
"""The group of the priors."""
DRIFT, MISFIT = "drift", "misfit"
ANY_LESS = 1.0 / np.sqrt(3.0)
"""Standard deviation of what is at most one, of either sign, where all sizes are as likely."""
_ANY_TO_TWICE = 2.0 * ANY_LESS
"""Standard deviation of what is at most two, such as a drift in standard errors of its own estimate from a record, or a
cause in sizes of its shape, which says only roughly how much of it the parameters take up."""
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
class Sums:
    """A block's contributions to the sums over its group, in the columns (k,) of the parameters with an effect on it.

    Attributes
    ----------
    count, square
        Number of samples, and the sum of their squared residuals.
    products
        answer^T answer, answer^T pull and pull^T pull, shape (3, k, k).
    """

    count: int
    square: float
    columns: Ints
    products: Floats

    @classmethod
    def over(cls, each: Sequence[Sums]) -> Sums:
        """The sums of several blocks, in all their columns."""
        columns = np.unique(np.concatenate([one.columns for one in each]))
        products = np.zeros((3, len(columns), len(columns)))
        for one in each:
            at = np.searchsorted(columns, one.columns)
            products[:, at[:, None], at] += one.products
        return cls(sum(one.count for one in each), sum(one.square for one in each), columns, products)

    @property
    def normal(self) -> Floats:
        """answer^T pull, the matrix of the normal equations."""
        return self.products[1]


@dataclass(frozen=True, eq=False)
class ScaledBlock:
    """A block of n samples in units of its noise v, with its cached contributions to sums.

    Attributes
    ----------
    experiment
        Name of the experiment; "" for a prior.
    group
        The group of channels that have this noise.
    stated
        Whether v is the stated noise; else v is 1.
    answer
        J / v (n, size).
    pull
        W v J (n, size).
    residual
        r / v (n,).
    systematic
        Change of the residual (n, k) over v by one standard deviation of each uncertain parameter.
    curving
        As `systematic`, without the direction in which the loss is straight: the part that pulls on the joint minimum.
    drift
        Progress of a drift of the instrument (n,), over v; None without a drift, or where a statement on it is made.
    misfit
        Changes of the residual (n, k) over v by what the model may miss, and their part that pulls, as in `curving`;
        None where the residual is noise.
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
    misfit: tuple[Floats, Floats] | None = None

    @cached_property
    def record(self) -> ErrorRecord:
        """The record of the block, averaged where it is long."""
        return record(self.residual, self.answer, self.pull, self.experiment)

    @cached_property
    def every(self) -> ErrorRecord:
        """The record of every sample."""
        return ErrorRecord(self.residual, self.answer, self.pull, self.experiment)

    @cached_property
    def pulled(self) -> Floats:
        """pull^T residual (size,)."""
        return self.pull.T @ self.residual

    @cached_property
    def sums(self) -> Sums:
        columns = np.flatnonzero(np.any(self.answer, axis=0) | np.any(self.pull, axis=0))
        answer, pull = self.answer[:, columns], self.pull[:, columns]
        square = float(self.residual @ self.residual)
        products = np.array([answer.T @ answer, answer.T @ pull, pull.T @ pull])
        return Sums(len(self.residual), square, columns, products)


@dataclass(frozen=True)
class Source:
    """One independent source of error.

    Attributes
    ----------
    kind
        "noise", "drift", "misfit", "prior", "experiments" or "set-ups" (differences between them), or the uncertain
        parameter that errs.
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
        roots = {n: np.linalg.cholesky(self.process.covariance(n)).T for n in {len(one) for one in responses}}
        return [roots[len(one)] @ one for one in responses]

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
    step = -inverse @ sum(part.pulled for part in parts)
    return [replace(part, residual=part.residual + part.answer @ step) for part in parts]


def sources(parts: Sequence[ScaledBlock], noise: Mapping[str, Noise]) -> list[Source]:
    """The sources of error in parts of one experiment or more: by group, correlated along the records or white."""
    found: list[Source] = []
    of = by_group(parts)
    for group, held in noise.items():
        own = of[group]
        correlated = None if group == PRIOR else process([part.record for part in own])
        records = tuple(part.every if correlated is None else part.record for part in own)
        kind = "prior" if group == PRIOR else "noise"
        found.append(Source(kind, group, records, held.size, held.dof, correlated))
    return found


def by_group(parts: Sequence[ScaledBlock]) -> dict[str, list[ScaledBlock]]:
    """Group of channels -> its parts."""
    found: dict[str, list[ScaledBlock]] = {}
    for part in parts:
        found.setdefault(part.group, []).append(part)
    return found


def by_experiment(parts: Sequence[ScaledBlock]) -> dict[str, list[ScaledBlock]]:
    """Experiment -> its parts; "" -> the priors."""
    found: dict[str, list[ScaledBlock]] = {}
    for part in parts:
        found.setdefault(part.experiment, []).append(part)
    return found


def drift_sources(parts: Sequence[ScaledBlock], noise: Sequence[Source]) -> list[Source]:
    """Drifts of the instruments, in proportion to time, that the noise of their records conceals."""
    found: list[Source] = []
    sources = {(source.name, one.experiment): source for source in reversed(noise) for one in source.records}
    for part in parts:
        drift = part.drift
        if drift is None or len(drift) < FEWEST or np.ptp(drift) == 0.0:
            continue
        of = sources[part.group, part.experiment]
        values = drift if of.process is None else record(drift, part.answer, part.pull).residual
        along = values - values.mean()
        error = np.sqrt(of.variances([along[:, None]])[0]) / (along @ along)
        pull = _ANY_TO_TWICE * error * (drift @ part.pull)[None, :]
        held = ErrorRecord(np.zeros(1), np.zeros_like(pull), pull, part.experiment)
        found.append(Source(DRIFT, part.group, (held,), 1.0, np.inf))
    return found


def misfit_sources(parts: Sequence[ScaledBlock]) -> list[Source]:
    """Sources of error by the usual causes that the model may miss in each channel, up to twice as large as there."""
    found: list[Source] = []
    for part in parts:
        if part.misfit is not None:
            alone, pull = (_ANY_TO_TWICE * changes.T @ part.pull for changes in part.misfit)
            held = ErrorRecord(np.zeros(len(pull)), np.zeros_like(pull), pull, part.experiment, alone)
            found.append(Source(MISFIT, part.group, (held,), 1.0, np.inf))
    return found


def systematic_sources(parts: Sequence[ScaledBlock], uncertain: Mapping[int, tuple[str, str]]) -> list[Source]:
    """The errors of uncertain parameters as sources; uncertain: column of `ScaledBlock.systematic` -> source, label."""
    found: list[Source] = []
    for k, (source, label) in uncertain.items():
        records: list[ErrorRecord] = []
        for name, own in by_experiment(parts).items():
            pull, alone = (
                np.sum([changes(part)[:, k : k + 1].T @ part.pull for part in own], axis=0)
                for changes in (attrgetter("curving"), attrgetter("systematic"))
            )
            records.append(ErrorRecord(np.zeros(1), np.zeros_like(pull), pull, name, alone))
        found.append(Source(source, label, tuple(records), 1.0, np.inf, in_common=True))
    return found


def white_noise(
    parts: Sequence[ScaledBlock], inverse: Floats, sums: Sequence[Sums] | None = None
) -> tuple[dict[str, Noise], tuple[str, ...]]:
    """The noise of every group, and the groups whose noise cannot be estimated.

    sums: of the parts in the columns of `inverse`, where these are other columns than the parts'.

    Parameters
    ----------
    parts
        Those of all blocks.
    inverse
        Of half the loss's Hessian (size, size).
    sums
        Of the parts in the columns of `inverse`, where these are other columns than the parts'.
    """
    of: dict[str, list[Sums]] = {}
    for part, one in zip(parts, [part.sums for part in parts] if sums is None else sums, strict=True):
        of.setdefault(part.group, []).append(one)
    by_priors = np.zeros_like(inverse)
    for one in of.pop(PRIOR, []):
        by_priors[np.ix_(one.columns, one.columns)] += one.products[2]
    groups, held = list(of), [Sums.over(each) for each in of.values()]
    counts, squares = (np.array([getattr(one, name) for one in held], dtype=float) for name in ("count", "square"))
    # Columns that a group has less than another are the first parameter's, with zeros.
    widest = max(len(one.columns) for one in held)
    columns = np.zeros((len(held), widest), dtype=int)
    answers, normals, pulls = products = np.zeros((3, len(held), widest, widest))
    for k, one in enumerate(held):
        width = len(one.columns)
        columns[k, :width], products[:, k, :width, :width] = one.columns, one.products
    # The inverse between the parameters of two groups, (groups, groups, k, k).
    across = inverse[columns[:, None, :, None], columns[None, :, None, :]]
    every = np.arange(len(groups))
    used = np.sum(across[every, every] * normals, axis=(1, 2))
    mixing = np.einsum("ghab,ghba->gh", across @ pulls, across.swapaxes(0, 1) @ answers[:, None])
    mixing += np.diag(counts - 2 * used)
    spread = (inverse @ by_priors @ inverse)[columns[:, :, None], columns[:, None, :]]
    priors = np.einsum("gab,gba->g", spread, answers)
    stated_of = {part.group: part.stated for part in reversed(parts)}
    stated = np.array([stated_of[g] for g in groups], dtype=bool)
    dof = counts - used
    free = dof > _SPENT
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
