"""A strain of any exponent, free of the change of volume, with its derivatives by the Green-Lagrange strain.

    A = sum_a sinh(m x_a) / m  N_a N_a,    x_a = ln lambda_a - ln J / 3

N_a being the principal axes of C. m = 0 is the logarithmic strain; m = 1 is (U - U^-1) / 2 and m = 2 is (C - C^-1) / 4
of the stretch without its change of volume. All are the small strain's deviator where that is small.

Hill, Adv. Appl. Mech. 18 (1978) 1; Curnier and Rakotomanana, Eng. Trans. 39 (1991) 461; the derivatives by divided
differences: Daletskii and Krein; Miehe and Lambrecht, Commun. Numer. Meth. Engng. 17 (2001) 337.
"""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.kernel import kernel
from softcal.materials.components import PAIRS, TWICE, doubled, full
from softcal.materials.stress_at import NO_TANGENT

_I = tuple(i for i, _ in PAIRS)
_J = tuple(j for _, j in PAIRS)
_ALIKE = 1e-5  # squared stretches that are nearer, relative to them, have the limit of their second difference


class MeasuredStrain:
    """A at points, from Green-Lagrange strains E (n, 6) with doubled shears; m: the exponent."""

    def __init__(self, E: Floats, m: float) -> None:
        self.m = float(m)
        squares, self._axes = np.linalg.eigh(2.0 * full(E / TWICE) + np.eye(3))
        x = 0.5 * np.log(squares)
        self._x: Floats = x - x.mean(axis=1, keepdims=True)
        self._squares: Floats = squares
        self.A: Floats = self._along_axes(self._x * _sinhc(m * self._x))
        """The strain (n, 6), its shears doubled."""

    def derivatives(self, T: Floats, *, second: bool) -> tuple[Floats, Floats]:
        """dA/dE (n, 6, 6), and T : d2A/dE2 (n, 6, 6) [Pa] of a stress T (n, 6), empty where it is not wanted."""
        n = len(self.A)
        slopes, bend = np.empty((n, 6, 6)), np.empty((n, 6, 6)) if second else NO_TANGENT
        _derivatives(self._x, self._squares, self._axes, self.m, np.ascontiguousarray(T), second, slopes, bend)
        return slopes, bend

    def by_exponent(self, T: Floats) -> tuple[Floats, Floats]:
        """dA/dm (n, 6), and its product with T by E, T : d2A/dE dm (n, 6) [Pa]."""
        slopes = np.empty((len(self.A), 6, 6))
        _slopes_by_exponent(self._x, self._squares, self._axes, self.m, slopes)
        dA = self._along_axes(self._x**2 * _sinhc_slope(self.m * self._x))
        return dA, np.einsum("nm,nmk->nk", T, slopes)

    def _along_axes(self, values: Floats) -> Floats:
        return doubled(np.einsum("nia,na,nja->nij", self._axes, values, self._axes))


def _sinhc(y: Floats) -> Floats:
    """sinh(y) / y."""
    small = np.abs(y) < 1e-4
    at = np.where(small, 1.0, y)
    return np.where(small, 1.0 + y**2 / 6.0, np.sinh(at) / at)


def _sinhc_slope(y: Floats) -> Floats:
    small = np.abs(y) < 1e-2
    at = np.where(small, 1.0, y)
    return np.where(small, y / 3.0 + y**3 / 30.0 + y**5 / 840.0, (at * np.cosh(at) - np.sinh(at)) / at**2)


@kernel()
def _one_sinhc(y: float) -> float:
    return 1.0 + y * y / 6.0 if abs(y) < 1e-4 else np.sinh(y) / y


@kernel()
def _one_sinhc_slope(y: float) -> float:
    return y / 3.0 + y**3 / 30.0 + y**5 / 840.0 if abs(y) < 1e-2 else (y * np.cosh(y) - np.sinh(y)) / (y * y)


@kernel()
def _difference(x: float, z: float, m: float) -> float:
    """(g(c_a) - g(c_b)) / (c_a - c_b) of g(c) = sinh(m x) / m, c = exp(2 x): stable where both are equal."""
    s, d = x + z, x - z
    return 0.5 * np.cosh(0.5 * m * s) * _one_sinhc(0.5 * m * d) / (np.exp(s) * _one_sinhc(d))


@kernel()
def _difference_by_exponent(x: float, z: float, m: float) -> float:
    s, d = x + z, x - z
    y = 0.5 * m * d
    top = 0.5 * s * np.sinh(0.5 * m * s) * _one_sinhc(y) + 0.5 * d * np.cosh(0.5 * m * s) * _one_sinhc_slope(y)
    return 0.5 * top / (np.exp(s) * _one_sinhc(d))


