"""What is seen while a calibration runs: a bar for the trials, and another for what follows them."""

from __future__ import annotations

import re

import pytest

from softcal.calibration.search.search import Progress
from softcal.cli.calibration_bars import CalibrationBars, calibration_progress
from softcal.cli.calibration_lines import CalibrationLines


def last_lines(err: str, n: int) -> list[str]:
    """The last n lines that were drawn, without what colours them and moves the cursor."""
    return [
        line.rstrip() for line in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", err).replace("\r", "\n").split("\n") if line
    ][-n:]


def be_a_terminal(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    for name, value in {"FORCE_COLOR": "1", "TERM": "xterm", "COLUMNS": str(columns)}.items():
        monkeypatch.setenv(name, value)


def test_a_stage_is_seen_while_it_is_computed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    be_a_terminal(monkeypatch, 100)
    with CalibrationBars() as bars:
        bars.show("20mm", Progress(5, 5, 1, 0.25, {}))
        bars.show("20mm", Progress(5, 5, 1, 0.25, {}, "importances (fANOVA)"))
        bars._progress.refresh()
        trials, stage = last_lines(capsys.readouterr().err, 2)
        assert trials.startswith("20mm ")
        assert "5/5 best loss 0.25, 1 failed" in trials
        assert stage.startswith("20mm: importances (fANOVA) ")
        assert re.search(r"\d:\d\d:\d\d$", stage)


def test_at_80_columns_nothing_is_cut_off(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    be_a_terminal(monkeypatch, 80)
    with CalibrationBars() as bars:
        bars.show("joint without load52_a, load52_b", Progress(1000, 1000, 13, 0.00569243, {}))
        bars.show("30mm_5mms", Progress(999, 1000, 0, 0.00569243, {}, "importances (fANOVA)"))
        bars._progress.refresh()
        drawn = last_lines(capsys.readouterr().err, 6)
    assert all(len(line) <= 80 for line in drawn)
    text = "\n".join(drawn)
    assert "…" not in text
    assert re.search(r"━ 1000/1000 best loss 0\.00569243, 13 failed \d:\d\d:\d\d", text)
    names = " ".join(" ".join(line.split("━")[0].split()) for line in drawn)
    assert "joint without load52_a, load52_b" in names
    assert "30mm_5mms: importances (fANOVA)" in names


def test_into_a_file_a_line_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    with CalibrationLines(lambda: now) as lines:
        for done in range(101):
            lines.show("joint", Progress(done, 100, done // 50, 1.0 / (1 + done), {}))
            now += 0.75
        lines.show("20mm", Progress(0, 10, 0, None, None))
        lines.show("20mm", Progress(10, 10, 0, 0.5, {}, "importances (fANOVA)"))
        lines.show("20mm", Progress(10, 10, 0, 0.5, {}))
    told = capsys.readouterr().err.splitlines()
    assert told == [
        "joint: 0/100, best loss 1 (0 s)",
        # A tenth takes 7.5 s: none of them within 10 s of the last.
        "joint: 14/100, best loss 0.0666667 (10 s)",
        "joint: 28/100, best loss 0.0344828 (21 s)",
        "joint: 42/100, best loss 0.0232558 (32 s)",
        "joint: 56/100, best loss 0.0175439, 1 failed (42 s)",
        "joint: 70/100, best loss 0.0140845, 1 failed (52 s)",
        "joint: 84/100, best loss 0.0117647, 1 failed (63 s)",
        "joint: 98/100, best loss 0.010101, 1 failed (74 s)",
        "joint: 100/100, best loss 0.00990099, 2 failed (76 s)",
        "20mm: 0/10 (0 s)",
        "20mm: 10/10, best loss 0.5; importances (fANOVA) (0 s)",
        "20mm: 10/10, best loss 0.5 (0 s)",
    ]


def test_into_a_file_a_line_every_minute_of_a_slow_run(capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    with CalibrationLines(lambda: now) as lines:
        for done in range(8):
            lines.show("joint", Progress(done, 1000, 0, 1.0, {}))
            now += 25.0
    told = [line.split(",")[0] + line[line.index(" (") :] for line in capsys.readouterr().err.splitlines()]
    assert told == ["joint: 0/1000 (0 s)", "joint: 3/1000 (75 s)", "joint: 6/1000 (150 s)", "joint: 7/1000 (200 s)"]


def test_bars_are_for_terminals_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(calibration_progress(), CalibrationLines)
    be_a_terminal(monkeypatch, 100)
    assert isinstance(calibration_progress(), CalibrationBars)


def test_a_limit_is_called_one(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that ends at its minimum is not "2 % done": its bar shows no share, and is full at the end."""
    with CalibrationLines(lambda: 0.0) as lines:
        lines.show("joint", Progress(0, 120, 0, None, None, is_limit=True))
        lines.show("joint", Progress(8, 120, 0, 0.5, {}, is_limit=True))
    told = capsys.readouterr().err.splitlines()
    assert told == ["joint: 0 of at most 120 (0 s)", "joint: 8 of at most 120, best loss 0.5 (0 s)"]
    assert Progress(120, 120, 0, 0.5, {}, is_limit=True).count == "120/120"
    be_a_terminal(monkeypatch, 80)
    with CalibrationBars() as bars:
        bars.show("joint without load52_a", Progress(3, 40, 0, 0.00569243, {}, is_limit=True))
        assert [task.total for task in bars._progress.tasks] == [None]
        bars.show("30mm", Progress(4, 40, 0, 0.00569243, {}, is_limit=True))
        assert bars._progress.tasks[0].percentage == 100.0
        bars.show("30mm", Progress(5, 40, 0, 0.00569243, {}, "mesh", is_limit=True))
        assert bars._progress.tasks[1].percentage == 100.0
        bars._progress.refresh()
        drawn = last_lines(capsys.readouterr().err, 6)
    assert all(len(line) <= 80 for line in drawn)
    assert any("5 of at most 40 best loss 0.00569243" in line for line in drawn)
