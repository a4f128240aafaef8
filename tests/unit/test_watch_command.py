"""The command `softcal watch`, the page beside a command, and the page in a notebook."""

from __future__ import annotations

import importlib.util
import json
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from project_case import write_project
from typer.testing import CliRunner
from watch_case import write_run

import softcal
from softcal.cli import app
from softcal.plugins.watch import server
from softcal.processes import beside
from softcal.workflows import watching
from softcal.workflows.calibration import Calibrations
from softcal.workflows.run import CalibrationRun
from softcal.workflows.sweep import Swept
from softcal.workflows.watching import WatchedPage, watch_run

there = importlib.util.find_spec("nicegui") is not None
needs_nicegui = pytest.mark.skipif(not there, reason="the extra `watch` is not installed")


def test_without_the_extra_one_sentence_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    find = importlib.util.find_spec
    lacks = {"nicegui"}
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name in lacks else find(name, *more))
    done = CliRunner().invoke(app, ["watch", str(write_run(tmp_path))])
    assert done.exit_code == 2
    expected = "softcal watch: this needs nicegui, which is not installed. Try: pip install 'softcal[watch]'."
    assert done.stderr == f"Error: {expected}\n"


@needs_nicegui
def test_a_folder_that_is_not_there_is_refused(tmp_path: Path):
    done = CliRunner().invoke(app, ["watch", str(tmp_path / "nothing")])
    assert done.exit_code == 2
    assert "there is no such folder" in done.stderr
    assert "--wait" in done.stderr
    (tmp_path / "file").write_text("")
    for options in ([], ["--wait"]):
        done = CliRunner().invoke(app, ["watch", str(tmp_path / "file"), *options])
        assert done.exit_code == 2
        assert "file: there is no such folder; got a file; allowed: a folder that" in done.stderr
        assert "--wait" not in done.stderr


@needs_nicegui
@pytest.mark.parametrize(
    "options", [["--host", "192.0.2.1"], ["--host", "no such host"], ["--host", "\u0000"], ["--host", "a\nb"]]
)
def test_an_address_that_is_not_this_machine_s_is_refused(options: list[str], tmp_path: Path):
    done = CliRunner().invoke(app, ["watch", str(write_run(tmp_path)), "--no-browser", "--port", "0", *options])
    assert done.exit_code == 2, done.output
    assert "the page cannot be served at this address" in done.stderr
    assert "\n" not in done.stderr.strip()


@needs_nicegui
@pytest.mark.parametrize(
    ("host", "why"),
    [
        ("", "the value of --host is empty"),
        ("[]", "--host: the page cannot be served at this address; got nothing; allowed: an address"),
    ],
)
def test_no_address_is_not_taken_for_all_of_them(host: str, why: str, tmp_path: Path):
    done = CliRunner().invoke(app, ["watch", str(write_run(tmp_path)), "--no-browser", "--port", "0", "--host", host])
    assert done.exit_code == 2, done.output
    assert why in done.stderr


