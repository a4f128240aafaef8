"""A tetrahedral mesh with named regions: points, tets, sets. Frozen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Annotated

import numpy as np

from softcal.arrays import Array, Numbers, Triangles
from softcal.checks import Floats, Ints, require_below
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import Fault, MeshError
from softcal.geometry.cell import CELLS, Cell, cell_of, outer_faces

ROUNDING = 1e-8  # of a tet's extent


@displayed
@dataclass(frozen=True)
class TetMesh(Checked):
    """Tetrahedra of order one (4 nodes) or two (10 nodes, VTK order).

    points [m], shape (n_points, 3); tets, shape (n_tets, 4 or 10).
    node_sets: name -> node numbers; face_sets: name -> triangles (k, 3 or 6) oriented outwards;
    element_sets: name -> tet numbers.
    """

    points: Annotated[Floats, Array((None, 3))]
    tets: Triangles
    node_sets: Mapping[str, Numbers] = field(default_factory=dict[str, Ints])
    face_sets: Mapping[str, Triangles] = field(default_factory=dict[str, Ints])
    element_sets: Mapping[str, Numbers] = field(default_factory=dict[str, Ints])

    def __post_init__(self) -> None:
        super().__post_init__()
        tets = self.tets
        if tets.ndim != 2 or tets.shape[1] not in {cell.n_nodes for cell in CELLS.values()} or len(tets) == 0:
            raise MeshError(
                Fault("the mesh has no tetrahedra", got=f"a connectivity of shape {tets.shape}", allowed="(n, 4 or 10)")
            )
        require_below(len(self.points), tets, "tets")
        corners = np.sort(tets[:, :4], axis=1)
        order = np.lexsort(corners.T)  # stable
        twice = np.flatnonzero((np.diff(corners[order], axis=0) == 0).all(axis=1))
        if len(twice):
            got = f"tets {order[twice[0]]} and {order[twice[0] + 1]}" + f", {len(twice)} in all" * (len(twice) > 1)
            raise MeshError(Fault("a tet appears twice, which would stiffen the body there", "tets", got))
        for name, n in (("node_sets", len(self.points)), ("face_sets", len(self.points)), ("element_sets", len(tets))):
            for key, numbers in getattr(self, name).items():
                require_below(n, numbers, f"{name}.{key}")
            object.__setattr__(self, name, MappingProxyType(getattr(self, name)))

    def __reduce__(self) -> tuple[object, ...]:  # a mapping proxy does not pickle; workers need meshes
        sets = (dict(self.node_sets), dict(self.face_sets), dict(self.element_sets))
        return type(self), (np.array(self.points), np.array(self.tets), *sets)

    @property
    def n_points(self) -> int:
        """Number of nodes, mid-edge nodes included."""
        return len(self.points)

    @property
    def n_tets(self) -> int:
        """Number of tetrahedra."""
        return len(self.tets)

    @property
    def cell(self) -> Cell:
        """Kind of the tetrahedra."""
        return cell_of(self.tets)

    @property
    def order(self) -> int:
        """1 for linear, 2 for quadratic tetrahedra."""
        return self.cell.order

    @property
    def corners(self) -> Ints:
        """Numbers of the nodes that are a corner of some tet, ascending."""
        return np.unique(self.tets[:, :4])

    @cached_property
    def pieces(self) -> Ints:
        """The connected piece of the mesh that each node belongs to (n_points,), counted from 0; -1 for a node of no
        tet.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        first, others = np.repeat(self.tets[:, 0], self.tets.shape[1] - 1), self.tets[:, 1:].ravel()
        graph = coo_array((np.ones(len(first), dtype=bool), (first, others)), shape=(self.n_points, self.n_points))
        labels = np.full(self.n_points, -1)
        used = np.unique(self.tets)
        labels[used] = np.unique(connected_components(graph, directed=False)[1][used], return_inverse=True)[1]
        return labels

    @cached_property
    def outer_faces(self) -> Ints:
        """Numbers of the faces, four of each tet in order, that belong to it alone, ascending."""
        return outer_faces(self.tets)

    @cached_property
    def to_barycentric(self) -> Floats:
        """For each straight-sided tet the matrix (n_tets, 3, 3) [1/m] from a point's offset to the first corner to its
        last three barycentric coordinates.
        """
        corners = self.points[self.tets[:, :4]]
        return np.linalg.inv(np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)).astype(np.float64)

    @cached_property
    def boxes(self) -> tuple[Floats, Floats]:
        """Lower and upper corners (n_tets, 3) [m] of boxes around the corners of each tet, wider by rounding."""
        corners = self.points[self.tets[:, :4]]
        lower, upper = corners.min(axis=1), corners.max(axis=1)
        margin = ROUNDING * (upper - lower).max(axis=1, keepdims=True)
        return lower - margin, upper + margin
