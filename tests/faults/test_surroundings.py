"""Whatever softcal is run in: variables, limits of the system, files beside the project, closed or full outputs."""

from __future__ import annotations

import ctypes
import os
import re
import resource
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from faults.case import Case, End, assert_proper, parts
from project_case import write_project

SOURCE = Path(__file__).parents[2] / "src"
OWNED = "raise SystemExit('owned')\n"


@dataclass(frozen=True)
class Around:
    """Surroundings: variables (None: not set), and what is done in the process before softcal begins."""

    variables: Mapping[str, str | None] = field(default_factory=dict)
    before: Callable[[], object] = lambda: None
    ends: Mapping[str, tuple[End, ...]] = field(default_factory=dict)  # by command, where it is not solved
    files: Mapping[str, str] = field(default_factory=dict)  # beside the project
    options: tuple[str, ...] = ()  # of Python


def begun(words: tuple[str, ...], around: Around) -> Callable[[], object]:
    """Runs softcal in a process of its own, in these surroundings."""

    def run() -> None:
        own = {name: value for name, value in os.environ.items() if "PYTEST" not in name}
        variables = {**own, "PYTHONPATH": str(SOURCE), **around.variables}
        around.before()
        os.execve(
            sys.executable,
            [sys.executable, *around.options, "-m", "softcal", *words],
            {name: value for name, value in variables.items() if value is not None},
        )

    return run


def without_rights() -> None:
    """Root may write anywhere; what it begins after this may not."""
    for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
        ctypes.CDLL(None).prctl(24, capability)  # PR_CAPBSET_DROP


