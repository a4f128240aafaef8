"""Shape functions and quadrature of linear and quadratic tetrahedra."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.mesh import TET_EDGES


def shape_functions(barycentric: Floats, order: int) -> Floats:
    """N_a at points given by barycentric coordinates (n, 4); shape (n, 4 or 10)."""
    L = barycentric
    if order == 1:
        return L.copy()
    corner = L * (2.0 * L - 1.0)
    edge = np.stack([4.0 * L[:, a] * L[:, b] for a, b in TET_EDGES], axis=1)
    return np.concatenate([corner, edge], axis=1)


def shape_gradients(barycentric: Floats, order: int) -> Floats:
    """dN_a / dL_k at points given by barycentric coordinates; shape (n, 4 or 10, 4)."""
    n = len(barycentric)
    L = barycentric
    if order == 1:
        return np.broadcast_to(np.eye(4), (n, 4, 4)).copy()
    dN = np.zeros((n, 10, 4))
    for a in range(4):
        dN[:, a, a] = 4.0 * L[:, a] - 1.0
    for i, (a, b) in enumerate(TET_EDGES):
        dN[:, 4 + i, a] = 4.0 * L[:, b]
        dN[:, 4 + i, b] = 4.0 * L[:, a]
    return dN


def quadrature(order: int) -> tuple[Floats, Floats]:
    """Points (n, 4) in barycentric coordinates and weights (n,), sum 1/6, for an element of the given order.

    One point for linear tets, four (exact to degree two) for quadratic ones, as CalculiX has for its C3D10.
    """
    if order == 1:
        return np.full((1, 4), 0.25), np.array([1.0 / 6.0])
    a, b = (5.0 + 3.0 * np.sqrt(5.0)) / 20.0, (5.0 - np.sqrt(5.0)) / 20.0
    points = np.full((4, 4), b)
    np.fill_diagonal(points, a)
    return points, np.full(4, 1.0 / 24.0)


def reference_gradients(points: Floats, tets: Ints, where: str = "mesh") -> tuple[Floats, Floats]:
    """dN_a/dX (n_tets, n_q, n_a, 3) [1/m] and weights |dX/dxi| w (n_tets, n_q) [m^3] on the undeformed mesh.

    Raises
    ------
    MeshError
        Where an element is inverted at a quadrature point.
    """
    order = 1 if tets.shape[1] == 4 else 2
    barycentric, weights = quadrature(order)
    dN_dL = shape_gradients(barycentric, order)
    # L0 = 1 - xi - eta - zeta: derivatives by (xi, eta, zeta)
    dN_dxi = dN_dL[:, :, 1:] - dN_dL[:, :, :1]
    X = points[tets]
    dX_dxi = np.einsum("eai,qak->eqik", X, dN_dxi)
    det = np.linalg.det(dX_dxi)
    bad = np.unique(np.nonzero(det <= 0.0)[0])
    if bad.size:
        raise MeshError(
            Fault(
                f"{bad.size} element(s) are inverted",
                where=where,
                got=f"tets {bad[:5].tolist()}",
                attempt="a finer or straighter mesh",
            )
        )
    dN_dX = np.einsum("qak,eqkj->eqaj", dN_dxi, np.linalg.inv(dX_dxi))
    return np.ascontiguousarray(dN_dX), det * weights


def nodal_volumes(points: Floats, tets: Ints) -> Floats:
    """Integral of each node's shape function over a mesh (n_points,) [m^3]: what its density weighs there."""
    order = 1 if tets.shape[1] == 4 else 2
    barycentric, _ = quadrature(order)
    _, w = reference_gradients(points, tets)
    volumes = np.zeros(len(points))
    np.add.at(volumes, tets, w @ shape_functions(barycentric, order))
    return volumes