@kernel()
def _second_difference(x: float, y: float, z: float, m: float) -> float:
    """The second divided difference of g at three squared stretches."""
    low, high = min(x, y, z), max(x, y, z)
    between = x + y + z - low - high
    below, above = np.exp(2.0 * low), np.exp(2.0 * high)
    if above - below > _ALIKE * above:
        return (_difference(high, between, m) - _difference(low, between, m)) / (above - below)
    c = (np.exp(2.0 * x) + np.exp(2.0 * y) + np.exp(2.0 * z)) / 3.0
    at = 0.5 * np.log(c)
    return (m * np.sinh(m * at) - 2.0 * np.cosh(m * at)) / (8.0 * c * c)


@kernel()
def _changes(squares: Floats, N: Floats, barred: Floats, H: Floats, traces: Floats) -> None:
    """H (6, 3, 3): the change of the isochoric C along its axes by each component of E; traces (6,): C^-1 : dC."""
    for k in range(6):
        i, j = _I[k], _J[k]
        traces[k] = 0.0
        for a in range(3):
            for b in range(3):
                H[k, a, b] = N[i, a] * N[j, b] + N[j, a] * N[i, b]
            traces[k] += H[k, a, a] / squares[a]
        for a in range(3):
            for b in range(3):
                H[k, a, b] *= barred[a] / squares[a]
            H[k, a, a] -= barred[a] * traces[k] / 3.0


@kernel()
def _slope(N: Floats, first: Floats, H: Floats, slopes: Floats) -> None:
    """The change of A by each component of E, with differences `first` (3, 3) of its eigenvalues."""
    for k in range(6):
        for c in range(6):
            i, j = _I[c], _J[c]
            total = 0.0
            for a in range(3):
                for b in range(3):
                    total += N[i, a] * first[a, b] * H[k, a, b] * N[j, b]
            slopes[c, k] = total if c < 3 else 2.0 * total


@kernel()
def _derivatives(
    x: Floats, squares: Floats, axes: Floats, m: float, T: Floats, second: bool, slopes: Floats, bend: Floats
) -> None:
    first, H, traces = np.empty((3, 3)), np.empty((6, 3, 3)), np.empty(6)
    t, Y, Z = np.empty((3, 3)), np.empty((3, 3)), np.empty((6, 3, 3))
    for p in range(len(x)):
        N, barred = axes[p], np.exp(2.0 * x[p])
        _changes(squares[p], N, barred, H, traces)
        for a in range(3):
            for b in range(3):
                first[a, b] = _difference(x[p, a], x[p, b], m)
        _slope(N, first, H, slopes[p])
        if not second:
            continue
        for a in range(3):
            for b in range(3):
                t[a, b] = 0.0
                for c in range(6):
                    i, j = _I[c], _J[c]
                    pair = N[i, a] * N[j, b]
                    t[a, b] += T[p, c] * (pair if c < 3 else pair + N[j, a] * N[i, b])
                Y[a, b] = first[a, b] * t[a, b]
        on_C = Y[0, 0] * barred[0] + Y[1, 1] * barred[1] + Y[2, 2] * barred[2]
        for k in range(6):
            for c in range(3):
                for b in range(3):
                    total = 0.0
                    for a in range(3):
                        total += t[a, b] * _second_difference(x[p, a], x[p, c], x[p, b], m) * H[k, a, c]
                    Z[k, c, b] = 2.0 * total
        for k in range(6):
            for n in range(k, 6):
                total = 0.0
                Yk, Yn, both = 0.0, 0.0, 0.0
                for a in range(3):
                    for b in range(3):
                        total += Z[k, a, b] * H[n, a, b]
                        # The whole changes of C, over J^(2/3): with their part along C.
                        along = 1.0 if a == b else 0.0
                        whole_k = H[k, a, b] + along * barred[a] * traces[k] / 3.0
                        whole_n = H[n, a, b] + along * barred[a] * traces[n] / 3.0
                        Yk += Y[a, b] * whole_k
                        Yn += Y[a, b] * whole_n
                        both += whole_k * whole_n / (barred[a] * barred[b])
                total -= (traces[n] * Yk + traces[k] * Yn) / 3.0
                total += (traces[k] * traces[n] / 9.0 + both / 3.0) * on_C
                bend[p, k, n] = bend[p, n, k] = total


@kernel()
def _slopes_by_exponent(x: Floats, squares: Floats, axes: Floats, m: float, slopes: Floats) -> None:
    first, H, traces = np.empty((3, 3)), np.empty((6, 3, 3)), np.empty(6)
    for p in range(len(x)):
        _changes(squares[p], axes[p], np.exp(2.0 * x[p]), H, traces)
        for a in range(3):
            for b in range(3):
                first[a, b] = _difference_by_exponent(x[p, a], x[p, b], m)
        _slope(axes[p], first, H, slopes[p])
