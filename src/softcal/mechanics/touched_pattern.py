"""Factors of a tangent, and of one whose pattern grows with what touches: analysed anew only where entries are new."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.linear_solve import Factorisation, factorisation
from softcal.mechanics.pattern import Triangle, ascending


class TouchedPattern:
    """The planned pattern, and its union with all entries of contacts so far, with the factorisations of both.

    unit (n,): of the unknowns, in which the matrix is factorised; single: whether in single precision.
    """

    def __init__(self, pattern: Triangle, unit: Floats, *, single: bool = False) -> None:
        self._unit, self._single = unit, single
        entries = unit[pattern.rows] * unit[pattern.indices]
        self._unit_places = np.flatnonzero(entries != 1.0)  # most are one: points are in metres
        self._unit_entries = entries[self._unit_places]
        self._without = factorisation(pattern.indptr, pattern.indices, single=single)
        self._n = len(pattern.indptr) - 1
        self._planned = pattern.entries
        self._keys = self._planned
        self._own = np.arange(len(self._planned))
        self._factors: Factorisation | None = None

    def factorise(self, data: Floats, touch: Any, near: Callable[[], Any]) -> Factorisation:
        """The factors of a tangent with contact.

        Parameters
        ----------
        data
            The planned entries (nnz,).
        touch
            Those of contact, a sparse upper triangle; None where nothing touches.
        near
            The entries of all that is near, which the pattern also gets where `touch` has new ones.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        data = data.copy()
        data[self._unit_places] *= self._unit_entries
        if touch is None:
            self._without.factorise(data)
            return self._without
        rows, keys = self._entries(touch)
        places = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        new = self._keys[places] != keys
        if new.any():
            self._forget()
            self._keys = ascending(np.concatenate([self._keys, keys, self._entries(near())[1]]))
            self._own = np.searchsorted(self._keys, self._planned)
            places = np.searchsorted(self._keys, keys)
        whole = np.zeros(len(self._keys))
        whole[self._own] = data
        whole[places] += touch.data * self._unit[rows] * self._unit[touch.indices]
        factors = self._factors
        if factors is None:
            indptr = np.searchsorted(self._keys, np.arange(self._n + 1) * np.int64(self._n))
            factors = factorisation(indptr.astype(np.int64), self._keys % self._n, single=self._single)
        factors.factorise(whole)
        self._factors = factors
        return factors

    def _entries(self, touch: Any) -> tuple[Ints, Ints]:
        """Rows, and row times the number of unknowns plus column, of a sparse matrix."""
        rows = np.repeat(np.arange(self._n), np.diff(touch.indptr))
        return rows, rows * np.int64(self._n) + touch.indices

    def release(self) -> None:
        """Release the factors' memory."""
        self._without.release()
        self._forget()

    def _forget(self) -> None:
        if self._factors is not None:
            self._factors.release()
            self._factors = None
