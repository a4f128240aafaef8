"""Factors of a tangent whose pattern grows with what touches: analysed anew only where entries are new."""

from __future__ import annotations

from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.linear_solve import Factorisation, factorisation
from softcal.mechanics.pattern import Pattern


class TouchedPattern:
    """The union of the planned pattern and all entries of contacts so far, with its factorisation."""

    def __init__(self, pattern: Pattern) -> None:
        self._n = len(pattern.indptr) - 1
        self._planned = pattern.rows * self._n + pattern.indices
        self._keys = self._planned
        self._own = np.arange(len(self._planned))
        self._factors: Factorisation | None = None

    def factorise(self, data: Floats, touch: Any, unit: Floats) -> Factorisation:
        """The factors of the planned entries `data` (nnz,), in any units, and of `touch`, a sparse upper triangle; both
        are scaled by the unknowns' units.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        rows = np.repeat(np.arange(self._n), np.diff(touch.indptr))
        places = self._places(rows * np.int64(self._n) + touch.indices)
        whole = np.zeros(len(self._keys))
        whole[self._own] = data
        np.add.at(whole, places, touch.data)
        factors = self._factors or self._analysed()
        factors.factorise(whole * unit[self._keys // self._n] * unit[self._keys % self._n])
        self._factors = factors
        return factors

    def release(self) -> None:
        """Release the factors' memory."""
        if self._factors is not None:
            self._factors.release()
            self._factors = None

    def _places(self, keys: Ints) -> Ints:
        """Places of the entries, after the pattern has grown by the new ones."""
        places = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        new = self._keys[places] != keys
        if not new.any():
            return places
        self.release()
        fresh = np.unique(keys[new])
        self._keys = np.insert(self._keys, np.searchsorted(self._keys, fresh), fresh)
        self._own = np.searchsorted(self._keys, self._planned)
        return np.searchsorted(self._keys, keys)

    def _analysed(self) -> Factorisation:
        indptr = np.searchsorted(self._keys, np.arange(self._n + 1) * np.int64(self._n))
        return factorisation(indptr.astype(np.int64), self._keys % self._n)
