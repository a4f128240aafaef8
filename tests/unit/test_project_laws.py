"""The law named in a project file is the one that is simulated and calibrated with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from project_case import PROJECT, write_project

from softcal.errors import ProjectFileError
from softcal.project.project import load
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import calibrate


def with_law(folder: Path, law: str) -> Path:
    path = write_project(folder)
    path.write_text(PROJECT.replace("element: P1\n", f"element: P1\n      law: {law}\n"), encoding="utf-8")
    return path


def test_the_isochoric_law_is_calibrated_with_end_to_end(tmp_path: Path) -> None:
    project = load(with_law(tmp_path, "neo-hooke-isochoric"))
    (body,) = project.robot.bodies
    assert body.law == "neo-hooke-isochoric"
    pulled = Protocol({"front": Command("shortening", np.linspace(0.0, 0.01, 5))})
    other = load(with_law(tmp_path / "other", "neo-hooke")).robot
    tensions = [simulate(robot, pulled).channels["front.tension"][-1] for robot in (project.robot, other)]
    # Alike in the small, and not the same law.
    assert tensions[0] == pytest.approx(tensions[1], rel=0.05)
    assert tensions[0] != pytest.approx(tensions[1], rel=1e-6)
    found = calibrate(project, out=tmp_path / "run", method="least-squares").results
    for result in found.values():
        assert result.parameters["bar.youngs_modulus"].value == pytest.approx(1.3e6, rel=0.1)
        assert "onverged" in result.status


def test_an_unknown_law_is_answered_with_the_nearest_known(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError) as error:
        load(with_law(tmp_path, "neo-hook-isochoric"))
    (fault,) = [str(fault) for fault in error.value.faults]
    assert "law" in fault
    assert "neo-hook-isochoric" in fault
    assert "neo-hooke-isochoric" in fault
