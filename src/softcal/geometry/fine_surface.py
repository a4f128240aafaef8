"""Faces of tets as triangles that follow the curved faces of quadratic ones, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints

_STEPS, _FEWER = 4, 2  # parts of an edge of a quadratic face; of as many faces as `_MANY`
_MANY = 6000


@dataclass(frozen=True)
class FineSurface:
    """Triangles over points of faces, each point once.

    Attributes
    ----------
    faces
        The nodes of each face (k, 3 or 6).
    triangles
        Points of each triangle (m, 3), as many for every face, in the order of the faces.
    edges
        Points along each edge of a face (e, 2 or more).
    nodes, weights
        The nodes (n, 3 or 6) and shape functions [-] of each point.
    """

    faces: Ints
    triangles: Ints
    edges: Ints
    nodes: Ints
    weights: Floats

    def at(self, values: Floats) -> Floats:
        """Values of all nodes of the mesh (n_nodes, ...) at the points (n, ...)."""
        return np.einsum("pa,pa...->p...", self.weights, values[self.nodes])

    def by_triangle(self, values: np.ndarray) -> np.ndarray:
        """Values of the faces (k, ...) of each triangle (m, ...)."""
        return np.repeat(values, len(self.triangles) // max(len(self.faces), 1), axis=0)


def fine_surface(faces: Ints, most: int | None = None) -> FineSurface:
    """Linear faces (k, 3) as they are; quadratic ones (k, 6) divided evenly between their nodes.

    Parameters
    ----------
    faces
        Nodes of each face.
    most
        Triangles for which quadratic faces are divided less, or not at all.
    """
    n = 1 if faces.shape[1] == 3 else _STEPS if len(faces) < _MANY else _FEWER
    while most is not None and n > 1 and n * n * len(faces) > most:
        n //= 2
    grid = np.array([(n - i - j, i, j) for i in range(n + 1) for j in range(n + 1 - i)])
    at = {(i, j): place for place, (_, i, j) in enumerate(grid.tolist())}
    flat = [(at[i, j], at[i + 1, j], at[i, j + 1]) for i in range(n) for j in range(n - i)]
    flat += [(at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]) for i in range(n) for j in range(n - i - 1)]
    sides = [
        [at[i, 0] for i in range(n + 1)],
        [at[n - i, i] for i in range(n + 1)],
        [at[0, n - i] for i in range(n + 1)],
    ]
    # A number of each point: the same in two faces where both have the point, on a corner or an edge.
    keys = -1 - np.arange(len(faces) * len(grid), dtype=np.int64).reshape(len(faces), -1)
    size = int(faces[:, :3].max(initial=0)) + 1
    for place, shares in enumerate(grid.tolist()):
        held = [k for k in range(3) if shares[k]]
        if len(held) < 3:
            a, b = faces[:, held[0]], faces[:, held[-1]]
            share = np.where(a <= b, shares[held[0]], shares[held[-1]]) if len(held) == 2 else n
            keys[:, place] = (np.minimum(a, b) * size + np.maximum(a, b)) * (n + 1) + share
    _, first, own = np.unique(keys.ravel(), return_index=True, return_inverse=True)
    own = own.reshape(len(faces), len(grid))
    L = grid / n
    weights = L if faces.shape[1] == 3 else np.column_stack([L * (2 * L - 1), 4 * L * L[:, [1, 2, 0]]])
    edges = own[:, sides].reshape(-1, n + 1)
    _, once = np.unique(np.sort(edges[:, [0, -1]], axis=1), axis=0, return_index=True)
    which, place = np.divmod(first, len(grid))
    return FineSurface(faces, own[:, flat].reshape(-1, 3), edges[once], faces[which], weights[place])
