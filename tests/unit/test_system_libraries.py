"""Missing system libraries become package names; nothing is asked for where all is there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from scripts import system_libraries

LDD = """\tlinux-vdso.so.1 (0x00007ffd)
\tlibGLU.so.1 => not found
\tlibXft.so.2 => not found
\tlibz.so.1 => /lib/x86_64-linux-gnu/libz.so.1 (0x00007f2b)
"""


@pytest.fixture(autouse=True)
def linux_with_wheels(monkeypatch: pytest.MonkeyPatch):
    """A machine with both wheels, whose linker says `LDD`."""
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(system_libraries, "wheel_libraries", lambda: [Path("libgmsh.so"), Path("vtkRenderingCore.so")])
    monkeypatch.setattr(subprocess, "run", lambda command, **_: subprocess.CompletedProcess(command, 0, LDD, ""))
    monkeypatch.setattr(system_libraries, "is_loadable", lambda name: True)
    monkeypatch.setattr(system_libraries, "can_draw", lambda: True)


def test_what_the_linker_misses_becomes_packages():
    assert system_libraries.missing_packages() == ["libglu1-mesa", "libxft2"]


def test_what_vtk_opens_by_itself_is_asked_for(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(system_libraries, "unresolved", lambda library: set())
    monkeypatch.setattr(system_libraries, "is_loadable", lambda name: name != "libEGL.so.1")
    assert system_libraries.missing_packages() == ["libegl1"]


def test_a_machine_that_cannot_draw_gets_a_software_renderer(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(system_libraries, "unresolved", lambda library: set())
    monkeypatch.setattr(system_libraries, "can_draw", lambda: False)
    assert "libgl1-mesa-dri" in system_libraries.missing_packages()


def test_nothing_is_asked_for_where_all_is_there(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(system_libraries, "unresolved", lambda library: set())
    assert system_libraries.missing_packages() == []


def test_an_unknown_library_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setattr(system_libraries, "unresolved", lambda library: {"libnew.so.9"})
    assert system_libraries.missing_packages() == []
    assert "libnew.so.9" in capsys.readouterr().err
