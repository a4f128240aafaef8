"""Discs with holes: flat cylinders of tets by Gmsh."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np

from softcal.checks import Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.generate import OPTIONS, run_gmsh, target_of
from softcal.geometry.mesh import TetMesh
from softcal.geometry.ring import ring_points
from softcal.geometry.surface import boundary_faces

# The worker meshes in millimetres, for which the tolerances of its CAD kernel are designed.
MILLIMETRE = 1e-3
# Guide holes are small compared with the disc: their short edges must not spread, nor become too few for a circle.
SMALL_HOLES = {"Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MinimumCurveNodes": 8}
# Tolerance of nodes on a surface, relative to the disc's diameter.
ON_SURFACE = 1e-7


@dataclass(frozen=True)
class DiscShape:
    """A disc about z from z = 0 upwards; lengths in [m], angles in [rad].

    centre_hole: its diameter, 0 for none. holes: number of guide holes, evenly spaced on a circle of `hole_radius` from
    `first_angle`, about +z from +x.
    """

    diameter: float
    thickness: float
    centre_hole: float = 0.0
    holes: int = 0
    hole_diameter: float = 0.0
    hole_radius: float = 0.0
    first_angle: float = 0.0

    def __post_init__(self) -> None:
        where = "disc"
        positive = ["diameter", "thickness", *(["hole_diameter", "hole_radius"] if self.holes > 0 else [])]
        faults = [
            Fault(f"the {key.replace('_', ' ')} must be positive", where, f"{getattr(self, key):.6g} m", "> 0 m")
            for key in positive
            if not 0.0 < getattr(self, key) < math.inf
        ]
        if self.holes < 0:
            faults.append(Fault("the number of holes must not be negative", where, str(self.holes), ">= 0"))
        if not 0.0 <= self.centre_hole < math.inf:
            faults.append(
                Fault("the centre hole's diameter must not be negative", where, f"{self.centre_hole:.6g} m", ">= 0 m")
            )
        if not faults and not self._fit():
            faults.append(
                Fault(
                    "the holes do not fit into the disc",
                    where,
                    ", ".join(f"{1e3 * d:.4g} mm at {1e3 * math.hypot(x, y):.4g} mm" for x, y, d in self.circles),
                    f"holes apart from each other and from the rim at {500 * self.diameter:.4g} mm",
                )
            )
        if faults:
            raise MeshError(faults)

    @property
    def circles(self) -> tuple[tuple[float, float, float], ...]:
        """Every hole as x, y and its diameter [m]; the centre hole first, then the guide holes."""
        z, x = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
        ring = ring_points(np.zeros(3), z, x, self.hole_radius, self.holes, self.first_angle) if self.holes else []
        centre = [(0.0, 0.0, self.centre_hole)] if self.centre_hole > 0.0 else []
        return (*centre, *((float(x), float(y), self.hole_diameter) for x, y, _ in ring))

    @property
    def volume(self) -> float:
        """[m^3]."""
        return 0.25 * math.pi * (self.diameter**2 - sum(d**2 for *_, d in self.circles)) * self.thickness

    def _fit(self) -> bool:
        inside = all(math.hypot(x, y) + 0.5 * d < 0.5 * self.diameter for x, y, d in self.circles)
        pairs = combinations(self.circles, 2)
        return inside and all(math.dist(a[:2], b[:2]) > 0.5 * (a[2] + b[2]) for a, b in pairs)


def disc_mesh(
    shape: DiscShape,
    *,
    size: float | None = None,
    count: int | None = None,
    order: Literal[1, 2] = 2,
    timeout: float = 300.0,
) -> TetMesh:
    """Tets of a disc with holes.

    Parameters
    ----------
    size, count
        Target edge length [m], or target number of tets, to within 5 %; one of the two.
    order
        2 for quadratic tets, curved on the rim and in the holes; 1 for linear ones.
    timeout
        Longest time that Gmsh may take [s].

    Returns
    -------
    TetMesh
        With node and face sets "bottom", "top", "rim"; "holes" for the guide holes and "h1", "h2", … for each; "centre"
        for the centre hole. Sets of missing features are omitted.

    Raises
    ------
    MeshError
        If the target cannot be reached, or Gmsh is not installed, fails or takes too long.
    """
    where = "disc"
    job: dict[str, Any] = {
        "kind": "disc",
        "options": {**OPTIONS, **SMALL_HOLES},
        "diameter": shape.diameter / MILLIMETRE,
        "thickness": shape.thickness / MILLIMETRE,
        "holes": [[value / MILLIMETRE for value in circle] for circle in shape.circles],
        **target_of(size, count, MILLIMETRE, where=where),
        "order": order,
    }
    arrays = run_gmsh(job, where=where, timeout=timeout)
    mesh = TetMesh(MILLIMETRE * arrays["points"], arrays["tets"])
    face_sets = _sides(shape, mesh)
    node_sets: dict[str, Ints] = {name: np.unique(rows) for name, rows in face_sets.items()}
    return TetMesh(mesh.points, mesh.tets, node_sets=node_sets, face_sets=face_sets)


def _sides(shape: DiscShape, mesh: TetMesh) -> dict[str, Ints]:
    near = ON_SURFACE * shape.diameter
    faces = boundary_faces(mesh)
    corners = mesh.points[faces[:, :3]]
    bottom = (np.abs(corners[..., 2]) <= near).all(axis=1)
    top = (np.abs(corners[..., 2] - shape.thickness) <= near).all(axis=1)
    sides = {"bottom": faces[bottom], "top": faces[top]}

    def around(x: float, y: float, diameter: float) -> Ints:
        distance = np.linalg.norm(corners[..., :2] - [x, y], axis=2)
        return faces[(np.abs(distance - 0.5 * diameter) <= near).all(axis=1) & ~bottom & ~top]

    sides["rim"] = around(0.0, 0.0, shape.diameter)
    circles = list(shape.circles)
    if shape.centre_hole > 0.0:
        sides["centre"] = around(*circles.pop(0))
    guides = {f"h{k + 1}": around(*circle) for k, circle in enumerate(circles)}
    if guides:
        sides["holes"] = np.concatenate(list(guides.values()))
    return sides | guides
