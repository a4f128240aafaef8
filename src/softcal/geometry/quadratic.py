"""Conversion between linear and quadratic tetrahedra."""

from __future__ import annotations

import numpy as np

from softcal.checks import Ints
from softcal.geometry.cell import LINEAR, QUADRATIC
from softcal.geometry.mesh import TetMesh

# Corners of a triangle whose edge carries nodes 3, 4, 5 of its quadratic form.
TRIANGLE_EDGES = ((0, 1), (1, 2), (2, 0))


def of_order(mesh: TetMesh, order: int) -> TetMesh:
    """The mesh with tetrahedra of an order, one or two [m]; returned unchanged if it has that order."""
    return to_quadratic(mesh) if order == QUADRATIC.order else to_linear(mesh)


def to_quadratic(mesh: TetMesh) -> TetMesh:
    """The mesh with a node at the middle of every edge [m]; a quadratic mesh is returned unchanged.

    The new nodes follow the old ones. A new node is in a node set if both ends of its edge are.
    """
    if mesh.cell is QUADRATIC:
        return mesh
    edges, number = numbered_edges(mesh.tets, mesh.n_points)
    middles = 0.5 * (mesh.points[edges[:, 0]] + mesh.points[edges[:, 1]])
    tets = np.hstack([mesh.tets, mesh.n_points + number.reshape(-1, len(QUADRATIC.edges))])
    node_sets: dict[str, Ints] = {}
    for name, nodes in mesh.node_sets.items():
        inside = np.zeros(mesh.n_points, dtype=bool)
        inside[nodes] = True
        node_sets[name] = np.concatenate([nodes, mesh.n_points + np.flatnonzero(inside[edges].all(axis=1))])
    keys = edges[:, 0] * mesh.n_points + edges[:, 1]
    face_sets: dict[str, Ints] = {}
    for name, faces in mesh.face_sets.items():
        pairs = np.sort(faces[:, TRIANGLE_EDGES], axis=2)
        places = np.searchsorted(keys, pairs[..., 0] * mesh.n_points + pairs[..., 1])
        face_sets[name] = np.hstack([faces, mesh.n_points + places])
    return TetMesh(np.vstack([mesh.points, middles]), tets, node_sets, face_sets, dict(mesh.element_sets))


def to_linear(mesh: TetMesh) -> TetMesh:
    """The mesh without its mid-edge nodes [m]; a linear mesh is returned unchanged.

    The corners are renumbered in their old order; unused nodes are removed.
    """
    if mesh.cell is LINEAR:
        return mesh
    new = linear_numbers(mesh)
    node_sets = {name: new[nodes][new[nodes] >= 0] for name, nodes in mesh.node_sets.items()}
    return TetMesh(
        mesh.points[mesh.corners],
        new[mesh.tets[:, :4]],
        node_sets=node_sets,
        face_sets={name: new[faces[:, :3]] for name, faces in mesh.face_sets.items()},
        element_sets=dict(mesh.element_sets),
    )


def linear_numbers(mesh: TetMesh) -> Ints:
    """The number of each node in `to_linear(mesh)`, shape (n_points,); -1 for mid-edge nodes."""
    new = np.full(mesh.n_points, -1, dtype=np.int64)
    new[mesh.corners] = np.arange(len(mesh.corners))
    return new


def numbered_edges(tets: Ints, n_points: int) -> tuple[Ints, Ints]:
    """The edges (k, 2) of tets between n_points corners, lower corner first, and the number of each of their six edges,
    one after the other (6 n_tets,).
    """
    pairs = np.sort(tets[:, QUADRATIC.edges].reshape(-1, 2), axis=1)
    keys, number = np.unique(pairs[:, 0] * n_points + pairs[:, 1], return_inverse=True)
    return np.column_stack([keys // n_points, keys % n_points]), number
