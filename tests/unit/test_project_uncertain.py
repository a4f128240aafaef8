"""The `uncertain` section: what it gives a problem, and what is refused, all of it at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from project_case import PROJECT, write_project

from softcal.errors import ProjectFileError
from softcal.project.project import Project, load
from softcal.workflows.calibration import make_problem

END = PROJECT.rstrip().splitlines()[-1]


def loaded(folder: Path, section: str, *changes: tuple[str, str]) -> Project:
    return load(write_project(folder, (END, f"{END}\nuncertain:\n{section}"), *changes))


def faults(folder: Path, section: str, *changes: tuple[str, str]) -> list[str]:
    with pytest.raises(ProjectFileError) as error:
        loaded(folder, section, *changes)
    return [str(fault) for fault in error.value.faults]


def test_names_patterns_ties_and_nuisances(tmp_path: Path) -> None:
    project = loaded(
        tmp_path,
        """
  front.tension_gain: {sd: 1 %}
  plate.*_offset: {sd: 0.5 deg, per: experiment}
  friction: {sd: 0.02, of: front.friction_*}
""",
    )
    found = {p.label: (p.sd, p.unit, p.source, p.targets) for p in make_problem(project).uncertain}
    assert found == {
        "front.tension_gain": (0.01, "1", "front.tension_gain", ("front.tension_gain",)),
        "plate.pitch_offset[pull]": (
            pytest.approx(0.008726646),
            "rad",
            "plate.*_offset of each experiment",
            ("plate.pitch_offset",),
        ),
        "friction": (0.02, "1", "friction", ("front.friction_coefficient",)),
    }
    assert load(write_project(tmp_path / "without")).uncertain == ()


def test_every_fault_is_found_at_once_and_placed(tmp_path: Path) -> None:
    found = faults(
        tmp_path,
        """
  back.tension_gain: {sd: 0.1}
  front.tension_offset: {sd: 0.1}
  front.friction_coefficient: {sd: 0}
  bar.youngs_modulus: {sd: 0.1 MPa}
  plate.pitch_offset: {sd: 1 deg, per: week}
  noise: {sd: 0.02, of: bar.density}
""",
    )
    places = [fault.split(": ")[1] for fault in found]
    assert set(places) >= {
        "uncertain.back.tension_gain",
        "uncertain.front.tension_offset.sd",
        "uncertain.front.friction_coefficient.sd",
        "uncertain.plate.pitch_offset.per",
        "uncertain.noise",
    }
    told = " ".join(found)
    assert "the standard deviation must be above zero" in told
    assert "unit" in told


def test_names_are_compared_with_those_that_exist(tmp_path: Path) -> None:
    found = faults(tmp_path, "  front.tension_gane: {sd: 0.01}\n  cell: {sd: 0.01, of: [front.gain]}\n")
    assert [fault.split(": ")[1] for fault in found] == ["uncertain.front.tension_gane", "uncertain.cell.of"]
    assert "Try: 'front.tension_gain'" in found[0]


def test_faults_of_the_section_are_found_beside_those_of_the_robot(tmp_path: Path) -> None:
    found = " ".join(faults(tmp_path, "  front.tension_gain: {sd: -1}\n", ("element: P1", "element: P9")))
    assert "uncertain.front.tension_gain.sd" in found
    assert "P9" in found


def test_a_free_parameter_cannot_be_uncertain(tmp_path: Path) -> None:
    (fault,) = faults(tmp_path, "  bar.youngs_modulus: {sd: 0.1 MPa}\n")
    assert "uncertain and free at once" in fault


CLAMP = ("      fixed: foot\n", "      fixed: foot\n      clamp: {direction: [0, 0, 1]}\n")


def test_the_depth_of_a_clamp_is_a_parameter_of_a_body_that_states_one(tmp_path: Path) -> None:
    project = loaded(tmp_path, "  bar.clamp_depth: {sd: 1 mm}\n", CLAMP)
    (depth,) = make_problem(project).uncertain
    assert (depth.label, depth.sd, depth.unit) == ("bar.clamp_depth", 0.001, "m")
    found = " ".join(faults(tmp_path / "without", "  bar.clamp_depth: {sd: 1 mm}\n"))
    assert "uncertain.bar.clamp_depth" in found
    assert "there is no such parameter" in found
    away = (CLAMP[0], CLAMP[1].replace("0, 1]", "0, -1]"))
    found = " ".join(faults(tmp_path / "away", "  bar.clamp_depth: {sd: 1 mm}\n", away))
    assert "robot.bodies.bar.clamp" in found
    assert "no fixed face lies behind the body" in found