def read_only() -> None:
    for path in (Path(), *Path().rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    without_rights()


def gone() -> None:
    """The present folder is one that is no longer there."""
    os.mkdir("gone")
    os.chdir("gone")
    os.rmdir("../gone")


def limited(what: int, most: int) -> Callable[[], object]:
    return lambda: resource.setrlimit(what, (most, most))


def into(target: str, *outputs: int) -> Callable[[], object]:
    def before() -> None:
        number = os.open(target, os.O_WRONLY)
        for output in outputs:
            os.dup2(number, output)

    return before


def unread(*outputs: int) -> Callable[[], object]:
    """Outputs into a pipe that nobody reads."""

    def before() -> None:
        reading, writing = os.pipe()
        for output in outputs:
            os.dup2(writing, output)
        os.close(reading)

    return before


def closed(*numbers: int) -> Callable[[], object]:
    return lambda: [os.close(number) for number in numbers]


def masked() -> None:
    os.umask(0o777)
    without_rights()


def variables(**values: tuple[str | None, ...]) -> dict[str, Around]:
    """Surroundings with the first value of each variable, with the second, and so on, while there is one.

    Those of one call act on different things, so that none hides another.
    """
    rows = ({n: own[k] for n, own in values.items() if k < len(own)} for k in range(max(map(len, values.values()))))
    return {", ".join(map(_shown, row, row.values())): Around(row) for row in rows}


def _shown(name: str, value: str | None) -> str:
    return f"{name} {'not set' if value is None else repr(value[:30])}"


CHECK = ("check", "project.yaml", "--no-solve", "--no-pictures")
CALIBRATE = ("calibrate", "project.yaml", "--out", "run", "--trials", "2", "--no-mesh-error")
NOT_KEPT: Mapping[str, tuple[End, ...]] = {"calibrate": ("refused", "failed")}
UNSAID: Mapping[str, tuple[End, ...]] = {"check": ("failed",), "calibrate": ("failed",)}
ANY: Mapping[str, tuple[End, ...]] = dict.fromkeys(("check", "calibrate"), ("solved", "refused", "failed"))
REFUSED: Mapping[str, tuple[End, ...]] = {"check": ("refused",), "calibrate": ("refused",)}
SURROUNDINGS: Mapping[str, Around] = {
    **variables(
        HOME=(None, "", "/etc/passwd", "/proc/nobody", "relative", "/dev/null/x", "\udcff"),
        OMP_NUM_THREADS=("x", "0", "-1", "99999"),
    ),
    **variables(MPLCONFIGDIR=("/etc/passwd", "/dev/null/x", "", "/proc"), MKL_NUM_THREADS=("x", "0")),
    **variables(MATPLOTLIBRC=("/dev/null", "/nowhere", "nobody"), NUMBA_CACHE_DIR=("/etc/passwd", "/dev/null/x")),
    **variables(MPLBACKEND=("nobody", "TkAgg", ""), NUMBA_NUM_THREADS=("99999",)),
    **variables(
        TMPDIR=("/nowhere", "", "/etc/passwd", "relative"),
        COLUMNS=("0", "-1", "1", "x", "9" * 30),
        SOFA_ROOT=("/dev/zero", "nobody", ""),
        PYTHONWARNINGS=("error", "nobody"),
        TZ=("Nobody/Nowhere",),
    ),
    **variables(
        PATH=(None, "", "/etc/passwd", "."),
        LC_ALL=("C", "POSIX", "nobody.nothing", "tr_TR.UTF-8"),
        LINES=("0", "x"),
        SOFTCAL=("/dev/zero", "nobody"),
        DISPLAY=("nobody:99",),
    ),
    **variables(
        TERM=(None, "", "nobody", "dumb"),
        PYTHONIOENCODING=("ascii", "latin-1", "utf-16"),
        PYTHONSAFEPATH=("1",),
        XDG_CACHE_HOME=("/etc/passwd",),
    ),
    **variables(FORCE_COLOR=("1",), PYTHONDONTWRITEBYTECODE=("1",)),
    **variables(TTY_COMPATIBLE=("1",), PYTHONUTF8=("0",)),
    **variables(COLORTERM=("nobody",), PYTHONDEVMODE=("1",)),
    **variables(PYTHONOPTIMIZE=("2",)),
    **{f"{n!r} threads of Numba": Around({"NUMBA_NUM_THREADS": n}, ends=REFUSED) for n in ("0", "-3", "x", "")},
    "ASCII without UTF-8": Around({"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}),
    "modules beside the project": Around(
        files=dict.fromkeys(
            (
                "numpy.py", "yaml.py", "sitecustomize.py", "usercustomize.py", "matplotlib.py", "json.py",
                "ruamel.py", "pint.py", "numba/__init__.py", "softcal/cli.py", "typer.py",
                "pyvista.py",
                "vtkmodules/__init__.py", "optuna/__init__.py", "scipy/__init__.py", "encodings/__init__.py", "site.py",
            ),
            OWNED,
        )
    ),
    # `python -m softcal` runs these before any line of softcal; the command `softcal` does not (docs/security.md).
    **{
        f"{name} beside the project": Around(files={name: OWNED}, options=("-P",))
        for name in ("softcal.py", "softcal/__init__.py")
    },
    "settings of pytest, Dask and Python beside": Around(
        files={
            "conftest.py": OWNED,
            "pyproject.toml": "[[[",
            "dask.yaml": "[[[",
            "pyvenv.cfg": "home = /nowhere\n",
            "python._pth": "x\n",
        }
    ),
    "settings of Matplotlib beside": Around(files={"matplotlibrc": "backend: nobody\ntext.usetex: True\n"}),
    "settings of Matplotlib of noise": Around(files={"matplotlibrc": "\x00\x01: \x02\n" * 50}),
    **{
        f"settings of Numba beside, {text[:20]!r}": Around(files={".numba_config.yaml": text}, ends=REFUSED)
        for text in ("disable_jit: [1\nnum_threads: x\n", "cache_dir: ./kernels\n")  # which are pickles
    },
    "a folder that is read only": Around(before=read_only, ends=NOT_KEPT),
    "a mask of all rights": Around(before=masked, ends={"calibrate": ("solved", "refused", "failed")}),
    "a folder that is gone": Around(before=gone, ends=REFUSED),
    **{
        f"{count} open files": Around(before=limited(resource.RLIMIT_NOFILE, count), ends=ANY)
        for count in (8, 12, 16, 24, 40)
    },
    **{
        f"files of {size} bytes": Around(before=limited(resource.RLIMIT_FSIZE, size), ends=ANY)  # the output is one
        for size in (0, 100, 5000)
    },
    "no core and no stack": Around(before=limited(resource.RLIMIT_STACK, 1 << 20)),
    "no input": Around(before=closed(0)),
    "no output": Around(before=closed(1)),
    "no errors": Around(before=closed(2)),
    "no input, output and errors": Around(before=closed(0, 1, 2)),
    "a full output": Around(before=into("/dev/full", 1), ends=UNSAID),
    "full errors": Around(before=into("/dev/full", 2), ends=ANY),
    "a full output and full errors": Around(before=into("/dev/full", 1, 2), ends=UNSAID),
    "an output that nobody reads": Around(before=unread(1), ends=ANY),
    "errors that nobody reads": Around(before=unread(2), ends=ANY),
    "an output and errors that nobody reads": Around(before=unread(1, 2), ends=ANY),
}  # fmt: skip


# Surroundings that what is simulated, drawn and written might notice, and not only what is read.
MATTERS = re.compile(
    "HOME|TMPDIR '/etc|MPL|MATPLOTLIB|OMP|NUMBA|OPTIMIZE|Matplotlib|vtk"
    "|read only|mask|gone|bytes|output|errors|[14][60] open"
)


def beside(files: Mapping[str, str]) -> Callable[[Path], object]:
    """Writes the small project, and files beside it."""

    def write(folder: Path) -> None:
        write_project(folder)
        for name, text in files.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text)

    return write


def commands(what: str, around: Around) -> tuple[tuple[str, ...], ...]:
    """Both where they may end differently: else a calibration does all that a check without solving does."""
    if not MATTERS.search(what):
        return (CHECK,)
    return (CHECK, CALIBRATE) if around.ends else (CALIBRATE,)


CASES = [
    Case(
        "environment",
        f"{what}, {words[0]}",
        begun(words, around),
        around.ends.get(words[0], ("solved",)),
        beside(around.files),
        keeps="run",
    )
    for what, around in SURROUNDINGS.items()
    for words in commands(what, around)
]  # fmt: skip


@pytest.fixture(autouse=True)
def can_be_removed(tmp_path: Path):
    """Files without rights are removed by those who may not write them, too."""
    yield
    for path in [tmp_path, *tmp_path.rglob("*")]:
        if not path.is_symlink():
            path.chmod(0o755)


@pytest.mark.slow
@pytest.mark.parametrize("case", parts(CASES, every=20, slow=6))
def test_hostile_surroundings(case: Case, tmp_path: Path) -> None:
    assert_proper(case, tmp_path)
