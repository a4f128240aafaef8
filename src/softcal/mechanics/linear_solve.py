"""Sparse symmetric matrices given by their upper triangle: factorised by MKL's PARDISO, by Apple's Accelerate, else by
SuperLU.
"""

from __future__ import annotations

import ctypes
import functools
import os
import re
import sys
import weakref
from importlib.metadata import PackageNotFoundError, distribution
from typing import Any, NamedTuple, Protocol

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import SimulationError

# Of the entries of a row of the factors: solutions by iteration that cost as much as a factorisation. Tangents of the
# neck, P2P1, in single precision on one core: 331 entries and 11 solutions at 28k unknowns, 552 and 21 at 75k.
SOLVES = 0.03
# MKL before 2026 gives wrong factors without an error where a neck's tangent is factorised at two levels a second time
# on its first analysis (2025.0.1, 2025.2.0 and 2025.3.1: residual 1e-3, one negative eigenvalue too many).
SOUND = 2026


class Factors(Protocol):
    """Factors of one matrix."""

    def solve(self, b: Floats) -> Floats: ...

    @property
    def n_negative(self) -> int:
        """The number of negative eigenvalues of the matrix factorised last (Sylvester's law of inertia)."""
        ...

    @property
    def solves_per_factorisation(self) -> float:
        """The number of solutions by iteration that cost about as much as a factorisation."""
        ...


class Factorisation(Factors, Protocol):
    """Analyse once, factorise often, solve."""

    def factorise(self, data: Floats) -> None: ...

    def release(self) -> None: ...


def factorisation(indptr: Ints, indices: Ints, *, single: bool = False) -> Factorisation:
    """The fastest available factorisation for a fixed pattern.

    Parameters
    ----------
    indptr, indices
        The upper triangle in compressed rows, sorted (n + 1,) (nnz,).
    single
        Whether in single precision where that is available: 1.7 times faster in half the memory.
    """
    if _mkl_pardiso() is not None:
        return Pardiso(indptr, indices, single=single)
    if _accelerate() is not None:
        return Accelerate(indptr, indices, single=single)
    return SuperLU(indptr, indices)


_ZERO, _ONE, _TYPE = ctypes.c_int32(0), ctypes.c_int32(1), ctypes.c_int32(-2)  # the type: symmetric indefinite


class _Handle(NamedTuple):
    """PARDISO's state between calls: its own memory, its options, the pattern counted from one."""

    memory: Ints
    options: np.ndarray
    indptr: np.ndarray
    indices: np.ndarray
    pointers: tuple[ctypes.c_void_p, ...]  # to the four, made once


class Pardiso:
    """MKL PARDISO for symmetric indefinite matrices (mtype -2); the analysis is done once, on the first values."""

    def __init__(self, indptr: Ints, indices: Ints, *, single: bool = False) -> None:
        options = np.zeros(64, dtype=np.int32)
        for key, value in {
            0: 1,  # values given here, not defaults
            1: 2,  # nested dissection
            7: 0,  # no iterative refinement: Newton's method refines
            9: 8,  # pivots below 1e-8 are perturbed
            10: 0,  # no scaling, no matching: both need the values at analysis, and the tangent is well scaled
            12: 0,
            17: -1,  # reports the number of the factors' entries
            20: 0,  # pivots of one: displacements and pressures make a quasi-definite matrix
            23: int(mkl_year() >= SOUND),  # two-level factorisation
            27: int(single),
        }.items():
            options[key] = value
        arrays = (
            np.zeros(64, dtype=np.int64),
            options,
            (indptr + 1).astype(np.int32),
            (indices + 1).astype(np.int32),
        )
        self._handle = _Handle(*arrays, tuple(_pointer(array) for array in arrays))
        self._finalizer = weakref.finalize(self, _release, self._handle)
        self._type: type[np.floating] = np.float32 if single else np.float64
        self._data: np.ndarray = np.zeros(0)

    def factorise(self, data: Floats) -> None:
        """Numeric factorisation of the values `data` (nnz,).

        Raises
        ------
        SimulationError
            Where the matrix is singular to working precision.
        """
        phase = 22 if self._data.size else 12
        self._data = np.asarray(data, dtype=self._type)
        self._call(phase, np.zeros(len(self._handle.indptr) - 1, dtype=self._type))

    def solve(self, b: Floats) -> Floats:
        """x with A x = b; b (n,) or (n, k)."""
        return np.asarray(self._call(33, np.asfortranarray(b, dtype=self._type)), dtype=np.float64)

    @property
    def n_negative(self) -> int:
        """The number of negative eigenvalues of the matrix factorised last."""
        return int(self._handle.options[22])

    @property
    def solves_per_factorisation(self) -> float:
        """The number of solutions by iteration that cost about as much as a factorisation."""
        return SOLVES * int(self._handle.options[17]) / (len(self._handle.indptr) - 1)

    def release(self) -> None:
        """Release the factors' memory."""
        self._finalizer()

    def _call(self, phase: int, b: np.ndarray) -> np.ndarray:
        x = np.empty_like(b, order="F")
        error = _pardiso(self._handle, phase, self._data, b, x)
        if error != 0:
            raise SimulationError(f"The tangent could not be factorised (PARDISO error {error}).")
        return x


