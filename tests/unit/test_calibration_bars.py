"""What is seen while a calibration runs: a bar for the trials, and another for what follows them."""

from __future__ import annotations

import re

import pytest

from softcal.calibration.run import Progress
from softcal.cli.calibration_bars import CalibrationBars


def last_lines(err: str, n: int) -> list[str]:
    """The last n lines that were drawn, without what colours them and moves the cursor."""
    return [
        line.rstrip() for line in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", err).replace("\r", "\n").split("\n") if line
    ][-n:]


def test_a_stage_is_seen_while_it_is_computed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    with CalibrationBars() as bars:
        bars.show("20mm", Progress(5, 5, 1, 0.25, {}))
        bars.show("20mm", Progress(5, 5, 1, 0.25, {}, "importances (fANOVA) from 5 trials"))
        bars._progress.refresh()
        trials, stage = last_lines(capsys.readouterr().err, 2)
        assert trials.startswith("20mm ")
        assert "5/5 best loss 0.25, 1 failed" in trials
        assert stage.startswith("20mm: importances (fANOVA) from 5 trials ")
        assert re.search(r"\d:\d\d:\d\d$", stage)
