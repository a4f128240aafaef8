"""CalculiX as a process: how each of its ends is told. A script stands for ccx."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest
from project_case import write_project
from typer.testing import CliRunner

from softcal.cli import app
from softcal.errors import SimulationError
from softcal.plugins.calculix.deck import Deck
from softcal.plugins.calculix.run import run_calculix
from softcal.plugins.calculix.workflow import crosscheck_project
from softcal.project.project import load
from softcal.workflows.cases import PULL, cases

DECK = Deck("** a deck", {}, 2, 3)
TABLE = """
 displacements (vx,vy,vz) for set ALL and time  0.{}000000E+01

         1  1.000000E-01  2.000000E-01  3.000000E-01
         2  0.000000E+00  0.000000E+00  1.000000-104
         3  0.000000E+00  0.000000E+00 -{}.00000E+00

"""


@pytest.fixture
def ccx(tmp_path, monkeypatch):
    """Puts a shell script in the place of ccx."""

    def put(script: str) -> Path:
        folder = tmp_path / "bin"
        folder.mkdir()
        path = folder / "ccx"
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
        return path

    return put


def printing(*times: int) -> str:
    return "cat > robot.dat <<'END'\n" + "".join(TABLE.format(t, t) for t in times) + "END"


def test_displacements_at_every_state_are_read(ccx, tmp_path):
    ccx(printing(1, 2))
    found = run_calculix(DECK, tmp_path)
    assert found.shape == (2, 3, 3)
    expected = [[1e-4, 2e-4, 3e-4], [0.0, 0.0, 1e-107], [0.0, 0.0, -2e-3]]  # [m]
    np.testing.assert_allclose(found[1], expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("script", "sentence"),
    [
        ("echo ' *ERROR: increment size smaller than minimum'; exit 201", r"\(ERROR: increment size smaller than min"),
        (f"{printing(1)}\necho ' *ERROR: too many cutbacks'", r"\(ERROR: too many cutbacks\); it reached 1 of 2"),
        ("echo nothing of note; exit 3", r"\(exit code 3\); it reached 0 of 2 states"),
        (printing(1, 2).replace("         2 ", "         3 "), r".*; it reached 0 of 2 states"),
        (printing(1, 2).replace("2.000000E-01", "NaN"), r".*; it reached 0 of 2 states"),
        (printing(1, 2).replace("2.000000E-01", "************"), r".*; it reached 0 of 2 states"),
        (printing(1, 2)[: -len("E+00\n\nEND") - 20] + "\nEND", r".*; it reached 1 of 2 states"),
        (printing(1, 2)[:-4] + "         4  0.0  0.0  0.0\nEND", r".*; it reached 1 of 2 states"),
        (
            printing(1).replace("cat >", "printf '\\377' > robot.dat; cat >>") + "\nexit 3",
            r"\(exit code 3\); it reached 1 of 2 states",
        ),
        (printing(1, 2).replace("2.000000E-01", "٢.000000E-01"), r".*; it reached 0 of 2 states"),
        ("kill -SEGV $$", r"\(it crashed: SIGSEGV\)"),
    ],
    ids=[
        "diverged",
        "cut back",
        "unknown",
        "a node is missing",
        "NaN",
        "stars",
        "cut off",
        "a node more",
        "no text",
        "other digits",
        "crashed",
    ],
)
def test_an_end_before_the_full_load_is_told(ccx, tmp_path, script, sentence):
    ccx(script)
    with pytest.raises(SimulationError, match=f"CalculiX did not reach the full load {sentence}"):
        run_calculix(DECK, tmp_path)


def test_a_run_that_takes_too_long_is_ended_with_all_that_it_started(ccx, tmp_path):
    ccx("sleep 60 & echo $! > child; wait")
    began = time.monotonic()
    with pytest.raises(SimulationError, match=r"CalculiX did not end within 0.5 s; it reached 0 of 2 states\."):
        run_calculix(DECK, tmp_path, timeout=0.5)
    assert time.monotonic() - began < 10.0
    child = int((tmp_path / "child").read_text())
    deadline = time.monotonic() + 10.0
    while running(child) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not running(child)


def running(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


def test_a_ccx_that_cannot_be_started_is_told(ccx, tmp_path):
    ccx("").write_bytes(b"\x7fELF broken")
    with pytest.raises(SimulationError, match=r"CalculiX could not be started: .*bin/ccx"):
        run_calculix(DECK, tmp_path)


def test_a_missing_calculix_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SimulationError, match="apt-get install calculix-ccx"):
        run_calculix(DECK, tmp_path)


@pytest.mark.parametrize(
    ("script", "options", "sentence"),
    [
        ("echo ' *ERROR: too many cutbacks'; exit 201", [], "did not reach the full load (ERROR: too many cutbacks)"),
        ("sleep 60", ["--timeout", "300ms"], "calculix failed: CalculiX did not end within 0.3 s"),
    ],
    ids=["diverges", "too long"],
)
def test_crosscheck_ends_with_1_where_calculix_fails(ccx, tmp_path, script, options, sentence):
    ccx(script)
    project = write_project(tmp_path / "project")
    arguments = ["crosscheck", str(project), "--engines", "calculix", "--pull", "front=3mm", *options]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 1
    assert sentence in done.output


@pytest.mark.slow
def test_two_workers_compare_as_one_process_does(ccx, tmp_path):
    ccx("echo ' *ERROR: too many cutbacks'; exit 201")
    project = load(write_project(tmp_path / "project"))
    chosen = {f"{mm} mm": cases(project, [f"front={mm}mm"])[PULL] for mm in (2, 3)}
    seen: list[tuple[str, str]] = []
    there = crosscheck_project(project, chosen, ["calculix"], workers=2, progress=lambda *told: seen.append(told))
    assert there == crosscheck_project(project, chosen, ["calculix"])
    assert seen == [("2 mm", "each engine"), ("3 mm", "each engine")]
    assert all("too many cutbacks" in result.failed["calculix"] for result in there.values())
