"""The meshes of all shipped examples are sound: no slivers, and no body intersects itself or another one at rest."""

from dataclasses import replace
from pathlib import Path

import pytest

from softcal.geometry.quality import check_quality
from softcal.project.project import load
from softcal.twin.build import twin_of

ROOT = Path(__file__).parents[2]
PROJECTS = [
    *(path for path in sorted(ROOT.glob("examples/*/*.yaml")) if "\nrobot:" in path.read_text(encoding="utf-8")),
    *sorted(ROOT.glob("src/softcal/templates/*/project.yaml")),
]


@pytest.mark.parametrize("path", PROJECTS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_a_shipped_robot_has_sound_meshes_and_intersects_nothing_at_rest(path: Path):
    robot = replace(load(path).robot, contact=None)
    for body in robot.bodies:
        report = check_quality(body.mesh)
        assert not report.inverted, body.name
        assert not report.slivers, body.name
    skins = twin_of(robot).skins
    assert skins is None or not skins.at_rest
