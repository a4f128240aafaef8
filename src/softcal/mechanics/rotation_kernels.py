"""Rotation vectors and the tangent map that goes with them, as Numba functions on 3-vectors and 3 x 3 arrays.

    A(theta) = Jl^-1(theta) = I - [theta]/2 + beta [theta]^2,   d log(exp(eta) exp(theta)) = A eta

beta and its derivatives b1 = beta'/|theta|, b2 = b1'/|theta| are all the transcendental functions there are. Numba
does not see that a function called from another file has changed: after a change here, empty its cache.
"""

from __future__ import annotations

import math

from softcal.checks import Floats
from softcal.kernel import kernel

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


@kernel(error_model="numpy")
def relative(La: Floats, Lb: Floats, Q: Floats) -> None:
    """The rotation Lambda_b Lambda_a^T.

    Parameters
    ----------
    La, Lb
        Rotations (3, 3).
    Q
        The product (3, 3), written.
    """
    for i in range(3):
        for j in range(3):
            Q[i, j] = Lb[i, 0] * La[j, 0] + Lb[i, 1] * La[j, 1] + Lb[i, 2] * La[j, 2]


@kernel(error_model="numpy")
def rotation_vector(Q: Floats, out: Floats) -> None:
    """Logarithm of a rotation by the unit quaternion's largest entry, so that no angle is ill-conditioned."""
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


@kernel(error_model="numpy")
def coefficients(theta: Floats) -> tuple[float, float, float]:
    """The coefficients beta, b1 and b2 of A."""
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


@kernel(error_model="numpy")
def cross(a: Floats, b: Floats, out: Floats) -> None:
    """out = a x b.

    Parameters
    ----------
    a, b
        Vectors (3,).
    out
        Their product (3,), written.
    """
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel(error_model="numpy")
def add_spin(a0: float, a1: float, a2: float, out: Floats) -> None:
    """Add [a], the matrix of the cross product with a.

    Parameters
    ----------
    a0, a1, a2
        Components of a.
    out
        Matrix (3, 3), changed.
    """
    out[0, 1] -= a2
    out[0, 2] += a1
    out[1, 0] += a2
    out[1, 2] -= a0
    out[2, 0] -= a1
    out[2, 1] += a0


@kernel(error_model="numpy")
def tangent_map(theta: Floats, beta: float, A: Floats) -> None:
    """Jl^-1(theta) = I - [theta]/2 + beta [theta]^2.

    Parameters
    ----------
    theta
        Rotation vector (3,) [rad].
    beta
        See `coefficients`.
    A
        The map (3, 3), written.
    """
    t = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2]
    for i in range(3):
        for j in range(3):
            A[i, j] = beta * theta[i] * theta[j]
        A[i, i] += 1.0 - beta * t
    add_spin(-0.5 * theta[0], -0.5 * theta[1], -0.5 * theta[2], A)


@kernel(error_model="numpy")
def turning(f: Floats, theta: Floats, beta: float, b1: float, G: Floats, w: Floats) -> None:
    """G(f) with w . G v = f . (dJl^-1(theta)[w] v). As a map of w, dJl^-1(theta)[w] v is (G(v) - [v])^T w.

    Parameters
    ----------
    f
        Vector (3,).
    theta
        Rotation vector (3,) [rad].
    beta, b1
        See `coefficients`.
    G
        G(f) (3, 3), written.
    w
        Room (3,).
    """
    cross(theta, f, w[14])
    cross(theta, w[14], w[15])
    k = w[15]
    ft = f[0] * theta[0] + f[1] * theta[1] + f[2] * theta[2]
    for i in range(3):
        for j in range(3):
            G[i, j] = -beta * (2.0 * theta[i] * f[j] - f[i] * theta[j]) + b1 * theta[i] * k[j]
        G[i, i] += beta * ft
    add_spin(0.5 * f[0], 0.5 * f[1], 0.5 * f[2], G)


@kernel(error_model="numpy")
def second_derivative(f: Floats, P: Floats, theta: Floats, beta: float, b1: float, b2: float, H: Floats) -> None:
    """Second derivative of f . Jl^-1(theta) P by theta.

    Parameters
    ----------
    f, P
        Vectors (3,).
    theta
        Rotation vector (3,) [rad].
    beta, b1, b2
        See `coefficients`.
    H
        The derivative (3, 3), written.
    """
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
