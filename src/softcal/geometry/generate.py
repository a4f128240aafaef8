"""Tetrahedral meshes from surfaces and CAD models, by Gmsh in a separate process."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from softcal.errors import Fault, MeshError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.stl import checked_stl
from softcal.geometry.surface import boundary_faces
from softcal.limits import LIMITS
from softcal.processes import run_module
from softcal.quantities import QUANTITIES
from softcal.units import unit_factor

KINDS = {".stl": "stl", ".step": "step", ".stp": "step"}
# One thread and a fixed seed: the same input gives the same mesh. Algorithm3D 1 is Delaunay.
OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Mesh.MaxNumThreads1D": 1,
    "Mesh.MaxNumThreads2D": 1,
    "Mesh.MaxNumThreads3D": 1,
    "Mesh.RandomSeed": 1,
    "Mesh.Algorithm3D": 1,
    "Mesh.Optimize": 1,
    "Mesh.OptimizeNetgen": 0,
}
# Debian packages of the system libraries that the Gmsh wheel does not include.
APT_PACKAGES = {
    "libGL": "libgl1",
    "libGLU": "libglu1-mesa",
    "libOpenGL": "libopengl0",
    "libX11": "libx11-6",
    "libXcursor": "libxcursor1",
    "libXext": "libxext6",
    "libXfixes": "libxfixes3",
    "libXft": "libxft2",
    "libXinerama": "libxinerama1",
    "libXrender": "libxrender1",
    "libfontconfig": "libfontconfig1",
    "libfreetype": "libfreetype6",
    "libgomp": "libgomp1",
}


_TOO_LONG = "Gmsh took too long and was stopped"


def mesh_file(
    path: str | Path,
    *,
    size: float | None = None,
    tets: int | None = None,
    order: Literal[1, 2] = 1,
    unit: str = "mm",
    edges_around: int | None = None,
    timeout: float = 300.0,
) -> TetMesh:
    """A mesh of the inside of a closed surface (.stl) or of the solids of a CAD model (.step, .stp); Delaunay.

    Parameters
    ----------
    path
        The file.
    size, tets
        Target edge length [m], or target number of tets, to within 5 %; one of the two.
    order
        1 for linear tets, 2 for quadratic ones, curved on curved faces.
    unit
        Unit of the lengths in an .stl file, which has none. A STEP file has its own; leave it at "mm".
    edges_around
        For a STEP file: number of edges around a bore or fillet, by smaller elements on round faces.
    timeout
        Longest time that Gmsh may take [s].

    Returns
    -------
    TetMesh
        With the boundary as node set and face set "surface".

    Raises
    ------
    MeshError
        If the file cannot be meshed, or Gmsh is not installed, fails or takes too long.
    """
    path = Path(path)
    kind = KINDS.get(path.suffix.lower())
    if kind is None:
        raise MeshError(
            Fault("the file cannot be meshed", where=str(path), got=f"'{path.suffix}'", allowed=", ".join(KINDS))
        )
    if not path.is_file():
        raise MeshError(Fault("the file does not exist", where=str(path)))
    if path.stat().st_size == 0:
        raise MeshError(Fault("the file is empty", where=str(path)))
    if kind == "step" and unit != "mm":
        raise MeshError(
            Fault("a STEP file carries its own unit", where=str(path), got=f"unit '{unit}'", allowed="no unit")
        )
    if edges_around is not None:
        LIMITS["edges around a bore"].check(edges_around, where=str(path))
        if kind != "step":
            allowed = "a STEP file, which says where it is round"
            raise MeshError(Fault("edges around a bore cannot be counted", str(path), f"'{path.suffix}'", allowed))
    factor = unit_factor(unit, "m", where=str(path))
    job = {
        "kind": kind,
        "options": {**OPTIONS, "Mesh.MeshSizeFromCurvature": edges_around or 0},
        **target_of(size, tets, factor, where=str(path)),
        "order": order,
    }
    with tempfile.TemporaryDirectory(prefix="softcal-") as folder:
        source = path.resolve()
        if kind == "stl":
            source = Path(folder) / "surface.stl"
            source.write_bytes(checked_stl(path)[1])
        arrays = run_gmsh({**job, "path": str(source)}, where=str(path), timeout=timeout)
    mesh = TetMesh(factor * arrays["points"], arrays["tets"])
    faces = boundary_faces(mesh)
    return TetMesh(mesh.points, mesh.tets, node_sets={"surface": np.unique(faces)}, face_sets={"surface": faces})


def require_target(size: float | None, tets: int | None, *, where: str = "") -> None:
    """Check that a mesh has one target: either size or tets.

    Parameters
    ----------
    size
        Target edge length [m].
    tets
        Target number of tets.
    where
        Place for error messages.

    Raises
    ------
    MeshError
        Where not exactly one of size and tets is given.
    """
    if (size is None) == (tets is None):
        got = "neither size nor tets" if size is None else "size and tets"
        allowed = "one of size, the length of an edge, and tets, their number"
        raise MeshError(Fault("the mesh needs a target", where, got, allowed))


def target_of(size: float | None, tets: int | None, factor: float, *, where: str) -> dict[str, float | int | None]:
    """The target of a job, with the size in the job's unit of `factor` metres.

    Parameters
    ----------
    size
        Target edge length [m].
    tets
        Target number of tets.
    factor
        The job's unit [m].
    where
        Place for error messages.

    Raises
    ------
    MeshError
        Where not exactly one of size and tets is given, or it is out of range.
    """
    require_target(size, tets, where=where)
    faults = [
        None if size is None else QUANTITIES["size"].fault(size, where),
        None if tets is None else LIMITS["tets"].fault(tets, where),
    ]
    if found := [fault for fault in faults if fault]:
        raise MeshError(found)
    return {"size": None if size is None else size / factor, "count": tets}


def run_gmsh(job: Mapping[str, Any], *, where: str, timeout: float) -> dict[str, np.ndarray[Any, Any]]:
    """Run a job in the worker: returns "points" and "tets", or "section" and "triangles", in the job's unit.

    Parameters
    ----------
    job
        The job, as JSON.
    where
        Place for error messages.
    timeout
        Longest time [s].

    Raises
    ------
    MeshError
        Where Gmsh is not installed, fails, crashes or takes longer than `timeout` [s].
    """
    with tempfile.TemporaryDirectory(prefix="softcal-") as folder:
        mesh, fault = Path(folder) / "mesh.npz", Path(folder) / "fault.json"
        try:
            done = run_module(
                "softcal.geometry.gmsh_worker",
                folder,
                timeout=timeout,
                told=json.dumps({"options": OPTIONS, "timeout": timeout, "most_tets": LIMITS["tets"].most, **job}),
            )
        except subprocess.TimeoutExpired as error:
            attempt = "a larger size, a smaller count, or a longer timeout"
            raise MeshError(Fault(_TOO_LONG, where, f"more than {timeout:g} s", attempt=attempt)) from error
        if fault.is_file():
            report = json.loads(fault.read_text())
            got, attempt = report["got"], report["attempt"]
            if attempt == "apt":
                library = re.search(r"(lib[\w+-]+)\.so", got)
                package = " ".join(sorted(APT_PACKAGES.values()))
                if library is not None:
                    package = APT_PACKAGES.get(library[1], f"the package that holds {library[1]}.so")
                attempt = f"apt-get install {package}"
            raise MeshError(Fault(report["fault"], where, got, report["allowed"], attempt))
        if hasattr(signal, "SIGPROF") and done.returncode == -signal.SIGPROF:  # a step's limit of time
            attempt = "a larger size, a smaller count, or repair the model"
            raise MeshError(Fault(_TOO_LONG, where, "more than a mesh of this size takes", attempt=attempt))
        if done.returncode or not mesh.is_file():
            last = (done.stderr or done.stdout).strip().splitlines()[-1:] or ["no message"]
            end = f"signal {-done.returncode}" if done.returncode < 0 else f"exit code {done.returncode}"
            attempt = "another size, order: 1, or repair the model"
            raise MeshError(Fault("Gmsh crashed", where, f"{end}: {last[0]}", attempt=attempt))
        with np.load(mesh) as arrays:
            return dict(arrays)
