"""Quality check of a mesh before solving."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.cell import TET_EDGES, TET_FACES, face_keys
from softcal.geometry.mesh import TetMesh
from softcal.units import format_place

# A tet whose smallest dihedral angle [rad] is below this is a sliver.
SLIVER_ANGLE = math.radians(5.0)
# A tet is flat if its Jacobian, relative to the cube of the longest edge, is below this.
FLAT = 1e-10
# Nodes closer than this, relative to the mesh's diagonal, are duplicates.
SAME_PLACE = 1e-9


@dataclass(frozen=True)
class MeshReport:
    """Result of `check_quality`.

    volume [m^3]; lower, upper: corners of the bounding box [m]; qualities: mean ratio, 1 for a regular tet, 0 for a
    flat one; min_dihedral [rad]; inverted: tets that are flat or turned inside out somewhere; slivers: tets with a
    dihedral angle below 5 degrees; n_parts: parts that share no node; unreferenced: nodes that no tet uses;
    n_duplicate_nodes: pairs of nodes at the same place; hinged: tets of all but the largest piece, where pieces of the
    mesh share edges or nodes, but no face.
    """

    n_points: int
    n_tets: int
    order: int
    volume: float
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    min_quality: float
    median_quality: float
    min_dihedral: float
    inverted: tuple[int, ...]
    slivers: tuple[int, ...]
    n_parts: int
    unreferenced: tuple[int, ...]
    n_duplicate_nodes: int
    hinged: tuple[int, ...] = ()

    @property
    def warning(self) -> str:
        """A sentence on poor but usable elements, or empty."""
        texts: list[str] = []
        if self.slivers:
            texts.append(
                f"{len(self.slivers)} of {self.n_tets} tets are slivers (tets {_some(self.slivers)}), "
                f"smallest dihedral angle {math.degrees(self.min_dihedral):.2g} deg, where 5 deg or more is good"
            )
        if self.n_duplicate_nodes:
            texts.append(f"{self.n_duplicate_nodes} pairs of nodes coincide, so that the mesh has a slit")
        if self.hinged and self.n_parts == 1:
            texts.append(
                f"{len(self.hinged)} of {self.n_tets} tets (tets {_some(self.hinged)}) share edges or nodes with the "
                "others, but no face, so that they turn there as on a hinge"
            )
        return "; ".join(texts)


def check_quality(mesh: TetMesh) -> MeshReport:
    """Measure a mesh; never raises an error for a poor one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # pyright: ignore[reportUnknownVariableType]
    from scipy.spatial import KDTree  # pyright: ignore[reportUnknownVariableType, reportAttributeAccessIssue]

    corners = mesh.points[mesh.tets[:, :4]]
    lower, upper = mesh.points.min(axis=0), mesh.points.max(axis=0)
    dihedral = least_dihedral(corners)
    volumes = np.maximum(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0, 0.0)
    squares = (_edge_lengths(corners) ** 2).sum(axis=1)
    quality = 12.0 * (3.0 * volumes) ** (2.0 / 3.0) / np.maximum(squares, np.finfo(float).tiny)
    inverted = inverted_tets(mesh)
    used = np.zeros(mesh.n_points, dtype=bool)
    used[mesh.tets] = True
    near = SAME_PLACE * float(np.linalg.norm(upper - lower))
    tree: Any = KDTree(mesh.points)
    # The Jacobian of a quadratic tet is cubic: five points integrate it exactly.
    five = np.vstack([np.full((1, 4), 0.25), np.full((4, 4), 1 / 6) + np.eye(4) / 3])
    weights = np.array([-0.8, 0.45, 0.45, 0.45, 0.45]) / 6.0
    first = np.repeat(mesh.tets[:, 0], mesh.tets.shape[1] - 1)
    others = mesh.tets[:, 1:].ravel()
    graph = coo_array((np.ones(len(first), dtype=np.int8), (first, others)), shape=(mesh.n_points, mesh.n_points))
    _, labels = cast("tuple[int, Ints]", connected_components(graph, directed=False))
    return MeshReport(
        n_points=mesh.n_points,
        n_tets=mesh.n_tets,
        order=mesh.order,
        volume=float((_jacobians(mesh, five) @ weights).sum()),
        lower=_triple(lower),
        upper=_triple(upper),
        min_quality=float(quality.min()),
        median_quality=float(np.median(quality)),
        min_dihedral=float(dihedral.min()),
        inverted=tuple(inverted.tolist()),
        slivers=tuple(np.setdiff1d(np.flatnonzero(dihedral < SLIVER_ANGLE), inverted).tolist()),
        n_parts=len(np.unique(labels[used])),
        unreferenced=tuple(np.flatnonzero(~used).tolist()),
        n_duplicate_nodes=len(tree.query_pairs(near)),
        hinged=tuple(_hinged(mesh).tolist()),
    )