def _release(handle: _Handle) -> None:
    """Free what PARDISO holds; also called when its owner is collected, or at exit."""
    if handle.memory.any():
        unused = np.zeros(len(handle.indptr) - 1)
        _pardiso(handle, -1, unused, unused, unused)
        handle.memory[:] = 0


def _pardiso(handle: _Handle, phase: int, data: np.ndarray, b: np.ndarray, x: np.ndarray) -> int:
    """One call of MKL's pardiso; its error number."""
    n_rhs = 1 if b.ndim == 1 else b.shape[1]
    memory, options, indptr, indices = handle.pointers
    by, int32, error = ctypes.byref, ctypes.c_int32, ctypes.c_int32(0)
    # The permutation, a zero, is not read: the order is PARDISO's own.
    _mkl_pardiso()(
        memory, by(_ONE), by(_ONE), by(_TYPE), by(int32(phase)), by(int32(len(handle.indptr) - 1)), _pointer(data),
        indptr, indices, by(_ZERO), by(int32(n_rhs)), options, by(_ZERO), _pointer(b), _pointer(x), by(error),
    )  # fmt: skip
    return int(error.value)


# Structures and constants of Apple's Sparse/Solve.h, in its order; 64-bit systems alone.
_I32, _U32, _U8, _SIZE, _POINTER = ctypes.c_int32, ctypes.c_uint32, ctypes.c_uint8, ctypes.c_size_t, ctypes.c_void_p
_SYMMETRIC_LOWER = 3 << 2 | 1 << 1  # attributes: kind and triangle; columns of it are the rows of the upper triangle
_METIS = 3  # order: nested dissection
_LDLT = _U8(4)  # with threshold partial pivoting, so that the inertia is right for every symmetric matrix
_SPARSE = "/System/Library/Frameworks/Accelerate.framework/Accelerate"
# Inertia is a function of C with overloads, so its name is that of C++; it came with macOS 13.
_INERTIA = "_Z16SparseGetInertia{0}SparseOpaqueFactorization_{1}PiS0_S0_"
_ReportError = ctypes.CFUNCTYPE(None, ctypes.c_char_p)


class _Pattern(ctypes.Structure):
    _fields_ = (
        ("n_rows", _I32), ("n_columns", _I32), ("starts", _POINTER), ("rows", _POINTER), ("attributes", _U32),
        ("block_size", _U8),
    )  # fmt: skip


class _Matrix(ctypes.Structure):
    _fields_ = (("pattern", _Pattern), ("data", _POINTER))


class _Columns(ctypes.Structure):
    _fields_ = (("n_rows", _I32), ("n_columns", _I32), ("stride", _I32), ("attributes", _U32), ("data", _POINTER))


class _SymbolicOptions(ctypes.Structure):
    _fields_ = (
        ("control", _U32), ("order", _U8), ("permutation", _POINTER), ("ignored", _POINTER), ("malloc", _POINTER),
        ("free", _POINTER), ("report_error", _ReportError),
    )  # fmt: skip


class _NumericOptions(ctypes.Structure):
    _fields_ = (
        ("control", _U32), ("scaling_method", _U8), ("scaling", _POINTER), ("pivot_tolerance", ctypes.c_double),
        ("zero_tolerance", ctypes.c_double),
    )  # fmt: skip


class _Symbolic(ctypes.Structure):
    _fields_ = (
        ("status", _I32), ("n_rows", _I32), ("n_columns", _I32), ("attributes", _U32), ("block_size", _U8),
        ("kind", _U8), ("factors", _POINTER), ("workspace_Float", _SIZE), ("workspace_Double", _SIZE),
        ("size_Float", _SIZE), ("size_Double", _SIZE),
    )  # fmt: skip


class _Numeric(ctypes.Structure):
    _fields_ = (
        ("status", _I32), ("attributes", _U32), ("symbolic", _Symbolic), ("own_storage", ctypes.c_bool),
        ("factors", _POINTER), ("workspace", _SIZE), ("workspace_per_column", _SIZE),
    )  # fmt: skip


