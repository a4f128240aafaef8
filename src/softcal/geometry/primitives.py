"""Primitives: bodies that are meshed from their measures, by Gmsh or without; and the box, meshed in bricks."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Annotated, ClassVar, Literal, Self

import numpy as np

from softcal.arrays import ArrayOf, Numbers
from softcal.checks import Floats, Ints
from softcal.declare import Declared, checked_arguments
from softcal.errors import Fault, MeshError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import of_order
from softcal.geometry.surface import boundary_faces
from softcal.limits import LIMITS
from softcal.quantities import QUANTITIES, Point, Size

_Edge = Annotated[float, QUANTITIES["extent of a mesh"]]


@checked_arguments
def box_mesh(
    lengths: Annotated[Sequence[float], ArrayOf(tuple[_Edge, _Edge, _Edge])],
    divisions: Annotated[Sequence[int], Numbers],
    *,
    order: Literal[1, 2] = 1,
    origin: Annotated[Sequence[float], ArrayOf(Point)] = (0.0, 0.0, 0.0),
) -> TetMesh:
    """A box divided into bricks of six tetrahedra each (Kuhn's subdivision, which conforms across bricks).

    Parameters
    ----------
    lengths
        Edges of the box along x, y, z [m].
    divisions
        Number of bricks along each of them.
    order
        1 for linear, 2 for quadratic tetrahedra.
    origin
        Corner with the smallest coordinates [m].

    Returns
    -------
    TetMesh
        With the sides as node sets and face sets "x0", "x1", "y0", "y1", "z0", "z1".

    Raises
    ------
    InputError
        Where a length is not positive, or there are too many divisions.
    MeshError
        Where a number of divisions is not positive.
    """
    bricks = [int(n) for n in divisions]
    if len(bricks) != 3 or min(bricks) < 1:
        what = "a box needs three numbers of divisions"
        raise MeshError(Fault(what, "divisions", str(tuple(bricks)), ">= 1 each"))
    LIMITS["tets"].check(6 * math.prod(bricks), where="divisions")
    axes = [
        np.linspace(start, start + length, n + 1) for start, length, n in zip(origin, lengths, divisions, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    mesh = TetMesh(points, _kuhn_tets(divisions))
    faces = boundary_faces(mesh)
    node_sets: dict[str, Ints] = {}
    face_sets: dict[str, Ints] = {}
    for axis, name in enumerate("xyz"):
        for end, place in (("0", axes[axis][0]), ("1", axes[axis][-1])):
            on_side = points[:, axis] == place
            node_sets[name + end] = np.flatnonzero(on_side)
            face_sets[name + end] = faces[on_side[faces].all(axis=1)]
    mesh = TetMesh(points, mesh.tets, node_sets=node_sets, face_sets=face_sets)
    return of_order(mesh, order)


def _kuhn_tets(divisions: Sequence[int]) -> Ints:
    shape = tuple(n + 1 for n in divisions)
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in divisions), indexing="ij"), axis=-1).reshape(-1, 3)
    tets: list[Ints] = []
    for path in permutations(range(3)):
        corners = [cells]
        for axis in path:
            corners.append(corners[-1] + np.eye(3, dtype=np.int64)[axis])
        numbers = [np.ravel_multi_index(tuple(corner.T), shape) for corner in corners]
        odd = np.linalg.det(np.eye(3)[list(path)]) < 0
        if odd:
            numbers[1], numbers[2] = numbers[2], numbers[1]
        tets.append(np.column_stack(numbers))
    return np.stack(tets, axis=1).reshape(-1, 4)


@dataclass(frozen=True)
class Primitive(Declared, ABC):
    """A body by its dimensions, in its own frame.

    lengths: names of the fields that can be parameters of a body of this shape (see `PrimitiveShape`).
    """

    lengths: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def mesh(self) -> TetMesh:
        """The mesh [m]."""

    @property
    def knots(self) -> tuple[Sequence[float], Sequence[float]]:
        """Ascending radii about z and heights [m], from zero to the outermost. Where a length changes, the points
        between two of them stay between them, at the same fraction of their distance. Empty without such lengths.
        """
        return (), ()

    def shares(self, places: Floats) -> Floats:
        """Coordinates (n, 2) [-], constant where a length changes, of points at a radius and height [m]: by default the
        numbers of the knots inside and below, plus the fraction of the distance to the next knot.
        """
        numbers = [np.interp(x, knots, np.arange(len(knots))) for x, knots in zip(places.T, self.knots, strict=True)]
        return np.column_stack(numbers)

    def places(self, shares: Floats) -> Floats:
        """Radius and height (n, 2) [m] of points from their `shares`, the inverse of it."""
        at = [np.interp(x, np.arange(len(knots)), knots) for x, knots in zip(shares.T, self.knots, strict=True)]
        return np.column_stack(at)

    def with_lengths(self, values: Mapping[str, float]) -> Self:
        """The same body with other lengths [m].

        Raises
        ------
        InputError
            Where no body has them.
        """
        return replace(self, **values)


@dataclass(frozen=True, kw_only=True)
class Filled(Primitive):
    """A body that Gmsh fills with tets.

    Attributes
    ----------
    size, tets : Target edge length [m], and target number of tets, to within 5 %; one of the two for a mesh
    order : 2 for quadratic tets, curved on curved faces; 1 for linear ones
    """

    size: Size | None = None
    tets: Annotated[int, LIMITS["tets"]] | None = None
    order: Literal[1, 2] = 2
