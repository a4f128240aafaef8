"""Residuals along a record as a stationary process plus white noise, by restricted maximum likelihood (REML).

Neighbouring samples of an experiment share most of their error: friction, hysteresis, a law that does not fit. Along
the record, in the order of its samples, the residuals of a channel have the covariance

    s^2 [a exp(-|i - j| / l) + (1 - a) delta_ij]

with the correlated share a and the correlation length l [samples]. The three are found by REML (Patterson and Thompson
1971), which is free of the bias that the fitted parameters X cause: it sees only what no change of theta can explain.
White noise alone is kept unless the likelihood ratio asks for more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints

BINS = 100
"""A longer record is averaged to so many values: a correlation within one of them is part of its own noise."""
FEWEST = 8  # values of a record in which a correlation can be seen
_RATIO = 8.0
"""Least gain of a correlated process in twice the log-likelihood: for two parameters, one at its bound, about 1 %."""
_SHORTEST = 0.5  # correlation length [values]
_LENGTHS = 24
_SHARES = np.array([0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.98, 0.99, 0.997, 0.999])
_STEP = 0.05  # of the logarithms by which the likelihood's curvature is taken
_NULL = 1e-9  # singular value over the largest below which a column of X counts as dependent


@dataclass(frozen=True, eq=False)
class ErrorRecord:
    """One channel of one experiment, averaged to at most `BINS` values.

    What REML needs of it is the same among any others, and is kept with it.

    Attributes
    ----------
    residual
        Residuals (m,), divided by the stated noise; in SI units without one.
    answer
        d residual / dz, shape (m, size).
    pull
        Pull of each value on the loss's minimum, shape (m, size).
    experiment
        The experiment that it is of.
    alone
        Pull on the minimum of weighted squares of the experiment alone, where it is another than `pull`.
    """

    residual: Floats
    answer: Floats
    pull: Floats
    experiment: str = ""
    alone: Floats | None = None

    @cached_property
    def columns(self) -> Ints:
        """The parameters that it pulls on."""
        return np.flatnonzero(np.any(self.pull, axis=0))

    @cached_property
    def basis(self) -> Floats:
        """An orthonormal basis of the changes that parameters can make, (m, r)."""
        return span(self.answer)

    @cached_property
    def process(self) -> Process | None:
        """The process of the record, where no other record has the same."""
        return _process([self])

    def on_grid(self, longest: int) -> Floats:
        """The record's parts of r' P r and of the determinants at the lengths and shares of the grid, (2, lengths,
        shares); longest: values of the longest record in the group.
        """
        if longest not in self._on_grids:
            stack = _Stack([self])
            self._on_grids[longest] = np.array([stack.rotated(length)(_SHARES) for length in _lengths(longest)])
        return self._on_grids[longest]

    @cached_property
    def _on_grids(self) -> dict[int, Floats]:
        return {}


@dataclass(frozen=True)
class Process:
    """A stationary process plus white noise in the values of a group's records.

    Attributes
    ----------
    variance
        s^2 of one value, in the square of the records' unit.
    share
        a, the correlated share of the variance [-].
    length
        l, the correlation length [values].
    scatter
        Covariance of the estimates of (ln s^2, logit a, ln l), zero for those at the end of their range, shape (3, 3).
    """

    variance: float
    share: float
    length: float
    scatter: Floats

    def covariance(self, n: int) -> Floats:
        """Of n neighbouring values, shape (n, n)."""
        return _covariance(self._phi, n)

    @property
    def _phi(self) -> Floats:
        return np.array([np.log(self.variance), _logit(np.array(self.share)), np.log(self.length)])

    def scatter_of(self, responses: Sequence[Floats]) -> Floats:
        """Variance (k,) of the estimated variances of k quantities with these responses (m, k) to the records."""

        def variances(phi: Floats) -> Floats:
            parts = [np.einsum("ij,ik,kj->j", one, _covariance(phi, len(one)), one) for one in responses]
            return np.sum(parts, axis=0)

        steps = _STEP * np.eye(3)
        slopes = np.array([(variances(self._phi + d) - variances(self._phi - d)) / (2 * _STEP) for d in steps])
        return np.einsum("ij,ik,kj->j", slopes, self.scatter, slopes)


def record(residual: Floats, answer: Floats, pull: Floats, experiment: str = "") -> ErrorRecord:
    """The record of a channel, averaged where it is long.

    Parameters
    ----------
    residual, answer, pull
        As of `ErrorRecord`, one row for each sample.
    experiment
        Name of the channel's experiment.
    """
    n = len(residual)
    if n <= BINS:
        return ErrorRecord(residual, answer, pull, experiment)
    cuts = np.linspace(0, n, BINS + 1).astype(int)
    counts = np.diff(cuts).astype(float)
    of = cuts[:-1]
    return ErrorRecord(
        np.add.reduceat(residual, of) / counts,
        np.add.reduceat(answer, of) / counts[:, None],
        np.add.reduceat(pull, of),
        experiment,
    )


def process(records: Sequence[ErrorRecord]) -> Process | None:
    """The process in a group of records of one kind; None where white noise explains them as well, or too few values
    are left.
    """
    return records[0].process if len(records) == 1 else _process(records)


def _process(records: Sequence[ErrorRecord]) -> Process | None:
    long = [one for one in records if len(one.residual) >= FEWEST]
    if not long:
        return None
    likelihood = _Restricted(long)
    if likelihood.free < FEWEST or likelihood.is_exact:
        return None
    best, share, length = likelihood.best()
    if likelihood.white - best <= _RATIO:
        return None
    variance = likelihood.variance(share, length)
    if not variance > 0.0:  # residuals of a fit that is exact but for rounding
        return None
    phi = np.array([np.log(variance), _logit(np.array(share)), np.log(length)])
    return Process(variance, share, length, likelihood.scatter(phi))


class _Restricted:
    """Minus twice the restricted log-likelihood of the records' residuals."""

    def __init__(self, records: Sequence[ErrorRecord]) -> None:
        # Each record by itself is free of what any theta explains: how experiments differ is not noise within one.
        self._records = records
        shapes = dict.fromkeys(one.basis.shape for one in records)
        self._stacks = [_Stack([one for one in records if one.basis.shape == shape]) for shape in shapes]
        self._count = sum(len(one.residual) for one in records)
        self.free = self._count - sum(one.basis.shape[1] for one in records)
        self._longest = max(len(one.residual) for one in records)

    @property
    def is_exact(self) -> bool:
        """Whether nothing is left of the residuals."""
        return self.variance(0.0, _SHORTEST) <= 0.0

    def variance(self, share: float, length: float) -> float:
        """s^2 at a share and a length."""
        return float(self._at(length)(np.array([share]))[0, 0]) / self.free

    def profiled(self, parts: Floats) -> Floats:
        """Minus twice the log-likelihood with the best s^2; parts: as of `_Stack.rotated`."""
        return self.free * np.log(np.maximum(parts[0], 1e-300) / self.free) + parts[1]

    @property
    def white(self) -> float:
        """The same without a process."""
        return float(self.profiled(self._at(_SHORTEST)(np.zeros(1)))[0])

    def best(self) -> tuple[float, float, float]:
        """The least value with its share and length, off a grid and then between its points."""
        from scipy.optimize import minimize_scalar

        grid = self.profiled(np.sum([one.on_grid(self._longest) for one in self._records], axis=0).swapaxes(0, 1))
        i, k = divmod(int(np.argmin(grid)), len(_SHARES))
        length = float(_lengths(self._longest)[i])
        ends = _logit(_SHARES[[max(k - 1, 0), min(k + 1, len(_SHARES) - 1)]])
        at = self._at(length)
        found: Any = minimize_scalar(
            lambda x: float(self.profiled(at(np.array([_share(x)])))[0]), bounds=tuple(ends), method="bounded"
        )
        return float(found.fun), float(_share(found.x)), length

    def scatter(self, phi: Floats) -> Floats:
        """Covariance (3, 3) of the estimates (ln s^2, logit a, ln l), by the likelihood's curvature."""
        places = _STEP * np.arange(-2, 3)
        parts = np.array([self._at(float(np.exp(one)))(_share(phi[1] + places)) for one in phi[2] + places])
        squares, determinants = parts[:, 0].T, parts[:, 1].T
        scales = (phi[0] + places)[:, None, None]
        values = self.free * scales + squares / np.exp(scales) + determinants  # at all places, (5, 5, 5)

        def at(place: Floats) -> float:
            return float(values[tuple(2 + place)])

        steps = np.eye(3, dtype=int)
        half = np.array([[at(p + q) - at(p - q) - at(q - p) + at(-p - q) for q in steps] for p in steps])
        # Where the correlation length exceeds the record, only the ratio of s^2 and l is identified: the curvature in
        # the other direction is near zero, and is limited from below.
        sizes, axes = np.linalg.eigh(half / (8 * _STEP**2))
        return (axes / np.maximum(sizes, 0.5 / self._count)) @ axes.T

    def _at(self, length: float) -> Callable[[Floats], Floats]:
        """At a length, by the shares: r' P r in units of s^2, and log |S| + log |X' S^-1 X|, (2, shares)."""
        of_stacks = [stack.rotated(length) for stack in self._stacks]
        return lambda shares: np.sum([one(shares) for one in of_stacks], axis=0)


