"""Detection of SOFA: SOFA_ROOT, the Python of its bindings, and the plugin SoftRobots."""

from __future__ import annotations

import functools
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from softcal.errors import Fault, InputError
from softcal.plugins.sofa.scene import write_sources
from softcal.processes import run

CONDA = "conda install -c sofa-framework sofa-softrobots"
ROOT, PYTHON = "SOFA_ROOT", "SOFA_PYTHON"
PROBE_TIMEOUT = 300.0  # [s]; the first start reads every plugin from disk


@dataclass(frozen=True)
class Sofa:
    """A SOFA with SoftRobots: its folder, its Python, and the entries of that Python's path."""

    root: str
    python: str
    packages: tuple[str, ...]

    def environment(self) -> dict[str, str]:
        """The environment of its processes: one thread each, as several may run at once."""
        own = {name: value for name, value in os.environ.items() if name not in ("PYTHONHOME", "VIRTUAL_ENV")}
        path = [*self.packages, *filter(None, [own.get("PYTHONPATH", "")])]
        threads = {name: own.get(name, "1") for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
        return {**own, **threads, ROOT: self.root, "PYTHONPATH": os.pathsep.join(path)}


def find_sofa(environment: Mapping[str, str] | None = None) -> Sofa:
    """The SOFA in SOFA_ROOT; SOFA_PYTHON gives its Python if that is not found automatically.

    Raises
    ------
    InputError
        If SOFA_ROOT is not set, is no SOFA with Python bindings, or has no SoftRobots.
    """
    given = os.environ if environment is None else environment
    written = given.get(ROOT, "")
    if not written:
        raise InputError(
            Fault(
                "SOFA was not found", ROOT, "it is not set", "the folder of SOFA v23.12 or newer with SoftRobots", CONDA
            )
        )
    root = Path(written).expanduser().absolute()
    found = [
        root / "plugins" / "SofaPython3" / "lib" / "python3" / "site-packages",
        *root.glob("lib/python3*/site-packages"),
    ]
    found += sorted(root.glob("plugins/*/lib/python3/site-packages"))
    packages = [folder for folder in dict.fromkeys(found) if folder.is_dir()]
    if not any((folder / "Sofa").is_dir() for folder in packages):
        what = (
            "this folder does not exist"
            if not root.is_dir()
            else "this is not an installation of SOFA: its Python package 'Sofa' is missing"
        )
        allowed = "a folder with lib/python3*/site-packages/Sofa or plugins/SofaPython3/lib/python3/site-packages/Sofa"
        raise InputError(Fault(what, ROOT, str(root), allowed, CONDA))
    sofa = Sofa(str(root), _python(root, packages, given.get(PYTHON, "")), tuple(map(str, packages)))
    _require_cables(sofa)
    return sofa


def _python(root: Path, packages: list[Path], given: str) -> str:
    """The interpreter for the bindings: the given one, the one beside them, or one of their version."""
    if given:
        if shutil.which(given) is None:
            raise InputError(
                Fault("this Python does not exist", PYTHON, given, "the Python that SOFA's bindings are for")
            )
        return given
    beside = [root / "bin" / "python3", root / "bin" / "python", root / "python.exe", root.parent / "python.exe"]
    for python in beside:
        if python.is_file():
            return str(python)
    bindings = (path.name for folder in packages for path in (folder / "Sofa").glob("*.cpython-*"))
    versions = (match[1] for name in bindings if (match := re.search(r"\.cpython-3(\d+)", name)))
    version = next((f"3.{minor}" for minor in versions), "")
    if version in ("", f"{sys.version_info.major}.{sys.version_info.minor}"):
        return sys.executable
    found = shutil.which(f"python{version}")
    if found is None:
        raise InputError(
            Fault(
                f"SOFA's bindings are for Python {version}, which was not found",
                ROOT,
                str(root),
                f"python{version} on the PATH, or {PYTHON} with its path",
            )
        )
    return found


@functools.cache
def _require_cables(sofa: Sofa) -> None:
    """Start SOFA once and check its plugins.

    Raises
    ------
    InputError
        If it does not start, or has no cables.
    """
    with tempfile.TemporaryDirectory(prefix="softcal-sofa-") as name:
        folder = Path(name)
        write_sources(folder)
        answer = folder / "answer.json"
        try:
            done = run(
                [sofa.python, "run.py", "--probe", answer.name],
                timeout=PROBE_TIMEOUT,
                folder=folder,
                environment=sofa.environment(),
            )
            said = (done.stderr or done.stdout).strip().splitlines()[-1:]
        except (OSError, subprocess.TimeoutExpired) as error:
            said = [str(error)]
        if not answer.is_file():
            what = f"SOFA does not start with {sofa.python}"
            allowed = f"SOFA v23.12 or newer and the Python that its bindings are for ({PYTHON})"
            raise InputError(Fault(what, ROOT, f"{sofa.root}: {' '.join(said)[-300:]}", allowed))
        found = json.loads(answer.read_text(encoding="utf-8"))
    missing = [plugin for plugin in found["missing_plugins"] if plugin != "SoftRobots"]
    if not found["has_cables"]:
        raise InputError(
            Fault(
                "this SOFA has no SoftRobots, so no cables", ROOT, sofa.root, "SOFA with the plugin SoftRobots", CONDA
            )
        )
    if missing:
        raise InputError(Fault("this SOFA lacks plugins", ROOT, ", ".join(missing), "SOFA v23.12 or newer"))
