"""A solid whose undeformed mesh is moved by a parameter s: node a to X_a + s V_a, and likewise in any other state.

The displacement x - X of a node is then that of the moved one, and the strain energy is that of the body on the moved
mesh. All else of the robot is as on the given mesh: the points attached to the body, and its weight. So bodies that are
clamped deeper than drawn are solved on the unknowns of those as drawn. At fixed unknowns, with G = dV/dX on the moved
mesh,

    dF = (1 - F) G,    d(dN_a) = -G^T dN_a,    dw = w tr G
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.materials.components import doubled, full


@dataclass(frozen=True)
class MeshMotion:
    """The motion of the undeformed mesh of a body by a parameter.

    Attributes
    ----------
    parameter : Its dotted name
    value : s [m]
    way : V (n, 3) [-] of the body's points
    first : Number of the first of them
    """

    parameter: str
    value: float
    way: Floats
    first: int = 0

    def moved(self, x: Floats) -> Floats:
        """The positions (n_points, 3) [m] of all points with those of the body moved."""
        x = x.copy()
        x[self.first : self.first + len(self.way)] += self.value * self.way
        return x

    def rate(self, conn: Ints, dN: Floats) -> tuple[Ints, Floats]:
        """The tets that it deforms (k,), and G (k, n_q, 3, 3) [1/m] in them."""
        V = self.way[conn - self.first]
        # The tets far from what moves, and those that all of it carries along, keep their shape.
        tets = np.flatnonzero((V != V[:, :1]).any(axis=(1, 2)))
        return tets, np.einsum("eai,eqaj->eqij", V[tets], dN[tets])


def stress_rate(F: Floats, dF: Floats, S: Floats, D: Floats) -> tuple[Floats, Floats]:
    """The first Piola-Kirchhoff stress P (n_tets, n_q, 3, 3) [Pa], and its rate.

    Parameters
    ----------
    F
        Deformation gradients (n_tets, n_q, 3, 3) [-].
    dF
        Their rates (n_tets, n_q, 3, 3).
    S
        Second Piola-Kirchhoff stress (n_tets, n_q, 6) [Pa].
    D
        Its tangent (n_tets, n_q, 6, 6) [Pa].
    """
    dE = 0.5 * (np.swapaxes(dF, 2, 3) @ F + np.swapaxes(F, 2, 3) @ dF)
    stress, stress_rates = full(S), full(np.einsum("eqab,eqb->eqa", D, doubled(dE)))
    return F @ stress, dF @ stress + F @ stress_rates


def cofactor(A: Floats, B: Floats) -> Floats:
    """The rows A_1 x B_2, A_2 x B_0, A_0 x B_1 of matrices (..., 3, 3): cof F of F and F."""
    return np.cross(A[..., (1, 2, 0), :], B[..., (2, 0, 1), :])
