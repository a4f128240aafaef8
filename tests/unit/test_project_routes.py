"""Where a project's cables run between their via points."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from project_case import write_project

from softcal.errors import ProjectFileError
from softcal.geometry.primitives import box_mesh
from softcal.project.project import load
from softcal.twin.cables import ViaPoint
from softcal.twin.routing import bored
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
    assert last.on == ""
    along = np.array([via.at for via in inside])
    between = along[along[:, 2] >= 40e-3]
    np.testing.assert_allclose(between[:, :2], [[1e-3, 2e-3]] * len(between))
    assert along[:, 0].max() == pytest.approx(10e-3, abs=2e-3)  # to the face where it leaves the bar, then straight
    row = next(text for name, text in check(project).rows if name == "cable front")
    assert row.endswith(f"bar ({len(inside)} points) → space")


def test_from_a_plate_into_a_body_a_cable_follows_the_body(tmp_path: Path) -> None:
    via = "- {on: plate, at: [1 mm, 2 mm, 100 mm]}\n        - {on: bar, at: [1 mm, 2 mm, 0 mm]}\n"
    first, *inside, last = load(write_project(tmp_path, (VIA, via))).robot.cables[0].via_points
    assert (first.on, last.on) == ("plate", "")
    assert {via.on for via in inside} == {"bar"}
    np.testing.assert_array_less(np.diff([via.at[2] for via in inside]), 0.0)
    assert len(inside) > 10


def test_from_a_body_into_another_one_a_cable_follows_each() -> None:
    """Two halves of a bar, the meshes of which do not match."""
    low, high = (box_mesh((0.01, 0.01, 0.02), (2, 2, n), origin=(0.0, 0.0, z)) for n, z in ((4, 0.0), (5, 0.02)))
    ends = ViaPoint(np.array([0.004, 0.003, 0.039]), "high"), ViaPoint(np.array([0.004, 0.003, 0.001]), "low")
    route = bored(ends, {"low": low, "high": high})
    assert len(route) > 20
    assert {via.on for via in route if via.at[2] > 0.021} == {"high"}
    assert {via.on for via in route if via.at[2] < 0.019} == {"low"}
    np.testing.assert_array_less(np.diff([via.at[2] for via in route]), 0.0)


def warnings(folder: Path, via: str) -> list[str]:
    return [one for one in check(load(write_project(folder, (VIA, via))), solve=False).warnings if "front" in one]


def test_check_warns_of_the_length_that_runs_straight_through_a_body(tmp_path: Path) -> None:
    through = "- {on: plate, at: [1 mm, 2 mm, 100 mm]}\n        - {at: [1 mm, 2 mm, 0 mm]}\n"
    (warning,) = warnings(tmp_path / "a", through)
    length = float(re.search(r"front: ([\d.]+) mm of it run straight through the material of bar", warning)[1])  # type: ignore[index]
    assert length == pytest.approx(100.0, rel=0.06)
    assert "via point on it" in warning
    assert warnings(tmp_path / "b", through.replace("\n", "\n        - {on: bar, at: [1 mm, 2 mm, 50 mm]}\n", 1)) == []


def test_check_states_the_extents(tmp_path: Path) -> None:
    via = "- {on: bar, at: [1 mm, 2 mm, 90 mm], radius: 3 mm}\n        - {on: bar, at: [1 mm, 2 mm, 40 mm]}\n"
    rows = dict(check(load(write_project(tmp_path, (VIA, via))), solve=False).rows)
    assert rows["  extent"] == "force over a radius of 3 mm (stated) at 1 via point, 1 mm (by default) at 1 via point"


def test_a_cable_runs_straight_where_asked_to(tmp_path: Path) -> None:
    assert len(load(bar_with(tmp_path, "route: straight")).robot.cables[0].via_points) == 3


def test_there_are_two_routes(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError, match=r"(?s)route.*curved"):
        load(bar_with(tmp_path, "route: curved"))
