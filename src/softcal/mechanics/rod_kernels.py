"""The loops over the elements of rods.

With everything in space, about the current state (see `rod.py` for the element):

    P = x_b - x_a,   exp(theta) = Lambda_b Lambda_a^T,   A = Jl^-1(theta) = I - [theta]/2 + beta [theta]^2
    rho = A P,       d theta = A eta,                    eta = omega_b - omega_a - omega_a x omega_b / 2 + ...

Lambda_a^T (rho, theta) are the coordinates that the energy is quadratic in. A and its derivatives by theta stand in
`rotation_kernels.py`.
"""

from __future__ import annotations

import math

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel
from softcal.mechanics.rotation_kernels import (
    add_spin,
    coefficients,
    cross,
    relative,
    rotation_vector,
    second_derivative,
    tangent_map,
    turning,
)


@kernel(error_model="numpy")
def stiffness(by_bending: Floats, by_shear: Floats, E: float, nu: float, S: Floats) -> None:
    """S = E (by_bending + (1 + nu) by_shear)^-1 per element, by Cholesky's factors.

    Parameters
    ----------
    by_bending, by_shear
        Parts of E times the flexibility (n, 6, 6), see `rod_flexibility.py`.
    E, nu
        Young's modulus [Pa] and Poisson's ratio [-].
    S
        Stiffness (n, 6, 6), written.
    """
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


@kernel(error_model="numpy")
def coordinates(
    position: Floats,
    rotation: Floats,
    frames: Ints,
    arm: Floats,
    triad: Floats,
    xi: Floats,
    turn: Floats,
) -> None:
    """Lambda_a^T (rho, theta) and |theta| of all elements.

    Parameters
    ----------
    position
        References of the frames (n_frames, 3) [m].
    rotation
        Their rotation matrices (n_frames, 3, 3).
    frames
        Frames at both ends of each element (n, 2).
    arm
        Ends of the elements less the frames' references at rest (n, 2, 3) [m].
    triad
        Triads at the ends at rest (n, 2, 3, 3).
    xi
        Lambda_a^T (rho, theta) (n, 6) [m; rad], written.
    turn
        |theta| (n,) [rad], written.
    """
    w = np.zeros((8, 3))
    La, Lb, Q = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for e in range(len(frames)):
        _ends(position, rotation, frames[e], arm[e], triad[e], La, Lb, w)
        relative(La, Lb, Q)
        rotation_vector(Q, w[4])
        beta, _, _ = coefficients(w[4])
        tangent_map(w[4], beta, Q)
        for i in range(3):
            w[5, i] = Q[i, 0] * w[3, 0] + Q[i, 1] * w[3, 1] + Q[i, 2] * w[3, 2]
        turn[e] = math.sqrt(w[4, 0] ** 2 + w[4, 1] ** 2 + w[4, 2] ** 2)
        for i in range(3):
            xi[e, i] = La[0, i] * w[5, 0] + La[1, i] * w[5, 1] + La[2, i] * w[5, 2]
            xi[e, 3 + i] = La[0, i] * w[4, 0] + La[1, i] * w[4, 1] + La[2, i] * w[4, 2]


@kernel(error_model="numpy")
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
    """Gradient that a conjugate dE/d(Lambda_a^T (rho, theta)) makes, and the tangent with the second derivative of E
    and the same conjugate.

    Parameters
    ----------
    position
        References of the frames (n_frames, 3) [m].
    rotation
        Their rotation matrices (n_frames, 3, 3).
    frames
        Frames at both ends of each element (n, 2).
    arm
        Ends of the elements less the frames' references at rest (n, 2, 3) [m].
    triad
        Triads at the ends at rest (n, 2, 3, 3).
    conjugate
        The conjugate (n, 6) [N; N m].
    S
        Second derivatives of E (n, 6, 6).
    with_tangent
        Whether the tangent is wanted.
    gradient, tangent
        By the frames' increments (n, 12), (n, 12, 12), written.
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
        relative(La, Lb, A)
        rotation_vector(A, theta)
        beta, b1, b2 = coefficients(theta)
        tangent_map(theta, beta, A)
        for i in range(3):
            f[i] = La[i, 0] * conjugate[e, 0] + La[i, 1] * conjugate[e, 1] + La[i, 2] * conjugate[e, 2]
            mu[i] = La[i, 0] * conjugate[e, 3] + La[i, 1] * conjugate[e, 4] + La[i, 2] * conjugate[e, 5]
        turning(f, theta, beta, b1, G, w)
        for i in range(3):
            g_theta[i] = mu[i] + G[i, 0] * P[0] + G[i, 1] * P[1] + G[i, 2] * P[2]
        for i in range(3):
            g_P[i] = A[0, i] * f[0] + A[1, i] * f[1] + A[2, i] * f[2]
            g_eta[i] = A[0, i] * g_theta[0] + A[1, i] * g_theta[1] + A[2, i] * g_theta[2]
        for i in range(3):
            gradient[e, i] = -g_P[i]
            gradient[e, 6 + i] = g_P[i]
        cross(e_ab, g_P, w[10])
        cross(arm_b, g_P, w[11])
        for i in range(3):
            gradient[e, 3 + i] = -w[10, i] - g_eta[i]
            gradient[e, 9 + i] = w[11, i] + g_eta[i]
        if not with_tangent:
            continue

        # J: Lambda_a^T (rho, theta) by (P, eta).
        turning(P, theta, beta, b1, D, w)
        add_spin(-P[0], -P[1], -P[2], D)
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
        second_derivative(f, P, theta, beta, b1, b2, H)
        turning(g_theta, theta, beta, b1, G, w)
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


@kernel(error_model="numpy")
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


@kernel(error_model="numpy")
def _bend(out: Floats, g: Floats, g_eta: Floats, e_ab: Floats, arm_b: Floats) -> None:
    """Add the products of g = dE/dP and dE/d eta with the second derivatives of P and eta by the increments."""
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
            spin = 0.0
            if i != j:
                k = 3 - i - j
                sign = 1.0 if (j - i) % 3 == 2 else -1.0
                spin = sign * g[k]
                out[3 + i, 9 + j] += sign * 0.5 * g_eta[k]
                out[9 + j, 3 + i] += sign * 0.5 * g_eta[k]
            out[3 + i, 6 + j] += spin
            out[6 + j, 3 + i] += spin
            out[3 + i, j] -= spin
            out[j, 3 + i] -= spin
            turned = arm_b[i] * g[j]  # -[g][arm_b] = (g . arm_b) I - arm_b g^T
            out[3 + i, 9 + j] -= turned
            out[9 + j, 3 + i] -= turned
        out[3 + i, 9 + i] += gl
        out[9 + i, 3 + i] += gl


@kernel(error_model="numpy")
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
