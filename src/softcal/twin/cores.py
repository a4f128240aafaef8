"""The skin of a part, in pieces as fine as its curved faces need, and its core: a copy of it at a depth below, that
moves with the material around.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.mesh import TetMesh
from softcal.geometry.surface import boundary_faces, boundary_owners

PIECES = {3: 2, 6: 4}  # of each edge of a face by its number of nodes: straight ones, and curved ones
SHARP = np.cos(np.radians(40.0))  # between the normals of triangles, least: less is a sharp edge
SIDES = ((0, 1), (1, 2), (2, 0))
EQUAL = 1e-6  # relative difference of choices that are equally good
MITRE = 2.0  # depths at most that a core's vertex at an edge or in a groove lies below it


@dataclass(frozen=True, eq=False)
class CoredSkin:
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
    drawn
        Its points before the part's shape was changed (n, 3) [m]. Choices among triangles and tets are made there: as
        lengths change they do not, nor by rounding in a symmetric mesh.
    """

    X: Floats
    triangles: Ints
    weights: Any
    core: Any
    drawn: Floats


class Pressing(NamedTuple):
    """The points of a skin that press: each on one smooth part of it.

    Attributes
    ----------
    base
        The skin's point that each is, or is next to (n,).
    weights
        Of each by the skin's points: sparse (n, n_skin).
    area
        Of each one's part of the surface (n,) [m^2]: a third of the triangles around it.
    normals
        Outward ones (n, 3).
    """

    base: Ints
    weights: Any
    area: Floats
    normals: Floats


