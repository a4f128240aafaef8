"""Whatever stands in the place of a file that softcal reads: a table, a mesh, a law, a prediction, a file of a run."""

from __future__ import annotations

import importlib
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from coupon_case import mooney_coupon, write_coupon
from faults.case import Case, End, assert_proper, parts
from faults.hostile import HOSTILE, attacked
from fleet_case import FILE, write_fleet
from project_case import write_project


def project(*changes: tuple[str, str]) -> Callable[[Path], object]:
    """Writes the small project with some text replaced."""
    return lambda folder: write_project(folder, *changes)


def with_mesh(suffix: str) -> Callable[[Path], object]:
    """Writes the small project with the name of a mesh of another kind."""

    def files(folder: Path) -> None:
        is_surface = suffix in (".stl", ".step")
        size = ", size: 8 mm" if is_surface else ""
        write_project(folder, ("{file: bar.msh, unit: mm}", f"{{file: bar{suffix}, unit: mm{size}}}"))
        (folder / "bar.msh").rename(folder / f"bar{suffix}") if suffix != ".msh" else None

    return files


def coupon(folder: Path) -> None:
    test = mooney_coupon("a", "uniaxial", (2e5, 5e4))
    write_coupon(folder / "coupon.csv", {"stretch [1]": test.strain[:, 0], "stress [Pa]": test.stress[:, 0]})


def laws(folder: Path) -> None:
    coupon(folder)
    (folder / "laws.yaml").write_text("laws: {}\n")


def fleet(folder: Path) -> None:
    write_fleet(folder, (1.0, 1.1), f"specimen,{FILE}\np1,p1.csv\np2,p2.csv\n")


def predictions(folder: Path) -> None:
    (folder / "own.csv").write_text("sample,channel,value\n")


def scores(folder: Path) -> None:
    (folder / "a").mkdir()
    (folder / "a" / "score.json").write_text("{}")


CHECK = ("check", "project.yaml", "--no-solve", "--no-pictures")
# Door -> what writes the folder, the file that is attacked, and the command that reads it.
DOORS: Mapping[str, tuple[Callable[[Path], object], str, tuple[str, ...]]] = {
    "project file": (project(), "project.yaml", CHECK),
    "bench table": (project(), "data/pull.csv", CHECK),
    **{
        f"mesh {suffix}": (with_mesh(suffix), f"bar{suffix}", CHECK)
        for suffix in (".msh", ".vtk", ".vtu", ".inp", ".stl", ".step")
    },
    "coupon": (coupon, "coupon.csv", ("coupon", "coupon.csv", "--test", "uniaxial", "--law", "neo-hooke")),
    "laws of a coupon": (laws, "laws.yaml", ("coupon", "coupon.csv", "--test", "uniaxial", "--laws", "laws.yaml")),
    "fleet": (fleet, "fleet.csv", ("fleet", "fleet.csv", "--template", "project.yaml", "--out", "out")),
    "specimen of a fleet": (fleet, "p2.csv", ("fleet", "fleet.csv", "--template", "project.yaml", "--out", "out")),
    "predictions": (predictions, "own.csv", ("bench", "score", "neck", "own.csv")),
    "score": (scores, "a/score.json", ("bench", "page", ".", "--out", "page.md")),
    **{
        f"samples for {case}": (predictions, "own.csv", ("bench", "score", case, "own.csv", "--data", "own.csv"))
        for case in ("tentacle", "sorosim-tpu")
    },
}  # fmt: skip


CASES = [
    Case(door, what, command, ("refused",), attacked(files, name, place), name.rpartition("/")[2].partition(".")[0])
    for door, (files, name, command) in DOORS.items()
    for what, place in HOSTILE.items()
]


@pytest.mark.parametrize("case", parts(CASES))
def test_what_is_no_such_file_is_refused(case: Case, tmp_path: Path) -> None:
    assert_proper(case, tmp_path)


def wide(folder: Path) -> None:
    columns = "".join(f",c{k}" for k in range(50_000))
    write_fleet(folder, (1.0,), f"specimen,{FILE}{columns}\np1,p1.csv{',1' * 50_000}\n")