def _hinged(mesh: TetMesh) -> Ints:
    """Numbers of the tets outside the largest piece of the mesh whose tets share faces."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # pyright: ignore[reportUnknownVariableType]

    keys = face_keys(mesh.tets[:, np.array(TET_FACES)].reshape(-1, 3), mesh.n_points)
    _, face = np.unique(keys, return_inverse=True)
    tet = np.repeat(np.arange(mesh.n_tets), 4)
    n = mesh.n_tets + int(face.max()) + 1
    graph = coo_array((np.ones(len(tet), dtype=np.int8), (tet, mesh.n_tets + face)), shape=(n, n))
    _, labels = cast("tuple[int, Ints]", connected_components(graph, directed=False))
    piece = labels[: mesh.n_tets]
    return np.flatnonzero(piece != np.bincount(piece).argmax())


def inverted_tets(mesh: TetMesh) -> Ints:
    """Numbers of the tets that are flat or turned inside out somewhere."""
    longest = _edge_lengths(mesh.points[mesh.tets[:, :4]]).max(axis=1)
    places = np.vstack([mesh.cell.nodes, np.full((1, 4), 0.25)])
    return np.flatnonzero(_jacobians(mesh, places).min(axis=1) <= FLAT * longest**3)


def require_sound(mesh: TetMesh, where: str = "") -> MeshReport:
    """The report of a usable mesh.

    Raises
    ------
    MeshError
        If tets are inverted, parts are not connected or nodes belong to no tet; with all faults.
    """
    report = check_quality(mesh)
    faults: list[Fault] = []
    if report.inverted:
        everything = len(report.inverted) == report.n_tets
        faults.append(
            Fault(
                f"{len(report.inverted)} of {report.n_tets} tets are inverted or flat",
                where=where,
                got=f"tets {_some(report.inverted)}",
                allowed="a positive Jacobian throughout every tet",
                attempt="swap two nodes of every tet: their order is mirrored" if everything else "mesh anew",
            )
        )
    if report.n_parts > 1:
        hint = f"; {report.n_duplicate_nodes} pairs of nodes at the same place" if report.n_duplicate_nodes else ""
        faults.append(
            Fault(
                "the mesh has several parts that share no node",
                where=where,
                got=f"{report.n_parts} parts{hint}",
                allowed="one connected part for each body",
                attempt="merge the nodes at the same place" if hint else "one mesh for each body",
            )
        )
    if loose := report.unreferenced:
        faults.append(
            Fault(
                f"{len(loose)} of {report.n_points} nodes belong to no tet",
                where=where,
                got=f"nodes {_some(loose)}, the first at {format_place(mesh.points[loose[0]])}",
                allowed="nodes of tets only",
                attempt="write the tets and their nodes alone; in Python drop_unreferenced(mesh)",
            )
        )
    if faults:
        raise MeshError(faults)
    return report


def drop_unreferenced(mesh: TetMesh) -> TetMesh:
    """The mesh without unused nodes, renumbered in the old order."""
    used = np.unique(mesh.tets)
    new = np.full(mesh.n_points, -1, dtype=np.int64)
    new[used] = np.arange(len(used))
    return TetMesh(
        mesh.points[used],
        new[mesh.tets],
        node_sets={name: new[nodes][new[nodes] >= 0] for name, nodes in mesh.node_sets.items()},
        face_sets={name: new[faces] for name, faces in mesh.face_sets.items()},
        element_sets=dict(mesh.element_sets),
    )


def _edge_lengths(corners: Floats) -> Floats:
    return np.stack([np.linalg.norm(corners[:, b] - corners[:, a], axis=1) for a, b in TET_EDGES], axis=1)


def least_dihedral(corners: Floats) -> Floats:
    """The smallest dihedral angle [rad] of each tet (n,), by corners (n, 4, 3)."""
    normals: list[Floats] = []
    for a, b, c in TET_FACES:
        normal = np.cross(corners[:, b] - corners[:, a], corners[:, c] - corners[:, a])
        normals.append(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny))
    cosines = [-np.einsum("ij,ij->i", normals[i], normals[j]) for i in range(len(normals)) for j in range(i)]
    return np.arccos(np.clip(np.max(cosines, axis=0), -1.0, 1.0))


def _jacobians(mesh: TetMesh, places: Floats) -> Floats:
    """Jacobians at barycentric places (p, 4), shape (n_tets, p)."""
    nodes = mesh.points[mesh.tets]
    by_barycentric = np.einsum("pai,ead->epid", mesh.cell.gradients(places), nodes)
    return np.linalg.det(by_barycentric[:, :, 1:] - by_barycentric[:, :, :1])


def _triple(values: Floats) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _some(numbers: tuple[int, ...] | Ints) -> str:
    shown = ", ".join(str(number) for number in numbers[:8])
    return shown if len(numbers) <= 8 else f"{shown}, ..."
