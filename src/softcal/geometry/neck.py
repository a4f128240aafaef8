"""The soft neck: bell-shaped links on a core, a collar on top; its shape and its mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.generate import run_gmsh, target_of
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import of_order
from softcal.geometry.surface import boundary_faces
from softcal.geometry.sweep import sweep

Place = tuple[float, float]

# The worker meshes in millimetres, for which the tolerances of its CAD kernel are designed.
MILLIMETRE = 1e-3
# Tolerance of nodes on a plane, relative to the neck's height.
ON_PLANE = 1e-9
# Distance from a waist at which the elements reach their full size, in core radii.
REFINED_REACH = 1.0


@dataclass(frozen=True)
class NeckShape:
    """A neck as a solid of revolution about z, its base at z = 0; every length in [m].

    Each link is a cylindrical skirt under a dome, a quarter ellipse that runs from the outer diameter in to the
    waist. The defaults are the published neck at an outer diameter of 38 mm.

    n_bells: number of links; bottom_link_height: from the base to the first waist; link_pitch: from waist to waist;
    dome_height: of every link; waist_diameter: of the core between two links; collar_diameter, collar_height: the
    cylinder on top that is fixed to the plate; clamp_depth: length of the bottom link in the socket.
    """

    outer_diameter: float = 0.038
    n_bells: int = 5
    bottom_link_height: float = 0.617 * 0.038
    link_pitch: float = 0.481 * 0.038
    dome_height: float = 0.27 * 0.038
    waist_diameter: float = 0.6 * 0.038
    collar_diameter: float = 0.6 * 0.038
    collar_height: float = 0.267 * 0.038
    clamp_depth: float = 0.37 * 0.038

    def __post_init__(self) -> None:
        faults = [
            Fault("a length of the neck is not positive", where=name, got=f"{value:g} m", allowed="> 0 m")
            for name, value in vars(self).items()
            if name != "n_bells" and not 0 < value < math.inf
        ]
        if self.n_bells < 1:
            faults.append(Fault("the neck has no bells", where="n_bells", got=str(self.n_bells), allowed=">= 1"))
        limits = [
            ("waist_diameter", self.waist_diameter, "outer_diameter", self.outer_diameter, False),
            ("collar_diameter", self.collar_diameter, "outer_diameter", self.outer_diameter, True),
            ("dome_height", self.dome_height, "bottom_link_height", self.bottom_link_height, True),
            ("dome_height", self.dome_height, "link_pitch", self.link_pitch, True),
            ("clamp_depth", self.clamp_depth, "bottom_link_height", self.bottom_link_height, False),
        ]
        for name, value, other, limit, may_equal in limits:
            if value > limit or (value == limit and not may_equal):
                sign = "<=" if may_equal else "<"
                faults.append(
                    Fault(
                        "a length of the neck is too large",
                        where=name,
                        got=f"{value:g} m",
                        allowed=f"{sign} {other}, {limit:g} m",
                    )
                )
        if faults:
            raise MeshError(faults)

    @classmethod
    def of_diameter(cls, outer_diameter: float) -> NeckShape:
        """The published neck scaled to another outer diameter [m]."""
        default = cls()
        scale = outer_diameter / default.outer_diameter
        lengths = {name: scale * value for name, value in vars(default).items() if name != "n_bells"}
        return cls(n_bells=default.n_bells, **lengths)

    @property
    def waists(self) -> tuple[float, ...]:
        """Heights of the link tops (waists) [m]; the collar starts at the last."""
        return tuple(self.bottom_link_height + i * self.link_pitch for i in range(self.n_bells))

    @property
    def collar_start(self) -> float:
        """Height at which the collar starts [m]."""
        return self.waists[-1]

    @property
    def height(self) -> float:
        """Total height [m]."""
        return self.collar_start + self.collar_height

    def dome_radius(self, below_waist: float) -> float:
        """Radius of a dome [m] at a distance below its waist [m]."""
        along = min(max(1.0 - below_waist / self.dome_height, 0.0), 1.0)
        width = 0.5 * (self.outer_diameter - self.waist_diameter)
        return 0.5 * self.waist_diameter + width * math.sqrt(1.0 - along**2)

    def profile(self, points_per_dome: int = 16) -> Floats:
        """The outline as a polyline of (r, z) [m], from the base's centre to the top's centre, shape (n, 2)."""
        outer, waist = 0.5 * self.outer_diameter, 0.5 * self.waist_diameter
        places: list[Place] = [(0.0, 0.0)]
        start = 0.0
        for top in self.waists:
            places.append((outer, start))
            for angle in np.linspace(0.0, 0.5 * np.pi, points_per_dome):
                r = waist + (outer - waist) * math.cos(angle)
                places.append((r, top - self.dome_height * (1.0 - math.sin(angle))))
            start = top
        places += [
            (0.5 * self.collar_diameter, self.collar_start),
            (0.5 * self.collar_diameter, self.height),
            (0.0, self.height),
        ]
        line = np.array(places)
        moved = np.linalg.norm(np.diff(line, axis=0), axis=1) > ON_PLANE * self.height
        return line[np.concatenate([[True], moved])]


def neck_mesh(
    shape: NeckShape | None = None,
    *,
    size: float | None = None,
    count: int | None = None,
    order: Literal[1, 2] = 1,
    waist_refinement: float = 1.0,
    sectors: int | None = None,
    timeout: float = 300.0,
) -> TetMesh:
    """A mesh of the neck, z upwards, base at z = 0, conforming to the planes of the clamp and the collar.

    Delaunay, or swept about the axis in `sectors`: elements that are long in the hoop direction and small across reach
    the same accuracy with far fewer elements, since the stress gradient at the waists is small in the hoop direction.
    For quadratic tets, 6 or 8 sectors with a refinement of about 12 are suitable.

    Parameters
    ----------
    shape
        The neck; by default the published one.
    size, count
        Target edge length away from the waists [m], or target number of tets, to within 5 %; one of the two.
    order
        1 for linear tets, 2 for quadratic ones, curved on the surface of revolution.
    waist_refinement
        Ratio of element sizes away from and at the waists, where the stress is singular [-]; varied by up to a fifth at
        some waists if needed for the target count.
    sectors
        Number of sectors of the sweep, even and at least 4; the mesh is then symmetric about the plane y = 0. By
        default the solid is meshed as a whole.
    timeout
        Longest time that Gmsh may take [s].

    Returns
    -------
    TetMesh
        With node sets "socket" (z <= clamp depth) and "collar" (z >= collar start), and node and face sets "outer",
        "top" and "bottom".

    Raises
    ------
    MeshError
        If the target cannot be reached, or Gmsh is not installed, fails or takes too long.
    """
    shape = NeckShape() if shape is None else shape
    where = "neck"
    if not 1.0 <= waist_refinement < math.inf:
        raise MeshError(
            Fault("the refinement of the waists is too small", where=where, got=f"{waist_refinement:g}", allowed=">= 1")
        )
    if sectors is not None and (sectors < 4 or sectors % 2):
        raise MeshError(
            Fault("the neck cannot be swept like this", where=where, got=f"{sectors} sectors", allowed="4, 6, 8, ...")
        )
    job: dict[str, Any] = {
        "kind": "revolution" if sectors is None else "section",
        "sectors": sectors,
        "regions": _regions(shape),
        **target_of(size, count, MILLIMETRE, where=where),
        "order": order if sectors is None else 2,
    }
    if waist_refinement > 1.0:
        radius = 0.5 * shape.waist_diameter
        circles = [_in_millimetres((radius, z)) for z in shape.waists]
        job["refine"] = {
            "circles": circles,
            "ratios": [waist_refinement] * len(circles),
            "reach": REFINED_REACH * radius / MILLIMETRE,
        }
    arrays = run_gmsh(job, where=where, timeout=timeout)
    if sectors is None:
        mesh = TetMesh(MILLIMETRE * arrays["points"], arrays["tets"])
    else:
        mesh = sweep(MILLIMETRE * arrays["section"], arrays["triangles"], sectors=sectors)
        mesh = of_order(mesh, order)
    z, near = mesh.points[:, 2], ON_PLANE * shape.height
    faces = boundary_faces(mesh)
    bottom = (np.abs(z) <= near)[faces].all(axis=1)
    top = (np.abs(z - shape.height) <= near)[faces].all(axis=1)
    face_sets = {"outer": faces[~bottom & ~top], "top": faces[top], "bottom": faces[bottom]}
    node_sets: dict[str, Ints] = {name: np.unique(rows) for name, rows in face_sets.items()}
    node_sets["socket"] = np.flatnonzero(z <= shape.clamp_depth + near)
    node_sets["collar"] = np.flatnonzero(z >= shape.collar_start - near)
    return TetMesh(mesh.points, mesh.tets, node_sets=node_sets, face_sets=face_sets)


@dataclass(frozen=True)
class _Curve:
    """A piece of the outline in (r, z) [m]: straight, or on the dome below the waist at height `dome_of`."""

    start: Place
    end: Place
    dome_of: float | None = None


def _regions(shape: NeckShape) -> list[list[dict[str, Any]]]:
    """Closed outlines of the regions in the socket, between socket and collar, and in the collar, for the worker."""
    socket, rest = _cut(shape, _outline(shape), shape.clamp_depth)
    body, collar = _cut(shape, rest, shape.collar_start)
    return [[_item(shape, curve) for curve in _closed(curves)] for curves in (socket, body, collar)]


def _outline(shape: NeckShape) -> list[_Curve]:
    outer, waist, neck = 0.5 * shape.outer_diameter, 0.5 * shape.waist_diameter, 0.5 * shape.collar_diameter
    curves: list[_Curve] = []
    place: Place = (0.0, 0.0)
    for top in shape.waists:
        skirt = max(top - shape.dome_height, place[1])
        curves += [
            _Curve(place, (outer, place[1])),
            _Curve((outer, place[1]), (outer, skirt)),
            _Curve((outer, skirt), (waist, top), dome_of=top),
        ]
        place = (waist, top)
    curves += [
        _Curve(place, (neck, place[1])),
        _Curve((neck, place[1]), (neck, shape.height)),
        _Curve((neck, shape.height), (0.0, shape.height)),
    ]
    near = ON_PLANE * shape.height
    return [curve for curve in curves if math.dist(curve.start, curve.end) > near]


def _cut(shape: NeckShape, curves: list[_Curve], height: float) -> tuple[list[_Curve], list[_Curve]]:
    near = ON_PLANE * shape.height
    i = next(i for i, curve in enumerate(curves) if curve.end[1] > height + near)
    below, above = curves[:i], curves[i:]
    crossing = above[0]
    if crossing.start[1] < height - near:
        r = crossing.start[0] if crossing.dome_of is None else shape.dome_radius(crossing.dome_of - height)
        below.append(_Curve(crossing.start, (r, height), crossing.dome_of))
        above[0] = _Curve((r, height), crossing.end, crossing.dome_of)
    elif below[-1].start[1] == below[-1].end[1] and below[-1].end[0] > below[-1].start[0]:
        above.insert(0, below.pop())  # an overhanging underside belongs to the region above
    return below, above


def _closed(curves: list[_Curve]) -> list[_Curve]:
    first, last = curves[0].start, curves[-1].end
    bottom, top = (0.0, first[1]), (0.0, last[1])
    closing = [_Curve(last, top), _Curve(top, bottom), _Curve(bottom, first)]
    return [*curves, *(curve for curve in closing if curve.start != curve.end)]


def _item(shape: NeckShape, curve: _Curve) -> dict[str, Any]:
    item: dict[str, Any] = {"from": _in_millimetres(curve.start), "to": _in_millimetres(curve.end)}
    if curve.dome_of is not None:
        waist, skirt = 0.5 * shape.waist_diameter, curve.dome_of - shape.dome_height
        flat = 0.5 * shape.outer_diameter - waist > shape.dome_height
        tip = (0.5 * shape.outer_diameter, skirt) if flat else (waist, curve.dome_of)
        item |= {"centre": _in_millimetres((waist, skirt)), "major": _in_millimetres(tip)}
    return item


def _in_millimetres(place: Place) -> list[float]:
    # Rounded far below any tolerance, so that adjacent curves share identical points.
    return [round(length / MILLIMETRE, 9) for length in place]
