"""Print what softcal and each of its extras bring into an environment: packages, and megabytes on disk.

python -m scripts.sizes [--clean [--python NAME ...] [--only EXTRA ...]]

The files of an extra's packages that softcal alone does not need; `all` has some of them once. With `--clean`, an
sdist is built and a wheel of it, which is installed alone and with each extra into environments of their own, for each
version of Python that is found. In each a mesh file is checked, calibrated and reported, and what an extra brings
works, or a sentence names it. `--only ""` is softcal alone. An environment takes some minutes, and the registry.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, distribution, distributions
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from scripts.check_licences import needed_by

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS: tuple[str, ...] = tuple(PROJECT["optional-dependencies"])
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
MKL = ("pypardiso", "mkl")  # what brings it, and itself
# What works without an extra, in a folder with the examples of a mesh file and of a surface.
CORE = (
    ("--help",),
    ("init", "neck", "neck"),
    ("check", "beam/project.yaml", "--out", "check"),
    ("calibrate", "beam/project.yaml", "--fit", "joint", "--no-mesh-error", "--no-report", "--out", "run"),
    ("report", "run"),
)
# A command that needs an extra: without it a sentence names it. Some then end for another reason, which is soon.
NEEDS = {
    "mesh": ("check", "finger/project.yaml", "--out", "finger-check"),
    "pictures": ("export", "vtk", "beam/project.yaml", "--out", "shapes"),
    "markers": ("board", "--out", "board.svg"),
    "importance": ("importance", "beam/project.yaml", "--simulations", "1", "--out", "importance"),
    "cluster": ("calibrate", "beam/project.yaml", "--on", "dask:nowhere", "--out", "cluster"),
    "watch": ("watch", "nowhere"),
}


def megabytes(package: Distribution) -> float:
    """Of the files that a package installs."""
    paths = [Path(str(file.locate())) for file in package.files or ()]
    return sum(path.lstat().st_size for path in paths if path.is_file() and not path.is_symlink()) / 1e6


def installed() -> None:
    """Print what this environment has."""
    alone = needed_by("softcal")
    sys.stdout.write(f"{'(none)':<12}{len(alone) - 1:>4} packages {sum(map(megabytes, alone.values())):>7.0f} MB\n")
    for extra in distribution("softcal").metadata.get_all("Provides-Extra") or ():
        more = [package for name, package in needed_by(f"softcal[{extra}]").items() if name not in alone]
        sys.stdout.write(f"{extra:<12}{len(more):>4} packages {sum(map(megabytes, more)):>7.0f} MB\n")


class Environment:
    """A new environment for one Python, with pip alone."""

    def __init__(self, python: str, folder: Path) -> None:
        subprocess.run([python, "-m", "venv", str(folder)], check=True)
        self._folder = folder
        self._bin = folder / ("Scripts" if os.name == "nt" else "bin")
        # Neither the source tree nor the packages of this environment.
        self._variables = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
        self._given = set(self.packages)

    @property
    def packages(self) -> dict[str, Distribution]:
        """By canonical name, without what the environment began with."""
        sites = [str(path) for path in self._folder.glob("[Ll]ib*/**/site-packages")]
        found = {canonicalize_name(package.name): package for package in distributions(path=sites)}
        return {name: package for name, package in found.items() if name not in getattr(self, "_given", ())}

    def pip(self, *arguments: str) -> None:
        subprocess.run(
            [str(self._bin / "python"), "-m", "pip", "-q", "--disable-pip-version-check", *arguments],
            check=True, env=self._variables, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def softcal(self, arguments: Iterable[str], folder: Path) -> tuple[int, str]:
        """Exit code and all that a command prints, on one line."""
        done = subprocess.run(
            [str(self._bin / "softcal"), *arguments],
            check=False, capture_output=True, text=True, cwd=folder, env=self._variables, timeout=1200,
        )  # fmt: skip
        return done.returncode, " ".join((done.stdout + done.stderr).split())


def tried(environment: Environment, folder: Path) -> list[str]:
    """The commands that do not do what they should, each with the end of what it said; none is best."""
    wrong: list[str] = []
    for example in ("beam", "finger"):
        shutil.copytree(ROOT / "examples" / example, folder / example, ignore=shutil.ignore_patterns("run*"))

    def run(arguments: Iterable[str], right: Callable[[int, str], bool]) -> None:
        code, said = environment.softcal(arguments, folder)
        if not right(code, said):
            wrong.append(f"softcal {' '.join(arguments)}: exit code {code}: …{said[-300:]}")

    for arguments in CORE:
        run(arguments, lambda code, _: code == 0)
    present = set(environment.packages)
    for extra, arguments in NEEDS.items():
        brought = {canonicalize_name(name) for name in direct(extra)} <= present
        run(arguments, lambda code, said, extra=extra, brought=brought: ok(code, said, extra, brought))
    return wrong


def ok(code: int, said: str, extra: str, brought: bool) -> bool:
    """Whether a command that needs an extra does what it should: names the extra where that is missing."""
    named = f"softcal[{extra}]" in said
    return "Traceback" not in said and named is not brought and (brought or code == 2)


def direct(extra: str) -> Iterator[str]:
    """Names of the packages that an extra asks for."""
    for line in PROJECT["optional-dependencies"][extra]:
        yield line.partition(">")[0].partition("[")[0]


def pythons(named: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Version and command of each Python that is here; one that is not here is said."""
    for version in named:
        candidates = (f"python{version}", *([sys.executable] if sys.version.startswith(f"{version}.") else []))
        for command in filter(None, map(shutil.which, candidates)):
            if subprocess.run([command, "-c", "import venv, ensurepip"], check=False, capture_output=True).returncode:
                continue
            yield version, command
            break
        else:
            sys.stdout.write(f"Python {version} is not here, or without venv: not tried.\n")


