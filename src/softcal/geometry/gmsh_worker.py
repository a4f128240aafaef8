"""Meshing in a separate process: `python -m softcal.geometry.gmsh_worker FOLDER`, with the job as JSON on stdin.

Gmsh is GPL, keeps global state and can crash, hang and take all memory: nothing else in softcal may import it, and each
step has a limit of processor time, after which it is ended by SIGPROF, and of memory; gmsh_shapes.py is part of the
worker. It writes mesh.npz into FOLDER: points in the job's unit and tets in VTK node order, or a half section and
its triangles; or it writes fault.json with {"fault", "got", "allowed", "attempt"}.
"""

from __future__ import annotations

import contextlib
import json
import math
import signal
import sys
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np

from softcal.bounded_work import memory_limit
from softcal.geometry.gmsh_shapes import LOADERS, JobError, load_stl, surface_triangles
from softcal.geometry.quality import SLIVER_ANGLE, least_dihedral

# Gmsh and VTK number the last two edges of a quadratic tet in opposite order.
GMSH_TO_VTK = (0, 1, 2, 3, 4, 5, 6, 7, 9, 8)
# Gmsh's number and the nodes of the elements: tets by order, and quadratic triangles.
TET_TYPES = {1: (4, 4), 2: (11, 10)}
TRIANGLE_TYPES = {1: (2, 3), 2: (9, 6)}
# Tolerances of a target count: of an accepted mesh, and of one that stops the search early.
COUNT_TOLERANCE, COUNT_GOAL, MAX_MESHES = 0.05, 0.03, 16
# The search ends if two sizes of this ratio give too few and too many tets.
CLOSE = 0.99
AROUND_A_JUMP = (0.97, 1.03, 0.94, 1.06, 0.9, 1.1, 0.85, 1.15, 0.8, 1.2)
# Quadratic tets whose smallest Jacobian is below this share of the largest one are repaired.
LEAST_JACOBIAN = 0.1
# Recipes for a mesh without slivers: algorithm of the surfaces (6 frontal, 5 Delaunay), and passes of optimisation. The
# first one makes the fewest tets; Netgen's pass, the surest, makes half as many more.
SMOOTHED = ("Relocate3D", "")
RECIPES = ((6, ()), (6, SMOOTHED), (5, ()), (5, SMOOTHED), (5, (*SMOOTHED, "Netgen")))
# Tets per cube, and triangles per square, of the edge length.
TETS_PER_CUBE, TRIANGLES_PER_SQUARE = 6.0 * math.sqrt(2.0), 4.0 / math.sqrt(3.0)
# Processor time [s] and memory [B] of a step, and more for each tet; a quadratic one takes half of that.
MOST_SECONDS, MOST_BYTES, SECONDS_EACH, BYTES_EACH = 10.0, 4e8, 2e-4, 2e3
# Share of that time for the search for a count; the rest is for its last mesh.
SHARE_OF_SEARCH = 0.5
# A search for a count begins with no smaller size than one that puts so many triangles on the surface per tet.
MOST_ON_SURFACE = 10
# Tolerance of nodes of a half section on the axis.
ON_AXIS = 1e-9


def main() -> int:
    """Run the job on stdin; the exit code is 0 if there is a mesh."""
    job = json.load(sys.stdin)
    folder = Path(sys.argv[1])
    if hasattr(signal, "alarm"):
        # Stops a hanging Gmsh even if the parent was killed.
        signal.alarm(math.ceil(job["timeout"]) + 10)
    try:
        arrays = make_mesh(job)
    except JobError as error:
        (folder / "fault.json").write_text(json.dumps(error.message))
        return 1
    np.savez(folder / "mesh.npz", **arrays)
    return 0


def make_mesh(job: dict[str, Any]) -> dict[str, Any]:
    """Points and elements of a job; see generate.py, neck.py and disc.py for its keys."""
    gmsh = import_gmsh()
    gmsh.initialize(["softcal"], readConfigFiles=False)
    try:
        for option, value in job["options"].items():
            gmsh.option.setNumber(option, value)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        with limits(0.0):
            LOADERS[job["kind"]](gmsh, job)
        with limits(most_expected(job)):
            mesh_to_target(gmsh, job)
            if job["order"] == 2:
                curve(gmsh, job)
            return collect(gmsh, job)
    except JobError:
        raise
    except Exception as error:  # Gmsh raises nothing more specific; the parent turns it into a sentence
        raise failure(gmsh, job, str(error).strip() or gmsh.logger.getLastError()) from error
    finally:
        gmsh.finalize()


