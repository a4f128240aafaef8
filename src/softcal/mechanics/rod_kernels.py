"""The loops over the elements of rods.

With everything in space, about the current state (see `rod.py` for the element):

    P = x_b - x_a,   exp(theta) = Lambda_b Lambda_a^T,   A = Jl^-1(theta) = I - [theta]/2 + beta [theta]^2
    rho = A P,       d theta = A eta,                    eta = omega_b - omega_a - omega_a x omega_b / 2 + ...

Lambda_a^T (rho, theta) are the coordinates that the energy is quadratic in. beta and its derivatives
b1 = beta'/|theta|, b2 = b1'/|theta| are all the transcendental functions there are.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from softcal.checks import Floats, Ints

# beta = sum of BETA[k] |theta|^(2k): the coefficients of (1 - x/2 cot x/2) / x^2.
BETA = (
    1.0 / 12.0,
    1.0 / 720.0,
    1.0 / 30240.0,
    1.0 / 1209600.0,
    1.0 / 47900160.0,
    691.0 / 1307674368000.0,
    1.0 / 74724249600.0,
    3617.0 / 10670622842880000.0,
    43867.0 / 5109094217170944000.0,
    174611.0 / 802857662698291200000.0,
    77683.0 / 14101100039391805440000.0,
    236364091.0 / 1693824136731743669452800000.0,
)


@numba.njit(cache=True, error_model="numpy")
def stiffness(by_bending: Floats, by_shear: Floats, E: float, nu: float, S: Floats) -> None:
    """S = E (by_bending + (1 + nu) by_shear)^-1 per element, by Cholesky's factors."""
    L = np.zeros((6, 6))
    for e in range(len(S)):
        for i in range(6):
            for j in range(i + 1):
                total = by_bending[e, i, j] + (1.0 + nu) * by_shear[e, i, j]
                for k in range(j):
                    total -= L[i, k] * L[j, k]
                L[i, j] = math.sqrt(total) if i == j else total / L[j, j]
        for j in range(6):  # the inverse of L in its own place, column by column
            L[j, j] = 1.0 / L[j, j]
            for i in range(j + 1, 6):
                total = 0.0
                for k in range(j, i):
                    total -= L[i, k] * L[k, j]
                L[i, j] = total / L[i, i]
        for i in range(6):
            for j in range(i + 1):
                total = 0.0
                for k in range(i, 6):
                    total += L[k, i] * L[k, j]
                S[e, i, j] = E * total
                S[e, j, i] = E * total


@numba.njit(cache=True, error_model="numpy")
def coordinates(
    position: Floats,
    rotation: Floats,
    frames: Ints,
    arm: Floats,
    triad: Floats,
    xi: Floats,
    turn: Floats,
) -> None:
    """Lambda_a^T (rho, theta) (n, 6) and |theta| (n,) of all elements."""
    w = np.zeros((8, 3))
    La, Lb, Q = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for e in range(len(frames)):
        _ends(position, rotation, frames[e], arm[e], triad[e], La, Lb, w)
        _relative(La, Lb, Q)
        _rotation_vector(Q, w[4])
        beta, _, _ = _beta(w[4])
        _tangent_matrix(w[4], beta, Q)
        for i in range(3):
            w[5, i] = Q[i, 0] * w[3, 0] + Q[i, 1] * w[3, 1] + Q[i, 2] * w[3, 2]
        turn[e] = math.sqrt(w[4, 0] ** 2 + w[4, 1] ** 2 + w[4, 2] ** 2)
        for i in range(3):
            xi[e, i] = La[0, i] * w[5, 0] + La[1, i] * w[5, 1] + La[2, i] * w[5, 2]
            xi[e, 3 + i] = La[0, i] * w[4, 0] + La[1, i] * w[4, 1] + La[2, i] * w[4, 2]


