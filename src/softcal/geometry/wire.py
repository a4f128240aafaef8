"""Solid round wires swept along a centreline: rods and helical springs, structured, without Gmsh."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.cell import TET_EDGES
from softcal.geometry.centreline import Centreline, helix, straight
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import of_order
from softcal.geometry.quality import require_sound
from softcal.geometry.surface import boundary_faces
from softcal.geometry.sweep import WEDGE_TETS, upright
from softcal.limits import LIMITS

# Triangles around the centre of a section.
SECTORS = 6
# A layer of one ring: a wedge of three tets over each.
TETS_OF_A_RING = 3 * SECTORS
# Smallest number of layers per turn of a spring: with fewer, the curved tets of a tight coil are inverted.
LEAST_PER_TURN = 6
# Default number of layers per turn, if the layers are then no longer than the tets are wide.
PER_TURN = 12


def wire_mesh(
    line: Centreline, diameter: float, *, rings: int = 1, order: Literal[1, 2] = 2, where: str = ""
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
        Diameter of the wire [m].
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
    faults = _faults({"diameter": diameter}, {"rings": (rings, 1)}, where)
    n_elements = len(line.lengths)
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

    pairs = np.sort(tets[:, TET_EDGES].reshape(-1, 2), axis=1)
    n_corners = n * (len(layers) + 1)
    keys, number = np.unique(pairs[:, 0] * n_corners + pairs[:, 1], return_inverse=True)
    ends = np.stack(np.divmod(keys, n_corners), axis=1)
    corners = np.arange(n_corners)
    station = np.concatenate([2 * (corners // n), (ends // n).sum(axis=1)])
    across = 0.5 * diameter * np.concatenate([section.corners[corners % n], section.between(ends % n)])
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


def rod_mesh(
    length: float, diameter: float, *, layers: int | None = None, rings: int = 1, order: Literal[1, 2] = 2
) -> TetMesh:
    """A straight round rod from the origin along z; see `wire_mesh`.

    Parameters
    ----------
    length, diameter
        [m].
    layers
        Number of layers of tets along the rod; by default layers as long as the tets are wide.

    Raises
    ------
    MeshError
        Where a measure is out of range.
    """
    where = "rod"
    faults = _faults({"length": length, "diameter": diameter}, {"layers": (1 if layers is None else layers, 1)}, where)
    if faults:
        raise MeshError(faults)
    count = _layers(length, diameter, rings) if layers is None else layers
    _check_tets(count, rings, where)
    line = straight((0.0, 0.0, 0.0), (0.0, 0.0, length), 2 * count, first=(1.0, 0.0, 0.0))
    return wire_mesh(line, diameter, rings=rings, order=order, where=where)


@dataclass(frozen=True)
class SpringShape:
    """A helical spring about z, its wire's axis from (coil_diameter / 2, 0, 0) upwards, with plain ends.

    wire_diameter; coil_diameter: from wire centre to wire centre; pitch: rise per turn; all [m].
    """

    wire_diameter: float
    coil_diameter: float
    turns: float
    pitch: float
    left_handed: bool = False

    def __post_init__(self) -> None:
        where = "spring"
        values = {key: getattr(self, key) for key in ("wire_diameter", "coil_diameter", "turns", "pitch")}
        faults = _faults(values, {}, where)
        if not faults and self.wire_diameter >= self.coil_diameter:
            faults.append(
                Fault(
                    "the wire fills the coil",
                    where,
                    f"a wire of {1e3 * self.wire_diameter:.4g} mm",
                    f"below the coil's diameter of {1e3 * self.coil_diameter:.4g} mm",
                )
            )
        if not faults and self.turns > 1.0 and self.coil_distance <= self.wire_diameter:
            faults.append(
                Fault(
                    "the spring's coils touch at rest",
                    where,
                    f"a wire of {1e3 * self.wire_diameter:.4g} mm, coils {1e3 * self.coil_distance:.4g} mm apart",
                    "coils further apart than the wire is thick",
                    "a larger pitch or a thinner wire",
                )
            )
        if faults:
            raise MeshError(faults)

    @property
    def coil_distance(self) -> float:
        """Distance between adjacent turns of the wire's axis, normal to it [m]."""
        return self.pitch / math.hypot(1.0, self.pitch / (math.pi * self.coil_diameter))

    @property
    def wire_length(self) -> float:
        """Arc length of the wire's axis [m]."""
        return self.turns * math.hypot(math.pi * self.coil_diameter, self.pitch)

    def layers_per_turn(self, rings: int, given: int | None = None) -> int:
        """Number of layers of tets per turn: the given one, or the default of `spring_mesh`.

        Raises
        ------
        MeshError
            For fewer than six.
        """
        if given is None:
            return max(PER_TURN, _layers(self.wire_length / self.turns, self.wire_diameter, rings))
        faults = _faults({}, {"layers_per_turn": (given, LEAST_PER_TURN)}, "spring")
        if faults:
            raise MeshError(faults)
        return given

    def centreline(self, elements: int) -> Centreline:
        """The wire's axis in elements of equal length."""
        return helix(
            (0.0, 0.0, 0.0),
            (0.0, 0.0, 1.0),
            diameter=self.coil_diameter,
            pitch=self.pitch,
            turns=self.turns,
            at=elements,
            towards=(1.0, 0.0, 0.0),
            left_handed=self.left_handed,
        )


def spring_mesh(
    shape: SpringShape, *, layers_per_turn: int | None = None, rings: int = 1, order: Literal[1, 2] = 2
) -> TetMesh:
    """The wire of a helical spring; see `wire_mesh`.

    Parameters
    ----------
    layers_per_turn
        Number of layers of tets per turn of the wire, at least 6; by default 12, or more if they would otherwise be
        longer than the tets are wide.

    Raises
    ------
    MeshError
        Where a measure is out of range.
    """
    layers = max(1, math.ceil(shape.turns * shape.layers_per_turn(rings, layers_per_turn) - 1e-9))
    _check_tets(layers, rings, "spring")
    return wire_mesh(shape.centreline(2 * layers), shape.wire_diameter, rings=rings, order=order, where="spring")


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


def _faults(positive: dict[str, float], at_least: dict[str, tuple[int, int]], where: str) -> list[Fault]:
    faults = [
        Fault(f"the {name.replace('_', ' ')} must be positive", where, f"{value:.6g}", "> 0")
        for name, value in positive.items()
        if not 0.0 < value < math.inf
    ]
    return faults + [
        Fault(f"there are too few {name.replace('_', ' ')}", where, str(value), f"{least} or more")
        for name, (value, least) in at_least.items()
        if value < least
    ]
