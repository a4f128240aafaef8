"""Whatever stands in the place of a file that softcal reads: a table, a mesh, a law, a prediction, a file of a run."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

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
}  # fmt: skip


CASES = [
    Case(door, what, command, ("refused",), attacked(files, name, place), name.rpartition("/")[2].partition(".")[0])
    for door, (files, name, command) in DOORS.items()
    for what, place in HOSTILE.items()
]


@pytest.mark.parametrize("case", parts(CASES))
def test_what_is_no_such_file_is_refused(case: Case, tmp_path: Path) -> None:
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