@numba.njit(cache=True, error_model="numpy")
def derivatives(
    position: Floats,
    rotation: Floats,
    frames: Ints,
    arm: Floats,
    triad: Floats,
    conjugate: Floats,
    S: Floats,
    with_tangent: bool,
    gradient: Floats,
    tangent: Floats,
) -> None:
    """Gradient (n, 12) that conjugate (n, 6) = dE/d(Lambda_a^T (rho, theta)) makes, and the tangent (n, 12, 12) with S
    the second derivative of E.
    """
    w = np.zeros((16, 3))
    La, Lb = np.empty((3, 3)), np.empty((3, 3))
    A, D, G = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    H, M, N = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    J, SJ, K = np.zeros((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    KT = np.empty((6, 12))
    arm_b, e_ab, P, theta = w[1], w[2], w[3], w[4]
    f, mu, g_P, g_eta, g_theta = w[5], w[6], w[7], w[8], w[9]
    for e in range(len(frames)):
        _ends(position, rotation, frames[e], arm[e], triad[e], La, Lb, w)
        _relative(La, Lb, A)
        _rotation_vector(A, theta)
        beta, b1, b2 = _beta(theta)
        _tangent_matrix(theta, beta, A)
        for i in range(3):
            f[i] = La[i, 0] * conjugate[e, 0] + La[i, 1] * conjugate[e, 1] + La[i, 2] * conjugate[e, 2]
            mu[i] = La[i, 0] * conjugate[e, 3] + La[i, 1] * conjugate[e, 4] + La[i, 2] * conjugate[e, 5]
        _turning(f, theta, beta, b1, G, w)
        for i in range(3):
            g_theta[i] = mu[i] + G[i, 0] * P[0] + G[i, 1] * P[1] + G[i, 2] * P[2]
        for i in range(3):
            g_P[i] = A[0, i] * f[0] + A[1, i] * f[1] + A[2, i] * f[2]
            g_eta[i] = A[0, i] * g_theta[0] + A[1, i] * g_theta[1] + A[2, i] * g_theta[2]
        for i in range(3):
            gradient[e, i] = -g_P[i]
            gradient[e, 6 + i] = g_P[i]
        _cross(e_ab, g_P, w[10])
        _cross(arm_b, g_P, w[11])
        for i in range(3):
            gradient[e, 3 + i] = -w[10, i] - g_eta[i]
            gradient[e, 9 + i] = w[11, i] + g_eta[i]
        if not with_tangent:
            continue

        # J: Lambda_a^T (rho, theta) by (P, eta).
        _turning(P, theta, beta, b1, D, w)
        _add_spin(-P[0], -P[1], -P[2], D)
        for i in range(3):
            for j in range(3):
                M[i, j] = D[0, i] * A[0, j] + D[1, i] * A[1, j] + D[2, i] * A[2, j]
        for i in range(3):
            for j in range(3):
                a = La[0, i] * A[0, j] + La[1, i] * A[1, j] + La[2, i] * A[2, j]
                J[i, j] = a
                J[3 + i, 3 + j] = a
                J[i, 3 + j] = La[0, i] * M[0, j] + La[1, i] * M[1, j] + La[2, i] * M[2, j]
        for i in range(6):
            for j in range(3):
                SJ[i, j] = S[e, i, 0] * J[0, j] + S[e, i, 1] * J[1, j] + S[e, i, 2] * J[2, j]
            for j in range(3, 6):
                total = 0.0
                for k in range(6):
                    total += S[e, i, k] * J[k, j]
                SJ[i, j] = total
        for i in range(3):
            for j in range(6):
                K[i, j] = J[0, i] * SJ[0, j] + J[1, i] * SJ[1, j] + J[2, i] * SJ[2, j]
        for i in range(3, 6):
            for j in range(3, 6):
                total = 0.0
                for k in range(6):
                    total += J[k, i] * SJ[k, j]
                K[i, j] = total

        # The same by the curvature of (rho, theta) in (P, eta).
        for i in range(3):
            for j in range(3):
                K[j, 3 + i] += A[0, i] * G[0, j] + A[1, i] * G[1, j] + A[2, i] * G[2, j]
        _second(f, P, theta, beta, b1, b2, H)
        _turning(g_theta, theta, beta, b1, G, w)
        for i in range(3):
            for j in range(3):
                M[i, j] = H[i, 0] * A[0, j] + H[i, 1] * A[1, j] + H[i, 2] * A[2, j]
                N[i, j] = A[0, i] * G[0, j] + A[1, i] * G[1, j] + A[2, i] * G[2, j]
        for i in range(3):
            for j in range(3):
                curved = A[0, i] * M[0, j] + A[1, i] * M[1, j] + A[2, i] * M[2, j]
                K[3 + i, 3 + j] += curved + 0.5 * (N[i, j] + N[j, i])
        for i in range(3):
            for j in range(3):
                K[3 + i, j] = K[j, 3 + i]

        _spread(K, e_ab, arm_b, KT, tangent[e])
        _bend(tangent[e], g_P, g_eta, e_ab, arm_b)


@numba.njit(cache=True, error_model="numpy")
def _spread(K: Floats, e_ab: Floats, arm_b: Floats, KT: Floats, out: Floats) -> None:
    """T^T K T with (dP, eta) = T (dc_a, omega_a, dc_b, omega_b):
    dP = dc_b - dc_a + omega_b x arm_b - omega_a x e_ab and eta = omega_b - omega_a.
    """
    for i in range(6):
        k0, k1, k2 = K[i, 0], K[i, 1], K[i, 2]
        for j in range(3):
            KT[i, j] = -K[i, j]
            KT[i, 6 + j] = K[i, j]
        KT[i, 3] = k1 * e_ab[2] - k2 * e_ab[1] - K[i, 3]
        KT[i, 4] = k2 * e_ab[0] - k0 * e_ab[2] - K[i, 4]
        KT[i, 5] = k0 * e_ab[1] - k1 * e_ab[0] - K[i, 5]
        KT[i, 9] = arm_b[1] * k2 - arm_b[2] * k1 + K[i, 3]
        KT[i, 10] = arm_b[2] * k0 - arm_b[0] * k2 + K[i, 4]
        KT[i, 11] = arm_b[0] * k1 - arm_b[1] * k0 + K[i, 5]
    for j in range(12):
        k0, k1, k2 = KT[0, j], KT[1, j], KT[2, j]
        for i in range(3):
            out[i, j] = -KT[i, j]
            out[6 + i, j] = KT[i, j]
        out[3, j] = k1 * e_ab[2] - k2 * e_ab[1] - KT[3, j]
        out[4, j] = k2 * e_ab[0] - k0 * e_ab[2] - KT[4, j]
        out[5, j] = k0 * e_ab[1] - k1 * e_ab[0] - KT[5, j]
        out[9, j] = arm_b[1] * k2 - arm_b[2] * k1 + KT[3, j]
        out[10, j] = arm_b[2] * k0 - arm_b[0] * k2 + KT[4, j]
        out[11, j] = arm_b[0] * k1 - arm_b[1] * k0 + KT[5, j]


@numba.njit(cache=True, error_model="numpy")
def _bend(out: Floats, g: Floats, g_eta: Floats, e_ab: Floats, arm_b: Floats) -> None:
    """Add what the second derivatives of P and eta by the increments make of g = dE/dP and dE/d eta."""
    ge = g[0] * e_ab[0] + g[1] * e_ab[1] + g[2] * e_ab[2]
    gl = g[0] * arm_b[0] + g[1] * arm_b[1] + g[2] * arm_b[2]
    for i in range(3):
        for j in range(3):
            out[3 + i, 3 + j] += 0.5 * (e_ab[i] * g[j] + g[i] * e_ab[j])
            out[9 + i, 9 + j] += 0.5 * (arm_b[i] * g[j] + g[i] * arm_b[j])
        out[3 + i, 3 + i] -= ge
        out[9 + i, 9 + i] -= gl
    for i in range(3):
        for j in range(3):
            cross = 0.0
            if i != j:
                k = 3 - i - j
                sign = 1.0 if (j - i) % 3 == 2 else -1.0
                cross = sign * g[k]
                out[3 + i, 9 + j] += sign * 0.5 * g_eta[k]
                out[9 + j, 3 + i] += sign * 0.5 * g_eta[k]
            out[3 + i, 6 + j] += cross
            out[6 + j, 3 + i] += cross
            out[3 + i, j] -= cross
            out[j, 3 + i] -= cross
            turned = arm_b[i] * g[j]  # -[g][arm_b] = (g . arm_b) I - arm_b g^T
            out[3 + i, 9 + j] -= turned
            out[9 + j, 3 + i] -= turned
        out[3 + i, 9 + i] += gl
        out[9 + i, 3 + i] += gl


@numba.njit(cache=True, error_model="numpy")
def _ends(
    position: Floats, rotation: Floats, ends: Ints, arm: Floats, triad: Floats, La: Floats, Lb: Floats, w: Floats
) -> None:
    """Lambda_a, Lambda_b, and into w: the arms of a (0) and b (1), c_b + arm_b - c_a (2), x_b - x_a (3)."""
    a, b = ends[0], ends[1]
    for i in range(3):
        for j in range(3):
            La[i, j] = (
                rotation[a, i, 0] * triad[0, 0, j]
                + rotation[a, i, 1] * triad[0, 1, j]
                + rotation[a, i, 2] * triad[0, 2, j]
            )
            Lb[i, j] = (
                rotation[b, i, 0] * triad[1, 0, j]
                + rotation[b, i, 1] * triad[1, 1, j]
                + rotation[b, i, 2] * triad[1, 2, j]
            )
        w[0, i] = rotation[a, i, 0] * arm[0, 0] + rotation[a, i, 1] * arm[0, 1] + rotation[a, i, 2] * arm[0, 2]
        w[1, i] = rotation[b, i, 0] * arm[1, 0] + rotation[b, i, 1] * arm[1, 1] + rotation[b, i, 2] * arm[1, 2]
        w[2, i] = (position[b, i] - position[a, i]) + w[1, i]
        w[3, i] = w[2, i] - w[0, i]


@numba.njit(cache=True, error_model="numpy")
def _relative(La: Floats, Lb: Floats, Q: Floats) -> None:
    """Lambda_b Lambda_a^T."""
    for i in range(3):
        for j in range(3):
            Q[i, j] = Lb[i, 0] * La[j, 0] + Lb[i, 1] * La[j, 1] + Lb[i, 2] * La[j, 2]


@numba.njit(cache=True, error_model="numpy")
def _rotation_vector(Q: Floats, out: Floats) -> None:
    """Logarithm of a rotation by way of the unit quaternion's largest entry, so that no angle is ill-conditioned."""
    trace = Q[0, 0] + Q[1, 1] + Q[2, 2]
    k = 0
    if Q[1, 1] > Q[0, 0]:
        k = 1
    if Q[2, 2] > Q[k, k]:
        k = 2
    if trace > Q[k, k]:
        s = 1.0 + trace
        x, y, z = Q[2, 1] - Q[1, 2], Q[0, 2] - Q[2, 0], Q[1, 0] - Q[0, 1]
    else:
        i, j = (k + 1) % 3, (k + 2) % 3
        s = Q[j, i] - Q[i, j]
        out[k] = 1.0 + Q[k, k] - Q[i, i] - Q[j, j]
        out[i] = Q[i, k] + Q[k, i]
        out[j] = Q[j, k] + Q[k, j]
        if s < 0.0:
            s = -s
            out[0], out[1], out[2] = -out[0], -out[1], -out[2]
        x, y, z = out[0], out[1], out[2]
    # (s, x, y, z) is the quaternion but for its length.
    sine = math.sqrt(x * x + y * y + z * z)
    t = sine / s
    factor = 2.0 * (1.0 - t * t / 3.0) / s if t < 1e-4 else 2.0 * math.atan2(sine, s) / sine
    out[0], out[1], out[2] = factor * x, factor * y, factor * z


@numba.njit(cache=True, error_model="numpy")
def _beta(theta: Floats) -> tuple[float, float, float]:
    t = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2]
    if t < 1.0:
        beta = 0.0
        first = 0.0
        second = 0.0
        for k in range(len(BETA) - 1, -1, -1):
            second = second * t + 2.0 * first
            first = first * t + beta
            beta = beta * t + BETA[k]
        return beta, 2.0 * first, 4.0 * second
    y = 0.5 * math.sqrt(t)
    g = y / math.sin(y)
    c = g * math.cos(y)
    beta = (1.0 - c) / t
    p = (g * g - c) / t
    b1 = (p - 2.0 * beta) / t
    return beta, b1, ((2.0 * g * g * beta - p) / t - 4.0 * b1) / t


@numba.njit(cache=True, error_model="numpy")
def _cross(a: Floats, b: Floats, out: Floats) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, error_model="numpy")
def _add_spin(a0: float, a1: float, a2: float, out: Floats) -> None:
    """out += [a]."""
    out[0, 1] -= a2
    out[0, 2] += a1
    out[1, 0] += a2
    out[1, 2] -= a0
    out[2, 0] -= a1
    out[2, 1] += a0


