"""`import softcal` and `softcal --help` load nothing heavy: they must feel instant."""

from __future__ import annotations

import importlib.util
import os
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
    ["mesh-study"], ["importance"],
    *(["export", kind, "--out", "out"] for kind in ("vtk", "calculix", "sofa", "reduced")),
]
for command in commands:
    try:
        main([*command, {project!r}])
    except SystemExit as done:
        assert done.code == 2, (command, done.code)
"""
READING = {"pydantic", "ruamel"}


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


@pytest.mark.slow
def test_a_slip_in_a_project_file_is_told_before_anything_heavy_is_loaded(tmp_path: Path):
    path = write_project(tmp_path, ("poissons_ratio: 0.42", "poissons_ratoi: 0.42"))
    assert set(heavy_after(MISTYPED.format(project=str(path)))) == READING


def test_the_probe_sees_what_is_loaded():
    assert heavy_after("import sympy") == ["sympy"]


TOLD = '''
import rich.console, typer
from softcal import register_command
from softcal.cli import main
@register_command("data")
def told() -> None:
    """Text that not every terminal can write."""
    typer.echo("\\u03bd 0.4 \\u00b1 1 \\u00b0, 3 cm\\u00b3, \\u03bb\\u2081 \\u2026 \\u2013 \\u4e2d")
    rich.console.Console().print("\\u03a8 \\u00e4 \\u2265 \\udcff")
    typer.echo("\\u03bd", err=True)
main(["told"])
'''


@pytest.mark.parametrize(
    ("encoding", "echoed", "printed"),
    [
        ("ascii", "nu 0.4 +/- 1 deg, 3 cm3, lambda1 ... - ?", "Psi a >= ?"),
        ("latin-1", "nu 0.4 ± 1 °, 3 cm³, lambda1 ... - ?", "Psi ä >= ?"),
        ("cp1252", "nu 0.4 ± 1 °, 3 cm³, lambda1 … – ?", "Psi ä >= ?"),
        ("utf-8", "ν 0.4 ± 1 °, 3 cm³, λ₁ … – 中", "Ψ ä ≥ ?"),
    ],
)
def test_what_a_terminal_cannot_write_is_written_in_other_characters(encoding: str, echoed: str, printed: str):
    done = subprocess.run(
        [sys.executable, "-c", TOLD], capture_output=True, check=False, env={**os.environ, "PYTHONIOENCODING": encoding}
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.decode(encoding).splitlines() == [echoed, printed]


@pytest.mark.parametrize("words", [["calibrate", "--help"], ["nö"], ["check", "--nö"], ["check", "nö.yaml"]])
def test_help_and_errors_of_usage_are_in_ascii_where_the_terminal_is(words: list[str]):
    done = subprocess.run(
        [sys.executable, "-m", "softcal", *words],
        capture_output=True, check=False, env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    text = (done.stdout + done.stderr).decode("ascii")
    assert ("mysql://..." if "--help" in words else words[-1].replace("ö", "o")) in text


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="writes to /dev/full")
@pytest.mark.parametrize("words", [["--help"], ["bench", "list"]])
def test_output_that_finds_no_room_ends_in_a_sentence(words: list[str]):
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "softcal", *words]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "Error: the output cannot be written: No space left on device.\n")


def test_an_unknown_backend_of_matplotlib_does_not_matter():
    told = "from softcal.cli import main\ntry: main(['--version'])\nexcept SystemExit: import matplotlib.pyplot"
    env = {**os.environ, "MPLBACKEND": "nonsense"}
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 0, done.stderr


def test_numpy_has_one_thread_beside_the_solvers_unless_the_user_sets_more():
    code = "from softcal.cli import main\ntry: main(['--version'])\nexcept SystemExit: pass\nimport os, numpy\n"
    code += "print(os.environ['OPENBLAS_NUM_THREADS'])"
    without = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    for env, n_threads in ((without, "1"), ({**without, "OPENBLAS_NUM_THREADS": "2"}, "2")):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=env)
        assert done.stdout.split()[-1] == n_threads, done.stderr


@pytest.mark.slow
def test_members_are_registered_where_python_drops_docstrings():
    told = """
from softcal.experiments.step import STEPS
from softcal.report.figure import FIGURES
from softcal.workflows.export import EXPORTS
print(STEPS["set_noise"].summary, len(FIGURES), len(EXPORTS))
"""
    done = subprocess.run([sys.executable, "-OO", "-c", told], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("set noise ")


@pytest.mark.slow
def test_a_simulation_with_a_law_of_softcals_own_needs_neither_sympy_nor_pint(tmp_path: Path):
    project = write_project(tmp_path / "p")
    code = f"from softcal import load, simulate\nassert simulate(load({str(project)!r})).succeeded"
    assert not {"sympy", "pint"} & set(heavy_after(code))