class _Stack:
    """Records (k, m) of one length, whose bases (k, m, r) have one rank."""

    def __init__(self, records: Sequence[ErrorRecord]) -> None:
        self._residuals = np.array([one.residual for one in records])
        self._bases = np.array([one.basis for one in records])

    def rotated(self, length: float) -> Callable[[Floats], Floats]:
        """At a length, by the shares: r' P r in units of s^2, and log |S| + log |X' S^-1 X|, (2, shares)."""
        k, m, r = self._bases.shape
        values, axes = _spectrum(m, length)
        residuals, X = self._residuals @ axes, axes.T @ self._bases
        squares, pulls = np.sum(residuals**2, axis=0), X * residuals[:, :, None]
        products = (X[:, :, :, None] * X[:, :, None, :]).reshape(k, m, r * r)

        def parts(shares: Floats) -> Floats:
            inverse = 1.0 / (shares[:, None] * values + (1.0 - shares[:, None]))
            information, pulled = (inverse @ products).reshape(k, len(shares), r, r), inverse @ pulls
            explained = np.sum(pulled * np.linalg.solve(information, pulled[..., None])[..., 0], axis=(0, 2))
            determinants = np.sum(np.linalg.slogdet(information)[1], axis=0) - k * np.log(inverse).sum(axis=1)
            return np.array([inverse @ squares - explained, determinants])

        return parts


