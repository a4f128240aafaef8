"""What is seen of a motion and of a report while they are computed: on a terminal, and nothing elsewhere."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest
from project_case import write_project
from typer.testing import CliRunner

from softcal.cli import app
from softcal.cli.commands import export_commands, simulate_command
from softcal.cli.running import clock, motion_bars, steps


def be_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"FORCE_COLOR": "1", "TERM": "xterm", "COLUMNS": "80"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)


def drawn(err: str) -> list[str]:
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", err).replace("\r", "\n")
    return [line.rstrip() for line in text.split("\n") if line.strip()]


def test_a_motion_has_a_bar_and_another_while_it_settles(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    be_a_terminal(monkeypatch)
    with motion_bars() as show:
        for time in (0.0, 0.5, 1.0, 1.5):
            show("pull", time, 1.0)
        show("again", 0.25, 1.0)
    pull, settling, again = drawn(capsys.readouterr().err)[-3:]
    assert re.search(r"^ *pull +━{20} 1\.00 of 1\.00 s +\d:\d\d:\d\d$", pull)
    assert re.search(r"^ *pull: settling +━{20} 1\.50 s +\d:\d\d:\d\d$", settling)
    assert "again" in again
    assert "0.25 of 1.00 s" in again


def test_what_is_being_done_is_seen_in_turn_and_then_gone(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    be_a_terminal(monkeypatch)
    with clock() as show:
        show("Simulating")
        show("Drawing")
    printed = capsys.readouterr().err
    assert "Drawing 0:00:00" in drawn(printed)[-1]
    assert printed.endswith("\x1b[2K")  # the line is erased


def test_into_a_pipe_nothing_is_drawn(capsys: pytest.CaptureFixture[str]) -> None:
    with motion_bars() as show, clock() as tell:
        show("pull", 0.5, 1.0)
        show("pull", 1.5, 1.0)
        tell("Drawing")
    assert capsys.readouterr() == ("", "")


def test_without_a_motion_there_is_no_bar(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    be_a_terminal(monkeypatch)
    with motion_bars():
        pass
    assert capsys.readouterr() == ("", "")


@pytest.mark.slow
def test_simulate_and_export_say_what_they_are_doing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []

    @contextmanager
    def seen(*, keeps: bool = False) -> Generator[Callable[[str], None]]:
        yield told.append

    monkeypatch.setattr(simulate_command, "clock", seen)
    monkeypatch.setattr(export_commands, "clock", seen)
    path = write_project(tmp_path)
    assert run("simulate", path, "--out", tmp_path / "simulated") == 0
    assert told == ["Simulating pull (1 of 1)", "", "Drawing and writing"]
    assert run("export", "vtk", path, "--out", tmp_path / "vtk", "--pull", "front=5mm") == 0
    assert told[3:] == ["Simulating pull (1 of 1)"]
    assert run("export", "calculix", path, "--out", tmp_path / "ccx", "--pull", "front=5mm") == 0
    assert len(told) == 5
    capsys.readouterr()


def run(*arguments: object) -> int:
    return CliRunner().invoke(app, [str(argument) for argument in arguments]).exit_code


def test_into_a_file_a_stage_is_told_where_a_minute_passed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setattr("softcal.cli.running.time.monotonic", lambda: now)
    with clock() as show:
        for stage in ("one", "two", "three", "four", "five"):
            show(stage)
            now += 25.0
    assert capsys.readouterr().err == "four (75 s)\n"


def test_the_steps_of_a_report_are_a_bar_on_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    be_a_terminal(monkeypatch)
    with steps("Report") as show:
        show("drawing overview", 2, 8)
        show("drawing trajectory", 3, 8)
    printed = capsys.readouterr().err
    assert re.search(r"Report: drawing trajectory ━+.* 3/8 \d:\d\d:\d\d", "\n".join(drawn(printed)))
    assert printed.endswith("\x1b[2K")


def test_the_steps_of_a_report_are_a_line_or_two_in_a_file(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setattr("softcal.cli.running.time.monotonic", lambda: now)
    with steps("Report") as show:
        for k, name in enumerate(("reading the run", "simulating the twin", "drawing overview", "drawing twin")):
            show(name, k, 4)
            now += 25.0
    assert capsys.readouterr().err == "Report: reading the run, 1 of 4 (0 s)\nReport: drawing twin, 4 of 4 (75 s)\n"


@pytest.mark.slow
def test_calibrate_says_what_the_report_is_doing(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["calibrate", str(write_project(tmp_path)), "--option", "starts=1"])
    assert done.exit_code == 0, done.output
    assert re.search(r"^Report: reading the run, 1 of \d\d \(0 s\)$", done.stderr, re.MULTILINE)
    assert re.search(r"^pull: \d of at most 40, best loss", done.stderr, re.MULTILINE)
