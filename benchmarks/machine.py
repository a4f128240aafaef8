"""What the benchmarks ran on."""

from __future__ import annotations

import ctypes
import os
import platform
import re
import subprocess
from importlib import metadata
from pathlib import Path

HERE = Path(__file__).parent
PACKAGES = ("numpy", "scipy", "numba", "pypardiso", "optuna")


def machine() -> list[list[str]]:
    """Rows of (what, value)."""
    rows = [
        ["processor", _cpu()],
        ["cores", f"{os.cpu_count()} (usable: {len(os.sched_getaffinity(0))})"],
        ["memory", _memory()],
        ["system", f"{platform.system()} {platform.machine()}"],
        ["Python", platform.python_version()],
        *([name, _version(name)] for name in PACKAGES),
        ["MKL", _mkl()],
        ["threads", ", ".join(f"{key}={os.environ[key]}" for key in sorted(os.environ) if key.endswith("_NUM_THREADS"))
                    or "as the libraries choose"],
        ["softcal", f"{_version('softcal')}, commit {_commit()}"],
    ]  # fmt: skip
    return rows


def load() -> str:
    """Mean number of processes that wanted a core over the last minute."""
    return f"{os.getloadavg()[0]:.1f}"


def _cpu() -> str:
    path = Path("/proc/cpuinfo")
    found = re.search(r"^model name\s*:\s*(.*)$", path.read_text(), re.MULTILINE) if path.exists() else None
    return found[1] if found else platform.processor() or "unknown"


def _memory() -> str:
    path = Path("/proc/meminfo")
    found = re.search(r"^MemTotal:\s*(\d+) kB$", path.read_text(), re.MULTILINE) if path.exists() else None
    return f"{int(found[1]) / 2**20:.0f} GiB" if found else "unknown"


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _mkl() -> str:
    try:
        from pypardiso import PyPardisoSolver
    except ImportError:
        return "not installed"
    text = ctypes.create_string_buffer(200)
    library = PyPardisoSolver().libmkl
    library.MKL_Get_Version_String(text, 199)
    return f"{_version('mkl')} ({text.value.decode().strip()}), {library.mkl_get_max_threads()} threads by default"


def _commit() -> str:
    done = subprocess.run(
        ["git", "describe", "--always", "--dirty"],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parent,
    )
    return done.stdout.strip() or "unknown"
