"""A polynomial in the parameters through simulated values and derivatives, where the twin itself is too slow.

The values (n, m) at n points and their derivatives are fitted together by least squares, so that a point tells
1 + size times as much as its value alone. The degree is the one that predicts best each point from the others, which
the fit's leverages give without another fit.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.polynomial import legendre

from softcal.checks import Floats

HIGHEST = 6  # degree
_ROWS = 1.3  # rows of the fit over its coefficients, at least
_BETTER = 0.8  # of the squared error: a higher degree must gain as much
_KNOWN = 1e-9  # of a row's own leverage that must be left to predict it from others


@dataclass(frozen=True)
class Surrogate:
    """A polynomial of total degree `degree` in the coordinates u = (z - centre) @ turn, |u| <= 1.

    Attributes
    ----------
    centre, turn
        Of the coordinates, shapes (size,) and (size, size).
    degree
        Total degree.
    coefficients
        Shape (terms, m).
    missed
        Sum of the squared errors of the values at the points it was fitted to, each predicted from the others.
    """

    centre: Floats
    turn: Floats
    degree: int
    coefficients: Floats
    missed: float

    def coordinates(self, z: Floats) -> Floats:
        """u of points z (n, size)."""
        return (z - self.centre) @ self.turn

    def predicted(self, z: Floats) -> Floats:
        """The values (n, m) at points z (n, size)."""
        return _terms(self.coordinates(z), self.degree) @ self.coefficients

    def turned(self) -> Surrogate:
        """The surrogate of the values turned into as many as there are terms: their squares have the same sum."""
        return replace(self, coefficients=np.linalg.qr(self.coefficients.T)[1].T)


def fewest_points(size: int, degree: int = 2) -> int:
    """The number of points that a polynomial of this degree in `size` parameters needs."""
    return int(np.ceil(_ROWS * len(_exponents(size, degree)) / (1 + size)))


def fitted_surrogate(z: Floats, values: Floats, jacobians: Floats, covariance: Floats) -> Surrogate:
    """The polynomial that predicts best each of the points from the others.

    Parameters
    ----------
    z
        The points, shape (n, size).
    values
        Shape (n, m).
    jacobians
        d values / dz, shape (n, m, size).
    covariance
        Of where values are wanted, shape (size, size): its axes are those of the coordinates.
    """
    centre = z.mean(axis=0)
    lengths, axes = np.linalg.eigh(covariance)
    turn = axes / np.sqrt(lengths)
    turn = turn / np.linalg.norm((z - centre) @ turn, axis=1).max()
    u = (z - centre) @ turn
    slopes = jacobians @ np.linalg.inv(turn).T  # by u
    n, size = u.shape
    rows = np.concatenate([values[:, None, :], np.moveaxis(slopes, 2, 1)], axis=1)  # (n, 1 + size, m)
    best: Surrogate | None = None
    for degree in range(1, HIGHEST + 1):
        powers: Floats = np.asarray(legendre.legvander(u, degree), dtype=np.float64)
        rates = np.stack(
            [legendre.legval(u, legendre.legder(np.eye(degree + 1)[k])) for k in range(degree + 1)], axis=-1
        )
        derivatives: list[Floats] = []  # of the terms by each coordinate
        for j in range(size):
            mixed = powers.copy()
            mixed[:, j] = rates[:, j]
            derivatives.append(_products(mixed, range(size), _exponents(size, degree)))
        terms = np.concatenate([_terms(u, degree)[:, None, :], np.stack(derivatives, axis=1)], axis=1)
        if degree > 1 and n * (1 + size) < _ROWS * terms.shape[2]:
            break
        flat = terms.reshape(n * (1 + size), -1)
        coefficients = np.asarray(
            np.linalg.lstsq(flat, rows.reshape(n * (1 + size), -1), rcond=None)[0], dtype=np.float64
        )
        missed = _missed_by_others(terms, rows - terms @ coefficients)
        if best is None or missed < _BETTER * best.missed:
            best = Surrogate(centre, turn, degree, coefficients, missed)
    if best is None:
        raise ValueError("there are no points")
    return best


def _missed_by_others(terms: Floats, residuals: Floats) -> float:
    """Sum of squared errors of the predictions of each point from the other points."""
    n, rows, _ = terms.shape
    left = np.linalg.svd(terms.reshape(n * rows, -1), full_matrices=False)[0].reshape(n, rows, -1)
    total = 0.0
    for own, residual in zip(left, residuals, strict=True):
        kept = np.eye(rows) - own @ own.T
        total += float(np.sum((np.linalg.pinv(kept, rcond=_KNOWN, hermitian=True)[0] @ residual) ** 2))
        # A point that the others do not determine at all is predicted as zero.
        total += float(np.sum(residual[0] ** 2))
    return total


@cache
def _exponents(size: int, degree: int) -> tuple[tuple[int, ...], ...]:
    """Degrees by coordinate of all terms up to a total degree."""
    found: list[tuple[int, ...]] = []
    for total in range(degree + 1):
        for chosen in itertools.combinations_with_replacement(range(size), total):
            found.append(tuple(chosen.count(k) for k in range(size)))
    return tuple(found)


def _terms(u: Floats, degree: int) -> Floats:
    """Products of Legendre polynomials at points (n, size), shape (n, terms)."""
    powers: Floats = np.asarray(legendre.legvander(u, degree), dtype=np.float64)  # (n, size, degree + 1)
    return _products(powers, range(u.shape[1]), _exponents(u.shape[1], degree))


def _products(powers: Floats, places: Sequence[int], exponents: tuple[tuple[int, ...], ...]) -> Floats:
    chosen = np.array(exponents)
    found = np.ones((len(powers), len(chosen)))
    for k in places:
        found *= powers[:, k, chosen[:, k]]
    return found