class Accelerate:
    """The sparse LDL^T of Apple's Accelerate for symmetric indefinite matrices; the pattern is analysed once."""

    def __init__(self, indptr: Ints, indices: Ints, *, single: bool = False) -> None:
        self._type: type[np.floating] = np.float32 if single else np.float64
        self._precision = "Float" if single else "Double"
        self._arrays = (np.ascontiguousarray(indptr, dtype=np.int64), np.ascontiguousarray(indices, dtype=np.int32))
        self._n = len(indptr) - 1
        starts, rows = (array.ctypes.data for array in self._arrays)
        self._pattern = _Pattern(self._n, self._n, starts, rows, _SYMMETRIC_LOWER, 1)
        self._faults = faults = list[str]()  # not by `self`, which would keep this object in a cycle
        # Without a report of its own, Accelerate ends the process where it refuses an argument.
        report = _ReportError(lambda text: faults.append(text.decode(errors="replace").strip()))
        memory = [ctypes.cast(function, _POINTER) for function in (ctypes.CDLL(None).malloc, ctypes.CDLL(None).free)]
        self._symbolic = _SymbolicOptions(0, _METIS, None, None, *memory, report)
        pivots = 0.1 if single else 0.01  # Apple's defaults, as the next
        self._options = _NumericOptions(0, 0, None, pivots, 1e-4 * float(np.finfo(self._type).eps))
        self._numeric = _Numeric()
        self._n_negative = 0
        self._finalizer = weakref.finalize(self, _destroy, self._function("_SparseDestroyOpaqueNumeric"), self._numeric)

    def factorise(self, data: Floats) -> None:
        """Numeric factorisation of the values `data` (nnz,).

        Raises
        ------
        SimulationError
            Where the matrix is singular to working precision.
        """
        if not np.all(np.isfinite(data)):  # of which Accelerate says nothing
            raise SimulationError("The tangent could not be factorised (it has entries that are not finite).")
        values = np.ascontiguousarray(data, dtype=self._type)
        matrix = _Matrix(self._pattern, values.ctypes.data)
        by = ctypes.byref
        if self._numeric.factors and self._numeric.status == 0:
            workspace = _bytes(getattr(self._numeric.symbolic, f"workspace_{self._precision}"))
            refactor = self._function("_SparseRefactorSymmetric")
            refactor(by(matrix), by(self._numeric), by(self._options), _pointer(workspace))
        else:
            self.release()
            factor = self._function("_SparseFactorSymmetric")
            factor.restype = _Numeric
            made = factor(_LDLT, by(matrix), by(self._symbolic), by(self._options))
            ctypes.memmove(by(self._numeric), by(made), ctypes.sizeof(_Numeric))
        self._check(f"status {self._numeric.status}", self._numeric.status == 0)
        counts = [ctypes.c_int() for _ in range(3)]  # of positive, zero and negative pivots
        code = _inertia(_accelerate(), self._precision)(self._numeric, *map(ctypes.byref, counts))
        _, zero, negative = (count.value for count in counts)
        self._check(f"{zero} pivots of zero", code == 0 and zero == 0)  # its status is in order with them
        self._n_negative = negative

    def solve(self, b: Floats) -> Floats:
        """x with A x = b; b (n,) or (n, k)."""
        given = np.array(b, dtype=self._type, order="F", copy=True)
        x = np.empty_like(given, order="F")
        n_columns = 1 if given.ndim == 1 else given.shape[1]
        of = [_Columns(self._n, n_columns, self._n, 0, array.ctypes.data) for array in (given, x)]
        workspace = _bytes(self._numeric.workspace + n_columns * self._numeric.workspace_per_column)
        self._function("_SparseSolveOpaque")(
            ctypes.byref(self._numeric), ctypes.byref(of[0]), ctypes.byref(of[1]), _pointer(workspace)
        )
        self._check("no solution", True)
        return np.asarray(x, dtype=np.float64)

    @property
    def n_negative(self) -> int:
        """The number of negative eigenvalues of the matrix factorised last."""
        return self._n_negative

    @property
    def solves_per_factorisation(self) -> float:
        """The number of solutions by iteration that cost about as much as a factorisation."""
        size = getattr(self._numeric.symbolic, f"size_{self._precision}")
        return SOLVES * size / np.dtype(self._type).itemsize / self._n

    def release(self) -> None:
        """Release the factors' memory."""
        _destroy(self._function("_SparseDestroyOpaqueNumeric"), self._numeric)

    def _function(self, name: str) -> Any:
        return _accelerate()[f"{name}_{self._precision}"]

    def _check(self, what: str, right: bool) -> None:
        """Raise an error that Accelerate has reported, or that the caller has noticed."""
        if self._faults or not right:
            said = "; ".join([what, *self._faults])
            self._faults.clear()
            raise SimulationError(f"The tangent could not be factorised (Accelerate: {said}).")


