"""Stress and tangent at points, from the derivatives of an energy by invariants, or by principal stretches.

S is the second Piola-Kirchhoff stress, D = dS/dE with the shears of E doubled; components in the order of
`components.PAIRS`.
"""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.kernel import kernel
from softcal.materials.components import PAIRS

FIRST_OF = tuple(i for i, _ in PAIRS)
SECOND_OF = tuple(j for _, j in PAIRS)
FAST = {"contract", "reassoc", "nsz"}
ALIKE = 1e-5  # squared stretches nearer than this, relative to them, have the limit of their difference quotient


@kernel(error_model="numpy", fastmath=FAST, inline="always")
def _green(f: Floats, C: Floats) -> None:
    for m in range(6):
        i, j = FIRST_OF[m], SECOND_OF[m]
        C[m] = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]


@kernel(error_model="numpy", fastmath=FAST, inline="always")
def _adjugate(C: Floats, A: Floats) -> None:
    """J^2 C^-1 of symmetric C."""
    A[0] = C[1] * C[2] - C[4] * C[4]
    A[1] = C[0] * C[2] - C[5] * C[5]
    A[2] = C[0] * C[1] - C[3] * C[3]
    A[3] = C[4] * C[5] - C[3] * C[2]
    A[4] = C[3] * C[5] - C[4] * C[0]
    A[5] = C[3] * C[4] - C[5] * C[1]


@kernel(error_model="numpy", fastmath=FAST, inline="always")
def _add_inverse(D: Floats, A: Floats, whole: float, turned: float) -> None:
    """Add to the upper triangle whole A_m A_n + turned (A_ik A_jl + A_il A_jk) / 2."""
    M = ((A[0], A[3], A[5]), (A[3], A[1], A[4]), (A[5], A[4], A[2]))
    for m in range(6):
        i, j = FIRST_OF[m], SECOND_OF[m]
        for n in range(m, 6):
            r, s = FIRST_OF[n], SECOND_OF[n]
            D[m, n] += whole * A[m] * A[n] + 0.5 * turned * (M[i][r] * M[j][s] + M[i][s] * M[j][r])


@kernel(error_model="numpy", fastmath=FAST, inline="always")
def _mirror(D: Floats) -> None:
    for m in range(6):
        for n in range(m):
            D[m, n] = D[n, m]


@kernel(error_model="numpy", fastmath=FAST)
def from_invariants(
    F: Floats, I1: Floats, J: Floats, rows: Floats, directions: Floats, with_tangent: bool, S: Floats, D: Floats
) -> None:
    """Stress and tangent by the invariants.

    Parameters
    ----------
    F
        Deformation gradients (n, 3, 3).
    I1, J
        Invariants (n,).
    rows
        `CompiledLaw.rows`, of all points.
    directions
        Unit vectors of a law in I4, then of I6 (n, 1 or 2, 3); (1, …) where they are the same everywhere.
    with_tangent
        Whether the tangent is wanted.
    S
        Second Piola-Kirchhoff stress (n, 6) [Pa], written.
    D
        Its tangent (n, 6, 6) [Pa], written on demand.
    """
    k = len(rows) if len(rows) < 9 else round(0.5 * (np.sqrt(9.0 + 8.0 * len(rows)) - 3.0))  # k + k (k + 1) / 2 rows
    G, H = np.zeros((k, 6)), np.zeros((k, 6))
    C, A = np.empty(6), np.empty(6)
    G[0, :3] = 2.0
    for p in range(len(F)):
        if p < len(directions):
            for a in range(3, k):
                for m in range(6):
                    G[a, m] = 2.0 * directions[p, a - 3, FIRST_OF[m]] * directions[p, a - 3, SECOND_OF[m]]
        _green(F[p], C)
        _adjugate(C, A)
        by_J = 1.0 / J[p]
        for m in range(6):
            G[1, m] = (2.0 * I1[p] if m < 3 else 0.0) - 2.0 * C[m]
            G[2, m] = A[m] * by_J
            total = 0.0
            for a in range(k):
                total += rows[a, p] * G[a, m]
            S[p, m] = total
        if not with_tangent:
            continue
        for a in range(k):
            for n in range(6):
                H[a, n] = 0.0
        row = k
        for a in range(k):
            for b in range(a, k):
                h = rows[row, p]
                row += 1
                if h != 0.0:
                    for n in range(6):
                        H[a, n] += h * G[b, n]
                        if a != b:
                            H[b, n] += h * G[a, n]
        d = D[p]
        for m in range(6):
            for n in range(m, 6):
                v = 0.0
                for a in range(k):
                    v += G[a, m] * H[a, n]
                d[m, n] = v
        by_2 = 4.0 * rows[1, p]
        if by_2 != 0.0:
            d[0, 1] += by_2
            d[0, 2] += by_2
            d[1, 2] += by_2
            for m in range(3, 6):
                d[m, m] -= 0.5 * by_2
        of_J = rows[2, p] * by_J**3
        _add_inverse(d, A, of_J, -2.0 * of_J)
        _mirror(d)