@contextlib.contextmanager
def limits(tets: float) -> Generator[None]:
    """A step with its own processor time and memory: meshes of so many tets, with all that are tried for them."""
    most = MOST_BYTES + BYTES_EACH * tets
    if hasattr(signal, "setitimer"):  # ends the process, which Gmsh alone does not
        signal.setitimer(signal.ITIMER_PROF, most_seconds(tets))
    try:
        with memory_limit(most):
            yield
    except MemoryError:
        got = f"more than {most / 1e6:.0f} MB"
        raise JobError("Gmsh took too much memory and was stopped", got=got, attempt="a larger size") from None


def most_seconds(tets: float) -> float:
    """Processor time [s] of a step of so many tets."""
    return MOST_SECONDS + SECONDS_EACH * tets


def most_expected(job: dict[str, Any]) -> float:
    """Number of tets that a mesh of the job, or one that is tried for it, may have."""
    if job.get("refine") or job["options"].get("Mesh.MeshSizeFromCurvature"):
        return job["most_tets"]
    expected = job["count"] if job["size"] is None else expected_count(job, job["size"])
    return min(MOST_ON_SURFACE * expected, job["most_tets"])


def failure(gmsh: Any, job: dict[str, Any], reason: str) -> JobError:
    """Fault of a failed mesh; names a round face that is smaller than the elements.

    Parameters
    ----------
    gmsh
        The module `gmsh`, initialised.
    job
        The job, as in `softcal.geometry.gmsh_worker`.
    reason
        The message of Gmsh.
    """
    narrowest = narrowest_diameter(gmsh) if job["kind"] == "step" else math.inf
    size = gmsh.option.getNumber("Mesh.MeshSizeMax")
    if size <= narrowest:
        attempt = "unite bodies that overlap, and repair surfaces that cut one another, in the CAD program"
        return JobError("Gmsh could not mesh this", got=reason, attempt=attempt)
    return JobError(
        "the elements are larger than a bore or fillet, and Gmsh could not mesh it",
        got=f"a size of {size:.4g} mm beside a round face {narrowest:.4g} mm across ({reason})",
        allowed=f"a size of {narrowest:.4g} mm or less, or small elements where the model is round",
        attempt="edges_around: 6 beside the size, or close the bore in the CAD program: its via points may stay",
    )


def narrowest_diameter(gmsh: Any) -> float:
    """The smallest diameter of curvature at the centres of the CAD model's faces; infinite if all are flat."""
    found = [math.inf]
    for _, tag in gmsh.model.getEntities(2):
        lower, upper = gmsh.model.getParametrizationBounds(2, tag)
        middle = [0.5 * (low + high) for low, high in zip(lower, upper, strict=True)]
        largest, least, _, _ = gmsh.model.getPrincipalCurvatures(tag, middle)
        curvature = max(abs(float(largest[0])), abs(float(least[0])))
        if curvature > 0.0:
            found.append(2.0 / curvature)
    return min(found)


def import_gmsh() -> Any:
    """The module; raises a fault that names a missing package or library."""
    try:
        import gmsh
    except ImportError as error:
        raise JobError("Gmsh is not installed", got=str(error), attempt="pip install 'softcal[mesh]'") from error
    except OSError as error:
        raise JobError("a system library that Gmsh needs is missing", got=str(error), attempt="apt") from error
    return gmsh


def mesh_to_target(gmsh: Any, job: dict[str, Any]) -> None:
    """Mesh with linear tets at the target size, or search for the size of the target count."""
    if job["size"] is not None:
        expected = expected_count(job, job["size"])
        if expected > job["most_tets"]:
            raise JobError(
                "the target size is too small",
                got=f"a size that gives about {expected:.2g} tets",
                allowed=f"at most {job['most_tets']:.0e} tets",
                attempt="check the unit of the model and of the size",
            )
        mesh_at(gmsh, job, job["size"])
        return
    target = job["count"]
    size = (bulk_count(job, 1.0) / target) ** (1 / dimension(job))
    size = max(size, math.sqrt(surface_count(job, 1.0) / (MOST_ON_SURFACE * target)))
    tried: dict[float, int] = {}
    # A search ends with its best count before the time of the step ends the process.
    end = time.process_time() + SHARE_OF_SEARCH * most_seconds(most_expected(job))
    while len(tried) < MAX_MESHES and time.process_time() < end:
        tried[size] = mesh_at(gmsh, job, size)
        if abs(tried[size] / target - 1) <= COUNT_GOAL:
            return
        coarse = min((size for size, count in tried.items() if count < target), default=math.inf)
        fine = max((size for size, count in tried.items() if count > target), default=0.0)
        size = next_size(tried, target, fine, coarse)
        if fine > CLOSE * coarse or fine > largest_size(gmsh):
            break
    best = min(tried, key=lambda size: abs(tried[size] / target - 1))
    if abs(tried[best] / target - 1) > COUNT_TOLERANCE and mesh_around_jump(gmsh, job, best, end):
        return
    if abs(tried[best] / target - 1) > COUNT_TOLERANCE:
        reached = sorted(set(tried.values()), key=lambda count: abs(count - target))[:4]
        raise JobError(
            f"no mesh of about {target} tets was found",
            got=f"{tried[best]} tets at best",
            allowed="what the shape permits, such as " + ", ".join(map(str, sorted(reached))),
            attempt="another count, or a size",
        )
    mesh_at(gmsh, job, best)


