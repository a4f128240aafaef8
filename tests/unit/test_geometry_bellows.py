"""The bellows by its measures: what it encloses, its groups, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softcal.errors import MeshError
from softcal.geometry.bellows import Bellows
from softcal.geometry.quality import check_quality
from softcal.geometry.surface import border
from softcal.mechanics.chamber import ChamberTerm
from softcal.project.project import load
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.chamber import Chamber
from softcal.twin.build import build_twin
from softcal.twin.parameters import robot_parameters
from softcal.twin.robot import Body, Robot

BELLOWS = Bellows(0.030, 0.020, 0.012, 0.0015, 0.003)


def test_its_volumes_are_those_of_the_wave():
    """Pappus: the middle of the wall's length times its thickness times the way around; the cavity by its radius."""
    shape = replace(BELLOWS, layers=12, rings=2, sectors=24)
    mesh = shape.mesh()
    phase = np.linspace(0.0, 2.0 * np.pi, 4001)
    z, middle = phase / (2.0 * np.pi) * shape.pitch, 0.01175 - 0.0025 * np.cos(phase)
    steps, between = np.hypot(np.diff(z), np.diff(middle)), 0.5 * (middle[1:] + middle[:-1])
    wall = shape.folds * 2.0 * np.pi * float(between @ steps) * shape.wall
    cap = np.pi * 0.01**2 * shape.cap
    assert check_quality(mesh).volume == pytest.approx(wall + cap, rel=2e-3)
    body = Body("bellows", mesh, mesh.node_sets["foot"], {"youngs_modulus": 1e6, "poissons_ratio": 0.4})
    robot = Robot((body,), actuators=(NamedActuator("main", Chamber({"bellows": "cavity"})),))
    slope = np.hypot(1.0, np.gradient(middle, z))
    inner_z, inner = z + 0.00075 * np.gradient(middle, z) / slope, middle - 0.00075 / slope
    cavity = shape.folds * float(np.trapezoid(np.pi * inner**2, inner_z))
    assert build_twin(robot).system.of(ChamberTerm)[0].rest_volume == pytest.approx(cavity, rel=2e-3)


@pytest.mark.parametrize("order", [1, 2])
def test_its_groups_are_where_they_are_said_to_be(order):
    mesh = replace(BELLOWS, order=order).mesh()
    report = check_quality(mesh)
    assert (report.order, report.slivers, report.inverted) == (order, (), ())
    np.testing.assert_allclose(mesh.points[mesh.node_sets["foot"], 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(mesh.points[mesh.node_sets["top"], 2], BELLOWS.height, atol=1e-12)
    assert np.hypot(*mesh.points[:, :2].T).max() == pytest.approx(0.015, rel=1e-9)
    (rim,) = border(mesh.face_sets["cavity"])
    np.testing.assert_allclose(np.hypot(*mesh.points[rim[::order], :2].T), 0.0085, rtol=1e-6)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"sectors": 7}, "swept in pairs of sectors; got 7"),
        ({"root_diameter": 0.031}, "a diameter of the bellows does not fit"),
        ({"wall": 0.011}, "a diameter of the bellows does not fit"),
        ({"pitch": 0.006}, r"the wall is too thick for its folds; got 0.0015 m; allowed: < 0.000"),
    ],
)
def test_what_is_no_bellows_is_refused(values, says):
    with pytest.raises(MeshError, match=says):
        replace(BELLOWS, **values)


def test_too_many_tets_are_refused_before_they_are_made():
    with pytest.raises(MeshError, match="tets"):
        replace(BELLOWS, layers=5000, sectors=100).mesh()


def test_the_template_leaves_a_length_uncertain(repository: Path):
    project = load(repository / "src/softcal/templates/bellows/project.yaml")
    assert [(one.name, one.sd) for one in project.uncertain] == [("bellows.wall", 2e-5)]
    known = robot_parameters(project.robot)
    assert {key: known[f"bellows.{key}"].value for key in Bellows.lengths} == {
        key: getattr(BELLOWS, key) for key in Bellows.lengths
    }
