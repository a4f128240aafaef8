"""Solids of revolution swept from triangles of a half section: elements long in the hoop direction, small across."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.cell import TET_EDGES
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import TRIANGLE_EDGES, numbered_edges

# Corners of the three tets of a wedge whose triangle's corners are numbered upwards; 0..2 on an even, 3..5 on an odd
# layer. Every side is cut from the lower corner on the even layer, so that neighbours agree and the mesh is its own
# mirror image in every layer.
WEDGE_TETS = ((0, 3, 4, 5), (0, 1, 4, 5), (0, 1, 2, 5))


def sweep(section: Floats, triangles: Ints, *, sectors: int) -> TetMesh:
    """Quadratic tets from quadratic triangles of a half section, swept about the z axis.

    Parameters
    ----------
    section
        Nodes (r, z) of the half section [m], shape (n, 2); r = 0 on the axis.
    triangles
        Shape (k, 6): corners, then the middles of the edges 0-1, 1-2, 2-0.
    sectors
        Number of wedges around the axis; even. There is a layer of nodes at y = 0.

    Returns
    -------
    TetMesh
        Three tets per triangle and sector, fewer if the triangle touches the axis; curved on every surface of
        revolution.
    """
    corners = np.unique(triangles[:, :3])
    n = len(corners)
    rank = np.full(len(section), -1, dtype=np.int64)
    rank[corners] = np.arange(n)
    flat = np.sort(rank[triangles[:, :3]], axis=1)
    on_axis = section[corners, 0] == 0.0

    layers = np.arange(sectors)
    even = np.where(layers % 2 == 0, layers, (layers + 1) % sectors)
    odd = np.where(layers % 2 == 0, (layers + 1) % sectors, layers)
    wedge = np.concatenate(
        [even[:, None, None] * n + flat, odd[:, None, None] * n + flat], axis=2
    )  # a node is its layer times n plus its rank in the section
    tets = wedge[:, :, WEDGE_TETS].reshape(-1, 4)
    # A node on the axis is shared by all layers.
    tets = np.where(on_axis[tets % n], tets % n, tets)
    ordered = np.sort(tets, axis=1)
    tets = tets[(np.diff(ordered, axis=1) > 0).all(axis=1)]

    edges, number = numbered_edges(tets, n * sectors)
    angle = 2.0 * np.pi / sectors
    nodes = np.unique(tets)
    place = section[corners[nodes % n]]
    points = _around(place, angle * (nodes // n))
    new = np.full(n * sectors, -1, dtype=np.int64)
    new[nodes] = np.arange(len(nodes))
    ends = np.sort(rank[triangles[:, :3]][:, TRIANGLE_EDGES], axis=2).reshape(-1, 2)
    keys, first = np.unique(ends[:, 0] * n + ends[:, 1], return_index=True)
    middle_nodes = triangles[:, 3:].ravel()[first]
    low, high = np.sort(edges % n, axis=1).T
    between = np.empty((len(edges), 2))
    same = low == high
    between[same] = section[corners[low[same]]]
    between[~same] = section[middle_nodes[np.searchsorted(keys, low[~same] * n + high[~same])]]
    layers_of_ends = edges // n
    at_axis = on_axis[edges % n]
    lower, upper = layers_of_ends[:, 0].astype(np.float64), layers_of_ends[:, 1].astype(np.float64)
    lower = np.where(at_axis[:, 0], upper, lower)
    upper = np.where(at_axis[:, 1], lower, upper)
    wraps = np.abs(lower - upper) > 1
    middles = _around(between, angle * np.where(wraps, sectors - 0.5, 0.5 * (lower + upper)))

    tets10 = np.hstack([new[tets], len(nodes) + number.reshape(-1, len(TET_EDGES))])
    points = np.vstack([points, middles])
    return TetMesh(points, upright(points, tets10))


def _around(place: Floats, angle: Floats) -> Floats:
    r, z = place.T
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


def upright(points: Floats, tets: Ints) -> Ints:
    """Quadratic tets (n, 10) with two nodes swapped in inverted ones."""
    corners = points[tets[:, :4]]
    mirrored = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    tets = tets.copy()
    # Swap nodes 1 and 2, and with them the edges 0-1 and 0-2, and 1-3 and 2-3.
    tets[mirrored] = tets[mirrored][:, [0, 2, 1, 3, 6, 5, 4, 7, 9, 8]]
    return tets