def pressing(skin: CoredSkin, depth: float) -> Pressing:
    """Every point of a skin; on a sharp edge one point for each smooth part that ends there, `depth` [m] inside of it:
    as far as the core's edge, so that edges that are flush press straight.
    """
    import scipy.sparse as sp
    from scipy.sparse.csgraph import connected_components

    across = _across(skin.X, skin.triangles)
    k = len(skin.triangles)
    corners = np.arange(3 * k).reshape(k, 3)
    ends = np.concatenate([corners[:, [a, b]] for a, b in SIDES])
    points = skin.triangles.ravel()[ends]
    order = np.lexsort((points.max(axis=1), points.min(axis=1)))
    ends, points = ends[order], np.sort(points[order], axis=1)
    same = np.flatnonzero(np.all(points[1:] == points[:-1], axis=1))
    one, other = ends[same], ends[same + 1][:, ::-1]  # the neighbour runs along the edge the other way
    unit = across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
    smooth = np.einsum("mi,mi->m", unit[one[:, 0] // 3], unit[other[:, 0] // 3]) > SHARP
    links = (one[smooth].ravel(), other[smooth].ravel())
    graph = sp.csr_matrix((np.ones(len(links[0])), links), (3 * k, 3 * k))
    n, part = connected_components(graph, directed=False)
    base: Ints = np.zeros(n, dtype=np.int64)
    base[part] = skin.triangles.ravel()
    doubled = np.repeat(across, 3, axis=0)
    normals, area = np.zeros((n, 3)), np.zeros(n)
    np.add.at(normals, part, doubled)
    np.add.at(area, part, np.linalg.norm(doubled, axis=1) / 6.0)
    # Of a part that ends at an edge: along the triangle whose middle is most inside of it, at most as far as that, so
    # that it stays off the core below the triangles beyond.
    is_edge = np.bincount(base, minlength=len(skin.X))[base] > 1
    way = np.repeat(skin.drawn[skin.triangles].mean(axis=1), 3, axis=0) - skin.drawn[skin.triangles.ravel()]
    inside = np.zeros((n, 3))
    np.add.at(inside, part, way)
    inside /= np.maximum(np.linalg.norm(inside, axis=1), 1e-300)[:, None]
    way /= np.linalg.norm(way, axis=1)[:, None]
    corner, tied = _best(np.einsum("mi,mi->m", way, inside[part]), part, n)
    row = part[corner]
    to_middle = _rows(skin.triangles[corner // 3], np.repeat(tied[:, None] / 3.0, 3, axis=1), len(skin.X), row, n)
    way = skin.X[skin.triangles[corner // 3]].mean(axis=1) - skin.X[base[row]]
    length = np.bincount(row, tied * np.linalg.norm(way, axis=1), minlength=n)
    share = np.where(is_edge, np.minimum(1.0, np.sqrt(2.0) * depth / np.maximum(length, 1e-300)), 0.0)
    at_base = sp.csr_matrix((1.0 - share, (np.arange(n), base)), (n, len(skin.X)))
    weights = at_base + sp.diags_array(share) @ to_middle
    weights.eliminate_zeros()
    return Pressing(base, weights, area, normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None])


def body_skin(mesh: TetMesh, drawn: TetMesh | None = None) -> CoredSkin:
    """The skin of a body: its faces in flat pieces between points of the curved faces.

    A core's point follows the corners' mean deformation of the element below it in which its weights are smallest; of
    elements that are equally good, as in a symmetric mesh, their mean.

    drawn: the mesh before its shape was changed, see `CoredSkin`; by default as it is.
    """
    drawn = drawn or mesh
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
    L = grid / float(n)
    shape = L if faces.shape[1] == 3 else np.concatenate([L * (2.0 * L - 1.0), 4.0 * L * L[:, [1, 2, 0]]], axis=1)
    weights = _rows(faces[face], shape[at], mesh.n_points)
    triangles, owners = number[:, small].reshape(-1, 3), np.repeat(boundary_owners(mesh), len(small))
    X, before = weights @ mesh.points, weights @ drawn.points
    vertex, tet = triangles.ravel(), np.repeat(owners, 3)
    best, tied = _best(-np.abs(_rates(drawn, before, triangles, owners)).sum(axis=1), vertex, len(X))
    rates = tied[:, None] * _rates(mesh, X, triangles, owners)[best]
    core = _rows(mesh.tets[tet[best], :4], rates, mesh.n_points, vertex[best], len(X))
    return CoredSkin(X, triangles, weights, core, before)


def joined(skins: Mapping[str, CoredSkin], first: Mapping[str, int], n_points: int) -> CoredSkin:
    """All skins as one, by the points of a layout.

    Parameters
    ----------
    skins
        Part -> its skin.
    first
        Part -> the number of its first point.
    n_points
        Number of the layout's points.
    """
    import scipy.sparse as sp

    def on_layout(name: str, matrix: Any) -> Any:
        return sp.csr_matrix((matrix.data, matrix.indices + first[name], matrix.indptr), (matrix.shape[0], n_points))

    own = numbers(skins)
    return CoredSkin(
        np.concatenate([skin.X for skin in skins.values()]),
        np.concatenate([own[name][skin.triangles] for name, skin in skins.items()]),
        sp.vstack([on_layout(name, skin.weights) for name, skin in skins.items()], format="csr"),
        sp.vstack([on_layout(name, skin.core) for name, skin in skins.items()], format="csr"),
        np.concatenate([skin.drawn for skin in skins.values()]),
    )


def numbers(skins: Mapping[str, CoredSkin]) -> dict[str, Ints]:
    """The numbers of each skin's points among those of all."""
    ends = np.cumsum([0, *(len(skin.X) for skin in skins.values())]).tolist()
    return {name: np.arange(*ends[k : k + 2]) for k, name in enumerate(skins)}


def columns(matrix: Any) -> tuple[Ints, Any]:
    """The columns with entries of a sparse matrix, and the matrix of these alone."""
    own = np.unique(matrix.indices).astype(np.int64)
    return own, matrix[:, own]


def rigid_skin(X: Floats, triangles: Ints) -> CoredSkin:
    """The skin of a rigid part, of which each point is a node."""
    import scipy.sparse as sp

    chosen = [0]  # four points that span space well
    left = X - X[0]
    for _ in range(3):
        chosen.append(int(np.argmax(np.linalg.norm(left, axis=1))))
        along = left[chosen[-1]] / np.linalg.norm(left[chosen[-1]])
        left = left - np.outer(left @ along, along)
    last = np.linalg.solve((X[chosen[1:]] - X[chosen[0]]).T, _inwards(X, triangles).T).T
    rates = np.column_stack([-last.sum(axis=1), last])
    own = sp.csr_matrix((np.ones(len(X)), np.arange(len(X)), np.arange(len(X) + 1)))
    return CoredSkin(X, triangles, own, _rows(np.tile(chosen, (len(X), 1)), rates, len(X)), X)


def _rates(mesh: TetMesh, X: Floats, triangles: Ints, owners: Ints) -> Floats:
    """Rates (3 k, 4) [1/m] by depth of the barycentric coordinates, in the tet below, of core points that move inwards
    from each corner of the triangles; owners: these tets (k,).
    """
    corners = mesh.points[mesh.tets[:, :4]]
    to_corners = np.linalg.inv(corners[owners, 1:] - corners[owners, :1]).repeat(3, axis=0)
    rates = np.einsum("mi,mij->mj", _inwards(X, triangles)[triangles.ravel()], to_corners)
    return np.column_stack([-rates.sum(axis=1), rates])


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


def _best(merit: Floats, group: Ints, n: int) -> tuple[Ints, Floats]:
    """Of each of n groups the members (k,) of most merit, and their shares in it (k,): all that are equal count alike,
    so that in a symmetric mesh rounding does not choose.
    """
    most = np.full(n, -np.inf)
    np.maximum.at(most, group, merit)
    best = np.flatnonzero(merit >= most[group] - EQUAL * np.abs(most[group]))
    return best, 1.0 / np.bincount(group[best], minlength=n)[group[best]]


def _rows(nodes: Ints, values: Any, n_nodes: int, row: Ints | None = None, n_rows: int | None = None) -> Any:
    """The sparse matrix (n_rows, n_nodes) that sums the values (n, k) at these nodes (n, k), in each one's row (n,): by
    default one row for each.
    """
    import scipy.sparse as sp

    row = np.arange(len(nodes)) if row is None else row
    places = (np.repeat(row, nodes.shape[1]), nodes.ravel())
    matrix = sp.csr_matrix((values.ravel(), places), (len(nodes) if n_rows is None else n_rows, n_nodes))
    matrix.eliminate_zeros()
    return matrix
