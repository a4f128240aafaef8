"""The skin of a part, in pieces as fine as its curved faces need, and its core: a copy of it at a depth below, that
moves with the material around.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.mesh import TetMesh
from softcal.geometry.surface import boundary_faces, boundary_owners

PIECES = {3: 2, 6: 4}  # of each edge of a face by its number of nodes: straight ones, and curved ones
MITRE = 2.0  # depths at most that a core's vertex at an edge or in a groove lies below it


@dataclass(frozen=True, eq=False)
class Skin:
    """The surface of a part.

    Attributes
    ----------
    X
        Its points at rest (n, 3) [m].
    triangles
        Outward ones of these points (k, 3).
    weights
        Of the points by the part's nodes: sparse (n, n_nodes).
    core
        Where each point's core is, per depth, by the nodes: sparse (n, n_nodes), rows of sum zero.
    """

    X: Floats
    triangles: Ints
    weights: Any
    core: Any

    @cached_property
    def areas(self) -> Floats:
        """Of each point's part of the surface (n,) [m^2]: a third of the triangles around it."""
        areas = np.zeros(len(self.X))
        part = np.linalg.norm(_across(self.X, self.triangles), axis=1) / 6.0
        np.add.at(areas, self.triangles.ravel(), np.repeat(part, 3))
        return areas

    @cached_property
    def normals(self) -> Floats:
        """Outward ones of the points (n, 3): the mean of the triangles around, by their areas."""
        sums = np.zeros_like(self.X)
        np.add.at(sums, self.triangles.ravel(), np.repeat(_across(self.X, self.triangles), 3, axis=0))
        return sums / np.maximum(np.linalg.norm(sums, axis=1), 1e-300)[:, None]


def body_skin(mesh: TetMesh) -> Skin:
    """The skin of a body: its faces in flat pieces between points of the curved faces.

    A core's point follows the corners' mean deformation of the element below it in which its weights are smallest.
    """
    faces = boundary_faces(mesh)
    n = PIECES[faces.shape[1]]
    grid = np.array([(n - i - j, i, j) for i in range(n + 1) for j in range(n + 1 - i)])
    place = {tuple(row): k for k, row in enumerate(grid.tolist())}
    up = [[(i, j), (i + 1, j), (i, j + 1)] for i in range(n) for j in range(n - i)]
    down = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i in range(n) for j in range(n - 1 - i)]
    small = np.array([[place[n - i - j, i, j] for i, j in corners] for corners in up + down])
    # A point on an edge or corner is the same on all faces around: it is numbered by the corners it is between.
    corners = np.where(grid > 0, faces[:, None, :3], -1)
    order = np.argsort(corners, axis=2)
    key = np.concatenate([np.take_along_axis(part, order, 2) for part in (corners, grid + 0 * corners)], axis=2)
    _, first, number = np.unique(key.reshape(-1, 6), axis=0, return_index=True, return_inverse=True)
    number = number.reshape(len(faces), len(grid))
    face, at = np.divmod(first, len(grid))
    shape = _face_functions(grid / float(n), faces.shape[1])[at]
    weights = _rows(faces[face], shape, mesh.n_points)
    X, triangles = weights @ mesh.points, number[:, small].reshape(-1, 3)
    return Skin(X, triangles, weights, _core(mesh, X, triangles, np.repeat(boundary_owners(mesh), len(small))))


def joined(skins: Mapping[str, Skin], first: Mapping[str, int], n_points: int) -> Skin:
    """All skins as one, by the points of a layout; first: that of each part's nodes."""
    import scipy.sparse as sp

    def on_layout(name: str, matrix: Any) -> Any:
        return sp.csr_matrix((matrix.data, matrix.indices + first[name], matrix.indptr), (matrix.shape[0], n_points))

    own = numbers(skins)
    return Skin(
        np.concatenate([skin.X for skin in skins.values()]),
        np.concatenate([own[name][skin.triangles] for name, skin in skins.items()]),
        sp.vstack([on_layout(name, skin.weights) for name, skin in skins.items()], format="csr"),
        sp.vstack([on_layout(name, skin.core) for name, skin in skins.items()], format="csr"),
    )


