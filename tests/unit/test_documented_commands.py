"""Every command in the documents is one that softcal takes, and those of the examples run as they are written there."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from softcal.cli import app

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted(
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("examples/*/README.md"))
)
# Of the examples' commands: those that take longer than a test may, and where what they do is tested.
TOO_LONG = {
    "softcal calibrate project.yaml --out runs/fit": "a minute; tests/recovery/test_finger.py",
    "python generate.py --out runs/bench": "four minutes",
    "python generate.py --out runs/again --twin": "Gmsh and a minute",
    "softcal camera runs/bench/board --out runs/camera.yaml": "needs the images of the line before it",
    "softcal markers runs/bench/images": "needs those images; the command on the images here runs",
    "softcal sweep project.yaml": "half a minute; tests/unit/test_sweep.py",
    "softcal calibrate project.yaml --out runs/one": "a minute; tests/recovery/test_manipulator_bench.py",
    "softcal calibrate project.yaml --split": "a minute; tests/recovery/test_manipulator_bench.py",
    "softcal validate project.yaml": "minutes; tests/unit/test_cli.py",
    "softcal calibrate project.yaml --out runs/least-squares": "a minute; tests/recovery/test_neck_bench.py",
    "softcal calibrate project.yaml --out runs/tpe": "4000 trials",
    "softcal calibrate cycles.yaml --out runs/cycles": "two minutes; tests/recovery/test_neck_cycles.py",
    "softcal calibrate project.yaml --out runs/free": "two minutes; tests/validation/test_every_printed_sentence.py",
    "softcal calibrate project.yaml --set neck.poissons_ratio=0.45": "two minutes; the same",
    "softcal calibrate project.yaml --out runs/beam": "seconds; tests/validation/test_real_beam.py",
    "python vary.py": "a minute; tests/validation/test_real_beam.py",
}


def commands(document: str) -> list[str]:
    """The indented lines of a document that begin with a program, without the remark behind two spaces or `#`."""
    text = (ROOT / document).read_text(encoding="utf-8").replace("\\\n", "")
    found = re.findall(r"^    ((?:softcal|python) .*)$", text, re.MULTILINE)
    spoken = [re.split(r"\s{2,}(?=[^-\s])|\s+#", line)[0].strip() for line in found]
    return [re.sub(r"\[(--[^]]*)\]", r"\1", line) for line in spoken]


@pytest.mark.parametrize("document", DOCUMENTS)
def test_softcal_takes_every_command(document: str):
    """Options and arguments are read as on the command line; nothing is run."""
    for line in commands(document):
        program, *words = shlex.split(line)
        if program == "softcal":
            words = ["vtk" if word == "KIND" else word for word in words]
            command: Any = typer.main.get_command(app)
            while hasattr(command, "commands"):
                command = command.get_command(None, words.pop(0))
            command.make_context(line, words)


def test_python_m_softcal_is_softcal():
    done = subprocess.run([sys.executable, "-m", "softcal", "--version"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("softcal ")


OF_EXAMPLES = [document for document in DOCUMENTS if document.startswith("examples/")]
EXAMPLES = [(document, line) for document in OF_EXAMPLES for line in commands(document)]
LONG = [  # a minute and more
    ("examples/finger/README.md", "python generate.py --out runs/again"),
    ("examples/pneunet/README.md", "python generate.py --out runs/again"),
]
RUN = [
    pytest.param(*one, marks=pytest.mark.long if one in LONG else ())
    for one in EXAMPLES
    if not any(one[1].startswith(known) for known in TOO_LONG)
]


def test_what_is_too_long_is_still_documented():
    assert [known for known in TOO_LONG if not any(line.startswith(known) for _, line in EXAMPLES)] == []


@pytest.mark.slow
@pytest.mark.parametrize(("document", "line"), RUN)
def test_the_command_runs(document: str, line: str, tmp_path: Path):
    folder = tmp_path / "example"
    shutil.copytree((ROOT / document).parent, folder, ignore=shutil.ignore_patterns("runs"))
    program, *words = shlex.split(line)
    command = [sys.executable, "-m", "softcal", *words] if program == "softcal" else [sys.executable, *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
    if line.startswith("softcal check"):
        assert "The project is in order." in done.stdout
        assert "intersects itself" not in done.stdout