def test_a_fleet_of_many_columns_is_refused(tmp_path: Path) -> None:
    assert_proper(Case("fleet", "many columns", DOORS["fleet"][2], files=wide, says="too many columns"), tmp_path)


# Small meshes that say that they are large, or that take long to read.
VTK = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET "
VTK_POINT = VTK + "UNSTRUCTURED_GRID\nPOINTS 1 double\n0 0 0\nCELLS 1 5\n4 0 0 0 0\nCELL_TYPES 1\n10\n"
INP = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n*ELEMENT, TYPE=C3D4, ELSET=solid\n1, 1, 2, 3, 4\n"
MSH, MANY = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", 2_000_000_000
MSH_TET = (
    MSH + "$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n{0} 0 0 1\n$EndNodes\n"
    "$Elements\n1\n1 4 2 1 1 1 2 3 {0}\n$EndElements\n"
)
MESH_BOMBS = {
    "points of a grid.vtk": VTK + "STRUCTURED_POINTS\nDIMENSIONS 2000 2000 2000\nORIGIN 0 0 0\nSPACING 1 1 1\n",
    "cells of a grid.vtk": VTK + "STRUCTURED_GRID\nDIMENSIONS 2000 2000 200\nPOINTS 1 float\n0 0 0\n",
    "many points.vtk": VTK + f"UNSTRUCTURED_GRID\nPOINTS {MANY} double\n0 0 0\n",
    "many colours.vtk": VTK_POINT + f"POINT_DATA 1\nLOOKUP_TABLE a {MANY}\n",
    "a node set.inp": INP + f"*NSET, NSET=a, GENERATE\n1, {MANY}, 1\n",
    "an element set.inp": INP + f"*ELSET, ELSET=a, GENERATE\n1, {MANY}, 1\n",
    "an endless device.inp": INP + "*INCLUDE, INPUT=/dev/zero\n",
    "itself.inp": INP + "*INCLUDE, INPUT=itself.inp\n",
    "blocks that go back.msh": MSH.replace("2.2", "4.1")
    + "$Nodes\n1 1 1 1\n0 1 0 -1\n$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n",
    "many names of data.msh": MSH_TET.format(4) + f"$NodeData\n{MANY}\n",
    "many times of data.msh": MSH_TET.format(4) + f'$NodeData\n1\n"a"\n{MANY}\n',
    "many nodes.msh": MSH + f"$Nodes\n{MANY}\n1 0 0 0\n",
    "blocks of elements.msh": MSH.replace("2.2", "4.1")
    + '$PhysicalNames\n1\n3 1 "a"\n$EndPhysicalNames\n$Nodes\n1 1 1 1\n0 1 0 1\n1\n0 0 0\n$EndNodes\n'
    + f"$Elements\n{MANY} 1 1 1\n",
    "nodes of Ansys.msh": "(2 3)\n(10 (0 1 5f5e1000 0))\n(10 (1 1 5f5e1000 1 3)(\n0 0 0\n))\n",
}


def bomb(name: str, text: str) -> Case:
    def run() -> object:
        import softcal

        return softcal.read_mesh(name)

    return Case("a large mesh", name, run, files=lambda folder: (folder / name).write_text(text), says=re.escape(name))


@pytest.mark.parametrize("case", parts([bomb(*one) for one in MESH_BOMBS.items()], every=4))
def test_a_small_mesh_that_takes_much_is_refused(case: Case, tmp_path: Path) -> None:
    importlib.import_module("meshio")
    assert_proper(case, tmp_path)


def solid(*tets: np.ndarray) -> str:
    """Tetrahedra by their corners (4, 3) as surfaces of triangles in one .stl file."""
    return surface([tet[list(face)] for tet in tets for face in ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))])


def surface(faces: Sequence[np.ndarray]) -> str:
    """Triangles by their corners (3, 3) as an .stl file."""
    facets = ("".join(f"vertex {x:g} {y:g} {z:g}\n" for x, y, z in face) for face in faces)
    return "solid a\n" + "".join(f"facet normal 0 0 0\nouter loop\n{one}endloop\nendfacet\n" for one in facets)


