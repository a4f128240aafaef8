"""`import softcal` and `softcal --help` load nothing heavy: they must feel instant."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest
from project_case import write_project

HEAVY = (
    "cv2", "gmsh", "jinja2", "llvmlite", "matplotlib", "meshio", "numba", "optuna", "pandas", "pint", "pydantic",
    "pypardiso", "pyvista", "ruamel", "scipy", "scipy.linalg", "sqlalchemy", "sympy", "vtk", "vtkmodules",
)  # fmt: skip
LIST_HEAVY = f"import sys; sys.stdout.write('loaded: ' + ' '.join(n for n in {HEAVY!r} if n in sys.modules))"
RUN_HELP = """
import sys
sys.argv = ["softcal", "--help"]
try:
    from softcal.cli import main
    main()
except SystemExit as done:
    if done.code:
        raise
"""
# Each reads the project first: a slip in it is told before anything is imported that only meshes, data or a solve need.
MISTYPED = """
import sys
from softcal.cli import main
commands = [
    ["check"], ["calibrate"], ["validate"], ["sweep"], ["simulate", "--out", "out"], ["crosscheck"],
    ["mesh-study"],
    *(["export", kind, "--out", "out"] for kind in ("vtk", "calculix", "sofa", "reduced")),
]
for command in commands:
    try:
        main([*command, {project!r}])
    except SystemExit as done:
        assert done.code == 2, (command, done.code)
"""
READING = {"pint", "pydantic", "ruamel", "scipy"}  # Pint asks for the bare `scipy`, which loads nothing of it


def heavy_after(code: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", f"{code}\n{LIST_HEAVY}"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.rpartition("loaded: ")[2].split()


def test_import_loads_nothing_heavy():
    assert heavy_after("import softcal") == []


def test_help_loads_nothing_heavy():
    if importlib.util.find_spec("softcal.cli") is None:
        pytest.skip("there is no command line yet")
    assert heavy_after(RUN_HELP) == []


def test_a_slip_in_a_project_file_is_told_before_anything_heavy_is_loaded(tmp_path: Path):
    path = write_project(tmp_path, ("poissons_ratio: 0.42", "poissons_ratoi: 0.42"))
    with_dask = {"jinja2"} if importlib.util.find_spec("dask") else set()  # Pint loads Dask where it is, and that Jinja
    assert set(heavy_after(MISTYPED.format(project=str(path)))) == READING | with_dask


def test_the_probe_sees_what_is_loaded():
    assert heavy_after("import sympy") == ["sympy"]
