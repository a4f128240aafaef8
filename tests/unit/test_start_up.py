"""`import softcal` and `softcal --help` load nothing heavy: they must feel instant."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import pytest

HEAVY = (
    "cv2", "gmsh", "jinja2", "llvmlite", "matplotlib", "meshio", "numba", "optuna", "pandas", "pint", "pydantic",
    "pypardiso", "pyvista", "ruamel", "scipy", "sqlalchemy", "sympy", "vtk", "vtkmodules",
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


def test_the_probe_sees_what_is_loaded():
    assert heavy_after("import sympy") == ["sympy"]