def numbers(skins: Mapping[str, Skin]) -> dict[str, Ints]:
    """The numbers of each skin's points among those of all."""
    ends = np.cumsum([0, *(len(skin.X) for skin in skins.values())]).tolist()
    return {name: np.arange(*ends[k : k + 2]) for k, name in enumerate(skins)}


def columns(matrix: Any) -> tuple[Ints, Any]:
    """The columns with entries of a sparse matrix, and the matrix of these alone."""
    own = np.unique(matrix.indices).astype(np.int64)
    return own, matrix[:, own]


def rigid_skin(X: Floats, triangles: Ints) -> Skin:
    """The skin of a rigid part, of which each point is a node."""
    import scipy.sparse as sp

    chosen = _spread(X)
    last = np.linalg.solve((X[chosen[1:]] - X[chosen[0]]).T, _inwards(X, triangles).T).T
    rates = np.column_stack([-last.sum(axis=1), last])
    own = sp.csr_matrix((np.ones(len(X)), np.arange(len(X)), np.arange(len(X) + 1)))
    return Skin(X, triangles, own, _rows(np.tile(chosen, (len(X), 1)), rates, len(X)))


def _core(mesh: TetMesh, X: Floats, triangles: Ints, owners: Ints) -> Any:
    """See `Skin.core`; owners: the tet below each triangle (k,)."""
    corners = mesh.points[mesh.tets[:, :4]]
    vertex, tet = triangles.ravel(), np.repeat(owners, 3)
    to_corners = np.linalg.inv(corners[owners, 1:] - corners[owners, :1]).repeat(3, axis=0)
    rates = np.einsum("mi,mij->mj", _inwards(X, triangles)[vertex], to_corners)
    rates = np.column_stack([-rates.sum(axis=1), rates])
    order = np.lexsort((np.abs(rates).sum(axis=1), vertex))
    best = order[np.unique(vertex[order], return_index=True)[1]]
    return _rows(mesh.tets[tet[best], :4], rates[best], mesh.n_points)


def _inwards(X: Floats, triangles: Ints) -> Floats:
    """Of each point (n, 3) the way inwards that is one deep below all triangles around it, as nearly as one of at most
    `MITRE` can be.
    """
    across = _across(X, triangles)
    area = np.linalg.norm(across, axis=1)
    normals = across / np.maximum(area, 1e-300)[:, None]
    sums, b = np.zeros((len(X), 3, 3)), np.zeros((len(X), 3))
    for k in range(3):
        np.add.at(sums, triangles[:, k], area[:, None, None] * normals[:, :, None] * normals[:, None, :])
        np.add.at(b, triangles[:, k], across)
    # Along a flat surface or an edge, where any way would do, none.
    sums += 1e-3 * np.trace(sums, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    way = np.linalg.solve(sums, b[:, :, None])[:, :, 0]
    return -way * np.minimum(1.0, MITRE / np.maximum(np.linalg.norm(way, axis=1), 1e-300))[:, None]


def _across(X: Floats, triangles: Ints) -> Floats:
    """Outward normals (k, 3) of triangles, as long as twice their areas."""
    a, b, c = (X[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _face_functions(L: Floats, n_nodes: int) -> Floats:
    """Shape functions (n, 3 or 6) of a face at barycentric coordinates L (n, 3)."""
    if n_nodes == 3:
        return L
    return np.concatenate([L * (2.0 * L - 1.0), 4.0 * L * L[:, [1, 2, 0]]], axis=1)


def _rows(nodes: Ints, values: Any, n_nodes: int) -> Any:
    """The sparse matrix (n, n_nodes) with the values (n, k) of each row at these nodes (n, k)."""
    import scipy.sparse as sp

    matrix = sp.csr_matrix(
        (values.ravel(), nodes.ravel(), np.arange(0, nodes.size + 1, nodes.shape[1])), (len(nodes), n_nodes)
    )
    matrix.sum_duplicates()
    matrix.eliminate_zeros()
    return matrix


def _spread(points: Floats) -> Ints:
    """Four of the points (n, 3) that span space well."""
    chosen = [0]
    left = points - points[0]
    for _ in range(3):
        chosen.append(int(np.argmax(np.linalg.norm(left, axis=1))))
        along = left[chosen[-1]] / np.linalg.norm(left[chosen[-1]])
        left = left - np.outer(left @ along, along)
    return np.array(chosen)