FLAKE = np.array([[0, 0, 0], [1e4, 0, 0], [0, 1e4, 0], [3e3, 3e3, 1e-3]])
# The corners of a foil, 100 mm square and 0.02 mm thick, and of its triangles.
CORNERS = np.array([[100 * x, 100 * y, 0.02 * z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
FOIL = [CORNERS[[int(i) for i in face]] for face in "013 032 467 475 045 051 276 237 064 026 157 173".split()]
CLOUD = 100 * np.random.default_rng(0).random((300, 4, 3))
# Surfaces of triangles, and the sizes [m] or counts that are asked of them.
SURFACES: Mapping[str, tuple[str, dict[str, Any]]] = {
    "a flake by size": (solid(FLAKE), {"size": 0.002}),
    "a foil by count": (surface(FOIL), {"tets": 500}),
    "a cloud of tetrahedra by size": (solid(*CLOUD), {"size": 0.005}),
    "a cloud of tetrahedra by count": (solid(*CLOUD), {"tets": 5000}),
    "corners beyond all": (solid(1e103 * np.eye(4, 3)), {"tets": 500}),
    "a size of an atom": (solid(100 * np.eye(4, 3)), {"size": 1e-9}),
    "a surface twice": (solid(*[100 * np.eye(4, 3)] * 2), {"size": 0.02}),
    "a needle by count": (solid(np.array([1e-4, 1e-4, 1e4]) * np.eye(4, 3)), {"tets": 5000}),
}


def meshed(what: str) -> Case:
    text, target = SURFACES[what]

    def run() -> object:
        from softcal.geometry.generate import mesh_file

        return mesh_file("a.stl", **target)

    ends: tuple[End, ...] = ("refused", "failed")
    return Case("a surface to be meshed", what, run, ends, lambda f: (f / "a.stl").write_text(text), says="stl")


@pytest.mark.parametrize("case", parts([meshed(what) for what in SURFACES], every=5))
def test_a_surface_that_takes_much_to_mesh_is_refused(case: Case, tmp_path: Path) -> None:
    pytest.importorskip("gmsh", reason="Gmsh is not installed")
    assert_proper(case, tmp_path)


# Files of a run, of which a stranger may send the folder.
RUN = tuple(f"calibrations/pull/{name}" for name in ("result.json", "trials.csv", "optuna.journal")) + ("run.json",)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of a run."""
    import softcal

    folder = tmp_path_factory.mktemp("run")
    softcal.calibrate(write_project(folder), out=folder / "run", fit="each")
    return folder


def command(name: str) -> tuple[str, ...]:
    """What reads a file of a run: its report, or a search that goes on from its journal."""
    if name.endswith("journal"):
        return "calibrate", "project.yaml", "--out", "run", "--fit", "each", "--resume", "--no-report"
    return "report", "run", "--out", "report", "--figures", "overview"


def ends_of(what: str, name: str) -> tuple[End, ...]:
    """A journal of nothing, or of blocks that were never written, is of a search that was stopped at once."""
    may_begin_anew = name.endswith("journal") and what in ("nothing", "NUL")
    return ("refused", "failed", "solved") if may_begin_anew else ("refused", "failed")


RUN_CASES = [
    Case("run folder", f"{what} as {name}", command(name), ends_of(what, name), says=r"run")
    for name in RUN
    for what in HOSTILE
]


@pytest.mark.parametrize("case", parts(RUN_CASES))
def test_what_is_no_file_of_a_run_is_refused(case: Case, run: Path, tmp_path: Path) -> None:
    what, _, name = case.name.partition(" as ")

    def files(folder: Path) -> None:
        shutil.copytree(run, folder, dirs_exist_ok=True)
        HOSTILE[what](folder / "run" / name)

    assert_proper(Case(case.door, case.name, case.run, case.ends, files, case.says), tmp_path)
