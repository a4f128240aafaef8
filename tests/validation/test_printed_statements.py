"""The READMEs quote what `calibrate` prints of each shipped example, and the interval holds the true value."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
INTERVAL = re.compile(r"E = \S+ \w+ \(95 %: (\S+) to (\S+)")


def printed(example: str, folder: Path, *options: str) -> str:
    """What `softcal calibrate` prints of an example's joint fit, in one line."""
    project = ROOT / "examples" / example / "project.yaml"
    words = ["calibrate", str(project), "--fit", "joint", "--no-report", "--out", str(folder / "run"), *options]
    done = subprocess.run([sys.executable, "-m", "softcal", *words], capture_output=True, text=True, check=True)
    return " ".join(done.stdout.split())


@pytest.mark.slow  # a minute
def test_the_answer_stands_within_the_last_six_of_at_most_forty_lines(tmp_path: Path):
    words = [
        "calibrate",
        str(ROOT / "examples" / "neck" / "project.yaml"),
        "--no-report",
        "--out",
        str(tmp_path / "run"),
    ]
    done = subprocess.run([sys.executable, "-m", "softcal", *words], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines() + done.stderr.splitlines()
    assert len(lines) <= 40
    assert INTERVAL.search("\n".join(done.stdout.splitlines()[-6:]))


def quoted(example: str) -> str:
    """The statement in the README of an example: its one quotation that begins with E or a doubt of it, in one line."""
    text = (ROOT / "examples" / example / "README.md").read_text(encoding="utf-8")
    (found,) = re.findall(r"^> (?:No single E fits .*\n|E = .*\n)(?:> .*\n)*", text, re.MULTILINE)
    return " ".join(found.replace("\n> ", " ").removeprefix("> ").split())


@pytest.mark.slow  # minutes each
@pytest.mark.parametrize(
    ("example", "true"),
    [("neck", ()), ("neck-bench", (2.07, 2.135)), ("beam", (263.8, 283.0)), ("manipulator", (780.0, 860.0))],
)
def test_the_readme_of_an_example_quotes_it(example: str, true: tuple[float, ...], tmp_path: Path):
    statement = quoted(example)
    assert statement in printed(example, tmp_path)
    told = INTERVAL.search(statement)
    assert told is not None
    assert all(float(told[1]) < value < float(told[2]) for value in true)


@pytest.mark.slow  # minutes each
@pytest.mark.parametrize("options", [("--set", "neck.poissons_ratio=0.45"), ()], ids=["ratio fixed", "ratio free"])
def test_the_readme_tells_the_modulus_of_the_shipped_neck(options: tuple[str, ...], tmp_path: Path):
    output = printed("neck", tmp_path, *options)
    told = re.search(r"E = (\S+) MPa \(95 %: (\S+ to \S+) MPa\)", output)
    assert told is not None
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert re.search(rf"{re.escape(told[1])} MPa \((?:95 %: )?{re.escape(told[2])}\)", readme), told[0]
    largest = re.search(r"(\d+) % of the variance of E comes from", output)
    assert largest is not None
    assert re.search(rf"\b{largest[1]}(?: %)?(?: of the variance|,| and)", readme), largest[0]