@kernel(error_model="numpy", fastmath=FAST)
def add_volumetric(F: Floats, J: Floats, by_J: Floats, by_JJ: Floats, with_tangent: bool, S: Floats, D: Floats) -> None:
    """Add the part of an energy by J alone.

    Parameters
    ----------
    F
        Deformation gradients (n, 3, 3).
    J
        Volume ratios (n,) [-].
    by_J, by_JJ
        Derivatives of that part (n,) [Pa].
    with_tangent
        Whether the tangent is wanted.
    S
        Second Piola-Kirchhoff stress (n, 6) [Pa], changed.
    D
        Its tangent (n, 6, 6) [Pa], changed on demand.
    """
    C, A = np.empty(6), np.empty(6)
    for p in range(len(F)):
        _green(F[p], C)
        _adjugate(C, A)
        one = by_J[p] / J[p]
        for m in range(6):
            S[p, m] += one * A[m]
        if with_tangent:
            of_J = by_J[p] / J[p] ** 3
            _add_inverse(D[p], A, by_JJ[p] / J[p] ** 2 + of_J, -2.0 * of_J)
            _mirror(D[p])


@kernel(error_model="numpy")
def principal(F: Floats, squares: Floats, axes: Floats) -> None:
    """Principal stretches and axes of C = F^T F.

    The eigenvalue that is furthest from the others by the cubic's formula, its axis from the rows of C less it, and the
    other two from the plane across it (Scherzinger and Dohrmann, Comput. Methods Appl. Mech. Engrg. 197 (2008) 4007).

    Parameters
    ----------
    F
        Deformation gradients (n, 3, 3).
    squares
        Squares of the stretches (3, n) [-], written.
    axes
        Axes in columns (n, 3, 3), written.
    """
    C = np.empty(6)
    M, r = np.empty((3, 3)), np.empty((3, 3))
    s, t, n = np.empty(3), np.empty(3), np.empty(3)
    for p in range(len(F)):
        _green(F[p], C)
        mean = (C[0] + C[1] + C[2]) / 3.0
        for m in range(6):
            M[FIRST_OF[m], SECOND_OF[m]] = C[m]
            M[SECOND_OF[m], FIRST_OF[m]] = C[m]
        square = 0.0
        for i in range(3):
            M[i, i] -= mean
            for j in range(3):
                square += 0.5 * M[i, j] * M[i, j]
        axis = axes[p]
        if square <= (1e-15 * mean) ** 2:
            for i in range(3):
                for j in range(3):
                    axis[i, j] = 1.0 if i == j else 0.0
                squares[i, p] = mean
            continue
        det = (
            M[0, 0] * (M[1, 1] * M[2, 2] - M[1, 2] * M[2, 1])
            - M[0, 1] * (M[1, 0] * M[2, 2] - M[1, 2] * M[2, 0])
            + M[0, 2] * (M[1, 0] * M[2, 1] - M[1, 1] * M[2, 0])
        )
        size = np.sqrt(square / 3.0)
        angle = np.arccos(min(0.5 * abs(det) / size**3, 1.0)) / 3.0
        apart = (1.0 if det >= 0.0 else -1.0) * 2.0 * size * np.cos(angle)
        # The image of M less its eigenvalue is the plane across the axis: its two best independent rows span it.
        best, longest = 0, -1.0
        for i in range(3):
            length = 0.0
            for j in range(3):
                r[i, j] = M[i, j] - (apart if i == j else 0.0)
                length += r[i, j] * r[i, j]
            if length > longest:
                best, longest = i, length
        for j in range(3):
            s[j] = r[best, j] / np.sqrt(longest)
        longest = -1.0
        for k in range(1, 3):
            i = (best + k) % 3
            along = s[0] * r[i, 0] + s[1] * r[i, 1] + s[2] * r[i, 2]
            v0, v1, v2 = r[i, 0] - along * s[0], r[i, 1] - along * s[1], r[i, 2] - along * s[2]
            length = v0 * v0 + v1 * v1 + v2 * v2
            if length > longest:
                longest = length
                t[0], t[1], t[2] = v0, v1, v2
        a, b, c, own = 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            t[i] /= np.sqrt(longest)
        for i in range(3):
            n[i] = s[(i + 1) % 3] * t[(i + 2) % 3] - s[(i + 2) % 3] * t[(i + 1) % 3]
        for i in range(3):
            for j in range(3):
                a += s[i] * M[i, j] * s[j]
                b += t[i] * M[i, j] * t[j]
                c += s[i] * M[i, j] * t[j]
                own += n[i] * M[i, j] * n[j]
        half = np.sqrt(0.25 * (a - b) ** 2 + c * c)
        # The first axis in the plane is at half the angle of ((a - b) / 2, c): its larger part first.
        x, y = 1.0, 0.0
        if half > 0.0:
            large = np.sqrt(0.5 + 0.25 * abs(a - b) / half)
            small = 0.5 * c / (half * large)
            x, y = (large, small) if a >= b else (abs(small), large if c >= 0.0 else -large)
        for i in range(3):
            axis[i, 0] = n[i]
            axis[i, 1] = x * s[i] + y * t[i]
            axis[i, 2] = x * t[i] - y * s[i]
        squares[0, p] = mean + own
        squares[1, p] = mean + 0.5 * (a + b) + half
        squares[2, p] = mean + 0.5 * (a + b) - half


