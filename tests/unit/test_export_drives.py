"""What each export makes of a drive: the table of docs/exports.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from project_case import PROJECT, write_project
from typer.testing import CliRunner

from softcal.cli import app

STIFF, SPRINGS = "", ", spring_rate: 20 N/mm, pretension: 1 N"
ROBOT = """\
    back: {{via: [{{on: plate, at: [-30 mm, 0 mm, 100 mm]}}, {{at: [-30 mm, 0 mm, 0 mm]}}]}}
  actuators:
    servo: {{actuator: drive, cables: {{front: 1, back: -1}}, radius: 8 mm{springs}}}
"""
TURN, TWIST = ("--pull", "servo=5deg"), ("--pull", "servo=2mN*m")
REACH = ("--reach", "servo=-2mN*m..2mN*m", "--samples", "10")


@pytest.mark.parametrize(
    ("kind", "springs", "words", "expected"),
    [
        ("vtk", SPRINGS, TURN, "shapes.pvd"),
        ("calculix", SPRINGS, TURN, "robot.inp"),
        ("calculix", STIFF, TWIST, "robot.inp"),
        ("sofa", STIFF, TURN, "scene.py"),
        ("sofa", SPRINGS, TURN, "without springs and backlash"),
        ("sofa", STIFF, TWIST, "torque"),
        ("reduced", SPRINGS, REACH, "model.json"),
        ("web", SPRINGS, REACH, "twin.html"),
    ],
)
def test_a_drive_is_exported_or_refused(
    tmp_path: Path, kind: str, springs: str, words: tuple[str, ...], expected: str
) -> None:
    bench = PROJECT[PROJECT.index("experiments:") :]
    path, out = write_project(tmp_path / "p", (bench, ROBOT.format(springs=springs))), tmp_path / "out"
    done = CliRunner().invoke(app, ["export", kind, str(path), "--out", str(out), *words])
    if re.fullmatch(r"\w+\.\w+", expected):
        assert done.exit_code == 0, done.output
        assert expected in [one.name for one in out.iterdir()]
    else:
        assert done.exit_code == 2, done.output
        assert expected in done.output
        assert not out.exists()
