"""The loops over elements. One set serves every law: a simple law enters as coefficients psi_1, psi_J and psi_JJ, any
other as its stress S and tangent D at the quadrature points (`materials.stress_at`).

With N = dN_a (reference gradient of a shape function), and c_a = cof(F) N_a the 3 x 3 block of nodes a, b is

    simple:  2 psi_1 (N_a.N_b) I + psi_JJ c_a c_b^T + psi_J (c_a c_b^T - c_b c_a^T)/J
    any:     B_a^T D B_b + (N_a . S N_b) I,   dE = sum over a of B_a dx_a
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softcal.checks import Floats, Ints
from softcal.kernel import kernel

# Places in the tangent's long array: half the memory of the default integers.
Places = NDArray[np.int32]

# Sums may be reordered and contracted; NaN and infinity keep their meaning.
FAST = {"contract", "reassoc", "nsz"}


@kernel(error_model="numpy", fastmath=FAST)
def kinematics(x: Floats, conn: Ints, dN: Floats, F: Floats, I1: Floats, I2: Floats, J: Floats) -> None:
    """Deformation gradients and their invariants.

    Parameters
    ----------
    x
        Positions of the points (n_points, 3) [m].
    conn
        Points of the tets (n_tets, n_a).
    dN
        Gradients of the shape functions (n_tets, n_q, n_a, 3) [1/m].
    F
        Deformation gradients (n_tets, n_q, 3, 3) [-], written.
    I1, I2, J
        Invariants (n_tets, n_q) [-], written.
    """
    n, n_q, n_a, _ = dN.shape
    for e in range(n):
        for q in range(n_q):
            for i in range(3):
                f0 = 0.0
                f1 = 0.0
                f2 = 0.0
                for a in range(n_a):
                    xi = x[conn[e, a], i]
                    f0 += xi * dN[e, q, a, 0]
                    f1 += xi * dN[e, q, a, 1]
                    f2 += xi * dN[e, q, a, 2]
                F[e, q, i, 0] = f0
                F[e, q, i, 1] = f1
                F[e, q, i, 2] = f2
            f = F[e, q]
            trace = 0.0
            square = 0.0
            for i in range(3):
                for j in range(3):
                    c = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
                    square += c * c
                    if i == j:
                        trace += c
            I1[e, q] = trace
            I2[e, q] = 0.5 * (trace * trace - square)
            J[e, q] = (
                f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1])
                - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
                + f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
            )


@kernel(error_model="numpy", fastmath=FAST, inline="always")
def _cofactor(f: Floats, c: Floats) -> None:
    c[0, 0] = f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1]
    c[0, 1] = f[1, 2] * f[2, 0] - f[1, 0] * f[2, 2]
    c[0, 2] = f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0]
    c[1, 0] = f[2, 1] * f[0, 2] - f[2, 2] * f[0, 1]
    c[1, 1] = f[2, 2] * f[0, 0] - f[2, 0] * f[0, 2]
    c[1, 2] = f[2, 0] * f[0, 1] - f[2, 1] * f[0, 0]
    c[2, 0] = f[0, 1] * f[1, 2] - f[0, 2] * f[1, 1]
    c[2, 1] = f[0, 2] * f[1, 0] - f[0, 0] * f[1, 2]
    c[2, 2] = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]


@kernel(error_model="numpy", fastmath=FAST)
def add_gradient(gradient: Floats, conn: Ints, dN: Floats, w: Floats, F: Floats, coefficients: Floats) -> None:
    """Add the forces of a simple law (neo-Hookean and its like).

    Parameters
    ----------
    gradient
        Gradient on all entities, changed.
    conn
        Points of the tets (n_tets, n_a).
    dN
        Gradients of the shape functions (n_tets, n_q, n_a, 3) [1/m].
    w
        Weights of the quadrature points (n_tets, n_q) [m^3].
    F
        Deformation gradients (n_tets, n_q, 3, 3) [-].
    coefficients
        Its rows are psi_1, psi_J and psi_JJ, derivatives of the law by I1 and J (3, n_tets * n_q) [Pa]; the last is not
        used.
    """
    n, n_q = w.shape
    cof = np.empty((3, 3))
    P = np.empty((3, 3))
    for e in range(n):
        for q in range(n_q):
            k = e * n_q + q
            f = F[e, q]
            _cofactor(f, cof)
            for i in range(3):
                for j in range(3):
                    P[i, j] = 2.0 * coefficients[0, k] * f[i, j] + coefficients[1, k] * cof[i, j]
            _add_forces(gradient, conn, dN, w, P, e, q)


@kernel(error_model="numpy", fastmath=FAST)
def add_stress_gradient(gradient: Floats, conn: Ints, dN: Floats, w: Floats, F: Floats, S: Floats) -> None:
    """Add the forces of stresses.

    Parameters
    ----------
    gradient
        Gradient on all entities, changed.
    conn
        Points of the tets (n_tets, n_a).
    dN
        Gradients of the shape functions (n_tets, n_q, n_a, 3) [1/m].
    w
        Weights of the quadrature points (n_tets, n_q) [m^3].
    F
        Deformation gradients (n_tets, n_q, 3, 3) [-].
    S
        Second Piola-Kirchhoff stresses (n_tets * n_q, 6) [Pa].
    """
    n, n_q = w.shape
    P = np.empty((3, 3))
    for e in range(n):
        for q in range(n_q):
            f, s = F[e, q], S[e * n_q + q]
            for i in range(3):
                P[i, 0] = f[i, 0] * s[0] + f[i, 1] * s[3] + f[i, 2] * s[5]
                P[i, 1] = f[i, 0] * s[3] + f[i, 1] * s[1] + f[i, 2] * s[4]
                P[i, 2] = f[i, 0] * s[5] + f[i, 1] * s[4] + f[i, 2] * s[2]
            _add_forces(gradient, conn, dN, w, P, e, q)


@kernel(error_model="numpy", fastmath=FAST, inline="always")
def _add_forces(gradient: Floats, conn: Ints, dN: Floats, w: Floats, P: Floats, e: int, q: int) -> None:
    for a in range(dN.shape[2]):
        at = 3 * conn[e, a]
        d0 = dN[e, q, a, 0] * w[e, q]
        d1 = dN[e, q, a, 1] * w[e, q]
        d2 = dN[e, q, a, 2] * w[e, q]
        for i in range(3):
            gradient[at + i] += P[i, 0] * d0 + P[i, 1] * d1 + P[i, 2] * d2


@kernel(error_model="numpy", fastmath=FAST)
def add_tangent(
    data: Floats, places: Places, dN: Floats, w: Floats, F: Floats, J: Floats, coefficients: Floats
) -> None:
    """Add the tangent of a simple law (neo-Hookean and its like).

    Parameters
    ----------
    data
        Entries of the tangent, changed.
    places
        Places of the blocks.
    dN
        Gradients of the shape functions (n_tets, n_q, n_a, 3) [1/m].
    w
        Weights of the quadrature points (n_tets, n_q) [m^3].
    F
        Deformation gradients (n_tets, n_q, 3, 3) [-].
    J
        Volume ratios (n_tets, n_q) [-].
    coefficients
        Derivatives psi_1, psi_J and psi_JJ of the law by I1 and J (3, n_tets * n_q) [Pa].
    """
    n, n_q, n_a, _ = dN.shape
    n_pairs = places.shape[1]
    c = np.empty((n_q, n_a, 3))
    cof = np.empty((3, 3))
    s = np.empty(n_q)
    t = np.empty(n_q)
    u = np.empty(n_q)
    for e in range(n):
        for q in range(n_q):
            k = e * n_q + q
            _cofactor(F[e, q], cof)
            for a in range(n_a):
                for i in range(3):
                    c[q, a, i] = cof[i, 0] * dN[e, q, a, 0] + cof[i, 1] * dN[e, q, a, 1] + cof[i, 2] * dN[e, q, a, 2]
            turn = coefficients[1, k] / J[e, q] * w[e, q]
            s[q] = 2.0 * coefficients[0, k] * w[e, q]
            t[q] = coefficients[2, k] * w[e, q] + turn
            u[q] = turn
        a = 0
        b = 0
        for m in range(n_pairs):
            k00 = k01 = k02 = k10 = k11 = k12 = k20 = k21 = k22 = 0.0
            for q in range(n_q):
                d = s[q] * (
                    dN[e, q, a, 0] * dN[e, q, b, 0] + dN[e, q, a, 1] * dN[e, q, b, 1] + dN[e, q, a, 2] * dN[e, q, b, 2]
                )
                a0 = c[q, a, 0]
                a1 = c[q, a, 1]
                a2 = c[q, a, 2]
                b0 = c[q, b, 0]
                b1 = c[q, b, 1]
                b2 = c[q, b, 2]
                v = t[q] - u[q]
                k00 += d + v * a0 * b0
                k11 += d + v * a1 * b1
                k22 += d + v * a2 * b2
                k01 += t[q] * a0 * b1 - u[q] * a1 * b0
                k10 += t[q] * a1 * b0 - u[q] * a0 * b1
                k02 += t[q] * a0 * b2 - u[q] * a2 * b0
                k20 += t[q] * a2 * b0 - u[q] * a0 * b2
                k12 += t[q] * a1 * b2 - u[q] * a2 * b1
                k21 += t[q] * a2 * b1 - u[q] * a1 * b2
            p0 = places[e, m, 0]
            p1 = places[e, m, 1]
            p2 = places[e, m, 2]
            data[p0] += k00
            data[p0 + 1] += k01
            data[p0 + 2] += k02
            data[p1 + 1] += k11
            data[p1 + 2] += k12
            data[p2 + 2] += k22
            if a != b:
                data[p1] += k10
                data[p2] += k20
                data[p2 + 1] += k21
            b += 1
            if b == n_a:
                a += 1
                b = a


@kernel(error_model="numpy", fastmath=FAST)
def add_both_linear(
    gradient: Floats,
    data: Floats,
    conn: Ints,
    places: Places,
    dN: Floats,
    w: Floats,
    F: Floats,
    J: Floats,
    coefficients: Floats,
) -> None:
    """`add_gradient` and `add_tangent` in one pass for linear tets and laws without I2, whose one quadrature point
    leaves nothing to be summed: twice as fast.

    Parameters
    ----------
    gradient
        Gradient on all entities, changed.
    data
        Entries of the tangent, changed.
    conn
        Points of the tets (n_tets, n_a).
    places
        Places of the blocks.
    dN
        Gradients of the shape functions (n_tets, n_q, n_a, 3) [1/m].
    w
        Weights of the quadrature points (n_tets, n_q) [m^3].
    F
        Deformation gradients (n_tets, n_q, 3, 3) [-].
    J
        Volume ratios (n_tets, n_q) [-].
    coefficients
        Derivatives psi_1, psi_J and psi_JJ of the law by I1 and J (3, n_tets * n_q) [Pa].
    """
    c = np.empty((4, 3))
    cof = np.empty((3, 3))
    for e in range(len(w)):
        f = F[e, 0]
        _cofactor(f, cof)
        by_F, by_cof = 2.0 * coefficients[0, e] * w[e, 0], coefficients[1, e] * w[e, 0]
        turn = coefficients[1, e] / J[e, 0] * w[e, 0]
        s = 2.0 * coefficients[0, e] * w[e, 0]
        t = coefficients[2, e] * w[e, 0] + turn
        v = t - turn
        g = dN[e, 0]
        for a in range(4):
            for i in range(3):
                c[a, i] = cof[i, 0] * g[a, 0] + cof[i, 1] * g[a, 1] + cof[i, 2] * g[a, 2]
                along = f[i, 0] * g[a, 0] + f[i, 1] * g[a, 1] + f[i, 2] * g[a, 2]
                gradient[3 * conn[e, a] + i] += by_F * along + by_cof * c[a, i]
        m = 0
        for a in range(4):
            a0, a1, a2 = c[a, 0], c[a, 1], c[a, 2]
            g0, g1, g2 = s * g[a, 0], s * g[a, 1], s * g[a, 2]
            d = g0 * g[a, 0] + g1 * g[a, 1] + g2 * g[a, 2]
            p0, p1, p2 = places[e, m, 0], places[e, m, 1], places[e, m, 2]
            data[p0] += d + v * a0 * a0
            data[p0 + 1] += v * a0 * a1
            data[p0 + 2] += v * a0 * a2
            data[p1 + 1] += d + v * a1 * a1
            data[p1 + 2] += v * a1 * a2
            data[p2 + 2] += d + v * a2 * a2
            m += 1
            for b in range(a + 1, 4):
                b0, b1, b2 = c[b, 0], c[b, 1], c[b, 2]
                d = g0 * g[b, 0] + g1 * g[b, 1] + g2 * g[b, 2]
                p0, p1, p2 = places[e, m, 0], places[e, m, 1], places[e, m, 2]
                data[p0] += d + v * a0 * b0
                data[p0 + 1] += t * a0 * b1 - turn * a1 * b0
                data[p0 + 2] += t * a0 * b2 - turn * a2 * b0
                data[p1] += t * a1 * b0 - turn * a0 * b1
                data[p1 + 1] += d + v * a1 * b1
                data[p1 + 2] += t * a1 * b2 - turn * a2 * b1
                data[p2] += t * a2 * b0 - turn * a0 * b2
                data[p2 + 1] += t * a2 * b1 - turn * a1 * b2
                data[p2 + 2] += d + v * a2 * b2
                m += 1


@kernel(error_model="numpy", fastmath=FAST)
def add_stress_tangent(data: Floats, places: Places, dN: Floats, w: Floats, F: Floats, S: Floats, D: Floats) -> None:
    """Add the tangent of stresses.

    Parameters
    ----------
    data
        Entries of the tangent, changed.
    places
        Places of the blocks.
    dN
        Gradients of the shape functions (n_tets, n_q, n_a, 3) [1/m].
    w
        Weights of the quadrature points (n_tets, n_q) [m^3].
    F
        Deformation gradients (n_tets, n_q, 3, 3) [-].
    S
        Second Piola-Kirchhoff stresses (n_tets * n_q, 6) [Pa].
    D
        Their tangents (n_tets * n_q, 6, 6) [Pa].
    """
    n, n_q, n_a, _ = dN.shape
    A = np.empty((3, 3, 3, 3))  # dP/dF: (i, k, j, l)
    T = np.empty((3, 3, 3 * n_a))  # A N_b: (i, k, 3 b + j)
    K = np.empty((3 * n_a, 3 * n_a))
    FD = np.empty((3, 3, 6))
    for e in range(n):
        K[:] = 0.0
        for q in range(n_q):
            p = e * n_q + q
            _first_tangent(F[e, q], S[p], D[p], w[e, q], FD, A)
            for i in range(3):
                for k in range(3):
                    t, own = T[i, k], A[i, k]
                    for b in range(n_a):
                        x, y, z = dN[e, q, b, 0], dN[e, q, b, 1], dN[e, q, b, 2]
                        for j in range(3):
                            t[3 * b + j] = own[j, 0] * x + own[j, 1] * y + own[j, 2] * z
            for a in range(n_a):
                x, y, z = dN[e, q, a, 0], dN[e, q, a, 1], dN[e, q, a, 2]
                for i in range(3):
                    row, t0, t1, t2 = K[3 * a + i], T[i, 0], T[i, 1], T[i, 2]
                    for c in range(3 * a, 3 * n_a):
                        row[c] += x * t0[c] + y * t1[c] + z * t2[c]
        m = 0
        for a in range(n_a):
            for b in range(a, n_a):
                for i in range(3):
                    for j in range(i if a == b else 0, 3):
                        data[places[e, m, i] + j] += K[3 * a + i, 3 * b + j]
                m += 1


@kernel(error_model="numpy", fastmath=FAST, inline="always")
def _first_tangent(f: Floats, s: Floats, d: Floats, weight: float, FD: Floats, A: Floats) -> None:
    """weight dP/dF (3, 3, 3, 3) of a stress s (6,) and its tangent d (6, 6): F_ia D_akbl F_jb + I_ij S_kl."""
    for i in range(3):
        for n in range(6):
            FD[i, 0, n] = weight * (f[i, 0] * d[0, n] + f[i, 1] * d[3, n] + f[i, 2] * d[5, n])
            FD[i, 1, n] = weight * (f[i, 0] * d[3, n] + f[i, 1] * d[1, n] + f[i, 2] * d[4, n])
            FD[i, 2, n] = weight * (f[i, 0] * d[5, n] + f[i, 1] * d[4, n] + f[i, 2] * d[2, n])
    for i in range(3):
        for k in range(3):
            g = FD[i, k]
            for j in range(3):
                A[i, k, j, 0] = g[0] * f[j, 0] + g[3] * f[j, 1] + g[5] * f[j, 2]
                A[i, k, j, 1] = g[3] * f[j, 0] + g[1] * f[j, 1] + g[4] * f[j, 2]
                A[i, k, j, 2] = g[5] * f[j, 0] + g[4] * f[j, 1] + g[2] * f[j, 2]
    for i in range(3):
        A[i, 0, i, 0] += weight * s[0]
        A[i, 1, i, 1] += weight * s[1]
        A[i, 2, i, 2] += weight * s[2]
        A[i, 0, i, 1] += weight * s[3]
        A[i, 1, i, 0] += weight * s[3]
        A[i, 1, i, 2] += weight * s[4]
        A[i, 2, i, 1] += weight * s[4]
        A[i, 0, i, 2] += weight * s[5]
        A[i, 2, i, 0] += weight * s[5]


@kernel(error_model="numpy", fastmath=FAST)
def interpolate(pressure: Floats, pressure_conn: Ints, N_p: Floats) -> Floats:
    """The pressures at the quadrature points (n_tets, n_q) [Pa].

    Parameters
    ----------
    pressure
        Pressures (n_pressures,) [Pa].
    pressure_conn
        Pressures of each tet (n_tets, n_b).
    N_p
        Their shape functions (n_tets, n_q, n_b) [-].
    """
    n, n_q, n_b = N_p.shape
    p = np.zeros((n, n_q))
    for e in range(n):
        for q in range(n_q):
            for b in range(n_b):
                p[e, q] += N_p[e, q, b] * pressure[pressure_conn[e, b]]
    return p


@kernel(error_model="numpy", fastmath=FAST)
def add_volume_gradient(gradient: Floats, n_x: int, pressure_conn: Ints, N_p: Floats, w: Floats, value: Floats) -> None:
    """Add the integrals of a value with the pressures' shape functions.

    Parameters
    ----------
    gradient
        Gradient on all entities, changed.
    n_x
        Number of the points' components, before the pressures.
    pressure_conn
        Pressures of each tet (n_tets, n_b).
    N_p
        Their shape functions (n_tets, n_q, n_b) [-].
    w
        Weights of the quadrature points (n_tets, n_q) [m^3].
    value
        The value (n_tets * n_q,).
    """
    n, n_q, n_b = N_p.shape
    for e in range(n):
        for q in range(n_q):
            v = value[e * n_q + q] * w[e, q]
            for b in range(n_b):
                gradient[n_x + pressure_conn[e, b]] += v * N_p[e, q, b]


@kernel(error_model="numpy", fastmath=FAST)
def add_coupling(
    data: Floats,
    coupling: Places,
    pressure_places: Places,
    dN: Floats,
    w: Floats,
    F: Floats,
    J: Floats,
    N_p: Floats,
    dg: Floats,
    compliance: float,
) -> None:
    """Add the displacement-pressure blocks g'(J) c_a N_b and the pressure blocks -N_b N_d / kappa.

    Parameters
    ----------
    data
        Entries of the tangent, changed.
    coupling, pressure_places
        Places of the blocks.
    dN
        Gradients of the shape functions (n_tets, n_q, n_a, 3) [1/m].
    w
        Weights of the quadrature points (n_tets, n_q) [m^3].
    F
        Deformation gradients (n_tets, n_q, 3, 3) [-].
    J
        Volume ratios (n_tets, n_q) [-].
    N_p
        Shape functions of the pressures (n_tets, n_q, n_b) [-].
    dg
        g'(J) (n_tets * n_q,) [-].
    compliance
        1 / kappa [1/Pa].
    """
    n, n_q, n_a, _ = dN.shape
    n_b = N_p.shape[2]
    cof = np.empty((3, 3))
    block = np.empty((n_a, n_b, 3))
    for e in range(n):
        block[:] = 0.0
        for q in range(n_q):
            _cofactor(F[e, q], cof)
            scale = dg[e * n_q + q] * w[e, q]
            for a in range(n_a):
                for i in range(3):
                    c = cof[i, 0] * dN[e, q, a, 0] + cof[i, 1] * dN[e, q, a, 1] + cof[i, 2] * dN[e, q, a, 2]
                    for b in range(n_b):
                        block[a, b, i] += scale * c * N_p[e, q, b]
        for a in range(n_a):
            for b in range(n_b):
                for i in range(3):
                    data[coupling[e, a, b, i]] += block[a, b, i]
        m = 0
        for b in range(n_b):
            for d in range(b, n_b):
                total = 0.0
                for q in range(n_q):
                    total += w[e, q] * N_p[e, q, b] * N_p[e, q, d]
                data[pressure_places[e, m]] -= compliance * total
                m += 1
