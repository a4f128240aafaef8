"""Meshing in a process of its own: `python -m softcal.geometry.gmsh_worker OUT.npz`, the job as JSON on stdin.

Gmsh is GPL, keeps global state and can crash or hang: nothing else in softcal may import it. The worker writes
points and tets (VTK node order, unit of the job) to OUT.npz, or one JSON object {"fault", "got", "allowed",
"attempt"} to stdout. It knows nothing of softcal, so that it can be run alone.
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any

import numpy as np

# Gmsh numbers the last two edges of a quadratic tet the other way round than VTK.
GMSH_TO_VTK = (0, 1, 2, 3, 4, 5, 6, 7, 9, 8)
TET_TYPES = {1: (4, 4), 2: (11, 10)}
# A target count is met when the mesh is this near to it; the search stops early when it is very near.
COUNT_TOLERANCE, COUNT_GOAL, MAX_MESHES = 0.05, 0.03, 16
# Tetrahedra in a volume V meshed with edges of length s: about 6 sqrt(2) V / s^3.
TETS_PER_CUBE = 6.0 * math.sqrt(2.0)


class JobError(Exception):
    """A job that cannot be done; its argument is what goes to stdout."""

    def __init__(self, fault: str, *, got: str = "", allowed: str = "", attempt: str = "") -> None:
        super().__init__(fault)
        self.message = {"fault": fault, "got": got, "allowed": allowed, "attempt": attempt}


def main() -> int:
    job = json.load(sys.stdin)
    try:
        points, tets = make_mesh(job)
    except JobError as error:
        json.dump(error.message, sys.stdout)
        return 1
    np.savez(sys.argv[1], points=points, tets=tets)
    return 0


def make_mesh(job: dict[str, Any]) -> tuple[Any, Any]:
    """Points and tets of a job; see generate.py for its keys."""
    gmsh = import_gmsh()
    gmsh.initialize(["softcal"], readConfigFiles=False)
    try:
        for option, value in job["options"].items():
            gmsh.option.setNumber(option, value)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        {"stl": load_stl, "step": load_step, "revolution": build_revolution}[job["kind"]](gmsh, job)
        mesh_to_target(gmsh, job)
        if job["order"] == 2:
            gmsh.model.mesh.setOrder(2)
        return collect(gmsh, job["order"])
    except JobError:
        raise
    except Exception as error:  # Gmsh raises nothing finer; the parent makes a sentence of it
        raise JobError("Gmsh could not mesh this", got=str(error).strip() or gmsh.logger.getLastError()) from error
    finally:
        gmsh.finalize()


def import_gmsh() -> Any:
    try:
        import gmsh
    except ImportError as error:
        raise JobError("Gmsh is not installed", got=str(error), attempt="pip install 'softcal[mesh]'") from error
    except OSError as error:
        raise JobError("a system library that Gmsh needs is missing", got=str(error), attempt="apt") from error
    return gmsh


def load_stl(gmsh: Any, job: dict[str, Any]) -> None:
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
    gmsh.model.mesh.classifySurfaces(math.radians(job["feature_angle"]), True, True, math.pi)
    gmsh.model.mesh.createGeometry()
    surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
    gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop(surfaces)])
    gmsh.model.geo.synchronize()
    job["volume"] = abs(float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))) / 6.0


def load_step(gmsh: Any, job: dict[str, Any]) -> None:
    volumes = [shape for shape in gmsh.model.occ.importShapes(job["path"]) if shape[0] == 3]
    if not volumes:
        raise JobError("the file holds no solid", allowed="one or more solids", attempt="export solids, not surfaces")
    if len(volumes) > 1:
        gmsh.model.occ.fragment(volumes[:1], volumes[1:])
    gmsh.model.occ.synchronize()
    job["volume"] = sum(gmsh.model.occ.getMass(3, tag) for _, tag in gmsh.model.getEntities(3))


def build_revolution(gmsh: Any, job: dict[str, Any]) -> None:
    """A solid of revolution about z: regions, each a closed chain of curves in (r, z), conforming to each other.

    A curve is {"from", "to"}, and "centre" and "major" for an arc of an ellipse.
    """
    occ = gmsh.model.occ
    points: dict[tuple[float, float], int] = {}
    curves: dict[tuple[int, int], int] = {}

    def point(place: list[float]) -> int:
        r, z = place
        if (r, z) not in points:
            points[r, z] = occ.addPoint(r, 0.0, z)
        return points[r, z]

    def curve(item: dict[str, Any]) -> int:
        start, end = point(item["from"]), point(item["to"])
        if "centre" in item:
            return occ.addEllipseArc(start, point(item["centre"]), point(item["major"]), end)
        ends = (min(start, end), max(start, end))
        if ends not in curves:
            curves[ends] = occ.addLine(*ends)
        return curves[ends]

    loops = [occ.addCurveLoop([curve(item) for item in region]) for region in job["regions"]]
    outlines = [(2, occ.addPlaneSurface([loop])) for loop in loops]
    occ.revolve(outlines, 0, 0, 0, 0, 0, 1, 2 * math.pi)
    occ.remove(outlines, recursive=True)
    occ.synchronize()
    job["volume"] = sum(occ.getMass(3, tag) for _, tag in gmsh.model.getEntities(3))


def mesh_to_target(gmsh: Any, job: dict[str, Any]) -> None:
    """Mesh with linear tets at the target size, or search the size that gives the target count."""
    if job["size"] is not None:
        mesh_at(gmsh, job, job["size"])
        return
    target = job["count"]
    size = (TETS_PER_CUBE * job["volume"] / target) ** (1 / 3)
    tried: dict[float, int] = {}
    for _ in range(MAX_MESHES):
        tried[size] = mesh_at(gmsh, job, size)
        if abs(tried[size] / target - 1) <= COUNT_GOAL:
            return
        size = next_size(tried, target)
    best = min(tried, key=lambda size: abs(tried[size] / target - 1))
    if abs(tried[best] / target - 1) > COUNT_TOLERANCE:
        raise JobError(
            f"no mesh of about {target} tets was found",
            got=f"{tried[best]} tets at best",
            allowed=f"what the shape permits, here {min(tried.values())} to {max(tried.values())} were reached",
            attempt="another count, or a size",
        )
    mesh_at(gmsh, job, best)


def next_size(tried: dict[float, int], target: int) -> float:
    """Secant on log(count) over log(size), kept inside the bracket where there is one."""
    coarse = [size for size, count in tried.items() if count < target]
    fine = [size for size, count in tried.items() if count > target]
    nearest = sorted(tried, key=lambda size: abs(math.log(max(tried[size], 1) / target)))
    slope = -3.0
    if len(nearest) > 1 and tried[nearest[0]] != tried[nearest[1]]:
        a, b = nearest[:2]
        slope = math.log(tried[a] / tried[b]) / math.log(a / b)
        slope = min(max(slope, -6.0), -1.0)
    size = nearest[0] * (target / max(tried[nearest[0]], 1)) ** (1 / slope)
    if coarse and fine and not max(fine) < size < min(coarse):
        size = math.sqrt(max(fine) * min(coarse))
    return size * 1.003 if size in tried else size


def mesh_at(gmsh: Any, job: dict[str, Any], size: float) -> int:
    """Number of tets of a mesh of this target size, finer near the circles of job["refine"]."""
    gmsh.model.mesh.clear()
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    if job.get("refine"):
        set_grading(gmsh, job["refine"], size)
    gmsh.model.mesh.generate(3)
    return len(gmsh.model.mesh.getElementsByType(TET_TYPES[1][0])[0])


def set_grading(gmsh: Any, refine: dict[str, Any], size: float) -> None:
    """Size by the distance to circles about z: `size` / ratio on them, growing to `size` at the reach."""
    field = gmsh.model.mesh.field
    for tag in field.list():
        field.remove(tag)
    graded: list[int] = []
    for r, z in refine["circles"]:
        distance = field.add("MathEval")
        field.setString(distance, "F", f"Sqrt((Sqrt(x*x+y*y)-{r!r})^2+(z-{z!r})^2)")
        growth = field.add("Threshold")
        for key, value in (
            ("InField", distance),
            ("SizeMin", size / refine["ratio"]),
            ("SizeMax", size),
            ("DistMin", 0.0),
            ("DistMax", refine["reach"]),
        ):
            field.setNumber(growth, key, value)
        graded.append(growth)
    finest = field.add("Min")
    field.setNumbers(finest, "FieldsList", graded)
    field.setAsBackgroundMesh(finest)
    # The sizes of a refined curve would spread into the volume beyond the reach.
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)


def collect(gmsh: Any, order: int) -> tuple[Any, Any]:
    """Points and tets of the mesh, numbered densely, only points that tets use."""
    kind, n_nodes = TET_TYPES[order]
    _, connectivity = gmsh.model.mesh.getElementsByType(kind)
    if len(connectivity) == 0:
        raise JobError("Gmsh made no tetrahedra", got=gmsh.logger.getLastError())
    used, tets = np.unique(np.asarray(connectivity, dtype=np.int64), return_inverse=True)
    tets = tets.reshape(-1, n_nodes)
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    rows = np.argsort(tags)
    points = xyz.reshape(-1, 3)[rows[np.searchsorted(tags, used, sorter=rows)]]
    return points, tets if order == 1 else tets[:, GMSH_TO_VTK]


def surface_triangles(gmsh: Any) -> Any:
    """Corners of all triangles, shape (n, 3, 3), and their node tags, shape (n, 3)."""
    _, connectivity = gmsh.model.mesh.getElementsByType(2)
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    rows = np.argsort(tags)
    nodes = np.asarray(connectivity, dtype=np.int64)
    places = xyz.reshape(-1, 3)[rows[np.searchsorted(tags, nodes, sorter=rows)]]
    return places.reshape(-1, 3, 3), nodes.reshape(-1, 3)


if __name__ == "__main__":
    sys.exit(main())