def _lengths(longest: int) -> Floats:
    """The correlation lengths of the grid, for records of up to so many values."""
    return np.geomspace(_SHORTEST, longest / 2, _LENGTHS)


def _logit(share: Floats) -> Floats:
    return np.log(share / (1.0 - share))


def _share(logit: Floats) -> Floats:
    return 1.0 / (1.0 + np.exp(-logit))


def span(columns: Floats) -> Floats:
    """An orthonormal basis (n, r) of the span of columns (n, k)."""
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return left[:, sizes > _NULL * float(sizes.max(initial=1e-300))]


def triangle(rows: Floats) -> Floats:
    """Triangular factor R of rows A (n, k), R^T R = A^T A, with at most k rows."""
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


def _covariance(phi: Floats, n: int) -> Floats:
    share = _share(phi[1])
    return np.exp(phi[0]) * (share * _correlation(n, float(np.exp(phi[2]))) + (1 - share) * np.eye(n))


@lru_cache(maxsize=128)
def _spectrum(n: int, length: float) -> tuple[Floats, Floats]:
    """Eigenvalues and eigenvectors of the correlation matrix."""
    values, axes = np.linalg.eigh(_correlation(n, length))
    return np.maximum(values, 0.0), axes


def _correlation(n: int, length: float) -> Floats:
    places = np.arange(n)
    return np.exp(-np.abs(places[:, None] - places) / length)