@numba.njit(cache=True, error_model="numpy")
def _tangent_matrix(theta: Floats, beta: float, A: Floats) -> None:
    """Jl^-1(theta) = I - [theta]/2 + beta [theta]^2."""
    t = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2]
    for i in range(3):
        for j in range(3):
            A[i, j] = beta * theta[i] * theta[j]
        A[i, i] += 1.0 - beta * t
    _add_spin(-0.5 * theta[0], -0.5 * theta[1], -0.5 * theta[2], A)


@numba.njit(cache=True, error_model="numpy")
def _turning(f: Floats, theta: Floats, beta: float, b1: float, G: Floats, w: Floats) -> None:
    """G(f) with w . G v = f . (dJl^-1(theta)[w] v). As a map of w, dJl^-1(theta)[w] v is (G(v) - [v])^T w."""
    _cross(theta, f, w[14])
    _cross(theta, w[14], w[15])
    k = w[15]
    ft = f[0] * theta[0] + f[1] * theta[1] + f[2] * theta[2]
    for i in range(3):
        for j in range(3):
            G[i, j] = -beta * (2.0 * theta[i] * f[j] - f[i] * theta[j]) + b1 * theta[i] * k[j]
        G[i, i] += beta * ft
    _add_spin(0.5 * f[0], 0.5 * f[1], 0.5 * f[2], G)


@numba.njit(cache=True, error_model="numpy")
def _second(f: Floats, P: Floats, theta: Floats, beta: float, b1: float, b2: float, H: Floats) -> None:
    """Second derivative of f . Jl^-1(theta) P by theta."""
    t = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2]
    ft = f[0] * theta[0] + f[1] * theta[1] + f[2] * theta[2]
    pt = P[0] * theta[0] + P[1] * theta[1] + P[2] * theta[2]
    fp = f[0] * P[0] + f[1] * P[1] + f[2] * P[2]
    q = ft * pt - t * fp
    for i in range(3):
        qi = f[i] * pt + P[i] * ft - 2.0 * fp * theta[i]
        for j in range(3):
            qj = f[j] * pt + P[j] * ft - 2.0 * fp * theta[j]
            H[i, j] = (
                beta * (f[i] * P[j] + P[i] * f[j]) + b1 * (theta[i] * qj + qi * theta[j]) + b2 * q * theta[i] * theta[j]
            )
        H[i, i] += b1 * q - 2.0 * beta * fp
