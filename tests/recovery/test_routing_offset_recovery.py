"""A cable that runs 5 % further out than the project file says: found, together with the modulus and the slack."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from project_case import MODULUS, SLACK, write_project

from softcal.cli import main
from softcal.errors import InputError
from softcal.project.project import load

AXIS = ("  cables:\n    front:\n", "  cables:\n    front:\n      routing_axis: {}\n")
# The bench data were made with the cable 30 mm off the axis.
NEARER = (
    "{on: plate, at: [30 mm, 0 mm, 100 mm]}\n        - {at: [30 mm, 0 mm, 0 mm]}",
    "{on: plate, at: [28.5 mm, 0 mm, 100 mm]}\n        - {at: [28.5 mm, 0 mm, 0 mm]}",
)
FREE = ("  front.slack:", "  front.routing_offset: {bounds: [-5 mm, 5 mm]}\n  front.slack:")


def softcal(*arguments: object) -> None:
    with pytest.raises(SystemExit) as left:
        main([str(argument) for argument in arguments])
    assert not left.value.code


@pytest.mark.long
def test_a_routing_radius_five_per_cent_off_is_found_with_the_modulus(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    project = write_project(tmp_path / "bar", AXIS, NEARER, FREE)
    softcal("check", project, "--no-pictures")
    assert "28.5 mm from its axis, with an offset of 0" in " ".join(capsys.readouterr().out.split())
    softcal("calibrate", project, "--out", tmp_path / "run")
    assert "front.routing_offset" in " ".join(capsys.readouterr().out.split())
    found = json.loads((tmp_path / "run" / "result.json").read_text())["parameters"]
    assert found["front.routing_offset"]["value"] == pytest.approx(1.5e-3, rel=1e-3)
    assert found["bar.youngs_modulus"]["value"] == pytest.approx(MODULUS, rel=1e-3)
    assert found["front.slack[pull]"]["value"] == pytest.approx(SLACK, rel=1e-2)
    assert "routing offset (front)" in (tmp_path / "run" / "report.html").read_text()
    # Without the offset the wrong radius goes into the modulus.
    softcal("calibrate", write_project(tmp_path / "narrow", NEARER), "--no-report", "--out", tmp_path / "fixed")
    found = json.loads((tmp_path / "fixed" / "result.json").read_text())["parameters"]
    assert abs(found["bar.youngs_modulus"]["value"] / MODULUS - 1.0) > 0.05


def test_an_offset_needs_an_axis_and_cannot_lead_through_it(tmp_path: Path):
    with pytest.raises(InputError, match="no such parameter"):
        load(write_project(tmp_path / "none", FREE))
    wide = (FREE[0], FREE[1].replace("-5 mm", "-40 mm"))
    with pytest.raises(InputError, match=r"front\.routing_offset"):
        load(write_project(tmp_path / "wide", AXIS, wide))
    beside = (AXIS[0], AXIS[1].replace("{}", "{point: [30 mm, 0 mm, 0 mm]}"))
    with pytest.raises(InputError, match=r"via point 1") as caught:
        load(write_project(tmp_path / "on", beside))
    assert "robot.cables.front" in str(caught.value)


def test_via_points_that_cannot_be_moved_are_refused(tmp_path: Path):
    via = "{on: bar, at: [10.01 mm, 1 mm, 60 mm]}"
    lower = ("        - {at: [30 mm, 0 mm, 0 mm]}", f"        - {via}\n        - {{at: [30 mm, 0 mm, 0 mm]}}")
    load(write_project(tmp_path / "still", lower))
    with pytest.raises(InputError, match="must lie inside its body") as caught:
        load(write_project(tmp_path / "moved", lower, AXIS))
    assert "robot.cables.front" in str(caught.value)
