"""Where a project's cables run between their via points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from project_case import write_project

from softcal.errors import ProjectFileError
from softcal.project.project import load
from softcal.workflows.checking import check

VIA = "- {on: plate, at: [30 mm, 0 mm, 100 mm]}\n"


def bar_with(tmp_path: Path, route: str) -> Path:
    """The bar, its cable from two points inside it to one in space."""
    inside = "- {on: bar, at: [1 mm, 2 mm, 90 mm]}\n        - {on: bar, at: [1 mm, 2 mm, 40 mm]}\n"
    return write_project(tmp_path, (VIA, inside), ("      via:\n", f"      {route}\n      via:\n"))


@pytest.mark.parametrize("route", ["", "route: bore"])
def test_a_cable_follows_its_bore_between_two_points_in_one_body(tmp_path: Path, route: str) -> None:
    project = load(bar_with(tmp_path, route))
    *inside, last = project.robot.cables[0].via_points
    assert len(inside) > 4
    assert {via.on for via in inside} == {"bar"}
    assert last.on == ""  # reached straight
    np.testing.assert_allclose(np.array([via.at for via in inside])[:, :2], [[1e-3, 2e-3]] * len(inside))
    row = next(text for name, text in check(project).rows if name == "cable front")
    assert row.endswith(f"bar ({len(inside)} points) → space")


def test_a_cable_runs_straight_where_asked_to(tmp_path: Path) -> None:
    assert len(load(bar_with(tmp_path, "route: straight")).robot.cables[0].via_points) == 3


def test_there_are_two_routes(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError, match=r"(?s)route.*curved"):
        load(bar_with(tmp_path, "route: curved"))
