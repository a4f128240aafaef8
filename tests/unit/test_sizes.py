"""What `python -m scripts.sizes --clean` makes of an environment: its MKL, and whether a command is right."""

from __future__ import annotations

import platform
import re
import sys
from importlib.metadata import Distribution
from pathlib import Path
from typing import cast

import pytest

from scripts.check_licences import needed_by
from scripts.sizes import EXTRAS, NEEDS, direct, megabytes, ok, pythons, without_mkl

START = Path(__file__).parents[2] / "docs" / "start.md"


def package(*needs: str) -> Distribution:
    class Only:
        requires = needs

    return cast(Distribution, Only())


def test_what_mkl_alone_brings_is_its_own() -> None:
    packages = {
        "softcal": package("pypardiso", "intel-openmp<2025.1", "numpy", "scipy"),
        "pypardiso": package("mkl", "numpy", "scipy"),
        "mkl": package("intel-openmp", "tbb==2023.*"),
        "intel-openmp": package("ur==1"),
        "ur": package("pytest; extra == 'test'"),
    } | {name: package() for name in ("numpy", "scipy", "tbb", "pytest")}
    mkl, rest = without_mkl(packages)
    assert mkl == ["intel-openmp", "mkl", "pypardiso", "tbb", "ur"]
    assert rest == ["numpy", "pytest", "scipy", "softcal"]
    del packages["pypardiso"], packages["mkl"]
    assert without_mkl(packages)[0] == []


NAMED, SILENT = "Error: this needs cv2. Try: pip install 'softcal[markers]'.", "Wrote board.svg."


@pytest.mark.parametrize(
    ("code", "said", "brought", "right"),
    [
        (2, NAMED, False, True),
        (0, SILENT, True, True),
        (2, "Error: no such folder", True, True),
        (0, SILENT, False, False),
        (2, NAMED, True, False),
        (0, NAMED, False, False),
        (1, "Traceback (most recent call last)", True, False),
    ],
)
def test_a_command_names_the_extra_that_is_missing_and_no_other(
    code: int, said: str, brought: bool, right: bool
) -> None:
    assert ok(code, said, "markers", brought) is right


def test_every_extra_is_tried() -> None:
    assert {*NEEDS, "all"} == set(EXTRAS)
    assert list(direct("importance")) == ["SALib", "scikit-learn"]


def test_a_python_that_is_not_here_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(pythons(["2.0"])) == []
    assert "Python 2.0 is not here" in capsys.readouterr().out


@pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"), reason="the page has the sizes of Linux x86-64"
)
def test_the_page_has_the_sizes_of_the_extras() -> None:
    rows = re.findall(r"^\| `?(\w+)`? \|.*\| ([\d.]+) GB \|$", START.read_text(encoding="utf-8"), re.MULTILINE)
    assert {name for name, _ in rows} == {"none", *EXTRAS} - {"all"}
    alone = needed_by("softcal")
    for name, written in rows:
        packages = alone if name == "none" else needed_by(f"softcal[{name}]")
        size = sum(megabytes(one) for key, one in packages.items() if name == "none" or key not in alone)
        assert float(written) == pytest.approx(size / 1e3, rel=0.05, abs=0.005), name
    assert "0.9 GB of the 1.6 GB are Intel's MKL" in " ".join(START.read_text(encoding="utf-8").split())
    mkl = sum(megabytes(alone[name]) for name in without_mkl(alone)[0])
    assert mkl / 1e3 == pytest.approx(0.9, abs=0.05)
