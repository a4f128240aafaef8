"""Detection of skins of bodies that pass through themselves or each other, where no contact keeps them apart.

They do from where contact would begin to press, and as long as an edge passes through a face: deep in another body, no
point may be near the surface any more. For the latter, every skin is inset by a small part of its edges: skins that
only touch, or are bonded face to face, do not cross.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.surface import edges_of
from softcal.mechanics.contact import ContactTerm
from softcal.mechanics.wire_contact import collision_mesh

TOUCH = 1e-3  # of the contact's depth: overlaps below are rounding

Crossings = dict[tuple[str, str], float]
"""Names of two bodies, or of one twice, and about how deep [m] one is in the other."""


@dataclass(frozen=True)
class Skins:
    """The skins of the bodies.

    Attributes
    ----------
    points, weights
        The layout's points of which the vertices are weighted sums (n,), and the weights: sparse (n_vertices, n).
    X
        The vertices at rest (n_vertices, 3) [m].
    faces
        Faces of these vertices (k, 3), outward.
    owner, names
        Number of each vertex's body in `names` (n_vertices,), and the bodies' names.
    inset
        Distance by which the vertices are moved inwards [m].
    apart, patch
        See `softcal.mechanics.wire_contact.WireContactTerm`.
    touch, touch_owner
        The contact that the bodies would have, and the number of each of its vertices' body.
    """

    points: Ints
    weights: Any
    X: Floats
    faces: Ints
    owner: Ints
    names: tuple[str, ...]
    inset: float
    apart: Ints
    patch: Ints
    touch: ContactTerm
    touch_owner: Ints

    def crossings(self, x: Floats) -> Crossings:
        """The bodies that intersect at positions x (n_points, 3) [m], except pairs that intersect at rest."""
        found = self._crossings(self._vertices(x))
        for pair, depth in self.overlaps(x).items():
            found[pair] = max(found.get(pair, 0.0), depth)
        return {pair: depth for pair, depth in found.items() if pair not in self.at_rest}

    def pairs(self, x: Floats) -> frozenset[tuple[str, str]]:
        """The same pairs without depths, which is much faster for one body."""
        if len(self.names) == 1 and not self.at_rest:
            crosses = self.overlaps(x) or self._intersect(self._taken_in(self._vertices(x)))
            return frozenset([(self.names[0], self.names[0])] if crosses else [])
        return frozenset(self.crossings(x))

    def overlaps(self, x: Floats) -> Crossings:
        """The bodies whose points would be in contact, and their largest depth [m] beyond the other's surface."""
        points, simplices, depth = self.touch.overlaps(x)
        press = depth > TOUCH * self.touch.depth
        return self._deepest(self.touch_owner[points[press]], self.touch_owner[simplices[press, 0]], depth[press])

    def _deepest(self, one: Ints, other: Ints, depth: Floats) -> Crossings:
        """The largest depth (n,) [m] of each pair of bodies, by the numbers of both (n,)."""
        deepest: Crossings = {}
        for i, k, d in zip(np.minimum(one, other), np.maximum(one, other), depth.tolist(), strict=True):
            pair = (self.names[i], self.names[k])
            deepest[pair] = max(deepest.get(pair, 0.0), d)
        return deepest

    @cached_property
    def at_rest(self) -> Crossings:
        """The bodies that cross at rest."""
        return self._crossings(self.X)

    def _crossings(self, x: Floats) -> Crossings:
        import ipctk

        V = self._taken_in(x)
        if not self._intersect(V):
            return {}
        # Vertices of edges (m, 2) and of faces (m, 3) that are near each other and may cross.
        near = ipctk.LBVH()
        near.can_vertices_collide = self._mesh.can_collide
        near.build(V, self._mesh.edges, self._mesh.faces)
        pairs = np.array([(c.edge_id, c.face_id) for c in near.detect_edge_face_candidates()], dtype=np.int64)
        pairs = pairs.reshape(-1, 2)
        edges, faces = self._edges[pairs[:, 0]], self.faces[pairs[:, 1]]
        depth = _depth(V[edges], V[faces])
        cross = depth > 0.0
        edges, faces, depth = edges[cross, 0], faces[cross, 0], depth[cross]
        return self._deepest(self.owner[edges], self.owner[faces], depth + 2.0 * self.inset)

    def _vertices(self, x: Floats) -> Floats:
        return self.weights @ x[self.points]

    def _taken_in(self, x: Floats) -> Floats:
        """The vertices (n, 3) moved inwards along the area-weighted mean normal of their adjacent faces."""
        a, b, c = (x[self.faces[:, k]] for k in range(3))
        area = np.cross(b - a, c - a)
        normals = np.column_stack(
            [np.bincount(self.faces.ravel(), weights=np.repeat(area[:, k], 3), minlength=len(x)) for k in range(3)]
        )
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        return np.asfortranarray(x - self.inset * normals)

    def _intersect(self, V: Floats) -> bool:
        import ipctk

        return bool(ipctk.has_intersections(self._mesh, V, ipctk.LBVH()))

    @cached_property
    def _edges(self) -> Ints:
        return edges_of(self.faces)

    @cached_property
    def _mesh(self) -> Any:
        return collision_mesh(self.X, self._edges, self.faces, self.patch, self.apart)


def _depth(edge: Floats, face: Floats) -> Floats:
    """Depth [m] of the nearer end of each edge (m, 2, 3) beyond the face (m, 3, 3) that it passes through, or 0."""
    a, b, c = face[:, 0], face[:, 1], face[:, 2]
    normal = np.cross(b - a, c - a)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    height = np.einsum("mkj,mj->mk", edge - a[:, None], normal)
    across = height[:, 0] * height[:, 1] < 0.0
    t = height[:, 0] / np.where(across, height[:, 0] - height[:, 1], 1.0)
    at = edge[:, 0] + t[:, None] * (edge[:, 1] - edge[:, 0])
    inside = np.all(
        [np.einsum("mj,mj->m", np.cross(q - p, at - p), normal) > 0.0 for p, q in ((a, b), (b, c), (c, a))], axis=0
    )
    return np.where(across & inside, np.abs(height).min(axis=1), 0.0)
