"""Uniform refinement: each tet is divided into eight, each element of a rod into two, and all sets are kept.

A tet is divided at the middles of its edges: four tets at its corners, and the octahedron between them into four around
the shortest of its three diagonals (Bey, Computing 55, 1995), so that the pieces are conforming. A quadratic tet is
divided along its own map, so that the pieces fill the same volume, including curved sides. The body keeps its shape:
flat sides that approximate a curved surface stay flat.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.cell import LINEAR, QUADRATIC, TET_EDGES, TET_FACES, Cell
from softcal.geometry.centreline import Centreline
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import to_quadratic
from softcal.geometry.surface import matching_faces

PIECES = 8
# Nodes 4..9 of a quadratic tet are the octahedron's corners; each diagonal with the four corners around it, in turn.
_DIAGONALS = (((4, 9), (6, 7, 8, 5)), ((6, 8), (4, 7, 9, 5)), ((7, 5), (4, 6, 9, 8)))
# Nodes of the tets at the corners.
_AT_CORNERS = ((0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3))


@dataclass(frozen=True)
class MeshCounts:
    """Numbers of corners, edges, faces and tets of a mesh."""

    corners: int
    edges: int
    faces: int
    tets: int

    def nodes(self, cell: Cell) -> int:
        """Number of nodes with tets of this kind."""
        return self.corners + (self.edges if cell.edges else 0)

    @property
    def refined(self) -> MeshCounts:
        """Counts of the refined mesh, without generating it."""
        return MeshCounts(
            corners=self.corners + self.edges,
            edges=2 * self.edges + 3 * self.faces + self.tets,
            faces=4 * self.faces + PIECES * self.tets,
            tets=PIECES * self.tets,
        )


def count(mesh: TetMesh) -> MeshCounts:
    """Corners, edges, faces and tets of a mesh of any order."""
    corners = mesh.tets[:, :4]
    kinds = [np.sort(corners[:, local].reshape(-1, len(local[0])), axis=1) for local in (TET_EDGES, TET_FACES)]
    counts: list[int] = []
    for rows in kinds:
        keys = rows[:, 0]  # one number for each row of sorted node numbers
        for column in rows.T[1:]:
            keys = keys * mesh.n_points + column
        counts.append(len(np.unique(keys)))
    edges, faces = counts
    return MeshCounts(len(mesh.corners), edges, faces, mesh.n_tets)


def refined_mesh(mesh: TetMesh) -> TetMesh:
    """The mesh of the same order with every tet divided into eight [m]: tets 8 k … 8 k + 7 are those of tet k.

    The nodes keep their numbers, and new ones follow. A new node is in a node set if both ends of its edge are; face
    sets contain the quarters of their triangles, element sets the pieces of their tets.
    """
    nodes = to_quadratic(mesh)
    pieces = _pieces(nodes.points[nodes.tets])
    face_sets: dict[str, Ints] = {}
    for name, faces in nodes.face_sets.items():
        if faces.shape[1] == 3:  # a quadratic mesh whose set lists only the corners
            faces = matching_faces(nodes, faces)
        face_sets[name] = faces[:, QUADRATIC.flat_faces].reshape(-1, 3)
    cut = TetMesh(
        nodes.points,
        nodes.tets[np.arange(nodes.n_tets)[:, None, None], pieces].reshape(-1, 4),
        node_sets=dict(nodes.node_sets),
        face_sets=face_sets,
        element_sets={
            name: (PIECES * tets[:, None] + np.arange(PIECES)).ravel() for name, tets in nodes.element_sets.items()
        },
    )
    if mesh.cell is LINEAR:
        return cut
    fine = to_quadratic(cut)
    points = np.array(fine.points)
    # Middles of the edges of a quadratic mesh's pieces by its own map, (8 n_tets, 6, 3) [m].
    at = QUADRATIC.nodes[pieces]  # (n_tets, 8, 4, 4)
    L = 0.5 * (at[:, :, [a for a, _ in TET_EDGES]] + at[:, :, [b for _, b in TET_EDGES]])
    N = QUADRATIC.functions(L.reshape(-1, 4)).reshape(*L.shape[:3], QUADRATIC.n_nodes)
    points[fine.tets[:, 4:]] = np.einsum("epka,eai->epki", N, nodes.points[nodes.tets]).reshape(-1, len(TET_EDGES), 3)
    return TetMesh(points, fine.tets, dict(fine.node_sets), dict(fine.face_sets), dict(fine.element_sets))


def corners_in_parents(mesh: TetMesh) -> Floats:
    """Barycentric coordinates (8 n_tets, 4, 4) of the corners of the refined mesh's tets in their parent tets."""
    nodes = to_quadratic(mesh)
    return QUADRATIC.nodes[_pieces(nodes.points[nodes.tets])].reshape(-1, 4, 4)