@kernel(error_model="numpy", fastmath=FAST)
def from_stretches(squares: Floats, axes: Floats, rows: Floats, with_tangent: bool, S: Floats, D: Floats) -> None:
    """Stress and tangent by the logarithms of the principal stretches.

    Parameters
    ----------
    squares, axes
        Squares of the stretches (3, n) [-], and their axes (n, 3, 3), see `principal`.
    rows
        `CompiledLaw.rows`, of all points.
    with_tangent
        Whether the tangent is wanted.
    S
        Second Piola-Kirchhoff stress (n, 6) [Pa], written.
    D
        Its tangent (n, 6, 6) [Pa], written on demand.
    """
    own, d = np.empty(3), np.empty((3, 3))
    N, M = np.empty((6, 6)), np.empty((6, 6))  # of n_i n_i^T, then of the symmetric n_i n_j^T
    for p in range(squares.shape[1]):
        n = axes[p]
        for k in range(6):
            i, j = FIRST_OF[k], SECOND_OF[k]
            for m in range(6):
                a, b = FIRST_OF[m], SECOND_OF[m]
                N[k, m] = 0.5 * (n[a, i] * n[b, j] + n[a, j] * n[b, i])
        for i in range(3):
            own[i] = rows[i, p] / squares[i, p]
        for m in range(6):
            S[p, m] = own[0] * N[0, m] + own[1] * N[1, m] + own[2] * N[2, m]
        if not with_tangent:
            continue
        row = 3
        for i in range(3):
            for j in range(i, 3):
                d[i, j] = rows[row, p] / (squares[i, p] * squares[j, p])
                d[j, i] = d[i, j]
                row += 1
            d[i, i] -= 2.0 * own[i] / squares[i, p]
        t = D[p]
        for i in range(3):
            for m in range(6):
                M[i, m] = d[i, 0] * N[0, m] + d[i, 1] * N[1, m] + d[i, 2] * N[2, m]
        for k in range(3, 6):
            i, j = FIRST_OF[k], SECOND_OF[k]
            ci, cj = squares[i, p], squares[j, p]
            if abs(ci - cj) > ALIKE * (ci + cj):
                shear = (own[i] - own[j]) / (ci - cj)
            else:
                shear = 0.25 * (d[i, i] + d[j, j] - 2.0 * d[i, j])
            for m in range(6):
                M[k, m] = 4.0 * shear * N[k, m]
        for m in range(6):
            for q in range(m, 6):
                v = 0.0
                for k in range(6):
                    v += N[k, m] * M[k, q]
                t[m, q] = v
        _mirror(t)
