"""Finite elements of solids: shape functions of displacement and pressure, and a quadrature rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.cell import Cell
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import of_order


@dataclass(frozen=True, eq=False)
class Quadrature:
    """Points (n, 4) in barycentric coordinates and weights (n,), sum 1/6; exact for polynomials up to a degree."""

    points: Floats
    weights: Floats
    degree: int

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Quadrature) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[bytes, bytes, int]:
        return self.points.tobytes(), self.weights.tobytes(), self.degree


@dataclass(frozen=True)
class Element:
    """A finite element of solids.

    Parameters
    ----------
    name
        In project files and in `Body.element`.
    in_words
        What it is, for reports and messages.
    cell
        The tetrahedron of its mesh; the displacement has its shape functions.
    quadrature
        Where its energy is summed.
    rank
        Better elements, of the same tets, have a higher one.
    pressure
        The tetrahedron whose shape functions a pressure has that is continuous over the body; it has the first nodes
        of `cell`. None for elements in which the volume has no unknown of its own.
    """

    name: str
    in_words: str
    cell: Cell
    quadrature: Quadrature
    rank: int
    pressure: Cell | None = None

    @property
    def is_mixed(self) -> bool:
        """Whether pressures are among its unknowns."""
        return self.pressure is not None

    def mesh(self, given: TetMesh) -> TetMesh:
        """The mesh it takes, made of one of either order; edges stay straight where nodes are added."""
        return of_order(given, self.cell.order)

    def pressure_nodes(self, tets: Ints) -> Ints:
        """The nodes of each tet (n_tets, k) that have a pressure; none where the element has no pressure."""
        return tets[:, : self.pressure.n_nodes if self.pressure is not None else 0]

    def pressure_functions(self) -> Floats:
        """Shape functions of the pressure at the quadrature points (n_q, k)."""
        points = self.quadrature.points
        return np.zeros((len(points), 0)) if self.pressure is None else self.pressure.functions(points)

    def gradients(self, points: Floats, tets: Ints, where: str = "mesh") -> tuple[Floats, Floats]:
        """dN_a/dX (n_tets, n_q, n_a, 3) [1/m] and weights |dX/dxi| w (n_tets, n_q) [m^3] on the undeformed mesh.

        Parameters
        ----------
        points
            Nodes of the undeformed mesh (n_points, 3) [m].
        tets
            Nodes of its tets (n_tets, n_a).
        where
            Place for error messages.

        Raises
        ------
        MeshError
            Where an element is inverted at a quadrature point.
        """
        dX_dxi, det = self._jacobians(points, tets, where)
        dN_dX = np.einsum("qak,eqkj->eqaj", self._local_gradients, np.linalg.inv(dX_dxi))
        return np.ascontiguousarray(dN_dX), det * self.quadrature.weights

    def places(self, points: Floats, tets: Ints) -> Floats:
        """The quadrature points (n_tets n_q, 3) [m] of tets by the nodes of the undeformed mesh (n_points, 3) [m]."""
        return np.einsum("eai,qa->eqi", points[tets], self.cell.functions(self.quadrature.points)).reshape(-1, 3)

    @property
    def _local_gradients(self) -> Floats:
        """dN_a by (xi, eta, zeta) at the quadrature points (n_q, n_a, 3), with L0 = 1 - xi - eta - zeta."""
        dN_dL = self.cell.gradients(self.quadrature.points)
        return dN_dL[:, :, 1:] - dN_dL[:, :, :1]

    def _jacobians(self, points: Floats, tets: Ints, where: str = "mesh") -> tuple[Floats, Floats]:
        """dX/dxi (n_tets, n_q, 3, 3) [m] and its determinants (n_tets, n_q) [m^3].

        Raises
        ------
        MeshError
            Where an element is inverted at a quadrature point.
        """
        dX_dxi = np.einsum("eai,qak->eqik", points[tets], self._local_gradients)
        det = np.linalg.det(dX_dxi)
        bad = np.unique(np.nonzero(det <= 0.0)[0])
        if bad.size:
            raise MeshError(
                Fault(
                    f"{bad.size} element(s) are inverted",
                    where=where,
                    got=f"tets {bad[:5].tolist()}",
                    attempt="a finer or straighter mesh",
                )
            )
        return dX_dxi, det

    def nodal_volumes(self, points: Floats, tets: Ints) -> Floats:
        """Integral of each node's shape function over a mesh (n_points,) [m^3]: times density, the consistent nodal
        mass.
        """
        _, det = self._jacobians(points, tets)
        volumes = np.zeros(len(points))
        np.add.at(volumes, tets, (det * self.quadrature.weights) @ self.cell.functions(self.quadrature.points))
        return volumes