@needs_nicegui
@pytest.mark.parametrize("host", ["::1", "[::1]"])
def test_the_address_of_ipv6_is_one_that_can_be_typed(host: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("the system has no IPv6")
    said: list[str] = []

    class Served:
        def __init__(self, gate: object, ready: Callable[[], None]) -> None:
            self._ready = ready

        def run(self, sockets: list[socket.socket]) -> None:
            said.append(str(sockets[0].getsockname()[:2]))
            self._ready()

    monkeypatch.setattr(server, "_server", Served)
    shared = SimpleNamespace(twins=SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(server, "_application", lambda folder: (None, shared))
    monkeypatch.setenv("NICEGUI_STORAGE_PATH", "")  # which is set while it serves
    server.serve(write_run(tmp_path), host=host, port=0, ready=said.append)
    number = said[0].rpartition(" ")[2].rstrip(")")
    assert said == [f"('::1', {number})", f"http://[::1]:{number}/"]


@needs_nicegui
def test_a_page_in_a_notebook_is_there_until_it_is_closed(tmp_path: Path):
    with watch_run(write_run(tmp_path / "a run"), port=0) as page:
        shown = page._repr_html_()
        assert f'<iframe src="{page.address}"' in shown
        assert repr(page) == f"The page of the run: {page.address}"
        with urllib.request.urlopen(page.address, timeout=60) as answer:
            assert answer.status == 200
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(page.address, timeout=60)


def test_a_page_that_says_much_is_not_stopped_by_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    done = tmp_path / "done"
    talker = f"""
import sys, time
from pathlib import Path
print("Page: http://127.0.0.1:1/ (Ctrl-C ends it)", flush=True)
sys.stdout.buffer.write(b"a warning of a library \\xff\\n" * 50_000)
sys.stdout.flush()
Path({str(done)!r}).touch()
time.sleep(60)
"""
    (tmp_path / "talker.py").write_text(talker)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(watching, "beside", lambda *arguments: beside("talker"))
    with watch_run(tmp_path) as page:
        assert page.address == "http://127.0.0.1:1/"
        until = time.monotonic() + 60.0
        while not done.exists():
            assert time.monotonic() < until
            time.sleep(0.02)


@needs_nicegui
def test_a_page_that_cannot_be_served_is_an_error_of_the_input(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(softcal.InputError, match="there is no such folder; got a file"):
        watch_run(tmp_path / "file")


def test_every_run_has_a_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    asked: list[Any] = []
    monkeypatch.setattr("softcal.workflows.run.watch_run", asked.append)
    Calibrations({}, folder=tmp_path / "a").watch()
    CalibrationRun(tmp_path / "b", *[None] * 5, {}).watch()  # type: ignore[arg-type]
    Swept(None, None, (), folder=tmp_path / "c").watch()  # type: ignore[arg-type]
    assert [path.name for path in asked] == ["a", "b", "c"]
    with pytest.raises(softcal.StorageError, match="there is no run folder to show"):
        Calibrations({}, folder=None).watch()


def test_the_page_beside_a_command_ends_with_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    said: list[str] = []

    class Page(WatchedPage):
        def close(self) -> None:
            said.append("closed")

    def served(folder: Path) -> WatchedPage:
        said.append(f"page of {folder.name}, there: {folder.exists()}")
        return Page("http://127.0.0.1:1/", None)  # type: ignore[arg-type]

    monkeypatch.setattr("softcal.workflows.watching.watch_run", served)
    project = write_project(tmp_path / "project")
    run = tmp_path / "run"
    options = ["--out", str(run), "--method", "grid", "--trials", "4", "--no-report", "--watch"]
    done = CliRunner().invoke(app, ["calibrate", str(project), *options])
    assert done.exit_code == 0, done.output
    assert said == ["page of run, there: False", "closed"]
    assert "Page: http://127.0.0.1:1/ (until this command ends)" in done.stderr
    assert f"It is shown again by: softcal watch {run}" in done.stderr


def test_the_page_beside_a_sweep(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr("softcal.workflows.watching.watch_run", lambda folder: pytest.fail("not asked for"))
    project = write_project(tmp_path / "project")
    over = ["--over", "bar.youngs_modulus=1MPa,2MPa", "--no-report", "--out"]
    assert CliRunner().invoke(app, ["sweep", str(project), *over, str(tmp_path / "one")]).exit_code == 0
    seen: list[Path] = []

    def served(folder: Path) -> WatchedPage:
        seen.append(folder)
        from contextlib import ExitStack

        return WatchedPage("http://127.0.0.1:1/", ExitStack())

    monkeypatch.setattr("softcal.workflows.watching.watch_run", served)
    assert CliRunner().invoke(app, ["sweep", str(project), *over, str(tmp_path / "two"), "--watch"]).exit_code == 0
    assert seen == [tmp_path / "two"]


@needs_nicegui
@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has no such signal")
def test_a_page_answers_what_no_browser_sends_and_ends_with_its_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Without a traceback, and without a file that stays."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    run = write_run(tmp_path / "run")
    with (run / "report.html").open("wb") as file:
        file.truncate(2**32)
    command = [sys.executable, "-m", "softcal", "watch", str(run), "--no-browser", "--port", "0"]
    with ExitStack() as stack:
        process = stack.enter_context(
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        )
        stack.callback(process.kill)
        assert process.stdout is not None
        address = process.stdout.readline().split()[1]

        def asked(place: str, data: str | None = None, **headers: str) -> tuple[int, str]:
            request = urllib.request.Request(address + place, None if data is None else data.encode(), headers)
            try:
                with urllib.request.urlopen(request, timeout=20) as answer:
                    return answer.status, answer.read().decode()
            except urllib.error.HTTPError as error:
                return error.code, error.read().decode()

        assert asked("", Origin="http://[")[0] == 403
        assert asked("report") == (404, "report.html cannot be read: more than 64000000 bytes.\n")
        socket = "_nicegui_ws/socket.io/?EIO=4&transport=polling"
        opened = asked(socket)[1]
        socket += f"&sid={json.loads(opened[1:])['sid']}"
        for message in ("40", '42["event",{}]', '42["handshake",{}]', '42["ack",{}]', '42["log",{}]'):
            assert asked(socket, message) == (200, "OK")
        asked(socket)
        process.send_signal(signal.SIGHUP)
        said = process.communicate(timeout=60)[1]
    assert process.returncode == 129
    assert said.strip() == "Stopped."
    assert not list((tmp_path / "temporary").iterdir())
