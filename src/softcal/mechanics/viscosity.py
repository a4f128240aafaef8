"""Viscous bodies: in a step, a potential of the strain's change, whose stress is

    S_v = r_s / h (lambda tr(E - E_n) I + 2 mu (E - E_n)),   E = (F^T F - I) / 2

with the moduli of the undeformed body and E_n at the step's start (Kelvin and Voigt). It is zero in rigid motion and
dissipates energy in any other. Rayleigh's r_s K is the same in small strains about the undeformed body; in a compressed
or buckled one K has negative eigenvalues, and adds energy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.solid_kernels import FAST, Places, kinematics
from softcal.mechanics.state import State
from softcal.mechanics.term import Connectivity, Given, Sum, Term


@dataclass(frozen=True)
class ViscousTerm(Term):
    """A body's viscosity in one step.

    Attributes
    ----------
    conn, dN, w
        As of the body, see `SolidTerm`.
    lmbda, mu
        r_s / h times the moduli of the undeformed body [Pa].
    C_n
        F^T F at the step's start (n_tets, n_q, 3, 3) [-].
    places
        Of the blocks in the tangent, as the body's.
    """

    conn: Ints
    dN: Floats
    w: Floats
    lmbda: float
    mu: float
    C_n: Floats
    places: Places

    def connectivity(self, layout: Layout) -> Connectivity:
        return Connectivity([self.conn])

    def plan(self, layout: Layout, pattern: Pattern) -> ViscousTerm:
        return replace(self, places=pattern.blocks(self.conn).astype(np.int32))

    def kinematics(self, state: State) -> Floats:
        """F (n_tets, n_q, 3, 3)."""
        F, I1, I2, J = np.empty_like(self.C_n), *(np.empty_like(self.w) for _ in range(3))
        kinematics(state.x, self.conn, self.dN, F, I1, I2, J)
        return F

    def add(self, into: Sum, given: Given) -> None:
        F, S, gradient = given.known, np.empty_like(given.known), np.zeros_like(into.full)
        _add_gradient(gradient, self.conn, self.dN, self.w, F, self.C_n, S, (self.lmbda, self.mu))
        into.in_motion.append(gradient)
        if into.data is not None:
            _add_tangent(into.data, self.places, self.dN, self.w, F, S, self.lmbda, self.mu)

    def energy(self, given: Given) -> float:
        F = self.kinematics(given.state)
        dE = 0.5 * (np.swapaxes(F, 2, 3) @ F - self.C_n)
        trace, square = np.einsum("eqii->eq", dE), np.square(dE).sum(axis=(2, 3))
        return float(np.sum(self.w * (0.5 * self.lmbda * trace**2 + self.mu * square)))


@kernel(error_model="numpy", fastmath=FAST)
def _add_gradient(
    gradient: Floats, conn: Ints, dN: Floats, w: Floats, F: Floats, C_n: Floats, S: Floats, moduli: tuple[float, float]
) -> None:
    """Writes the stress into S, and adds w F S N_a."""
    n, n_q, n_a, _ = dN.shape
    lmbda, mu = moduli
    P = np.empty((3, 3))
    for e in range(n):
        for q in range(n_q):
            f, t = F[e, q], S[e, q]
            trace = 0.0
            for i in range(3):
                for j in range(3):
                    c = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
                    t[i, j] = mu * (c - C_n[e, q, i, j])
                trace += t[i, i]
            for i in range(3):
                t[i, i] += 0.5 * lmbda / mu * trace
            for i in range(3):
                for j in range(3):
                    P[i, j] = w[e, q] * (f[i, 0] * t[0, j] + f[i, 1] * t[1, j] + f[i, 2] * t[2, j])
            for a in range(n_a):
                at = 3 * conn[e, a]
                d0, d1, d2 = dN[e, q, a, 0], dN[e, q, a, 1], dN[e, q, a, 2]
                for i in range(3):
                    gradient[at + i] += P[i, 0] * d0 + P[i, 1] * d1 + P[i, 2] * d2


@kernel(error_model="numpy", fastmath=FAST)
def _add_tangent(
    data: Floats, places: Places, dN: Floats, w: Floats, F: Floats, S: Floats, lmbda: float, mu: float
) -> None:
    """w ((N_a . S N_b) I + lambda h_a h_b^T + mu ((N_a . N_b) F F^T + h_b h_a^T)) with h_a = F N_a."""
    n, n_q, n_a, _ = dN.shape
    h = np.empty((n_q, n_a, 3))
    s = np.empty((n_q, n_a, 3))
    B = np.empty((n_q, 3, 3))
    K = np.empty((3, 3))
    for e in range(n):
        for q in range(n_q):
            f = F[e, q]
            t = S[e, q]
            for i in range(3):
                for j in range(3):
                    B[q, i, j] = mu * (f[i, 0] * f[j, 0] + f[i, 1] * f[j, 1] + f[i, 2] * f[j, 2])
            for a in range(n_a):
                d0, d1, d2 = dN[e, q, a, 0], dN[e, q, a, 1], dN[e, q, a, 2]
                for i in range(3):
                    h[q, a, i] = f[i, 0] * d0 + f[i, 1] * d1 + f[i, 2] * d2
                    s[q, a, i] = t[i, 0] * d0 + t[i, 1] * d1 + t[i, 2] * d2
        m = 0
        for a in range(n_a):
            for b in range(a, n_a):
                for i in range(3):
                    for j in range(3):
                        K[i, j] = 0.0
                for q in range(n_q):
                    weight = w[e, q]
                    x0, x1, x2 = dN[e, q, b, 0] * weight, dN[e, q, b, 1] * weight, dN[e, q, b, 2] * weight
                    bent = s[q, a, 0] * x0 + s[q, a, 1] * x1 + s[q, a, 2] * x2
                    near = dN[e, q, a, 0] * x0 + dN[e, q, a, 1] * x1 + dN[e, q, a, 2] * x2
                    for i in range(3):
                        left, right = weight * lmbda * h[q, a, i], weight * mu * h[q, b, i]
                        for j in range(3):
                            K[i, j] += left * h[q, b, j] + right * h[q, a, j] + near * B[q, i, j]
                        K[i, i] += bent
                for i in range(3):
                    for j in range(i if a == b else 0, 3):
                        data[places[e, m, i] + j] += K[i, j]
                m += 1
