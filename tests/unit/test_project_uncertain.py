"""The `uncertain` section: what it gives a problem, and what is refused, all of it at once."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import pytest
from project_case import PROJECT, write_project

from softcal.calibration.problem.frame import FRAME
from softcal.errors import ProjectFileError
from softcal.geometry.shape import LENGTHS
from softcal.mechanics.tensions import BY_LENGTH, KINDS
from softcal.project.project import Project, load
from softcal.project.search import quantity_of
from softcal.quantities import GRAVITY
from softcal.sensing.channel import readings
from softcal.twin.parameters import MARKER_OFFSETS
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


DRAWN = ("      element: P1\n", "      element: P1\n      shape: drawn\n")


def test_the_shape_of_a_mesh_is_stated_for_its_lengths_to_be_parameters(tmp_path: Path) -> None:
    section = "  bar.scale: {sd: 1 %}\n  bar.wall_offset: {sd: 0.1 mm}\n"
    project = loaded(tmp_path, section, DRAWN)
    found = {p.label: (p.sd, p.unit) for p in make_problem(project).uncertain}
    assert found == {"bar.scale": (0.01, "1"), "bar.wall_offset": (pytest.approx(1e-4), "m")}
    assert "there is no such parameter" in " ".join(faults(tmp_path / "without", section))


@pytest.mark.parametrize(
    ("shape", "told"),
    [
        ("as drawn", "bar.shape: there is no such shape; got 'as drawn'; allowed: 'drawn', or a primitive"),
        ("{outer_diameter: 38 mm}", "bar.shape: there is no such shape"),
        ("{primitive: box}", "bar.shape: there is no such primitive; got 'box'"),
        ("{primitive: neck, outer: 38 mm}", "bar.shape.outer: unknown key"),
        (
            "{primitive: spring, wire_diameter: 2 mm, coil_diameter: 12 mm, turns: 2, pitch: 6 mm}",
            "bar.shape: no length of this primitive can be a parameter",
        ),
        (
            "{primitive: rod, length: 90 mm, diameter: 28.3 mm}",
            "bar.shape: the mesh does not have the shape that is stated for it; got height 100 mm; allowed: height 90",
        ),
    ],
)
def test_a_shape_that_is_not_the_mesh_s_is_refused(tmp_path: Path, shape: str, told: str) -> None:
    change = (DRAWN[0], DRAWN[1].replace("drawn", shape))
    assert any(told in fault for fault in faults(tmp_path, "  bar.density: {sd: 20 kg/m^3}\n", change))


def test_the_lengths_of_a_primitive_are_parameters_without_more(tmp_path: Path) -> None:
    rod = ("{file: bar.msh, unit: mm}", "{primitive: rod, length: 100 mm, diameter: 20 mm}")
    head = ("region: head", "region: end")
    group = ("        head: {group: z1}\n", "")
    project = loaded(tmp_path, "  bar.diameter: {sd: 0.1 mm}\n", rod, head, group)
    (diameter,) = make_problem(project).uncertain
    assert (diameter.label, diameter.unit) == ("bar.diameter", "m")
    assert project.robot.bodies[0].shape is not None
    assert dict(project.robot.bodies[0].shape.values) == {"length": 0.1, "diameter": 0.02}


PAGE = (Path(__file__).parents[2] / "docs" / "project-file.md").read_text(encoding="utf-8")


def test_the_table_of_the_rig_has_every_parameter_with_its_unit() -> None:
    table = PAGE.partition("| parameter | unit | what it does | as a rule |")[2].partition("\n\n")[0]
    rows = [[cell.strip() for cell in line.split(" | ")] for line in table.splitlines()[2:]]
    found: dict[str, str] = {}
    for names, unit, *_ in rows:
        first, *others = re.findall(r"`([\w.]+)`", names)
        found |= dict.fromkeys([first, *(first.rpartition(".")[0] + other for other in others)], unit)
    for name, unit in found.items():
        kind = quantity_of(name)
        assert kind is not None, name
        assert kind.unit == unit, name
    of_rig = {
        *readings(),
        *(name.partition(".")[2] for name in (*FRAME, *GRAVITY)),
        *MARKER_OFFSETS,
        "routing_offset",
        "routing_angle",
        "routing_twist",
        "clamp_depth",
        *LENGTHS,
        *KINDS,  # of a cable's line
        *BY_LENGTH,
        "backlash",
    }
    assert {name.rpartition(".")[2] for name in found} == of_rig


def test_the_documented_section_can_be_loaded(tmp_path: Path) -> None:
    block = PAGE.partition("    uncertain:\n")[2].partition("\n\n")[0]
    rig = ("experiments:\n", "rig: {pulleys: {count: 2, wrap: 180 deg, friction_coefficient: 0.1}}\nexperiments:\n")
    marker = ("  cables:\n", "  markers:\n    m1: {on: plate, at: [0 mm, 0 mm, 100 mm]}\n  cables:\n")
    section = textwrap.indent(textwrap.dedent(block), "  ").replace("neck", "bar").replace("outer_diameter", "scale")
    project = loaded(tmp_path, section.replace("0.1 mm", "1 %") + "\n", CLAMP, DRAWN, rig, marker)
    assert {p.name.partition(".")[2] or p.name for p in project.uncertain} == {
        *("tension_gain", "tension_drift", "friction_coefficient", "pitch_offset", "x_offset", "clamp_depth", "scale"),
        "density",
    }
