"""Points bonded to a mesh: as weighted sums of the nodes of the element they lie in, or next to."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.locate import locate_points
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.element import shape_functions, shape_gradients


def attach(mesh: TetMesh, points: Floats, *, tolerance: float | None = None, where: str = "") -> tuple[Ints, Floats]:
    """Nodes (n, 4 or 10) and weights of the points (n, 3) [m], with sum of w = 1 and sum of w X = the point exactly.

    So a point follows rigid motions, and constant strain, without error. One outside the mesh, by `tolerance` [m] at
    most (see `locate_points`), goes on from the nearest element along its deformation gradient.

    Raises
    ------
    MeshError
        Where points lie further outside.
    """
    tets, barycentric = locate_points(mesh, points, tolerance=tolerance, where=where)
    inside = np.clip(barycentric, 0.0, None)
    inside /= inside.sum(axis=1, keepdims=True)
    nodes = mesh.tets[tets]
    X = mesh.points[nodes]
    N = shape_functions(inside, mesh.order)
    dN = shape_gradients(inside, mesh.order)
    dN = dN[:, :, 1:] - dN[:, :, :1]
    left = points - np.einsum("na,nai->ni", N, X)  # to where the element's map does not reach
    local = np.linalg.solve(np.einsum("nai,nak->nik", X, dN), left[:, :, None])[:, :, 0]
    return nodes, N + np.einsum("nak,nk->na", dN, local)
