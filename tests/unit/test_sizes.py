"""What `python -m scripts.sizes --clean` makes of an environment: its MKL, and whether a command is right."""

from __future__ import annotations

from importlib.metadata import Distribution
from typing import cast

import pytest

from scripts.sizes import EXTRAS, NEEDS, direct, ok, pythons, without_mkl


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
