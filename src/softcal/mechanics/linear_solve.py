"""The factorisation of a sparse symmetric matrix given by its upper triangle: PARDISO, or SuperLU where MKL is absent."""

from __future__ import annotations

import ctypes
import functools
import weakref
from typing import Any, Protocol

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import SimulationError


class Factorisation(Protocol):
    """Analyse once, factorise often, solve."""

    def factorise(self, data: Floats) -> None: ...

    def solve(self, b: Floats) -> Floats: ...

    def release(self) -> None: ...


def factorisation(indptr: Ints, indices: Ints) -> Factorisation:
    """The best factorisation this machine has, for a fixed pattern (upper triangle, compressed rows, sorted)."""
    if _mkl() is not None:
        return Pardiso(indptr, indices)
    return SuperLU(indptr, indices)


class Pardiso:
    """MKL PARDISO for symmetric indefinite matrices (mtype -2); the analysis is done once, on the first values."""

    def __init__(self, indptr: Ints, indices: Ints) -> None:
        self._pt = np.zeros(64, dtype=np.int64)
        self._iparm = np.zeros(64, dtype=np.int32)
        self._indptr = (indptr + 1).astype(np.int32)
        self._indices = (indices + 1).astype(np.int32)
        self._n = len(indptr) - 1
        self._analysed = False
        self._data = np.zeros(len(indices))
        self._finalizer = weakref.finalize(self, _release, self._pt, self._iparm, self._indptr, self._indices)
        parameters = {
            0: 1,  # values given here, not defaults
            1: 2,  # nested dissection
            7: 0,  # no iterative refinement: Newton's method refines
            9: 8,  # pivots below 1e-8 are perturbed
            10: 0,  # no scaling, no matching: both need the values at analysis, and the tangent is well scaled
            12: 0,
            20: 0,  # pivots of one: displacements and pressures make a quasi-definite matrix
            23: 1,  # two-level factorisation
            34: 0,  # indices from one
        }
        for key, value in parameters.items():
            self._iparm[key] = value

    @property
    def n_negative(self) -> int:
        """Negative eigenvalues of the last factorised matrix."""
        return int(self._iparm[22])

    def factorise(self, data: Floats) -> None:
        """Numeric factorisation of the values `data` (nnz,).

        Raises
        ------
        SimulationError
            Where the matrix is singular to working precision.
        """
        self._data = data
        phase = 22 if self._analysed else 12
        self._call(phase, np.zeros(self._n), 1)
        self._analysed = True

    def solve(self, b: Floats) -> Floats:
        """x with A x = b; b (n,) or (n, k)."""
        columns = np.asfortranarray(b, dtype=np.float64)
        return self._call(33, columns, 1 if b.ndim == 1 else b.shape[1])

    def release(self) -> None:
        """Give the factors' memory back."""
        if self._analysed:
            self._finalizer()
            self._analysed = False

    def _call(self, phase: int, b: Floats, n_rhs: int) -> Floats:
        x = np.zeros_like(b, order="F")
        error = _pardiso(
            self._pt, self._iparm, self._indptr, self._indices, self._data, phase, b, x, n_rhs
        )
        if error != 0:
            raise SimulationError(f"The tangent could not be factorised (PARDISO error {error}).")
        return x


def _release(pt: Ints, iparm: np.ndarray, indptr: np.ndarray, indices: np.ndarray) -> None:
    """Free what PARDISO holds behind a handle; also called when its owner is collected, or at exit."""
    if pt.any():
        n = len(indptr) - 1
        _pardiso(pt, iparm, indptr, indices, np.zeros(1), -1, np.zeros(n), np.zeros(n), 1)
        pt[:] = 0


def _pardiso(
    pt: Ints,
    iparm: np.ndarray,
    indptr: np.ndarray,
    indices: np.ndarray,
    data: Floats,
    phase: int,
    b: Floats,
    x: Floats,
    n_rhs: int,
) -> int:
    """One call of MKL's pardiso; its error number."""
    error = ctypes.c_int32(0)
    maxfct, mnum, mtype, phase_c, n, nrhs, msglvl = (
        ctypes.c_int32(value) for value in (1, 1, -2, phase, len(indptr) - 1, n_rhs, 0)
    )
    permutation = np.zeros(1, dtype=np.int32)
    by = ctypes.byref
    _mkl().pardiso(
        _pointer(pt), by(maxfct), by(mnum), by(mtype), by(phase_c), by(n), _pointer(data), _pointer(indptr),
        _pointer(indices), _pointer(permutation), by(nrhs), _pointer(iparm), by(msglvl), _pointer(b), _pointer(x),
        by(error),
    )  # fmt: skip
    return int(error.value)


class SuperLU:
    """SciPy's SuperLU in symmetric mode: slower, everywhere."""

    def __init__(self, indptr: Ints, indices: Ints) -> None:
        self._indptr = indptr
        self._indices = indices
        self._lu: Any = None

    def factorise(self, data: Floats) -> None:
        """Numeric factorisation of the values `data` (nnz,).

        Raises
        ------
        SimulationError
            Where the matrix is singular.
        """
        import scipy.sparse as sp
        from scipy.sparse.linalg import splu

        n = len(self._indptr) - 1
        upper = sp.csr_matrix((data, self._indices, self._indptr), shape=(n, n))
        full = (upper + sp.triu(upper, 1).T).tocsc()
        try:
            self._lu = splu(full, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.01)
        except RuntimeError as error:
            raise SimulationError(f"The tangent could not be factorised ({error}).") from error

    def solve(self, b: Floats) -> Floats:
        """x with A x = b; b (n,) or (n, k)."""
        return self._lu.solve(b)

    def release(self) -> None:
        """Give the factors' memory back."""
        self._lu = None


@functools.cache
def _mkl() -> Any:
    try:
        from pypardiso import PyPardisoSolver
    except ImportError:
        return None
    # A handle of our own: pypardiso declares argument types that only its arrays fit.
    return ctypes.CDLL(PyPardisoSolver().libmkl._name)


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
