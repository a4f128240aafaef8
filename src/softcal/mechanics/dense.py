"""Tangents of few unknowns with many products of low rank, such as those of friction: whole, dense matrices."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.system import Border


class Dense:
    """LAPACK's LU of a whole matrix, which need not be symmetric: for few unknowns."""

    def __init__(self, matrix: Floats) -> None:
        """Factorise the matrix (n, n).

        Raises
        ------
        SimulationError
            Where it is singular.
        """
        from scipy.linalg import lu_factor

        self._matrix = matrix
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                self._lu = lu_factor(matrix, check_finite=False)
            except RuntimeWarning as error:
                raise SimulationError(f"The tangent could not be factorised ({error}).") from error

    def factorise(self, data: Floats) -> None:
        """Factorise another matrix (n, n)."""
        self.__init__(data)

    def solve(self, b: Floats) -> Floats:
        """x with A x = b; b (n,) or (n, k)."""
        from scipy.linalg import lu_solve

        return lu_solve(self._lu, b, check_finite=False)

    @property
    def n_negative(self) -> int:
        """The number of eigenvalues with a negative real part: none where the symmetric part is positive definite."""
        try:
            np.linalg.cholesky(self._matrix + self._matrix.T)
        except np.linalg.LinAlgError:
            return int(np.count_nonzero(np.linalg.eigvals(self._matrix).real < 0.0))
        return 0

    @property
    def solves_per_factorisation(self) -> float:
        """None: a small matrix is factorised for every tangent."""
        return 0.0

    def release(self) -> None:
        """Nothing is held outside of Python."""


def dense_tangent(pattern: Pattern, data: Floats, touch: Any, border: Border) -> tuple[Floats, Border]:
    """The tangent (n, n) with its products of low rank, and the border that remains, of the driven actuators.

    Parameters
    ----------
    pattern
        Sparsity of the tangent.
    data
        The sparse upper triangle (nnz,).
    touch
        The part outside of the pattern, or None.
    border
        The border of driven actuators and of products of low rank.
    """
    import scipy.sparse as sp

    n, k = len(pattern.indptr) - 1, len(border.driven)
    upper = sp.csr_matrix((data, pattern.indices, pattern.indptr), shape=(n, n))
    whole: Floats = (upper if touch is None else upper + touch).toarray()
    whole += np.triu(whole, 1).T + border.columns[:, k:] @ border.rows[:, k:].T
    own = {"columns": border.columns[:, :k], "rows": border.rows[:, :k], "corner": border.corner[:k, :k]}
    return whole, replace(border, **own)
