"""The soft neck: bell-shaped links on a core, a collar on top; its shape and its mesh."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np

from softcal.checks import Floats, Ints
from softcal.declare import ByShape
from softcal.errors import Fault, MeshError
from softcal.geometry.generate import OPTIONS, run_gmsh, target_of
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import Filled
from softcal.geometry.quadratic import of_order
from softcal.geometry.surface import boundary_faces
from softcal.geometry.sweep import sweep
from softcal.limits import LIMITS
from softcal.quantities import Refinement, Share, Size

Place = tuple[float, float]

# The worker meshes in millimetres, for which the tolerances of its CAD kernel are designed.
MILLIMETRE = 1e-3
# Tolerance of nodes on a plane, relative to the neck's height.
ON_PLANE = 1e-9
# Distance from a waist at which the elements reach their full size, in core radii.
REFINED_REACH = 1.0
# Points along a dome, through which Gmsh draws a spline.
POINTS_PER_DOME = 33

# The lengths of the published neck in outer diameters. The cubic fits the digitised radii below a waist to 0.011.
PUBLISHED = {
    "bottom_link_height": 0.617,
    "link_pitch": 0.481,
    "dome_height": 0.3,
    "waist_diameter": 0.587,
    "collar_diameter": 0.587,
    "collar_height": 0.267,
    "clamp_depth": 0.37,
}
# Those of the ellipse that is nearest to them.
PUBLISHED_ELLIPSE = {"dome_height": 0.27, "waist_diameter": 0.6, "collar_diameter": 0.6}
AS_PUBLISHED: Any = None  # a length in the published proportion, which `Neck` computes from its outer diameter

# Shapes of a dome by name: the share of its width at a share of its height, both from the waist. The cubic leaves the
# waist at an angle, as the printed neck does; the ellipse leaves it flat, in a cusp under the next link.
DOMES: dict[str, Callable[[Floats], Floats]] = {
    "cubic": lambda depth: 1.0 - (1.0 - depth) ** 3,
    "ellipse": lambda depth: np.sqrt(1.0 - (1.0 - depth) ** 2),
}
Dome = Annotated[Literal["cubic", "ellipse"] | tuple[tuple[Share, Share], ...], ByShape()]


@dataclass(frozen=True)
class Neck(Filled):
    """The soft neck, a solid of revolution about z with its base at z = 0; lengths as published where omitted.

    Each link is a cylindrical skirt under a dome, which runs from the outer diameter in to the waist.
    Meshes are Delaunay, or swept about the axis in `sectors`: elements that are long in the hoop direction and small
    across reach the same accuracy with far fewer elements, since the stress gradient at the waists is small in the hoop
    direction. For quadratic tets, 6 or 8 sectors with a refinement of about 12 are suitable.

    Attributes
    ----------
    outer_diameter : [m]
    n_bells : Number of links
    bottom_link_height : From the base to the first waist [m]
    link_pitch : From waist to waist [m]
    dome_height : Dome height of every link [m]
    dome
        Shape of every dome: "cubic", as digitised from the published neck; "ellipse", a quarter of one; or points
        (share of its height, share of its width), both from the waist, as by callipers or from a silhouette [-]. The
        shares ascend; a monotone curve goes through the waist, the points and the skirt.
    waist_diameter : Waist diameter of the core between two links [m]
    collar_diameter, collar_height : Of the cylinder on top, which is fixed to the plate [m]
    clamp_depth : Length of the bottom link in the socket [m]
    waist_refinement
        Ratio of element sizes away from and at the waists, where the stress is singular [-]; varied by up to a fifth at
        some waists if needed for the target number of tets. The target size is that away from the waists.
    sectors
        Number of sectors of the sweep, even; the mesh is then symmetric about the plane y = 0; None: Delaunay.
    """

    outer_diameter: Size = 0.038
    n_bells: Annotated[int, LIMITS["bells"]] = 5
    bottom_link_height: Size = AS_PUBLISHED
    link_pitch: Size = AS_PUBLISHED
    dome_height: Size = AS_PUBLISHED
    dome: Dome = "cubic"
    waist_diameter: Size = AS_PUBLISHED
    collar_diameter: Size = AS_PUBLISHED
    collar_height: Size = AS_PUBLISHED
    clamp_depth: Size = AS_PUBLISHED
    waist_refinement: Refinement = 1.0
    sectors: Annotated[int, LIMITS["sectors"]] | None = None
    # The collar is rigid, and the depth of the clamp is a parameter of the body's `clamp`.
    lengths: ClassVar[tuple[str, ...]] = (
        "outer_diameter",
        "bottom_link_height",
        "link_pitch",
        "dome_height",
        "waist_diameter",
        "collar_height",
    )
    # Each neck has its own: names of the omitted lengths, which follow the outer diameter where that is a parameter.
    as_published: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        omitted = tuple(name for name in PUBLISHED if getattr(self, name) is AS_PUBLISHED)
        object.__setattr__(self, "as_published", omitted)
        super().__post_init__()
        shares = PUBLISHED | (PUBLISHED_ELLIPSE if self.dome == "ellipse" else {})
        for name in omitted:
            object.__setattr__(self, name, shares[name] * self.outer_diameter)
        faults: list[Fault] = []
        if self.sectors is not None and self.sectors % 2:
            got = f"{self.sectors} sectors"
            faults.append(Fault("the neck cannot be swept like this", "sectors", got, "an even number"))
        up, out = np.diff(self._dome_points, axis=0).T
        if (up <= 0.0).any() or (out < 0.0).any():
            got = ", ".join(f"[{height:g}, {width:g}]" for height, width in self._dome_points[1:-1])
            allowed = "heights that ascend between 0 and 1, and widths that do not descend"
            faults.append(Fault("the points of the dome do not lead from the waist to the skirt", "dome", got, allowed))
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
                allowed = f"{sign} {other}, {limit:g} m"
                faults.append(Fault("a length of the neck is too large", name, f"{value:g} m", allowed))
        if faults:
            raise MeshError(faults)

    def with_lengths(self, values: Mapping[str, float]) -> Self:
        return replace(self, **{**dict.fromkeys(self.as_published, AS_PUBLISHED), **values})

    @property
    def knots(self) -> tuple[Sequence[float], Sequence[float]]:
        """Radii of the waists and the links; heights of the clamp's plane, the waists and the domes between them."""
        radii = (0.0, 0.5 * self.waist_diameter, 0.5 * self.outer_diameter)
        first, *others = self.waists
        domes = (z for top in others for z in (top - self.dome_height, top))
        return radii, (0.0, self.clamp_depth, first, *domes, self.height)

    def shares(self, places: Floats) -> Floats:
        """As `Primitive.shares`; radii outside the core are shares of the way to the outline at the same height."""
        shares, core, r = super().shares(places), 0.5 * self.waist_diameter, places[:, 0]
        shares[:, 0] = np.minimum(r, core) / core + np.maximum(r - core, 0.0) / self._beyond_core(places[:, 1])
        return shares

    def places(self, shares: Floats) -> Floats:
        places, core, r = super().places(shares), 0.5 * self.waist_diameter, shares[:, 0]
        places[:, 0] = np.minimum(r, 1.0) * core + np.maximum(r - 1.0, 0.0) * self._beyond_core(places[:, 1])
        return places

    def _beyond_core(self, z: Floats) -> Floats:
        """Thickness of the links around a core as wide as the waists, at heights [m]; at a waist, of the link above."""
        near = ON_PLANE * self.height
        tops = np.append(self.waists, np.inf)[np.searchsorted(self.waists, z + near)]
        return np.maximum(self.dome_radius(tops - z) - 0.5 * self.waist_diameter, near)

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

    @property
    def _dome_points(self) -> Floats:
        """The stated points of the dome, between its ends at the waist and the skirt, shape (n, 2)."""
        return np.array([(0.0, 0.0), *(() if isinstance(self.dome, str) else self.dome), (1.0, 1.0)])

    def dome_radius(self, below_waist: Floats | float) -> Floats:
        """Radius of a dome [m] at distances below its waist [m]."""
        depth = np.clip(np.divide(below_waist, self.dome_height), 0.0, 1.0)
        if isinstance(self.dome, str):
            share = DOMES[self.dome](depth)
        else:
            from scipy.interpolate import PchipInterpolator

            share = PchipInterpolator(*self._dome_points.T)(depth)
        return 0.5 * (self.waist_diameter + share * (self.outer_diameter - self.waist_diameter))

    def dome_places(self, start: float, end: float, top: float, n_points: int = POINTS_PER_DOME) -> list[Place]:
        """Points (r, z) [m] on the dome below the waist at height `top`, from one height to another [m].

        Parameters
        ----------
        start
            Height of the first point [m].
        end
            Height of the last point [m].
        top
            Height of the waist [m].
        n_points
            Number of points.
        """
        # Equal steps of an ellipse's angle: dense towards the waist, where a dome may begin flat.
        first, last = (math.acos(min(max(1.0 - (top - z) / self.dome_height, 0.0), 1.0)) for z in (start, end))
        belows = [self.dome_height * (1.0 - math.cos(angle)) for angle in np.linspace(first, last, n_points)]
        return [(float(self.dome_radius(below)), top - below) for below in belows]

    def profile(self, points_per_dome: int = POINTS_PER_DOME) -> Floats:
        """The outline as a polyline of (r, z) [m], from the base's centre to the top's centre, shape (n, 2)."""
        places: list[Place] = [(0.0, 0.0)]
        start = 0.0
        for top in self.waists:
            places.append((0.5 * self.outer_diameter, start))
            places += self.dome_places(top - self.dome_height, top, top, points_per_dome)
            start = top
        places += [
            (0.5 * self.collar_diameter, self.collar_start),
            (0.5 * self.collar_diameter, self.height),
            (0.0, self.height),
        ]
        line = np.array(places)
        moved = np.linalg.norm(np.diff(line, axis=0), axis=1) > ON_PLANE * self.height
        return line[np.concatenate([[True], moved])]

    def mesh(self, *, timeout: float = 300.0) -> TetMesh:
        """A mesh that conforms to the planes of the clamp and the collar; Gmsh may take as long as `timeout` [s].

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
        where = "neck"
        socket, rest = _cut(self, _outline(self), self.clamp_depth)
        body, collar = _cut(self, rest, self.collar_start)
        regions: list[list[list[list[float]]]] = []
        for curves in (socket, body, collar):
            first, last = curves[0].start, curves[-1].end
            low, high = (0.0, first[1]), (0.0, last[1])
            closing = [_Curve(last, high), _Curve(high, low), _Curve(low, first)]
            closed = [*curves, *(curve for curve in closing if curve.start != curve.end)]
            region: list[list[list[float]]] = []  # points of each curve: a line through two, a spline through more
            for curve in closed:
                start, end, top = curve.start, curve.end, curve.dome_of
                inner = () if top is None else self.dome_places(start[1], end[1], top)[1:-1]
                region.append([_in_millimetres(place) for place in (start, *inner, end)])
            regions.append(region)
        job: dict[str, Any] = {
            "kind": "revolution" if self.sectors is None else "section",
            "sectors": self.sectors,
            "regions": regions,
            **target_of(self.size, self.tets, MILLIMETRE, where=where),
            "order": self.order if self.sectors is None else 2,
            # Half of a short piece of a dome, such as from the skirt to the clamp's plane, would be swept into slivers.
            "options": OPTIONS if self.sectors is None else {**OPTIONS, "Mesh.MinimumCurveNodes": 2},
        }
        if self.waist_refinement > 1.0:
            radius = 0.5 * self.waist_diameter
            circles = [_in_millimetres((radius, z)) for z in self.waists]
            job["refine"] = {
                "circles": circles,
                "ratios": [self.waist_refinement] * len(circles),
                "reach": REFINED_REACH * radius / MILLIMETRE,
            }
        arrays = run_gmsh(job, where=where, timeout=timeout)
        if self.sectors is None:
            mesh = TetMesh(MILLIMETRE * arrays["points"], arrays["tets"])
        else:
            mesh = sweep(MILLIMETRE * arrays["section"], arrays["triangles"], sectors=self.sectors)
            mesh = of_order(mesh, self.order)
        z, near = mesh.points[:, 2], ON_PLANE * self.height
        faces = boundary_faces(mesh)
        bottom = (np.abs(z) <= near)[faces].all(axis=1)
        top = (np.abs(z - self.height) <= near)[faces].all(axis=1)
        face_sets = {"outer": faces[~bottom & ~top], "top": faces[top], "bottom": faces[bottom]}
        node_sets: dict[str, Ints] = {name: np.unique(rows) for name, rows in face_sets.items()}
        node_sets["socket"] = np.flatnonzero(z <= self.clamp_depth + near)
        node_sets["collar"] = np.flatnonzero(z >= self.collar_start - near)
        return TetMesh(mesh.points, mesh.tets, node_sets=node_sets, face_sets=face_sets)


@dataclass(frozen=True)
class _Curve:
    """A piece of the outline in (r, z) [m]: straight, or on the dome below the waist at height `dome_of`."""

    start: Place
    end: Place
    dome_of: float | None = None


def _outline(shape: Neck) -> list[_Curve]:
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


def _cut(shape: Neck, curves: list[_Curve], height: float) -> tuple[list[_Curve], list[_Curve]]:
    near = ON_PLANE * shape.height
    i = next(i for i, curve in enumerate(curves) if curve.end[1] > height + near)
    below, above = curves[:i], curves[i:]
    crossing = above[0]
    if crossing.start[1] < height - near:
        r = crossing.start[0] if crossing.dome_of is None else float(shape.dome_radius(crossing.dome_of - height))
        below.append(_Curve(crossing.start, (r, height), crossing.dome_of))
        above[0] = _Curve((r, height), crossing.end, crossing.dome_of)
    elif below[-1].start[1] == below[-1].end[1] and below[-1].end[0] > below[-1].start[0]:
        above.insert(0, below.pop())  # an overhanging underside belongs to the region above
    return below, above


def _in_millimetres(place: Place) -> list[float]:
    # Rounded far below any tolerance, so that adjacent curves share identical points.
    return [round(length / MILLIMETRE, 9) for length in place]
