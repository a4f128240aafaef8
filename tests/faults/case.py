"""One attack on a door of softcal: the files that it brings, what is run beside them, and the end that is proper.

Each case runs in a fork of its own: its time, its memory and what it does to its folder are its own. The fork is of a
process that has imported what softcal imports, and run none of it: a case takes a tenth of a second in place of one.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import os
import pkgutil
import re
import resource
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import pytest

if TYPE_CHECKING:
    from _pytest.mark import ParameterSet

SECONDS, BYTES = 20.0, 700_000_000  # what a refusal takes at most; softcal itself takes 300 MB
_PATIENCE = 4  # times SECONDS after which a case is stopped, on a machine that is shared
_HASHED = 64_000_000  # bytes of a file up to which its content is compared; beyond, when it was last changed
# What softcal imports within its functions; what it imports at the top of its modules comes with these.
_LATE = ("meshio", "optuna", "pint", "pydantic", "ruamel.yaml", "scipy.optimize", "scipy.stats", "sympy")
_NOT_IMPORTED = ("softcal.__main__", "softcal.plugins.sofa.sofa_files")
_DEFECTS = {
    "a traceback": re.compile(r"Traceback \(most recent call last\)|^\w+(?:Error|Exception): ", re.MULTILINE),
    "a warning of a library": re.compile(r"(?:Runtime|Complex|Deprecation|User)Warning"),
}

End = Literal["refused", "solved", "failed"]


@dataclass(frozen=True)
class Case:
    """An attack.

    Attributes
    ----------
    door, name
        Where it comes in, and what it is.
    run
        The words of a command after `softcal`, or a call in Python; in the folder of the files.
    ends
        The proper ends: refused with a sentence (exit code 2, InputError), solved (0), or failed with a sentence (1).
    files
        Writes the files into an empty folder.
    says
        A regular expression that the message matches where the case is not solved.
    keeps
        A folder that is there, or changed, even where it has failed, such as a run's: its trials are kept.
    """

    door: str
    name: str
    run: tuple[str, ...] | Callable[[], object]
    ends: tuple[End, ...] = ("refused",)
    files: Callable[[Path], object] = lambda folder: None
    says: str = ""
    keeps: str = ""

    def __str__(self) -> str:
        return f"{self.door}: {self.name}"


@dataclass(frozen=True)
class Outcome:
    """What a case did: its exit code (None: stopped or killed), all that it printed, its time [s], its memory with what
    softcal imports, beyond that of its parent without [B], and the files of its folder that are not as before.
    """

    code: int | None
    text: str
    seconds: float
    memory: int
    changed: tuple[str, ...]


def outcome(case: Case, folder: Path) -> Outcome:
    """Carry out a case in an empty folder."""
    own, log = folder / "case", folder / "log"
    own.mkdir()
    case.files(own)
    imported = _imported()
    before, began, resident = _states(own), time.perf_counter(), _resident() - imported
    process = os.fork()
    if process == 0:
        _carried_out(case, own, log)
    _, status, usage = os.wait4(process, 0)
    seconds = time.perf_counter() - began
    after = _states(own)
    changed = sorted(name for name in before | after if before.get(name) != after.get(name))
    code = os.waitstatus_to_exitcode(status)
    text = log.read_text(encoding="utf-8", errors="replace")
    return Outcome(code if code >= 0 else None, text, seconds, 1024 * usage.ru_maxrss - resident, tuple(changed))


def faults_of(case: Case, seen: Outcome) -> list[str]:
    """What is improper in how a case ended; empty where nothing is."""
    ends: dict[int | None, End] = {0: "solved", 1: "failed", 2: "refused"}
    end = ends.get(seen.code)
    faults = [f"{what}" for what, pattern in _DEFECTS.items() if pattern.search(seen.text)]
    if end is None:
        return [*faults, f"it ended with {seen.code} after {seen.seconds:.0f} s"]
    if end not in case.ends:
        faults.append(f"it {'was' if end == 'refused' else 'has'} {end}")
    if end == "solved":
        return faults
    if not re.search(case.says, seen.text, re.DOTALL):
        faults.append(f"the message does not say /{case.says}/")
    kept = case.keeps if end == "failed" else ""
    if changed := [name for name in seen.changed if not kept or name.partition("/")[0] != kept]:
        faults.append(f"it changed {', '.join(changed[:3])}")
    if seen.memory > BYTES:
        faults.append(f"it took {seen.memory / 1e6:.0f} MB")
    if seen.seconds > SECONDS:
        faults.append(f"it took {seen.seconds:.0f} s")
    return faults


def parts(cases: Sequence[Case], every: int = 10, slow: int = 3) -> list[ParameterSet]:
    """The cases as parameters of a test: one of `every` is in the default suite, of the others one of `slow` is
    slow, and the rest are long.
    """
    names = [str(case) for case in cases]
    if again := {name for name in names if names.count(name) > 1}:
        raise ValueError(f"two cases have one name: {', '.join(sorted(again))}")

    def marks(i: int) -> list[pytest.MarkDecorator]:
        if i % every == 0:
            return []
        return [pytest.mark.slow if i % slow == 1 else pytest.mark.long]

    return [pytest.param(case, id=str(case), marks=marks(i)) for i, case in enumerate(cases)]


def assert_proper(case: Case, folder: Path) -> None:
    """Carry out a case and assert that its end is proper."""
    seen = outcome(case, folder)
    if faults := faults_of(case, seen):
        pytest.fail(f"{case}: {'; '.join(faults)}\n{seen.text[-3000:]}", pytrace=False)


@functools.cache
def _imported() -> int:
    """Import what the cases would each import; the memory that it takes [B]."""
    before = _resident()
    import softcal
    from softcal.units import unit_factor

    unit_factor("mm", "m")  # reads the definitions of the units
    for name in _LATE:
        importlib.import_module(name)
    for module in pkgutil.walk_packages(softcal.__path__, "softcal."):
        if not module.name.startswith(_NOT_IMPORTED):
            importlib.import_module(module.name)
    return _resident() - before


def _resident() -> int:
    """The memory of this process without that of mapped files, which a fork has none of at first [B]."""
    _, resident, mapped, *_ = map(int, Path("/proc/self/statm").read_text().split())
    return (resident - mapped) * resource.getpagesize()


def _states(folder: Path) -> dict[str, str]:
    """Path -> what it is: the content of a file, the end of a link, or its kind."""
    found: dict[str, str] = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_symlink():
            found[name] = f"link to {os.readlink(path)}"
        elif path.is_file() and path.stat().st_size > _HASHED:
            about = path.stat()
            found[name] = f"{about.st_ino}, {about.st_size} bytes, changed at {about.st_ctime_ns}"
        elif path.is_file():
            with path.open("rb") as file:
                found[name] = hashlib.file_digest(file, "sha256").hexdigest()
        else:
            found[name] = "folder" if path.is_dir() else "special"
    return found


def _carried_out(case: Case, folder: Path, log: Path) -> None:
    """In the fork: run the case with its output in a file, and leave with its exit code."""
    signal.alarm(int(_PATIENCE * SECONDS))
    resource.setrlimit(resource.RLIMIT_CPU, (int(_PATIENCE * SECONDS), int(_PATIENCE * SECONDS)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    code = 70
    try:
        target = os.open(log, os.O_WRONLY | os.O_CREAT, 0o600)
        os.dup2(target, 1)
        os.dup2(target, 2)
        os.chdir(folder)
        code = _exit_code(case.run)
    finally:
        os._exit(code)


def _exit_code(run: tuple[str, ...] | Callable[[], object]) -> int:
    import sys
    import traceback

    from softcal.errors import InputError, SoftcalError

    sys.stdout, sys.stderr = (open(number, "w", encoding="utf-8", closefd=False) for number in (1, 2))
    try:
        if not isinstance(run, tuple):
            run()
            return 0
        from softcal.cli import main

        main(list(run))
    except SystemExit as leave:
        return leave.code if isinstance(leave.code, int) else 1 if leave.code else 0
    except InputError as error:
        sys.stderr.write(error.told(verbose=False))
        return 2
    except SoftcalError as error:
        sys.stderr.write(str(error))
        return 1
    except BaseException:  # noqa: BLE001 (the finding)
        traceback.print_exc()
        return 70
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 0
