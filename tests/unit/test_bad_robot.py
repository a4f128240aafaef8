"""Faults of the robot section: each with its line and key, what was found and what is allowed; all at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robot_case import MANIPULATOR, ROBOT, write_robot

from softcal.errors import MeshError, ProjectFileError
from softcal.geometry.primitives import box_mesh
from softcal.project.project import load
from softcal.twin.build import build_twin
from softcal.twin.joints import hinges
from softcal.twin.robot import Body, Plate, Robot

Change = tuple[str, str]
SOFT = {"youngs_modulus": 1e6, "poissons_ratio": 0.4}


def told(folder: Path, *changes: Change, text: str = ROBOT) -> list[str]:
    with pytest.raises(ProjectFileError) as error:
        load(write_robot(folder, *changes, text=text))
    return [str(fault) for fault in error.value.faults]


ROD = "straight: {start: [0 mm, 0 mm, 82 mm], end: [0 mm, 0 mm, 200 mm]}"
POINTS = "polyline: {points: [[0 mm, 0 mm, 0 mm], [1 mm, 0 mm, 0 mm]]}"
DISC = "    tip:\n      disc: {diameter: 30 mm, thickness: 6 mm, centre: [0 mm, 0 mm, %s mm]}\n      reference"
HELIX = "helix: {base: [0 mm, 0 mm, 84 mm], coil_diameter: 20 mm, turns: 4, "

CASES: dict[str, tuple[Change, tuple[str, ...]]] = {
    "an inertia that no body has": (
        ("mass: 10 g", "mass: 10 g\n      inertia: [1 kg*mm^2, 1 kg*mm^2, 3 kg*mm^2]"),
        ("robot.plates.top.inertia: no rigid body has this inertia", "at most the sum of the others"),
    ),
    "an inertia that is none": (
        ("mass: 10 g", "mass: 10 g\n      inertia: [1 kg*mm^2, 1 kg, 3 kg*mm^2]"),
        ("robot.plates.top.inertia[1]: the unit does not fit; got 'kg'", "converts to kg*m^2"),
    ),
    "an inertia of two rows": (
        ("mass: 10 g", "mass: 10 g\n      inertia: [[1 kg*mm^2, 0, 0], [0, 1 kg*mm^2, 0]]"),
        ("robot.plates.top.inertia", "an entry number 3"),
    ),
    "a hole that does not exist": (
        ("{on: top, hole: a}", "{on: top, hole: d}"),
        ("robot.cables.front.via[1].hole", "no such hole in top", "'d'", "allowed: a, b, c"),
    ),
    "a hole in a plate that does not exist": (
        ("{on: top, hole: a}", "{on: topp, hole: a}"),
        ("via[1].on", "no such plate", "'topp'", "Try: 'top'"),
    ),
    "a hole in a body": (("{on: top, hole: a}", "{on: upper, hole: a}"), ("only plates have holes", "a body", "top")),
    "a hole and a point": (
        ("{on: top, hole: a}", "{on: top, hole: a, at: [0 mm, 0 mm, 0 mm]}"),
        ("via[1]", "position of the point is not specified", "at and hole", "at, or hole"),
    ),
    "a hole of nothing": (
        ("{on: top, hole: a}", "{hole: a}"),
        ("via[1]", "plate of the hole is not specified", "on: PLATE"),
    ),
    "neither hole nor point": (("{on: tip, hole: p1}", "{on: tip}"), ("markers.eye", "neither")),
    "names of holes that do not fit": (
        ("names: [a, b, c]", "names: [a, b]"),
        ("plates.top.holes.ring", "one name for each hole", "got a, b", "3 names"),
    ),
    "a hole in ring and points": (
        ("names: [a, b, c]}", "names: [a, b, c]}, points: {c: [0 mm, 0 mm, 0 mm]}"),
        ("plates.top.holes", "both points and ring", "got c"),
    ),
    "a ring whose zero is along its axis": (
        ("first_angle: 90 deg", "zero: [0, 0, 1]"),
        ("plates.top.holes", "angle zero is along the ring's axis"),
    ),
    "a tie that touches nothing": (
        ("position: [0 mm, 0 mm, 40 mm]", "position: [0 mm, 0 mm, 55 mm]"),
        ("robot.ties.seam", "touches nothing", "the nearest of 9 nodes is 15 mm from lower", "tolerance"),
    ),
    "a tie half off": (
        ("position: [0 mm, 0 mm, 40 mm]", "position: [15 mm, 0 mm, 40 mm]"),
        ("robot.ties.seam", "of 9 nodes of the tie are off lower", "up to"),
    ),
    "a tie to itself": (("on: lower}", "on: upper}"), ("ties.seam.on", "cannot be tied to itself", "upper")),
    "a tie to no body": (("on: lower}", "on: lowr}"), ("ties.seam.on", "'lowr'", "Try: 'lower'")),
    "a tie of no region": (
        ("{body: upper, region: foot", "{body: upper, region: foto"),
        ("ties.seam.region", "'foto'", "Try: 'foot'"),
    ),
    "bodies that overlap": (
        ("position: [0 mm, 0 mm, 40 mm]", "position: [0 mm, 0 mm, 30 mm]"),
        ("robot.bodies.lower", "lower and upper overlap at rest", "points up to 10 mm deep", "touch at most"),
    ),
    "a disc in a body": (
        ("    tip:\n      reference", DISC % 20),
        ("robot.bodies.lower", "lower and tip overlap at rest", "10 mm deep"),
    ),
    "a disc in a disc": (
        ("    tip:\n      reference", DISC % 85),
        ("robot.plates.tip", "tip and top overlap at rest", "2 mm deep"),
    ),
    "a rod nothing holds": (
        ("      clamped: {top: start, tip: end}\n", ""),
        ("robot.rods.mast", "the rod is not attached", "clamped: {PLATE: station}"),
    ),
    "a rod on a plate that does not exist": (
        ("{top: start, tip: end}", "{top: start, tipp: end}"),
        ("rods.mast.clamped.tipp", "no such plate", "Try: 'tip'"),
    ),
    "a station off the rod": (
        ("tip: end}", "tip: 130 mm}"),
        ("rods.mast.clamped.tip", "the station is not on the rod", "got 130 mm", "0 to 118 mm"),
    ),
    "a station without a unit": (("tip: end}", "tip: 130}"), ("rods.mast.clamped.tip", "unit is missing")),
    "a station that is none": (("tip: end}", "tip: middle}"), ("rods.mast.clamped.tip", "'middle'")),
    "one node on two plates": (("{top: start, tip: end}", "{top: start, tip: start}"), ("rods.mast", "clamped twice")),
    "two shapes": ((ROD, f"{ROD}\n      {POINTS}"), ("rods.mast", "one shape", "straight and polyline")),
    "no shape": (("      " + ROD + "\n", ""), ("rods.mast", "one shape", "got none")),
    "a rod without length": (
        ("end: [0 mm, 0 mm, 200 mm]", "end: [0 mm, 0 mm, 82 mm]"),
        ("rods.mast.straight", "ends coincide"),
    ),
    "a helix that climbs twice": (
        (ROD, HELIX + "pitch: 9 mm, height: 36 mm}"),
        ("rods.mast.helix", "the height of the spring is not specified", "pitch and height"),
    ),
    "coils in each other": (
        (ROD, HELIX + "pitch: 3 mm}"),
        ("rods.mast.helix", "coils of the spring overlap", "2.997 mm from wire to wire", "at least the wire's 4 mm"),
    ),
    "a curve with a kink": (
        (ROD, "polyline: {points: [[0 mm, 0 mm, 82 mm], [0 mm, 0 mm, 90 mm], [0 mm, 0 mm, 85 mm]]}"),
        ("rods.mast.polyline", "too coarse", "180 deg"),
    ),
    "a section of no kind": (
        ("section: {diameter: 4 mm}", "section: {diameter: 4 mm, width: 3 mm}"),
        ("rods.mast.section", "not of one kind", "diameter, width", "width and height"),
    ),
    "a section without a key": (
        ("section: {diameter: 4 mm}", "section: {}"),
        ("rods.mast.section", "not of one kind", "nothing", "width and height"),
    ),
    "a section with a mistyped key": (
        ("section: {diameter: 4 mm}", "section: {diametr: 4 mm}"),
        ("rods.mast.section", "not of one kind", "'diameter'"),
    ),
    "half a section": (
        ("section: {diameter: 4 mm}", "section: {width: 4 mm, hight: 4 mm}"),
        ("rods.mast.section.hight", "unknown key", "'height'"),
    ),
    "a section that is a number": (
        ("section: {diameter: 4 mm}", "section: 4 mm"),
        ("rods.mast.section", "wrong kind", "a mapping of keys"),
    ),
    "a tube without a wall": (
        ("section: {diameter: 4 mm}", "section: {diameter: 4 mm, inner_diameter: 5 mm}"),
        ("rods.mast.section", "inner diameter does not fit", "below 0.004 m"),
    ),
    "a ratio of one half": (("poissons_ratio: 0.35", "poissons_ratio: 0.5"), ("rods.mast.poissons_ratio", "0.4999")),
    "a plate on nothing": (
        ("{top: start, tip: end}", "{top: start}"),
        ("robot.plates.tip", "the plate is not attached", "tied or clamped to nothing"),
    ),
    "a plate of half a tie": (
        ("      region: head\n      ref", "      ref"),
        ("plates.top", "only body", "body and region"),
    ),
    "a plate tied twice": (
        ("      region: head\n      ref", "      region: head\n      bodies: {lower: head}\n      ref"),
        ("plates.top", "body and bodies"),
    ),
    "a tie and a plate on one node": (
        ("      region: head\n      ref", "      region: foot\n      ref"),
        ("robot.ties.seam.region", "9 nodes are both on top and tied by seam", "regions that do not overlap"),
    ),
    "a name twice": (
        ("    mast:\n", "    top:\n"),
        ("robot.plates.top", "share a name", "'top', first as rods"),
    ),
    "nothing that does not move": (
        ("      fixed: foot\n", ""),
        ("robot", "the robot is not fixed", "fixed: true in a plate"),
    ),
    "a placement with an axis of no length": (
        ("{axis: [0, 0, 1], angle: 15 deg}", "{axis: [0, 0, 0], angle: 30 deg}"),
        ("robot.bodies.upper.placement.rotation", "direction has no length"),
    ),
    "an angle without a unit": (("angle: 15 deg", "angle: 15"), ("placement.rotation.angle", "unit is missing")),
    "a mass without gravity": (
        ("  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]\n", ""),
        ("robot.loads.weight.mass", "no gravity", "got 0.005 kg", "-9.81 m/s^2"),
    ),
    "a force of a mass": (
        ("force: 0.02 N", "force: 2 g"),
        ("robot.loads.push.force", "unit does not fit", "'g'", "converts to N", "gf for a weight"),
    ),
    "a mass of a force": (("mass: 5 g}", "mass: 5 N}"), ("robot.loads.weight.mass", "'N'", "converts to kg")),
    "a force without direction": (("direction: [0, 2, 0], ", ""), ("loads.push", "no direction", "force: [x, y, z]")),
    "a direction of no length": (
        ("direction: [0, 2, 0]", "direction: [0, 0, 0]"),
        ("loads.push.direction", "no length", "got [0, 0, 0]"),
    ),
    "a direction whose length is lost": (
        ("direction: [0, 2, 0]", "direction: [0, 1e-200, 0]"),
        ("loads.push.direction", "no length", "got [0, 1e-200, 0]"),
    ),
    "a direction twice": (
        ("force: 0.02 N", "force: [0 N, 1 N, 0 N]"),
        ("loads.push", "direction is given twice", "force: 2 N"),
    ),
    "a mass and a force": (("mass: 5 g", "mass: 5 g, force: [1 N, 0 N, 0 N]"), ("loads.weight", "at, force, mass")),
    "a section and sections": (
        ("section: {diameter: 4 mm}", "section: {diameter: 4 mm}\n      sections: []"),
        ("rods.mast", "one kind of section", "section and sections"),
    ),
    "sections that do not reach the end": (
        (
            "section: {diameter: 4 mm}",
            "sections: [{at: start, section: {diameter: 4 mm}}, {at: 50 mm, section: {diameter: 3 mm}}]",
        ),
        ("rods.mast.sections", "do not ascend from one end", "42"),
    ),
    "sections of two kinds": (
        (
            "section: {diameter: 4 mm}",
            "sections: [{at: start, section: {diameter: 4 mm}}, {at: end, section: {width: 3 mm, height: 2 mm}}]",
        ),
        ("rods.mast.sections", "of several kinds", "RoundBar, RectangularBar"),
    ),
    "materials of a rod that overlap": (
        (
            "section: {diameter: 4 mm}",
            "section: {diameter: 4 mm}\n      materials: {a: {between: [start, 60 mm]}, b: {between: [50 mm, 80 mm]}}",
        ),
        ("rods.mast", "elements are of two materials", "a, b"),
    ),
    "a material beyond the end of its rod": (
        (
            "section: {diameter: 4 mm}",
            "section: {diameter: 4 mm}\n      materials: {a: {between: [start, 600 mm]}}",
        ),
        ("rods.mast.materials.a.between", "the station is not on the rod", "600 mm"),
    ),
    "a material of no length": (
        (
            "section: {diameter: 4 mm}",
            "section: {diameter: 4 mm}\n      materials: {a: {between: [50 mm, 50 mm]}}",
        ),
        ("rods.mast.materials.a.between", "the stretch has no length", "50 mm and 50 mm", "two different stations"),
    ),
    "a marker on nothing": (("{on: tip, hole: p1}", "{on: rip, hole: p1}"), ("markers.eye.on", "'rip'", "Try: 'tip'")),
    "a marker in a hole of a rod": (
        ("{on: tip, hole: p1}", "{on: mast, hole: p1}"),
        ("markers.eye.on", "only plates have holes", "'mast', a rod"),
    ),
    "a contact without a gap": (
        ("  gravity: [0", "  contact: {gap: 0 mm}\n  gravity: [0"),
        ("robot.contact.gap", "above 0"),
    ),
    "a contact that is none": (("  gravity: [0", "  contact: soft\n  gravity: [0"), ("robot.contact", "'soft'")),
    "a disc without thickness": (("thickness: 4 mm", "thickness: 0 mm"), ("plates.top.disc.thickness", "above 0")),
}


@pytest.mark.parametrize("case", CASES)
def test_a_robot_with_one_fault(tmp_path: Path, case: str):
    change, pieces = CASES[case]
    faults = told(tmp_path, change)
    assert len(faults) == 1, "one mistake, several faults: " + "\n".join(faults)
    assert faults[0].startswith("project.yaml:")
    for piece in pieces:
        assert piece in faults[0], faults[0]


OWN: dict[str, tuple[Change, tuple[str, ...]]] = {
    "coils that touch": (
        ("turns: 3", "turns: 12"),
        ("robot.manipulator.springs", "coils of the spring overlap", "7.951 mm from wire to wire", "the wire's 9 mm"),
    ),
    "no room": (
        ("total_length: 425 mm", "total_length: 40 mm"),
        ("robot.manipulator.total_length", "no room for springs", "got 40 mm", "more than 42 mm"),
    ),
    "a length that is none": (
        ("wire_diameter: 9 mm", "wire_diameter: 0 mm"),
        ("robot.manipulator.springs.wire_diameter", "out of range", "above 0"),
    ),
    "cables through the springs": (
        ("radius: 25 mm", "radius: 20 mm"),
        ("robot.manipulator.cables.radius", "run through the springs", "at least 21 mm"),
    ),
    "a disc too small": (
        ("diameter: 60 mm", "diameter: 50 mm"),
        ("robot.manipulator.discs.diameter", "do not fit on the disc", "at least 53 mm"),
    ),
    "cables to a disc that is not there": (
        ("S4: 60 deg", "S5: 60 deg"),
        ("robot.manipulator.cables.ends", "disc that is not there", "got 'S5'", "S1 to S4"),
    ),
    "cables to no disc": (("S4: 60 deg", "base: 60 deg"), ("manipulator.cables.ends", "'base'", "S1 to S4")),
    "an unknown spring": (
        ("1.6 GPa", "{spring1: 1 GPa, spring2: 1 GPa, spring3: 1 GPa, spring4: 1 GPa, sprung: 1 GPa}"),
        ("springs.youngs_modulus.sprung", "no such spring"),
    ),
    "springs without modulus": (
        ("1.6 GPa", "{spring1: 1 GPa, spring2: 1 GPa}"),
        ("springs.youngs_modulus", "have no modulus", "spring3, spring4"),
    ),
    "a ratio of one half": (("ratio: 0.43", "ratio: 0.5"), ("manipulator.springs.poissons_ratio", "0.4999")),
    "a hole that does not exist": (
        ("hole: h2", "hole: h7"),
        ("robot.cables.extra.via[1].hole", "no such hole in S3", "'h7'", "h1, h2, h3, h4, h5, h6"),
    ),
    "a name of the manipulator's own": (
        ("    tip: {on", "    S2: {on"),
        ("robot.markers.S2", "share a name", "the manipulator's own"),
    ),
    "too few elements": (
        ("turns: 3", "turns: 3\n      elements_per_turn: 2"),
        ("robot.manipulator.springs.elements_per_turn", "too few elements in a turn", "got 2"),
    ),
    "rings of rods": (
        ("turns: 3", "turns: 3\n      rings: 1"),
        ("springs.rings", "the model 'rod' have no such setting", "allowed: elements_per_turn", "Try: model: solid"),
    ),
    "elements of solid springs": (
        ("turns: 3", "turns: 3\n      model: solid\n      elements_per_turn: 9"),
        ("springs.elements_per_turn", "model 'solid' have no such", "rings, layers_per_turn, element", "model: rod"),
    ),
}


@pytest.mark.parametrize("case", OWN)
def test_a_manipulator_with_one_fault(tmp_path: Path, case: str):
    change, pieces = OWN[case]
    faults = told(tmp_path, change, text=MANIPULATOR)
    assert len(faults) == 1, "one mistake, several faults: " + "\n".join(faults)
    for piece in pieces:
        assert piece in faults[0], faults[0]


def test_all_faults_at_once(tmp_path: Path):
    faults = told(
        tmp_path,
        ("{on: top, hole: a}", "{on: top, hole: d}"),
        ("tip: end}", "tip: 130 mm}"),
        ("position: [0 mm, 0 mm, 40 mm]", "position: [0 mm, 0 mm, 55 mm]"),
        ("mass: 5 g", "mass: 5 N"),
    )
    assert len(faults) == 1, "a wrong unit keeps the section from being read"
    faults = told(
        tmp_path,
        ("{on: top, hole: a}", "{on: top, hole: d}"),
        ("tip: end}", "tip: 130 mm}"),
        ("position: [0 mm, 0 mm, 40 mm]", "position: [0 mm, 0 mm, 55 mm]"),
        ("{on: tip, hole: p1}", "{on: rip, hole: p1}"),
    )
    assert len(faults) == 4
    lines = [int(fault.split(":")[1]) for fault in faults]
    assert lines == sorted(lines)


def test_a_robot_of_nothing(tmp_path: Path):
    (fault,) = told(tmp_path, text="softcal: 1\nname: none\nrobot: {gravity: [0 m/s^2, 0 m/s^2, 0 m/s^2]}\n")
    assert "nothing that bends" in fault


FOOT = "foot: {plane"
EDGE = (FOOT, "edge: {box: {lower: [-11 mm, -11 mm, -1 mm], upper: [-9 mm, 11 mm, 1 mm]}}\n        foot: {plane")
CORNER = (FOOT, "corner: {box: {lower: [-11 mm, -11 mm, 39 mm], upper: [-9 mm, -9 mm, 41 mm]}}\n        foot: {plane")


@pytest.mark.parametrize(
    ("changes", "where", "turns"),
    [
        ((EDGE, ("fixed: foot", "fixed: edge")), "bodies.lower.fixed", "lower"),
        ((EDGE, ("region: foot, on", "region: edge, on")), "ties.seam.", "upper"),
        ((CORNER, ("      region: head", "      region: corner")), "plates.top.", "top"),
    ],
)
def test_a_joint_on_one_line_is_warned_of(tmp_path: Path, changes: tuple[Change, ...], where: str, turns: str):
    (warning,) = load(write_robot(tmp_path, *changes)).warnings
    assert f"robot.{where}" in str(warning)
    assert f"one line, about which nothing but cables and weight holds {turns}" in str(warning)


def test_a_plate_on_a_line_of_each_of_two_bodies_is_not_warned_of(tmp_path: Path):
    """It turns about neither line."""
    lower = box_mesh([20.0, 20.0, 40.0], [2, 2, 3], origin=[-10.0, -10.0, 0.0])
    bodies = [
        Body(name, replace(lower, points=lower.points + [at, 0.0, 0.0]), lower.node_sets["z0"], SOFT, element="P1")
        for name, at in (("left", 0.0), ("right", 30.0))
    ]
    line = np.flatnonzero((lower.points[:, 0] == 0.0) & (lower.points[:, 2] == 40.0))
    plate = Plate("lid", {"left": line, "right": line}, np.array([15.0, 0.0, 40.0]))
    assert hinges(Robot(tuple(bodies), (plate,))) == []
    assert hinges(Robot(tuple(bodies), (replace(plate, nodes={"left": line}),))) == [("lid", "lid")]


def test_a_body_fixed_at_one_node_is_warned_of():
    mesh = box_mesh([20.0, 20.0, 40.0], [2, 2, 3])
    assert hinges(Robot((Body("arm", mesh, np.array([0]), SOFT, element="P1"),))) == [("arm", "arm")]


def test_two_bodies_that_are_tied_to_each_other_are_refused_by_the_names_of_the_ties(tmp_path: Path):
    project = load(write_robot(tmp_path, ("  plates:", "    back: {body: lower, region: head, on: upper}\n  plates:")))
    with pytest.raises(MeshError, match="seam: nodes of upper are tied to nodes of lower that back ties to upper"):
        build_twin(project.robot)


def test_a_rod_through_what_does_not_hold_it_is_warned_of(tmp_path: Path):
    project = load(write_robot(tmp_path, ("[0 mm, 0 mm, 82 mm], end", "[0 mm, 0 mm, 60 mm], end")))
    told = [str(warning) for warning in project.warnings]
    assert len(told) == 1
    assert "robot.rods.mast: the rod runs through upper" in told[0]
    assert "mm deep" in told[0]
