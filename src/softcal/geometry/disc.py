"""Discs with holes: flat cylinders of tets by Gmsh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated, Any, ClassVar

import numpy as np

from softcal.checks import Ints
from softcal.declare import Declared
from softcal.errors import Fault, MeshError
from softcal.geometry.generate import OPTIONS, run_gmsh, target_of
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import Filled
from softcal.geometry.ring import ring_points
from softcal.geometry.surface import boundary_faces
from softcal.limits import LIMITS
from softcal.quantities import Angle, Clearance, Size

# The worker meshes in millimetres, for which the tolerances of its CAD kernel are designed.
MILLIMETRE = 1e-3
# Guide holes are small compared with the disc: their short edges must not spread, nor become too few for a circle.
SMALL_HOLES = {"Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MinimumCurveNodes": 8}
# Tolerance of nodes on a surface, relative to the disc's diameter.
ON_SURFACE = 1e-7


@dataclass(frozen=True)
class GuideHoles(Declared):
    """Holes of a disc, evenly spaced on a circle.

    Attributes
    ----------
    count : Number of holes
    diameter : Diameter of each [m]
    radius : Radius of the circle of their centres [m]
    first_angle : Angle of the first, about +z from +x [rad]
    """

    count: Annotated[int, LIMITS["holes on a ring"]]
    diameter: Size
    radius: Size
    first_angle: Angle = 0.0


@dataclass(frozen=True)
class SolidDisc(Filled):
    """A disc about z from z = 0 upwards.

    Attributes
    ----------
    diameter, thickness : [m]
    centre_hole : Diameter of the hole in its centre [m]; 0: none
    holes : Its guide holes; None: none
    """

    diameter: Size
    thickness: Size
    centre_hole: Clearance = 0.0
    holes: GuideHoles | None = None

    lengths: ClassVar[tuple[str, ...]] = ("thickness",)

    @property
    def knots(self) -> tuple[Sequence[float], Sequence[float]]:
        return (0.0, 0.5 * self.diameter), (0.0, self.thickness)

    def __post_init__(self) -> None:
        super().__post_init__()
        inside = all(math.hypot(x, y) + 0.5 * d < 0.5 * self.diameter for x, y, d in self.circles)
        pairs = combinations(self.circles, 2)
        if not (inside and all(math.dist(a[:2], b[:2]) > 0.5 * (a[2] + b[2]) for a, b in pairs)):
            raise MeshError(
                Fault(
                    "the holes do not fit into the disc",
                    "",
                    ", ".join(f"{1e3 * d:.4g} mm at {1e3 * math.hypot(x, y):.4g} mm" for x, y, d in self.circles),
                    f"holes apart from each other and from the rim at {500 * self.diameter:.4g} mm",
                )
            )

    @property
    def circles(self) -> tuple[tuple[float, float, float], ...]:
        """Every hole as x, y and its diameter [m]; the centre hole first, then the guide holes."""
        centre = ((0.0, 0.0, self.centre_hole),) if self.centre_hole > 0.0 else ()
        if self.holes is None:
            return centre
        z, x, of = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), self.holes
        ring = ring_points(np.zeros(3), z, x, of.radius, of.count, of.first_angle)
        return (*centre, *((float(x), float(y), of.diameter) for x, y, _ in ring))

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return 0.25 * math.pi * (self.diameter**2 - sum(d**2 for *_, d in self.circles)) * self.thickness

    def mesh(self, *, timeout: float = 300.0) -> TetMesh:
        """Tets of the disc; Gmsh may take as long as `timeout` [s].

        Returns
        -------
        TetMesh
            With node and face sets "bottom", "top", "rim"; "holes" for the guide holes and "h1", "h2", … for each;
            "centre" for the centre hole. Sets of missing features are omitted.

        Raises
        ------
        MeshError
            If the target cannot be reached, or Gmsh is not installed, fails or takes too long.
        """
        where = "disc"
        job: dict[str, Any] = {
            "kind": "disc",
            "options": {**OPTIONS, **SMALL_HOLES},
            "diameter": self.diameter / MILLIMETRE,
            "thickness": self.thickness / MILLIMETRE,
            "holes": [[value / MILLIMETRE for value in circle] for circle in self.circles],
            **target_of(self.size, self.tets, MILLIMETRE, where=where),
            "order": self.order,
        }
        arrays = run_gmsh(job, where=where, timeout=timeout)
        mesh = TetMesh(MILLIMETRE * arrays["points"], arrays["tets"])
        near = ON_SURFACE * self.diameter
        faces = boundary_faces(mesh)
        corners = mesh.points[faces[:, :3]]
        bottom = (np.abs(corners[..., 2]) <= near).all(axis=1)
        top = (np.abs(corners[..., 2] - self.thickness) <= near).all(axis=1)
        sides = {"bottom": faces[bottom], "top": faces[top]}

        def around(x: float, y: float, diameter: float) -> Ints:
            distance = np.linalg.norm(corners[..., :2] - [x, y], axis=2)
            return faces[(np.abs(distance - 0.5 * diameter) <= near).all(axis=1) & ~bottom & ~top]

        sides["rim"] = around(0.0, 0.0, self.diameter)
        circles = list(self.circles)
        if self.centre_hole > 0.0:
            sides["centre"] = around(*circles.pop(0))
        guides = {f"h{k + 1}": around(*circle) for k, circle in enumerate(circles)}
        if guides:
            sides["holes"] = np.concatenate(list(guides.values()))
        face_sets = sides | guides
        node_sets: dict[str, Ints] = {name: np.unique(rows) for name, rows in face_sets.items()}
        return TetMesh(mesh.points, mesh.tets, node_sets=node_sets, face_sets=face_sets)
