"""The two kinds of tetrahedra that meshes are made of, linear and quadratic, all that depends on the kind, and their
triangular faces by connectivity alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats, Ints

# Corner pairs of the six edges of a tetrahedron, in the order of nodes 4..9 of a quadratic one (VTK, CalculiX C3D10).
TET_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
# Corners of the four faces, counter-clockwise seen from outside, and the edges (index into TET_EDGES) between them.
TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
TET_FACE_EDGES = ((2, 1, 0), (0, 4, 3), (1, 5, 4), (3, 5, 2))


@dataclass(frozen=True)
class Cell:
    """A tetrahedron with a node at each corner, and at the middle of each of its `edges` (pairs of corners).

    faces: nodes of each of its sides, corners first, as seen from outside; flat_faces: the flat triangles, by the
    nodes of a face, that stand for one; face_shares: what each node of a straight face gets of a constant traction on
    it; vtk, meshio, meshio_face, calculix: what those call it.
    """

    name: str
    order: int
    edges: tuple[tuple[int, int], ...]
    faces: tuple[tuple[int, ...], ...]
    flat_faces: tuple[tuple[int, int, int], ...]
    face_shares: tuple[float, ...]
    vtk: int
    meshio: str
    meshio_face: str
    calculix: str

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return 4 + len(self.edges)

    @cached_property
    def nodes(self) -> Floats:
        """Barycentric coordinates of the nodes (n_nodes, 4)."""
        corners = np.eye(4)
        return np.vstack([corners, *(0.5 * (corners[[a]] + corners[[b]]) for a, b in self.edges)])

    def functions(self, barycentric: Floats) -> Floats:
        """Shape functions N_a at points given by barycentric coordinates (n, 4); shape (n, n_nodes)."""
        L = barycentric
        if not self.edges:
            return L.copy()
        edge = np.stack([4.0 * L[:, a] * L[:, b] for a, b in self.edges], axis=1)
        return np.concatenate([L * (2.0 * L - 1.0), edge], axis=1)

    def gradients(self, barycentric: Floats) -> Floats:
        """dN_a / dL_k at points given by barycentric coordinates (n, 4); shape (n, n_nodes, 4)."""
        n, L = len(barycentric), barycentric
        if not self.edges:
            return np.broadcast_to(np.eye(4), (n, 4, 4)).copy()
        dN = np.zeros((n, self.n_nodes, 4))
        for a in range(4):
            dN[:, a, a] = 4.0 * L[:, a] - 1.0
        for i, (a, b) in enumerate(self.edges):
            dN[:, 4 + i, a] = 4.0 * L[:, b]
            dN[:, 4 + i, b] = 4.0 * L[:, a]
        return dN


LINEAR = Cell(
    "linear",
    order=1,
    edges=(),
    faces=TET_FACES,
    flat_faces=((0, 1, 2),),
    face_shares=(1.0 / 3.0,) * 3,
    vtk=10,
    meshio="tetra",
    meshio_face="triangle",
    calculix="C3D4",
)
QUADRATIC = Cell(
    "quadratic",
    order=2,
    edges=TET_EDGES,
    faces=tuple((*face, *(4 + edge for edge in edges)) for face, edges in zip(TET_FACES, TET_FACE_EDGES, strict=True)),
    flat_faces=((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    face_shares=(0.0,) * 3 + (1.0 / 3.0,) * 3,
    vtk=24,
    meshio="tetra10",
    meshio_face="triangle6",
    calculix="C3D10",
)
CELLS: Mapping[int, Cell] = {cell.order: cell for cell in (LINEAR, QUADRATIC)}


def cell_of(tets: Ints) -> Cell:
    """The kind of a connectivity (n_tets, 4 or 10)."""
    return next(cell for cell in CELLS.values() if cell.n_nodes == tets.shape[1])


def all_faces(tets: Ints) -> Ints:
    """Four faces of each tet in order, (4 n_tets, 3 or 6)."""
    faces = cell_of(tets).faces
    return tets[:, faces].reshape(-1, len(faces[0]))


def outer_faces(tets: Ints) -> Ints:
    """Rows (k,) of `all_faces(tets)` that belong to a single tet, ascending."""
    keys = face_keys(all_faces(tets), int(tets.max(initial=-1)) + 1)
    _, first, count = np.unique(keys, return_index=True, return_counts=True)
    return np.sort(first[count == 1])


def face_keys(faces: Ints, n_points: int) -> Ints:
    """A number for each face (k,), equal for equal corners."""
    low, middle, high = np.sort(faces[:, :3], axis=1).T
    return (low * n_points + middle) * n_points + high
