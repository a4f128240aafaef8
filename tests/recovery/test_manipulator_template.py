"""`softcal init manipulator`: checked, calibrated and reported as it is written, and its stated truth found again."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from softcal.cli import main


def softcal(*arguments: object) -> None:
    with pytest.raises(SystemExit) as left:
        main([str(argument) for argument in arguments])
    assert not left.value.code


def calibrated(tmp_path: Path) -> Path:
    softcal("init", "manipulator", tmp_path / "m")
    softcal("calibrate", tmp_path / "m" / "project.yaml", "--no-report", "--out", tmp_path / "run")
    return tmp_path / "run"


@pytest.mark.slow
def test_the_truth_that_it_states_is_found(tmp_path: Path):
    found = json.loads((calibrated(tmp_path) / "result.json").read_text())["parameters"]["springs.youngs_modulus"]
    stated = re.search(r"with E ([\d.]+) GPa for all", (tmp_path / "m" / "project.yaml").read_text())
    assert stated is not None
    assert found["value"] == pytest.approx(1e9 * float(stated[1]), rel=0.005)


@pytest.mark.long
def test_check_and_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    run = calibrated(tmp_path)
    capsys.readouterr()
    softcal("check", tmp_path / "m" / "project.yaml", "--out", tmp_path / "look")
    assert "The project is in order." in capsys.readouterr().out
    softcal("report", run)
    assert (run / "report.html").is_file()
