"""Solid round wires swept along a centreline: rods and helical springs, structured, without Gmsh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.cell import TET_EDGES
from softcal.geometry.centreline import Centreline, straight
from softcal.geometry.coil import Coil
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import Primitive
from softcal.geometry.quadratic import numbered_edges, of_order
from softcal.geometry.quality import require_sound
from softcal.geometry.surface import boundary_faces
from softcal.geometry.sweep import WEDGE_TETS, upright
from softcal.limits import LIMITS
from softcal.quantities import QUANTITIES, Size

# Triangles around the centre of a section.
SECTORS = 6
# A layer of one ring: a wedge of three tets over each.
TETS_OF_A_RING = 3 * SECTORS
# Default number of layers per turn, if the layers are then no longer than the tets are wide.
PER_TURN = 12


def wire_mesh(
    line: Centreline, diameter: float | Floats, *, rings: int = 1, order: Literal[1, 2] = 2, where: str = ""
) -> TetMesh:
    """Tets of a round wire along a centreline.

    All surface nodes are on the exact surface: a layer of tets spans two elements of the centreline, and the section at
    the node between them has the layer's middle nodes. Sections have threefold symmetry and adjacent layers are mirror
    images, so that the bending stiffness is isotropic and bending does not couple with twist.

    Parameters
    ----------
    line
        With an even number of elements.
    diameter
        Diameter of the wire [m], or that at each node of its centreline (n,).
    rings
        Number of tets from the axis to the surface: a section has 6 rings^2 triangles, a layer 18 rings^2 tets. Of the
        circle's area, one ring of quadratic tets leaves out 0.24 %, two leave out 0.015 %. Layers should not be longer
        than tets are wide, half the diameter over the rings: long tets are too stiff where a wire twists or is curved.
    order
        2 for quadratic tets, curved on the surface; 1 for linear ones, which inscribe a polygon of 6 rings corners.
    where
        Location for error messages.

    Returns
    -------
    TetMesh
        With node sets and face sets "start", "end" (the end faces) and "skin".

    Raises
    ------
    MeshError
        If a dimension is out of range, or the wire is too thick for the curvature of its axis.
    """
    n_elements = len(line.lengths)
    wide = np.broadcast_to(np.asarray(diameter, dtype=float), n_elements + 1)
    found = [QUANTITIES["size"].fault(size, where) for size in dict.fromkeys((float(wide.min()), float(wide.max())))]
    faults = [fault for fault in (*found, LIMITS["rings of elements"].fault(rings, where)) if fault]
    if n_elements % 2:
        faults.append(
            Fault(
                "a layer of tets spans two elements of a centreline", where, f"{n_elements} elements", "an even number"
            )
        )
    if faults:
        raise MeshError(faults)
    section = _section(rings)
    n, layers = len(section.corners), np.arange(n_elements // 2)
    even = (layers + layers % 2)[:, None, None]
    odd = (2 * layers + 1)[:, None, None] - even
    triangles = np.sort(section.triangles, axis=1)
    wedges = np.concatenate([even * n + triangles, odd * n + triangles], axis=2)
    tets = wedges[:, :, WEDGE_TETS].reshape(-1, 4)

    n_corners = n * (len(layers) + 1)
    ends, number = numbered_edges(tets, n_corners)
    corners = np.arange(n_corners)
    station = np.concatenate([2 * (corners // n), (ends // n).sum(axis=1)])
    unit = np.concatenate([section.corners[corners % n], section.between(ends % n)])
    across = 0.5 * wide[station][:, None] * unit
    points = line.nodes[station] + (line.triads[station][:, :, :2] @ across[:, :, None])[:, :, 0]
    tets10 = np.hstack([tets, n_corners + number.reshape(-1, len(TET_EDGES))])
    mesh = TetMesh(points, upright(points, tets10))
    require_sound(mesh, where)

    faces = boundary_faces(mesh)
    start, end = ((station == s)[faces].all(axis=1) for s in (0, n_elements))
    face_sets = {"start": faces[start], "end": faces[end], "skin": faces[~start & ~end]}
    node_sets: dict[str, Ints] = {name: np.unique(rows) for name, rows in face_sets.items()}
    mesh = TetMesh(points, mesh.tets, node_sets=node_sets, face_sets=face_sets)
    return of_order(mesh, order)


@dataclass(frozen=True)
class SolidRod(Primitive):
    """A straight round rod from the origin along z; see `wire_mesh`.

    Attributes
    ----------
    length, diameter : [m]
    layers : Number of layers of tets along the rod; None: layers as long as the tets are wide
    rings : Number of tets from the axis to the surface
    order : 2 for quadratic tets, 1 for linear ones
    """

    length: Size
    diameter: Size
    layers: Annotated[int, LIMITS["layers of elements"]] | None = None
    rings: Annotated[int, LIMITS["rings of elements"]] = 1
    order: Literal[1, 2] = 2

    lengths: ClassVar[tuple[str, ...]] = ("length", "diameter")

    @property
    def knots(self) -> tuple[Sequence[float], Sequence[float]]:
        return (0.0, 0.5 * self.diameter), (0.0, self.length)

    def mesh(self) -> TetMesh:
        """The mesh [m].

        Raises
        ------
        MeshError
            For too many tets.
        """
        count = self.layers or _layers(self.length, self.diameter, self.rings)
        _check_tets(count, self.rings, "rod")
        line = straight((0.0, 0.0, 0.0), (0.0, 0.0, self.length), 2 * count, first=(1.0, 0.0, 0.0))
        return wire_mesh(line, self.diameter, rings=self.rings, order=self.order, where="rod")


@dataclass(frozen=True, kw_only=True)
class SolidSpring(Coil, Primitive):
    """The wire of a helical spring about z, its axis from (coil_diameter / 2, 0, 0) upwards, with plain ends.

    Attributes
    ----------
    wire_diameter : [m]
    layers_per_turn : Number of layers of tets in a turn; None: 12, or more where they would be longer than wide
    rings, order : As of a `SolidRod`
    """

    wire_diameter: Size
    layers_per_turn: Annotated[int, LIMITS["layers in a turn"]] | None = None
    rings: Annotated[int, LIMITS["rings of elements"]] = 1
    order: Literal[1, 2] = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        if faults := self.wire_faults(self.wire_diameter):
            raise MeshError(faults)

    @property
    def layers(self) -> int:
        """Number of layers of tets in a turn."""
        as_wide = _layers(self.wire_length / self.turns, self.wire_diameter, self.rings)
        return self.layers_per_turn or max(PER_TURN, as_wide)

    def mesh(self) -> TetMesh:
        """The mesh [m].

        Raises
        ------
        MeshError
            For too many tets, or a wire too thick for its curvature.
        """
        layers = max(1, math.ceil(self.turns * self.layers - 1e-9))
        _check_tets(layers, self.rings, "spring")
        line = self.wire(2 * layers)
        return wire_mesh(line, self.wire_diameter, rings=self.rings, order=self.order, where="spring")


@dataclass(frozen=True)
class _Section:
    """Triangles of the unit disc: corners (n, 2), and their rings, 0 in the centre."""

    corners: Floats
    ring: Ints
    triangles: Ints

    def between(self, pairs: Ints) -> Floats:
        """The middles of edges (k, 2), on the circle for rim edges; a node is the middle of itself.

        Inner edges stay straight: with curved ones a quadratic tet could not represent the quadratic displacements of
        bending and twist, and a twisted rod would be 3 % too stiff.
        """
        a, b = pairs.T
        middle = 0.5 * (self.corners[a] + self.corners[b])
        rim = (self.ring[pairs] == self.ring.max()).all(axis=1)
        middle[rim] /= np.linalg.norm(middle[rim], axis=1)[:, None]
        return middle


def _section(rings: int) -> _Section:
    """Triangulated unit disc; ring i has 6 i corners, even ones numbered before odd ones.

    Sides of wedges are divided from their lower corner (see `WEDGE_TETS`): from the inner ring to the outer one, and
    around the rings from even to odd, which alternates.
    """
    ring, angle = [0], [0.0]
    number: dict[tuple[int, int], int] = {(0, 0): 0}
    for i in range(1, rings + 1):
        count = SECTORS * i
        for k in (*range(0, count, 2), *range(1, count, 2)):
            number[i, k] = len(ring)
            ring.append(i)
            angle.append(2.0 * math.pi * k / count)

    def at(i: int, k: int) -> int:
        return number[i, k % max(1, SECTORS * i)]

    triangles: list[tuple[int, int, int]] = []
    for sector in range(SECTORS):
        for i in range(rings):
            inner, outer = sector * i, sector * (i + 1)
            triangles += [(at(i, inner + j), at(i + 1, outer + j), at(i + 1, outer + j + 1)) for j in range(i + 1)]
            triangles += [(at(i, inner + j), at(i + 1, outer + j + 1), at(i, inner + j + 1)) for j in range(i)]
    rings_of, angles = np.array(ring), np.array(angle)
    corners = (rings_of / rings)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return _Section(corners, rings_of, np.array(triangles))


def _layers(length: float, diameter: float, rings: int) -> int:
    return max(1, math.ceil(2.0 * rings * length / diameter - 1e-9))


def _check_tets(layers: int, rings: int, where: str) -> None:
    if fault := LIMITS["tets"].fault(max(TETS_OF_A_RING * rings**2 * layers, 1), where):
        raise MeshError(replace(fault, attempt="fewer layers or rings, or a thicker wire"))