def mesh_around_jump(gmsh: Any, job: dict[str, Any], size: float, end: float) -> bool:
    """True if a mesh near this size has the target count, which jumps when many edges are divided once more at the same
    size.

    Parameters
    ----------
    gmsh
        The module `gmsh`, initialised.
    job
        The job, as in `softcal.geometry.gmsh_worker`.
    size
        Target edge length, in the job's unit.
    end
        Processor time of the process [s] after which no further mesh is tried.
    """
    for factor in AROUND_A_JUMP:
        if time.process_time() > end:
            return False
        varied = dict(job)
        if job.get("refine"):
            # Increases with height, so that the circles do not all jump together.
            ratios = job["refine"]["ratios"]
            steps = max(len(ratios) - 1, 1)
            varied_ratios = [ratio * factor ** (i / steps) for i, ratio in enumerate(ratios)]
            varied["refine"] = {**job["refine"], "ratios": varied_ratios}
            count = mesh_at(gmsh, varied, size)
        else:
            count = mesh_at(gmsh, varied, factor * size)
        if abs(count / job["count"] - 1) <= COUNT_TOLERANCE:
            return True
    return False


def dimension(job: dict[str, Any]) -> int:
    """Dimension of the elements to generate."""
    return 2 if job["kind"] == "section" else 3


def expected_count(job: dict[str, Any], size: float) -> float:
    """Number of tets to be expected for a target size: of a thin shape, as many as triangles on its surface."""
    return max(bulk_count(job, size), surface_count(job, size))


def surface_count(job: dict[str, Any], size: float) -> float:
    """Number of triangles to be expected on the surface of a solid."""
    return TRIANGLES_PER_SQUARE * job.get("surface", 0.0) / size**2


def bulk_count(job: dict[str, Any], size: float) -> float:
    """Number of tets to be expected of a shape that is not thin."""
    if job["kind"] == "section":
        return 3 * job["sectors"] * TRIANGLES_PER_SQUARE * job["area"] / size**2
    return TETS_PER_CUBE * job["volume"] / size**3


def count_tets(gmsh: Any, job: dict[str, Any]) -> int:
    """Number of tets of the linear mesh, or of the sweep of its triangles."""
    if dimension(job) == 3:
        return len(gmsh.model.mesh.getElementsByType(TET_TYPES[1][0])[0])
    corners, _ = surface_triangles(gmsh)
    return int(job["sectors"] * (3 - (abs(corners[:, :, 0]) < ON_AXIS).sum(axis=1)).sum())


def next_size(tried: dict[float, int], target: int, fine: float, coarse: float) -> float:
    """Secant step on log(count) over log(size), within the bracket of a too fine and a too coarse size.

    Parameters
    ----------
    tried
        Size -> number of tets.
    target
        Target number of tets.
    fine
        Largest size with too many tets.
    coarse
        Smallest size with too few tets.
    """
    a, *others = sorted(tried, key=lambda size: abs(math.log(tried[size] / target)))
    slope = -3.0
    if others and tried[a] != tried[others[0]]:
        slope = math.log(tried[a] / tried[others[0]]) / math.log(a / others[0])
        slope = min(max(slope, -6.0), -1.5)
    size = a * (target / tried[a]) ** (1 / slope)
    if not fine < size < coarse:
        size = math.sqrt(fine * coarse) if fine > 0 and coarse < math.inf else size * 1.1
    return size


def largest_size(gmsh: Any) -> float:
    """The diagonal of the model: larger sizes have no effect."""
    box = gmsh.model.getBoundingBox(-1, -1)
    return math.dist(box[:3], box[3:])


