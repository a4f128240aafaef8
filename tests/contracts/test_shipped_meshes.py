"""The meshes of all shipped examples have no slivers, and no body intersects itself or another one at rest."""

from dataclasses import replace
from pathlib import Path

import pytest

from softcal.geometry.quality import check_quality
from softcal.project.project import load
from softcal.twin.build import twin_of
from softcal.twin.robot import Robot

ROOT = Path(__file__).parents[2]
PROJECTS = [
    *(path for path in sorted(ROOT.glob("examples/*/*.yaml")) if "\nrobot:" in path.read_text(encoding="utf-8")),
    *sorted(ROOT.glob("src/softcal/templates/*/project.yaml")),
]


@pytest.fixture(scope="module", params=PROJECTS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def robot(request: pytest.FixtureRequest) -> Robot:
    return load(request.param).robot


def test_a_shipped_mesh_has_no_slivers(robot: Robot):
    for body in robot.bodies:
        report = check_quality(body.mesh)
        assert not report.inverted, body.name
        assert not report.slivers, body.name


def test_a_shipped_robot_intersects_nothing_at_rest(robot: Robot):
    skins = twin_of(replace(robot, contact=None)).skins
    assert skins is None or not skins.at_rest
