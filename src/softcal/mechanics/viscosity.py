"""Viscous bodies: in a step, a potential of the strain's change, whose stress is

    S_v = r_s / h (lambda tr(E - E_n) I + 2 mu (E - E_n)),   E = (F^T F - I) / 2

with the moduli of the undeformed body and E_n at the step's start (Kelvin and Voigt). It does nothing in rigid motion
and takes energy in any other. Rayleigh's r_s K is the same in small strains about the undeformed body; in a compressed
or buckled one K has negative eigenvalues, and gives energy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numba
import numpy as np

from softcal.checks import Floats, Ints
from softcal.materials.law import stacked
from softcal.mechanics.solid import SolidTerm
from softcal.mechanics.solid_kernels import FAST, Places
from softcal.mechanics.state import State
from softcal.mechanics.system import part_theta


@dataclass(frozen=True)
class ViscousTerm:
    """A body's viscosity in one step: lmbda and mu are r_s / h times its moduli [Pa]; C_n (n_tets, n_q, 3, 3): F^T F at
    the step's start.
    """

    conn: Ints
    dN: Floats
    w: Floats
    places: Places
    lmbda: float
    mu: float
    C_n: Floats

    def assemble(self, F: Floats, gradient: Floats, data: Floats | None) -> None:
        """Add the gradient (3 n_points + n_pressures,) and, where `data` is given, the tangent, at F."""
        S = np.empty_like(F)
        _add_gradient(gradient, self.conn, self.dN, self.w, F, self.C_n, S, (self.lmbda, self.mu))
        if data is not None:
            _add_tangent(data, self.places, self.dN, self.w, F, S, self.lmbda, self.mu)


def viscous_term(solid: SolidTerm, places: Places, theta: Mapping[str, float], share: float, now: State) -> ViscousTerm:
    """The viscosity of a body in a step from `now` on; share: r_s / h."""
    lmbda, mu = rest_moduli(solid, part_theta(theta, solid.name))
    F = solid.invariants(now.x)[0]
    return ViscousTerm(solid.conn, solid.dN, solid.w, places, share * lmbda, share * mu, np.swapaxes(F, 2, 3) @ F)


def rest_moduli(solid: SolidTerm, theta: Mapping[str, float]) -> tuple[float, float]:
    """Lamé's moduli [Pa] of the undeformed body, those of psi_d alone where pressures carry the rest."""
    compiled = solid.compiled
    values = (theta[name] for name in compiled.parameters)
    derivatives = compiled.distortional if solid.is_mixed else compiled.full
    rows = stacked(derivatives(np.full(1, 3.0), np.full(1, 3.0), np.ones(1), *values), 1)[:, 0]
    _, psi_2, psi_J, psi_11, psi_12, psi_1J, psi_22, psi_2J, psi_JJ = (float(row) for row in rows)
    # 4 d2psi/dC2 at C = I, where dI1 = I, dI2 = 2 I, dJ = I/2
    lmbda = 4.0 * (psi_11 + 4.0 * psi_12 + psi_1J + 4.0 * psi_22 + 2.0 * psi_2J + psi_2) + psi_JJ + psi_J
    return lmbda, -2.0 * psi_2 - psi_J


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
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


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
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
