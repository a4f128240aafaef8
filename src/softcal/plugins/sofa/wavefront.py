"""Surfaces as Wavefront .obj text; points on sharp edges are duplicated, as viewers shade smoothly across points."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from softcal.checks import Floats, Ints

SHARP = np.radians(40.0)  # angle between neighbouring triangles above which their edge is sharp


def split_at_edges(points: Floats, triangles: Ints) -> tuple[Ints, Ints]:
    """Duplicate points on sharp edges, once for each smooth part of the surface.

    Parameters
    ----------
    points
        (n, 3) [m].
    triangles
        (k, 3), consistently oriented.

    Returns
    -------
    source, triangles
        Original number of each new point (m,); triangles (k, 3) of new points.
    """
    k = len(triangles)
    corner = np.arange(3 * k).reshape(k, 3)
    begins, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    at_begin, at_end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    key = np.minimum(begins, ends) * len(points) + np.maximum(begins, ends)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    # A side of one triangle, or of three and more, is a sharp edge.
    one, two = order[first[count == 2]], order[first[count == 2] + 1]
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    smooth = (normal[one // 3] * normal[two // 3]).sum(axis=1) > np.cos(SHARP)
    one, two = one[smooth], two[smooth]
    rows, columns = np.concatenate([at_begin[one], at_end[one]]), np.concatenate([at_end[two], at_begin[two]])
    same = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(3 * k, 3 * k))
    label = np.asarray(connected_components(same, directed=False)[1], dtype=np.int64)
    _, where = np.unique(label, return_index=True)
    return begins[where], label.reshape(k, 3)


def wavefront(points: Floats, triangles: Ints, title: str) -> str:
    """Text of a .obj file, in full precision.

    Parameters
    ----------
    points
        Points (n, 3) [m].
    triangles
        Triangles (k, 3).
    title
        Comment in the first line.
    """
    lines = [f"# {title}"]
    lines += ["v " + " ".join(repr(float(value)) for value in at) for at in points]
    lines += ["f " + " ".join(str(n + 1) for n in corners) for corners in triangles.tolist()]
    return "\n".join(lines) + "\n"