def refined_centreline(line: Centreline) -> Centreline:
    """The centreline with a node in the middle of every element; node k becomes node 2 k.

    The middle is half the screw motion from one end to the other: exact on straight rods, arcs and helices, and equal
    to the shape that the rod elements assume.
    """
    from scipy.spatial.transform import Rotation

    first, last = line.triads[:-1], line.triads[1:]
    turn = Rotation.from_matrix(np.swapaxes(first, 1, 2) @ last).as_rotvec()
    chord = np.einsum("nji,nj->ni", first, np.diff(line.nodes, axis=0))
    screw = np.linalg.solve(_screw_map(turn), chord[:, :, None])
    half = 0.5 * (_screw_map(0.5 * turn) @ screw)[:, :, 0]
    m = len(line.nodes)
    nodes, triads = np.empty((2 * m - 1, 3)), np.empty((2 * m - 1, 3, 3))
    nodes[::2], triads[::2] = line.nodes, line.triads
    nodes[1::2] = line.nodes[:-1] + np.einsum("nij,nj->ni", first, half)
    triads[1::2] = first @ Rotation.from_rotvec(0.5 * turn).as_matrix()
    return Centreline(nodes, triads, np.repeat(0.5 * line.lengths, 2))


def refined_nodes(nodes: Ints) -> Ints:
    """Numbers in the refined centreline of a centreline's nodes, with the middles of elements with both ends listed."""
    held = np.unique(nodes)
    middles = [2 * a + 1 for a, b in pairwise(held.tolist()) if b == a + 1]
    return np.sort(np.concatenate([2 * held, np.array(middles, dtype=np.int64)]))


def _pieces(X: Floats) -> Ints:
    """The nodes (0 to 9) of each tet's pieces, (n_tets, 8, 4), from the positions of its ten nodes (n_tets, 10, 3)."""
    lengths = np.stack([np.linalg.norm(X[:, a] - X[:, b], axis=1) for (a, b), _ in _DIAGONALS], axis=1)
    # Among diagonals equal up to rounding the first, so that the division does not depend on the position of the mesh.
    shortest = np.argmax(lengths <= (1.0 + 1e-9) * lengths.min(axis=1, keepdims=True), axis=1)
    places = QUADRATIC.nodes[:, 1:]
    # For each choice of the diagonal the nodes of all pieces (3, 8, 4), positively oriented.
    tables: list[list[tuple[int, ...]]] = []
    for (a, b), around in _DIAGONALS:
        tables.append([*_AT_CORNERS])
        for pair in pairwise((*around, around[0])):
            at = places[[a, b, *pair]]
            tables[-1].append((a, b, *pair) if np.linalg.det(at[1:] - at[0]) > 0.0 else (b, a, *pair))
    return np.array(tables, dtype=np.int64)[shortest]


def _screw_map(turn: Floats) -> Floats:
    """(n, 3, 3): maps the translation of a screw with this rotation vector (n, 3) to the displacement of its end."""
    angle = np.linalg.norm(turn, axis=1)[:, None, None]
    x, y, z = turn.T
    zero = np.zeros_like(x)
    K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    small = angle < 1e-3
    t = np.where(small, 1.0, angle)
    first = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(t)) / t**2)
    second = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (t - np.sin(t)) / t**3)
    return np.eye(3) + first * K + second * K @ K