def without_mkl(packages: dict[str, Distribution]) -> tuple[list[str], list[str]]:
    """The names of the packages that are MKL and what it needs, and of all others."""
    mkl: set[str] = set()
    waiting = list(MKL)
    while waiting:
        if (name := waiting.pop()) in packages and name not in mkl:
            mkl.add(name)
            needed = map(Requirement, (packages[name].requires or ()) if name != MKL[0] else ())
            waiting += [canonicalize_name(one.name) for one in needed if "extra" not in str(one.marker)]
    return sorted(mkl), sorted(set(packages) - mkl)


@dataclass(frozen=True)
class Attempt:
    """What one environment has, and what in it does not work."""

    what: str
    packages: dict[str, Distribution]
    wrong: list[str]
    start: float  # [s]


def row(python: str, one: Attempt) -> bool:
    """Print it; whether all works."""
    sizes = [sum(megabytes(one.packages[name]) for name in names) for names in without_mkl(one.packages)]
    sizes = [f"{size:,.0f} MB" for size in (sum(sizes), *sizes)]
    works = "FAILS" if one.wrong else "works"
    cells = (python, one.what, str(len(one.packages)), *sizes, works, f"{time.monotonic() - one.start:.0f}")
    sys.stdout.write("\n".join([f"| {' | '.join(cells)} |", *one.wrong, ""]))
    sys.stdout.flush()
    return not one.wrong


def built(folder: Path) -> Path:
    """The wheel that is made of the sdist that is made here."""
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(folder)], cwd=ROOT, check=True)
    (sdist,) = folder.glob("*.tar.gz")
    subprocess.run([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder), str(sdist)], check=True)
    (wheel,) = folder.glob("*.whl")
    for path in (sdist, wheel):
        sys.stdout.write(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB\n")
    return wheel


def clean(named: Iterable[str], only: Iterable[str]) -> bool:
    """Build, install and try; whether all is right."""
    right = True
    with tempfile.TemporaryDirectory(prefix="softcal-") as made:
        wheel = built(Path(made))
        head = ("Python", "softcal with", "packages", "size", "of it MKL", "without MKL", "", "seconds")
        sys.stdout.write(f"| {' | '.join(head)} |\n|{'---|' * len(head)}\n")
        for version, command in pythons(named):
            for extra in only:
                with tempfile.TemporaryDirectory(prefix="softcal-") as place:
                    right &= all([row(version, one) for one in attempts(command, wheel, extra, Path(place))])
    return right


def attempts(command: str, wheel: Path, extra: str, folder: Path) -> Iterator[Attempt]:
    """One environment, installed and tried; softcal alone once more after MKL has been removed."""
    start = time.monotonic()
    environment = Environment(command, folder / "environment")
    environment.pip("install", f"{wheel}[{extra}]" if extra else str(wheel))
    what = f"`{extra}`" if extra else "no extra"
    yield Attempt(what, environment.packages, tried(environment, folder / "work"), start)
    mkl, _ = without_mkl(environment.packages)
    if mkl and not extra:
        start = time.monotonic()
        environment.pip("uninstall", "-y", *mkl)
        yield Attempt("no extra, no MKL", environment.packages, tried(environment, folder / "again"), start)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--clean", action="store_true")
    parser.add_argument("--python", nargs="+", default=PYTHONS, help="versions, such as 3.12")
    parser.add_argument("--only", nargs="+", default=("", *EXTRAS), help='names of extras; "" is softcal alone')
    given = parser.parse_args()
    if not given.clean:
        installed()
        return 0
    return int(not clean(given.python, given.only))


if __name__ == "__main__":
    sys.exit(main())
