"""Measured orders of convergence on a manufactured large deformation.

x = X + (a sin(k y), b sin(k z), 0), a composition of shears: J = 1, so it is a solution of the nearly incompressible
solid as well. The body force that it takes is -Div P, here by differences of the closed-form stress.
"""

import numpy as np
import pytest
from mechanics_cases import body_theta, elastic, held, placed, solid_system

from softcal.geometry.primitives import box_mesh
from softcal.geometry.surface import boundary_faces
from softcal.materials.neo_hooke import NEO_HOOKE
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.statics import Statics

A, B, K = 0.15, 0.1, 2.0


def exact(X):
    return X + np.stack([A * np.sin(K * X[..., 1]), B * np.sin(K * X[..., 2]), 0 * X[..., 0]], axis=-1)


def gradient(X):
    F = np.broadcast_to(np.eye(3), (*X.shape[:-1], 3, 3)).copy()
    F[..., 0, 1] = A * K * np.cos(K * X[..., 1])
    F[..., 1, 2] = B * K * np.cos(K * X[..., 2])
    return F


def body_force(X, nu):
    mu, lmbda = 1 / (2 * (1 + nu)), nu / ((1 + nu) * (1 - 2 * nu))

    def stress(X):
        F = gradient(X)
        inverse = np.swapaxes(np.linalg.inv(F), -1, -2)
        return mu * (F - inverse) + lmbda * np.log(np.linalg.det(F))[..., None, None] * inverse

    h = 1e-3
    divergence = np.zeros(X.shape)
    for j in range(3):
        e = h * np.eye(3)[j]
        slope = (8 * (stress(X + e) - stress(X - e)) - (stress(X + 2 * e) - stress(X - 2 * e))) / (12 * h)
        divergence += slope[..., j]
    return -divergence


def fine_quadrature(n=4):
    """Gauss points in barycentric coordinates, weights that sum to one sixth; exact to degree 2 n - 3."""
    x, w = np.polynomial.legendre.leggauss(n)
    x, w = 0.5 * (x + 1), 0.5 * w
    a, b, c = (v.ravel() for v in np.meshgrid(x, x, x, indexing="ij"))
    wa, wb, wc = (v.ravel() for v in np.meshgrid(w, w, w, indexing="ij"))
    xi, eta, zeta = a, b * (1 - a), c * (1 - a) * (1 - b)
    return np.stack([1 - xi - eta - zeta, xi, eta, zeta], axis=1), wa * wb * wc * (1 - a) ** 2 * (1 - b)


def errors(element, nu, n):
    """L2 errors of position and of its gradient, relative."""
    cell = ELEMENTS[element].cell
    mesh = box_mesh((1.0, 1.0, 1.0), (n, n, n), order=cell.order)
    at, weights = fine_quadrature()
    N = cell.functions(at)
    dN = cell.gradients(at)[:, :, 1:] - cell.gradients(at)[:, :, :1]
    X = np.einsum("qa,eai->eqi", N, mesh.points[mesh.tets])
    A = np.einsum("qak,eai->eqik", dN, mesh.points[mesh.tets])
    w = np.linalg.det(A) * weights
    force = np.zeros((mesh.n_points, 3))
    np.add.at(force, mesh.tets, np.einsum("eq,qa,eqi->eai", w, N, body_force(X, nu)))

    system = solid_system(mesh, element, NEO_HOOKE, np.unique(boundary_faces(mesh)), force)
    found = Statics(system, body_theta(elastic(1.0, nu))).equilibrium(placed(system, exact(mesh.points)), held())
    assert found.converged, found.status

    x = found.state.x[mesh.tets]
    displacement = np.einsum("qa,eai->eqi", N, x) - exact(X)
    F = np.einsum("eai,qak,eqkj->eqij", x, dN, np.linalg.inv(A))
    strain = F - gradient(X)
    return (
        np.sqrt(np.sum(w * np.sum(displacement**2, axis=-1))),
        np.sqrt(np.sum(w * np.sum(strain**2, axis=(-1, -2)))),
    )


@pytest.mark.parametrize(
    ("element", "nu", "divisions", "order"),
    [
        ("P1", 0.3, (3, 5, 7), 2),
        ("P2", 0.3, (2, 3, 5), 3),
        ("P2P1", 0.3, (2, 3, 5), 3),
        ("P2P1", 0.4999, (2, 3, 5), 3),
    ],
)
def test_order_of_convergence(element, nu, divisions, order):
    measured = np.array([errors(element, nu, n) for n in divisions])
    h = 1.0 / np.array(divisions)
    in_position, in_gradient = (np.polyfit(np.log(h), np.log(column), 1)[0] for column in measured.T)
    assert in_position == pytest.approx(order, abs=0.25)
    assert in_gradient == pytest.approx(order - 1, abs=0.2)
