"""Gmsh models of a meshing job: STL and STEP files, solids of revolution, discs.

Only for the worker's process, which has loaded Gmsh.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

# Surfaces with fewer triangles than this are refined before they are split into faces.
FEW_TRIANGLES = 400
# Edges of an .stl file sharper than this angle [rad] are kept.
FEATURE_ANGLE = 0.7


class JobError(Exception):
    """A job that failed; its message is written to fault.json."""

    def __init__(self, fault: str, *, got: str = "", allowed: str = "", attempt: str = "") -> None:
        super().__init__(fault)
        self.message = {"fault": fault, "got": got, "allowed": allowed, "attempt": attempt}


def load_stl(gmsh: Any, job: dict[str, Any]) -> None:
    """The volume inside a closed surface of triangles, split into faces at its sharp edges."""
    try:
        split_stl(gmsh, job, into_patches=True)
    except JobError:
        raise
    except Exception:  # noqa: BLE001 (Gmsh raises nothing finer; a face with holes is meshed whole)
        gmsh.clear()
        split_stl(gmsh, job, into_patches=False)


def split_stl(gmsh: Any, job: dict[str, Any], *, into_patches: bool) -> None:
    """Divide an STL surface into faces between sharp edges, with the volume inside.

    Parameters
    ----------
    gmsh
        The module `gmsh`, initialised.
    job
        The job, as in `softcal.geometry.gmsh_worker`.
    into_patches
        Divide the faces into disc-like patches.
    """
    gmsh.merge(job["path"])
    corners, nodes = surface_triangles(gmsh)
    if len(nodes) == 0:
        raise JobError("the file holds no triangles", allowed="a closed surface of triangles")
    edges = np.sort(nodes[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    if (count != 2).any():
        raise JobError(
            "the surface is not closed",
            got=f"{int((count == 1).sum())} free edges and {int((count > 2).sum())} shared by more than two triangles",
            allowed="a closed surface, two triangles at every edge",
            attempt="repair it in the CAD program and export it again",
        )
    if len(nodes) < FEW_TRIANGLES:
        # Gmsh hangs on a face that is a single triangle.
        gmsh.model.mesh.refine()
    gmsh.model.mesh.classifySurfaces(FEATURE_ANGLE, True, into_patches, math.pi)
    gmsh.model.mesh.createGeometry()
    surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
    gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop(surfaces)])
    gmsh.model.geo.synchronize()
    job["volume"] = abs(float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))) / 6.0
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    job["surface"] = float(np.linalg.norm(normals, axis=1).sum()) / 2.0


def load_step(gmsh: Any, job: dict[str, Any]) -> None:
    """The solids of a CAD model, sharing their faces where they touch."""
    volumes = [shape for shape in gmsh.model.occ.importShapes(job["path"]) if shape[0] == 3]
    if not volumes:
        raise JobError("the file holds no solid", allowed="one or more solids", attempt="export solids, not surfaces")
    if len(volumes) > 1:
        gmsh.model.occ.fragment(volumes[:1], volumes[1:])
    gmsh.model.occ.synchronize()
    measure(gmsh, job)


def measure(gmsh: Any, job: dict[str, Any]) -> None:
    """Volume of the solids, and surface of their faces."""
    for key, dimension in (("volume", 3), ("surface", 2)):
        job[key] = sum(gmsh.model.occ.getMass(dimension, tag) for _, tag in gmsh.model.getEntities(dimension))


def build_revolution(gmsh: Any, job: dict[str, Any]) -> None:
    """The conforming solid of revolution of a half section's regions about z."""
    section = draw_section(gmsh, job)
    gmsh.model.occ.revolve(section, 0, 0, 0, 0, 0, 1, 2 * math.pi)
    gmsh.model.occ.remove(section, recursive=True)
    gmsh.model.occ.synchronize()
    measure(gmsh, job)


def build_section(gmsh: Any, job: dict[str, Any]) -> None:
    """The half section, which the parent process sweeps about the axis."""
    section = draw_section(gmsh, job)
    gmsh.model.occ.synchronize()
    job["area"] = sum(gmsh.model.occ.getMass(2, tag) for _, tag in section)


def draw_section(gmsh: Any, job: dict[str, Any]) -> list[tuple[int, int]]:
    """Regions, each a closed chain of curves in (r, z), as surfaces in the plane y = 0 that share their edges.

    A curve is its points: a line through two, a spline through more.
    """
    occ = gmsh.model.occ
    points: dict[tuple[float, float], int] = {}
    lines: dict[tuple[int, int], int] = {}

    def point(place: list[float]) -> int:
        r, z = place
        if (r, z) not in points:
            points[r, z] = occ.addPoint(r, 0.0, z)
        return points[r, z]

    def curve(places: list[list[float]]) -> int:
        tags = [point(place) for place in places]
        if len(tags) > 2:
            return occ.addSpline(tags)
        ends = (min(tags), max(tags))
        if ends not in lines:
            lines[ends] = occ.addLine(*ends)
        return lines[ends]

    loops = [occ.addCurveLoop([curve(places) for places in region]) for region in job["regions"]]
    return [(2, occ.addPlaneSurface([loop])) for loop in loops]


def build_disc(gmsh: Any, job: dict[str, Any]) -> None:
    """A flat cylinder from z = 0 upwards with holes (x, y, diameter)."""
    occ = gmsh.model.occ
    body = occ.addCylinder(0, 0, 0, 0, 0, job["thickness"], 0.5 * job["diameter"])
    holes = [(3, occ.addCylinder(x, y, 0, 0, 0, job["thickness"], 0.5 * diameter)) for x, y, diameter in job["holes"]]
    if holes:
        occ.cut([(3, body)], holes)
    occ.synchronize()
    measure(gmsh, job)


LOADERS = {
    "stl": load_stl,
    "step": load_step,
    "revolution": build_revolution,
    "section": build_section,
    "disc": build_disc,
}


def surface_triangles(gmsh: Any) -> Any:
    """Corners of all triangles, shape (n, 3, 3), and their node tags, shape (n, 3)."""
    _, connectivity = gmsh.model.mesh.getElementsByType(2)
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    rows = np.argsort(tags)
    nodes = np.asarray(connectivity, dtype=np.int64)
    places = xyz.reshape(-1, 3)[rows[np.searchsorted(tags, nodes, sorter=rows)]]
    return places.reshape(-1, 3, 3), nodes.reshape(-1, 3)
