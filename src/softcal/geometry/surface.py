"""The faces of a mesh: its boundary, and triangles oriented outwards."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.cell import all_faces, cell_of, face_keys, outer_faces
from softcal.geometry.mesh import TetMesh

BESIDE = 1e-6  # of a triangle: so far beyond its edges a point is beside it


def boundary_faces(mesh: TetMesh) -> Ints:
    """Triangles of a single tet (the boundary), oriented outwards, shape (k, 3 or 6)."""
    return all_faces(mesh.tets)[mesh.outer_faces]


def edges_of(faces: Ints) -> Ints:
    """Every edge of the triangles (k, 3) once, (m, 2)."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def boundary(tets: Ints) -> Ints:
    """Faces of a single tet, oriented outwards, shape (k, 3 or 6)."""
    return all_faces(tets)[outer_faces(tets)]


def boundary_triangles(tets: Ints) -> Ints:
    """Outward flat triangles (k, 3) of the boundary of linear or quadratic tets; a quadratic face gives four."""
    faces = boundary(tets)
    return np.concatenate([faces[:, part] for part in cell_of(tets).flat_faces])


def border(faces: Ints) -> list[Ints]:
    """Closed loops of nodes around triangles (k, 3 or 6) that share edges: their edges that belong to one of them.

    The first node of a loop is also its last; the middle nodes of quadratic edges are between their ends.
    """
    if not len(faces):
        return []
    corners = faces[:, :3]
    starts, ends = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    middles = faces[:, 3:].ravel() if faces.shape[1] > 3 else None
    keys = np.sort(np.stack([starts, ends], axis=1), axis=1)
    _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
    follow: dict[int, list[int]] = {}
    for k in first[count == 1].tolist():
        follow.setdefault(int(starts[k]), []).append(k)
    loops: list[Ints] = []
    while follow:
        at = begun = next(iter(follow))
        loop = [at]
        while at in follow:
            k = follow[at].pop()
            if not follow[at]:
                del follow[at]
            at = int(ends[k])
            loop += [at] if middles is None else [int(middles[k]), at]
            if at == begun:
                break
        loops.append(np.array(loop))
    return loops


def boundary_owners(mesh: TetMesh) -> Ints:
    """Tet of each row of `boundary_faces(mesh)`."""
    return mesh.outer_faces // 4


def matching_faces(mesh: TetMesh, triangles: Ints, *, where: str = "") -> Ints:
    """The faces of the mesh with the corners of `triangles` (k, 3 or more), shape (k, 3 or 6).

    Boundary faces are oriented outwards; inner faces keep their given orientation.

    Parameters
    ----------
    mesh
        The mesh [m].
    triangles
        Corners of the faces (k, 3 or more).
    where
        Place for error messages.

    Raises
    ------
    MeshError
        If a triangle is not a face of any tet.
    """
    triangles = np.asarray(triangles, dtype=np.int64)
    faces = all_faces(mesh.tets)
    keys = face_keys(faces, mesh.n_points)
    order = np.argsort(keys, kind="stable")
    wanted = face_keys(triangles, mesh.n_points)
    left = np.searchsorted(keys[order], wanted, side="left")
    right = np.searchsorted(keys[order], wanted, side="right")
    strangers = np.flatnonzero(left == right)
    if strangers.size:
        raise MeshError(
            Fault(
                f"{strangers.size} of {len(triangles)} triangles are not faces of any tetrahedron",
                where=where,
                got=f"for instance nodes {triangles[strangers[0], :3].tolist()}",
                allowed="faces of the tetrahedra of the mesh",
            )
        )
    found = faces[order[left]]
    second = faces[order[right - 1]]
    turn = (right - left > 1) & (_handedness(found) != _handedness(triangles))
    found[turn] = second[turn]
    return found


def _handedness(faces: Ints) -> Ints:
    corners = faces[:, :3]
    first = np.argmin(corners, axis=1)
    rows = np.arange(len(corners))
    return (corners[rows, (first + 1) % 3] < corners[rows, (first + 2) % 3]).astype(np.int64)


def nearest_triangle(triangles: Floats, point: Floats) -> int:
    """Number of the triangle nearest to a point (3,), of those (n, 3, 3) beside which it is; else of all."""
    a, e1, e2 = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normals = np.cross(e1, e2)
    area = np.linalg.norm(normals, axis=1)
    to, n = point - a, normals / area[:, None]
    u, v = (np.einsum("nj,nj->n", n, np.cross(*pair)) / area for pair in ((to, e2), (e1, to)))
    distance = np.abs(np.einsum("nj,nj->n", to, n))
    beside = (u >= -BESIDE) & (v >= -BESIDE) & (u + v <= 1.0 + BESIDE)
    centres = np.linalg.norm(triangles.mean(axis=1) - point, axis=1)
    return int(np.argmin(np.where(beside, distance, np.inf) if beside.any() else centres))