def _destroy(function: Any, numeric: _Numeric) -> None:
    """Free the memory of the factors in Accelerate; also called when their owner is collected, or at exit."""
    if numeric.factors or numeric.symbolic.factors:
        function(ctypes.byref(numeric))
        ctypes.memset(ctypes.byref(numeric), 0, ctypes.sizeof(numeric))


def _bytes(n: int) -> np.ndarray:
    return np.empty(n // 16 + 1, dtype=np.complex128)  # aligned to 16 bytes


def _inertia(library: Any, precision: str) -> Any:
    """Accelerate's function that counts the signs of the pivots; raises AttributeError before macOS 13."""
    return library[_INERTIA.format(len(f"SparseOpaqueFactorization_{precision}"), precision)]


@functools.cache
def _accelerate() -> Any:
    """Apple's library, or None elsewhere, and where it cannot count negative eigenvalues."""
    if sys.platform != "darwin":
        return None
    library = ctypes.CDLL(_SPARSE)
    try:
        _inertia(library, "Double")
    except AttributeError:
        return None
    return library


class SuperLU:
    """SciPy's SuperLU in symmetric mode: slower, available everywhere."""

    def __init__(self, indptr: Ints, indices: Ints) -> None:
        self._indptr = indptr
        self._indices = indices
        self._matrix: Any = None
        self._lu: Any = None

    def factorise(self, data: Floats) -> None:
        """Numeric factorisation of the values `data` (nnz,).

        Raises
        ------
        SimulationError
            Where the matrix is singular.
        """
        import scipy.sparse as sp

        n = len(self._indptr) - 1
        upper = sp.csr_matrix((data, self._indices, self._indptr), shape=(n, n))
        self._matrix = (upper + sp.triu(upper, 1).T).tocsc()
        self._lu = self._factors(0.01)

    def _factors(self, pivot_threshold: float) -> Any:
        from scipy.sparse.linalg import splu

        options = {"SymmetricMode": True}
        try:
            return splu(self._matrix, permc_spec="MMD_AT_PLUS_A", options=options, diag_pivot_thresh=pivot_threshold)
        except RuntimeError as error:
            raise SimulationError(f"The tangent could not be factorised ({error}).") from error

    def solve(self, b: Floats) -> Floats:
        """x with A x = b; b (n,) or (n, k)."""
        return self._lu.solve(b)

    @property
    def n_negative(self) -> int:
        """The number of negative eigenvalues of the matrix factorised last."""
        lu = self._lu
        if np.any(lu.perm_r != lu.perm_c):  # its pivots give the inertia only where all are on the diagonal
            lu = self._factors(0.0)
        return int(np.count_nonzero(lu.U.diagonal() < 0.0))

    @property
    def solves_per_factorisation(self) -> float:
        """The number of solutions by iteration that cost about as much as a factorisation."""
        return SOLVES * self._lu.nnz / self._lu.shape[0]

    def release(self) -> None:
        """Release the factors' memory."""
        self._matrix = self._lu = None


def mkl_year() -> int:
    """The year of MKL's version; 0 where MKL is absent."""
    numbers, library = (ctypes.c_int * 16)(), _mkl()  # a structure that begins with the year, and has pointers behind
    if library is not None:
        library["MKL_Get_Version"](ctypes.byref(numbers))
    return int(numbers[0])


@functools.cache
def _mkl_pardiso() -> Any:
    """MKL's function, or None where MKL is absent."""
    library = _mkl()
    # Looked up by item, ctypes gives a function of our own: pypardiso's has argument types that only its arrays fit.
    return None if library is None else library["pardiso"]


@functools.cache
def _mkl() -> Any:
    """MKL's library, or None where it is absent."""
    # Where pip installed it; pypardiso would search all installed files for it, which may take longer than a solve.
    try:
        files = distribution("mkl").files or []
    except PackageNotFoundError:
        files = []
    libraries = [file for file in files if re.match(r"(lib)?mkl_rt\b", file.name) and "lib" not in file.suffix]
    for path in (str(file.locate()) for file in libraries):
        if os.path.exists(path):
            return ctypes.CDLL(path)
    try:
        from pypardiso import PyPardisoSolver
    except ImportError:
        return None
    return PyPardisoSolver().libmkl


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
