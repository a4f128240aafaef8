"""The lengths of a body as parameters: how the nodes of its undeformed mesh move with them.

The mesh keeps its tets, its regions and its numbers of nodes. Of a primitive the nodes keep their shares between the
planes and surfaces that its lengths define, or along a wall and across it; a mesh of which nothing is known is scaled,
and its walls are offset.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self

import numpy as np

from softcal.checks import Floats, Ints
from softcal.display import displayed
from softcal.errors import Fault, MeshError
from softcal.geometry.bellows import Bellows
from softcal.geometry.disc import SolidDisc
from softcal.geometry.mesh import TetMesh
from softcal.geometry.neck import Neck
from softcal.geometry.placement import Placement
from softcal.geometry.primitives import Primitive
from softcal.geometry.quadratic import numbered_edges
from softcal.geometry.surface import boundary_faces
from softcal.geometry.wire import SolidRod
from softcal.quantities import QUANTITIES, Length, PositiveRatio, Quantity
from softcal.units import format_quantity

# Relative difference of the radius or height of a mesh from those of its primitive.
ALIKE = 0.01
# Directions in which the normals around a node differ less than this have no corner: its offset is along their mean.
FLAT = 0.05
# The kind of quantity of every parameter of a shape, by the last part of its name.
LENGTHS: Mapping[str, Quantity] = {
    **{name: QUANTITIES["size"] for one in (Neck, SolidRod, SolidDisc, Bellows) for name in one.lengths},
    "scale": QUANTITIES["positive ratio"],
    "wall_offset": QUANTITIES["length"],
}


class BodyShape(ABC):
    """The parameters of the shape of a mesh, with their values."""

    @property
    @abstractmethod
    def values(self) -> Mapping[str, float]:
        """Values [SI] by the last part of the parameter's name."""

    @abstractmethod
    def moved(self, mesh: TetMesh, fixed: Ints, values: Mapping[str, float]) -> tuple[Floats, Self]:
        """Nodes (n_points, 3) [m] of a mesh of this shape at other values, and the shape with these values.

        Parameters
        ----------
        mesh
            The mesh [m].
        fixed
            Numbers (k,) of the fixed nodes.
        values
            Lengths [m] or factors [-], by the name of the parameter.

        Raises
        ------
        InputError
            Where no body has these values.
        """

    def require_fit(self, mesh: TetMesh, where: str) -> None:  # noqa: B027
        """Check that a mesh has this shape.

        Raises
        ------
        MeshError
            Where it has another one.
        """


@displayed
@dataclass(frozen=True)
class PrimitiveShape(BodyShape):
    """The shape of a mesh of a primitive, whose lengths are parameters.

    Attributes
    ----------
    primitive : With the lengths of the mesh
    placement : Where the mesh has its axes
    """

    primitive: Primitive
    placement: Placement = field(default_factory=Placement)

    @property
    def values(self) -> Mapping[str, float]:
        return {name: getattr(self.primitive, name) for name in self.primitive.lengths}

    def moved(self, mesh: TetMesh, fixed: Ints, values: Mapping[str, float]) -> tuple[Floats, Self]:
        """See `BodyShape.moved`; the nodes follow the primitive's map."""
        other = self.primitive.with_lengths(values)
        pose = self.placement.pose
        points = pose.inverse().apply(mesh.points)
        # All radii are scaled alike near the axis, where the ratio of two of them would be that of rounding errors.
        r = np.maximum(np.hypot(points[:, 0], points[:, 1]), 1e-6 * self.primitive.knots[0][1])
        new_r, new_z = other.places(self.primitive.shares(np.column_stack([r, points[:, 2]]))).T
        points[:, :2] *= (new_r / r)[:, None]
        points[:, 2] = new_z
        return pose.apply(points), replace(self, primitive=other)

    def require_fit(self, mesh: TetMesh, where: str) -> None:
        """Check that a mesh has the radius and height of the primitive.

        Raises
        ------
        MeshError
            Where it has others.
        """
        radii, heights = self.primitive.knots
        x, y, z = self.placement.pose.inverse().apply(mesh.points).T
        found = {"radius": (np.hypot(x, y).max(), radii[-1]), "height": (z.max(), heights[-1]), "base": (z.min(), 0.0)}
        wrong = {name: pair for name, pair in found.items() if abs(pair[0] - pair[1]) > ALIKE * heights[-1]}
        if wrong:
            got, want = (
                ", ".join(f"{name} {format_quantity(float(pair[k]), 'm')}" for name, pair in wrong.items())
                for k in (0, 1)
            )
            raise MeshError(
                Fault(
                    "the mesh does not have the shape that is stated for it",
                    where,
                    got,
                    want,
                    "the lengths of the mesh",
                )
            )


@displayed
@dataclass(frozen=True)
class DrawnShape(BodyShape):
    """The shape of any mesh: its scale about the centre of its fixed nodes, and an offset of its surface outwards.

    Attributes
    ----------
    scale : Factor on the mesh as it is [-]
    wall_offset : Wall offset of its surface as it is [m]
    """

    scale: PositiveRatio = 1.0
    wall_offset: Length = 0.0

    @property
    def values(self) -> Mapping[str, float]:
        return asdict(self)

    def moved(self, mesh: TetMesh, fixed: Ints, values: Mapping[str, float]) -> tuple[Floats, Self]:
        """See `BodyShape.moved`; the mesh is scaled, and its surface offset."""
        other, points = replace(self, **values), mesh.points
        offset = other.wall_offset - self.wall_offset
        centre = points[fixed if len(fixed) else slice(None)]
        centre = 0.5 * (centre.min(axis=0) + centre.max(axis=0))
        if offset != 0.0:
            points = points + offset * outward(mesh)
        return centre + other.scale / self.scale * (points - centre), other


def outward(mesh: TetMesh) -> Floats:
    """Motion of each node (n_points, 3) [-] if all faces of the surface move outwards by 1: at an edge such that both
    its faces do, inside smooth (harmonic on the graph of the edges).
    """
    import scipy.sparse as sp
    from scipy.sparse import csgraph
    from scipy.sparse.linalg import spsolve

    faces = boundary_faces(mesh)[:, :3]
    a, b, c = np.moveaxis(mesh.points[faces], 1, 0)
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= size
    products, sums = np.zeros((mesh.n_points, 3, 3)), np.zeros((mesh.n_points, 3))
    for column in faces.T:
        np.add.at(products, column, size[:, :, None] * normal[:, :, None] * normal[:, None, :])
        np.add.at(sums, column, size * normal)
    way = (np.linalg.pinv(products, rcond=FLAT, hermitian=True) @ sums[:, :, None])[..., 0]

    surface = np.unique(faces)
    inner = np.setdiff1d(mesh.corners, surface)
    if len(inner):
        edges, _ = numbered_edges(mesh.tets[:, :4], mesh.n_points)
        graph: Any = sp.csr_array((np.ones(len(edges)), tuple(edges.T)), shape=(mesh.n_points, mesh.n_points))
        laplacian: Any = sp.csr_array(csgraph.laplacian(graph + graph.T))[inner]
        solved: Any = spsolve(laplacian[:, inner].tocsc(), -laplacian[:, surface] @ way[surface])
        way[inner] = solved
    for k, (i, j) in enumerate(mesh.cell.edges):
        way[mesh.tets[:, 4 + k]] = 0.5 * (way[mesh.tets[:, i]] + way[mesh.tets[:, j]])
    return way