def mesh_at(gmsh: Any, job: dict[str, Any], size: float) -> int:
    """Number of tets of a mesh of this target size, finer near the circles of job["refine"].

    A surface or CAD model is meshed by the first of `RECIPES` without slivers, or the one with the fewest; other shapes
    by the first recipe.

    Parameters
    ----------
    gmsh
        The module `gmsh`, initialised.
    job
        The job, as in `softcal.geometry.gmsh_worker`.
    size
        Target edge length, in the job's unit.
    """
    if job["kind"] not in ("stl", "step"):
        generate(gmsh, job, size, *RECIPES[0])
        return count_tets(gmsh, job)
    slivers: dict[Any, float] = {}
    for recipe in RECIPES:
        try:
            generate(gmsh, job, size, *recipe)
            slivers[recipe] = count_slivers(gmsh, job)
        except Exception:  # Gmsh raises nothing more specific
            if not slivers:
                raise
            slivers[recipe] = math.inf
        if slivers[recipe] == 0:
            break
    else:
        generate(gmsh, job, size, *min(RECIPES, key=lambda recipe: slivers[recipe]))
    return count_tets(gmsh, job)


def generate(gmsh: Any, job: dict[str, Any], size: float, algorithm: int, passes: tuple[str, ...]) -> None:
    """Generate a mesh of this target size by a recipe.

    Parameters
    ----------
    gmsh
        The module `gmsh`, initialised.
    job
        The job, as in `softcal.geometry.gmsh_worker`.
    size
        Target edge length, in the job's unit.
    algorithm
        Gmsh's number of the algorithm for surfaces.
    passes
        Passes of optimisation.
    """
    if job["kind"] != "stl":
        gmsh.model.mesh.clear()
    elif job.get("has_meshed"):
        # A surface of triangles is itself a mesh, which clearing would delete.
        gmsh.clear()
        load_stl(gmsh, job)
    job["has_meshed"] = True
    gmsh.option.setNumber("Mesh.Algorithm", algorithm)
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    if job.get("refine"):
        set_grading(gmsh, job["refine"], size)
    gmsh.model.mesh.generate(dimension(job))
    if count_tets(gmsh, job) == 0:
        attempt = (
            "one closed surface: join bodies that touch, mesh others as bodies of their own, and close what is open"
        )
        raise JobError("Gmsh made no tetrahedra", got=gmsh.logger.getLastError(), attempt=attempt)
    for method in passes:
        gmsh.model.mesh.optimize(method)


def count_slivers(gmsh: Any, job: dict[str, Any]) -> int:
    """Number of slivers of the linear mesh."""
    mesh = collect(gmsh, {**job, "order": 1})
    return int((least_dihedral(mesh["points"][mesh["tets"]]) < SLIVER_ANGLE).sum())


def curve(gmsh: Any, job: dict[str, Any]) -> None:
    """Quadratic elements on the curved surface; inverted ones are repaired."""
    gmsh.model.mesh.setOrder(2)
    kind, _ = (TET_TYPES if dimension(job) == 3 else TRIANGLE_TYPES)[2]
    tags, _ = gmsh.model.mesh.getElementsByType(kind)
    if min(gmsh.model.mesh.getElementQualities(tags, "minSJ")) < LEAST_JACOBIAN:
        gmsh.model.mesh.optimize("HighOrder")


def set_grading(gmsh: Any, refine: dict[str, Any], size: float) -> None:
    """Size by the distance to circles about z: `size` / ratio on them, growing to `size` at the reach.

    Parameters
    ----------
    gmsh
        The module `gmsh`, initialised.
    refine
        Circles, ratio and reach.
    size
        Target edge length, in the job's unit.
    """
    field = gmsh.model.mesh.field
    for tag in field.list():
        field.remove(tag)
    graded: list[int] = []
    for (r, z), ratio in zip(refine["circles"], refine["ratios"], strict=True):
        distance = field.add("MathEval")
        field.setString(distance, "F", f"Sqrt((Sqrt(x*x+y*y)-{r!r})^2+(z-{z!r})^2)")
        growth = field.add("Threshold")
        for key, value in (
            ("InField", distance),
            ("SizeMin", size / ratio),
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


def collect(gmsh: Any, job: dict[str, Any]) -> dict[str, Any]:
    """Points and elements of the mesh, without unused points, renumbered."""
    kind, n_nodes = (TET_TYPES if dimension(job) == 3 else TRIANGLE_TYPES)[job["order"]]
    _, connectivity = gmsh.model.mesh.getElementsByType(kind)
    used, elements = np.unique(np.asarray(connectivity, dtype=np.int64), return_inverse=True)
    elements = elements.reshape(-1, n_nodes)
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    rows = np.argsort(tags)
    points = xyz.reshape(-1, 3)[rows[np.searchsorted(tags, used, sorter=rows)]]
    if dimension(job) == 2:
        section = points[:, [0, 2]]
        section[abs(section[:, 0]) < ON_AXIS, 0] = 0.0
        return {"section": section, "triangles": elements}
    return {"points": points, "tets": elements if job["order"] == 1 else elements[:, GMSH_TO_VTK]}


if __name__ == "__main__":
    sys.exit(main())
