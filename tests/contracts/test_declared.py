"""What a project file can state is declared once: text with units reads as what Python makes of numbers in SI."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from inspect import isabstract
from io import StringIO
from types import NoneType
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from pydantic_core import PydanticUndefined
from ruamel.yaml import YAML

from softcal.calibration.problem.frame import Frame
from softcal.calibration.problem.rig import CommonRig, Pulleys, Rig
from softcal.declare import Declared
from softcal.errors import InputError, ProjectFileError
from softcal.experiments.synchronise import CommonMotion
from softcal.experiments.table_format import ColumnSpec, TableFormat
from softcal.geometry.bellows import Bellows
from softcal.geometry.coil import Coil
from softcal.geometry.disc import GuideHoles, SolidDisc
from softcal.geometry.neck import Neck
from softcal.geometry.obstacle import BoxObstacle, HalfSpace, SphereObstacle
from softcal.geometry.placement import Placement, Turn
from softcal.geometry.regions import Box, Cavity, Cylinder, Plane, Sphere
from softcal.geometry.ring import Ring
from softcal.geometry.rod_shapes import Helix, Polyline, Straight
from softcal.geometry.section import GivenSection, RectangularBar, RoundBar
from softcal.geometry.varied_section import VariedSection
from softcal.geometry.wire import SolidRod, SolidSpring
from softcal.materials.infill import PrintInfill
from softcal.mechanics.path_limits import PathLimits
from softcal.plugins.sofa.settings import Rest, SofaSettings
from softcal.project.bench_schema import BenchFile
from softcal.project.document import Document, Findings
from softcal.project.robot_schema import (
    KINDS,
    BodySection,
    CableSection,
    LoadSection,
    MarkerSection,
    MaterialSection,
    PlateSection,
    RobotSection,
    TieSection,
    ViaSection,
)
from softcal.project.rod_schema import RodMaterialSection, RodSection
from softcal.project.section import Section, validated
from softcal.project.sections import SECTIONS
from softcal.sensing.sensor import ActuatorSensor
from softcal.sensing.sensors.actuators import CableSensor, ChamberSensor, DriveSensor
from softcal.sensing.sensors.pose import MarkerSensor, PlateSensor
from softcal.twin.actuators.chamber import Chamber
from softcal.twin.actuators.drive import Drive
from softcal.twin.barrier import Contact
from softcal.twin.cables import Cable, CableLine, RoutingAxis
from softcal.twin.clamp import Clamp
from softcal.twin.manipulator import BaseDisc, Cables, DiscMarkers, Discs, Manipulator, Springs
from softcal.twin.material import Winding
from softcal.twin.robot import (
    Body,
    Disc,
    Marker,
    Material,
    Moment,
    Plate,
    PointLoad,
    Robot,
    Rod,
    SurfaceLoad,
    Tie,
    ViaPoint,
)
from softcal.twin.time_settings import Settling, TimeSettings

TABLE_TEXT = (
    "delimiter: ';', decimal: ',', header_row: 2, units_row: 3, skip_rows: 1, skip_footer: 4, axes: [y, -x, z], "
    "rest_samples: 5"
)
TABLE: dict[str, Any] = {
    "delimiter": ";",
    "decimal": ",",
    "header_row": 2,
    "units_row": 3,
    "skip_rows": 1,
    "skip_footer": 4,
    "axes": ("y", "-x", "z"),
    "rest_samples": 5,
}
# Of every class: texts that state each of its fields, none as it is by default, and the same in Python.
STATED: list[tuple[str, Declared]] = [
    ("{speed: 2 um/s, hold: 50 ms, longest: 8 s, on: plate}", Settling(2e-6, 0.05, 8.0, "plate")),
    (
        "{time_step: 20 ms, rayleigh_stiffness: 50 ms, rayleigh_mass: 0.2 1/s, scheme: one-solve, damping: strain, "
        "masses: lumped, start: undeformed, ramp: 1 min, hold: 0 s}",
        TimeSettings(0.02, 0.05, 0.2, "one-solve", "strain", "lumped", "undeformed", 60.0, 0.0),
    ),
    ("{settle: {longest: 1 h}}", TimeSettings(settle=Settling(longest=3600.0))),
    ("{speed: 1 mm/min, hold: 20 ms, longest: 2 s}", Rest(1e-3 / 60.0, 0.02, 2.0)),
    (
        "{timeout: 10 min, states: 6, time_steps: [20 ms, 4 ms], rayleigh_stiffness: 10 ms, rayleigh_mass: 3 1/s, "
        "ramp: 20 ms, settle: {hold: 50 ms}}",
        SofaSettings(600.0, 6, (0.02, 0.004), 0.01, 3.0, 0.02, Rest(hold=0.05)),
    ),
    ("{time_steps: 1 ms}", SofaSettings(time_steps=(0.001,))),
    (
        "{bulk_youngs_modulus: [8 MPa, 12 MPa], infill: 30 %, exponent: [1.2, 1.6]}",
        PrintInfill((8e6, 12e6), 0.3, (1.2, 1.6)),
    ),
    (
        "{gap: 0.1 mm, stiffness: 2 MPa, friction_coefficient: 0.5, creep: 2 mm/s, depth: 0.2 mm}",
        Contact(1e-4, 2e6, 0.5, 2e-3, 2e-4),
    ),
    ("{friction_coefficient: 0.5}", Contact(friction_coefficient=0.5)),
    (
        "{factorisations: 400, creeping: 300, failing: 200, cpu_time: 1 min}",
        PathLimits(400, 300, 200, 60.0),
    ),
    (
        "{stiffness: 10 kN, compliance: 0.01 mm/N, pretension: 2 N, friction_memory: true, presliding: 1 mm, "
        "friction_preload: 1 N, friction_speed: 1 m/s}",
        CableLine(
            1e4, None, 1e-5, 2.0, friction_memory=True, presliding=1e-3, friction_preload=1.0, friction_speed=1.0
        ),
    ),
    ("{spring_rate: 20 N/mm, rest_length: 99 mm}", CableLine(spring_rate=2e4, rest_length=0.099)),
    (
        "{angle: 0.5 rad, point: [1 mm, 0 m, 0 m], direction: [0, 2, 0]}",
        Winding(0.5, (0.001, 0.0, 0.0), (0.0, 2.0, 0.0)),
    ),
    ("{point: [1 mm, 0 m, 0 m], direction: [0, 2, 0]}", RoutingAxis((0.001, 0.0, 0.0), (0.0, 2.0, 0.0))),
    ("{point: [0 mm, 0 mm, -1 cm], normal: [0, 0, 2]}", HalfSpace((0.0, 0.0, -0.01), (0.0, 0.0, 1.0))),
    ("{centre: [1 mm, 2 cm, 0 m], radius: 8 mm}", SphereObstacle((0.001, 0.02, 0.0), 0.008)),
    ("{lower: [0 mm, 0 mm, 0 mm], upper: [1 mm, 1 cm, 1 m]}", BoxObstacle((0.0, 0.0, 0.0), (0.001, 0.01, 1.0))),
    ("{direction: [0, 0, 2], depth: 0.5 mm}", Clamp((0.0, 0.0, 1.0), 5e-4)),
    ("{x: 1 mm, y: 2 mm, z: 3 mm, rx: 0.1 rad, ry: 0.2 rad, rz: 0.3 rad}", Frame(1e-3, 2e-3, 3e-3, 0.1, 0.2, 0.3)),
    ("{pulleys: {wrap: 2 rad}, length: 425 mm}", CommonRig(pulleys=Pulleys(wrap=2.0), length=0.425)),
    (
        "{pulleys: {wrap: 2 rad}, length: 425 mm, slack: 2 mm, backlash: 1 mm, "
        "tension_offset: 0.1 N, angle_offsets: {pitch: 0.1 rad}, "
        "frame: {x: 1 m}}",
        Rig(
            pulleys=Pulleys(wrap=2.0),
            length=0.425,
            slack=0.002,
            backlash=0.001,
            tension_offset=0.1,
            angle_offsets={"pitch": 0.1},
            frame=Frame(x=1.0),
        ),
    ),
    (
        "{max_lag: 2 s, reference: tension, signal: roll, estimate_rate: false, min_correlation: 90 %}",
        CommonMotion(2.0, "tension", "roll", False, 0.9),
    ),
    ("{name: Force, unit: kN, scale: -1}", ColumnSpec("Force", "kN", -1.0)),
    (f"{{{TABLE_TEXT}}}", TableFormat(**TABLE)),
    (
        f"{{{TABLE_TEXT}, path: a.csv, columns: {{tension: {{name: Force}}}}, markers: [m4], where: {{Speed: [2]}}}}",
        BenchFile(
            **TABLE,
            path="a.csv",
            columns={"tension": ColumnSpec("Force")},
            markers={"m4": "m4"},
            where={"Speed": [2]},
        ),
    ),
    ("{diameter: 4 mm, inner_diameter: 2 mm}", RoundBar(0.004, 0.002)),
    ("{width: 4 mm, height: 2 mm}", RectangularBar(0.004, 0.002)),
    (
        "{area: 2 mm^2, I1: 3e-12 m^4, I2: 4e-12 m^4, J: 5e-12 m^4, shear_coefficients: [0.8, 0.9]}",
        GivenSection(2e-6, 3e-12, 4e-12, 5e-12, (0.8, 0.9)),
    ),
    (
        "{count: 3, wrap: 2 rad, friction_coefficient: 0.1, friction_memory: true, presliding: 1 mm}",
        Pulleys(count=3, wrap=2.0, friction_coefficient=0.1, friction_memory=True, presliding=1e-3),
    ),
    ("{axis: [0, 0, 2], angle: 90 deg}", Turn((0.0, 0.0, 2.0), math.radians(90.0))),
    (
        "{position: [1 mm, 2 cm, 0 m], rotation: {axis: [1, 0, 0], angle: 1 rad}}",
        Placement((0.001, 0.02, 0.0), (Turn((1.0, 0.0, 0.0), 1.0),)),
    ),
    ("{lower: [0 mm, 0 mm, 0 mm], upper: [1 mm, 2 cm, 3 m]}", Box((0.0, 0.0, 0.0), (0.001, 0.02, 3.0))),
    (
        "{point: [0 m, 0 m, 1 m], normal: [0, 1, 0], tolerance: 1 um, side: above}",
        Plane((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), 1e-6, "above"),
    ),
    (
        "{start: [0 m, 0 m, 0 m], end: [0 m, 0 m, 1 m], radius: 5 mm}",
        Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.005),
    ),
    (
        "{at: [1 mm, 0 m, 0 m], openings: [{point: [0 m, 0 m, 1 m], normal: [0, 1, 0]}]}",
        Cavity((0.001, 0.0, 0.0), (Plane((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),)),
    ),
    ("{centre: [0 m, 0 m, 1 m], radius: 5 mm}", Sphere((0.0, 0.0, 1.0), 0.005)),
    (
        "{start: [0 m, 0 m, 0 m], end: [0 m, 0 m, 1 m], first: [1, 0, 0]}",
        Straight((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
    ),
    (
        "{base: [0 m, 0 m, 1 m], axis: [0, 1, 0], towards: [1, 0, 0], coil_diameter: 5 cm, turns: 3, pitch: 1 cm, "
        "left_handed: true}",
        Helix(
            base=(0.0, 0.0, 1.0),
            axis=(0.0, 1.0, 0.0),
            towards=(1.0, 0.0, 0.0),
            coil_diameter=0.05,
            turns=3.0,
            pitch=0.01,
            left_handed=True,
        ),
    ),
    (
        "{base: [0 m, 0 m, 0 m], coil_diameter: 5 cm, turns: 3, height: 1 cm}",
        Helix(base=(0.0, 0.0, 0.0), coil_diameter=0.05, turns=3.0, height=0.01),
    ),
    (
        "{points: [[0 m, 0 m, 0 m], [0 m, 0 m, 1 m]], first: [1, 0, 0]}",
        Polyline(((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), (1.0, 0.0, 0.0)),
    ),
    ("{count: 3, diameter: 2 mm, radius: 1 cm, first_angle: 1 rad}", GuideHoles(3, 0.002, 0.01, 1.0)),
    (
        "{diameter: 5 cm, thickness: 1 cm, centre_hole: 2 mm, holes: {count: 3, diameter: 2 mm, radius: 1 cm}, "
        "size: 3 mm, order: 1}",
        SolidDisc(0.05, 0.01, 0.002, GuideHoles(3, 0.002, 0.01), size=0.003, order=1),
    ),
    ("{diameter: 5 cm, thickness: 1 cm, tets: 900}", SolidDisc(0.05, 0.01, tets=900)),
    (
        "{outer_diameter: 4 cm, root_diameter: 3 cm, pitch: 12 mm, wall: 1 mm, cap: 2 mm, folds: 2, layers: 6, "
        "rings: 2, sectors: 8, order: 1}",
        Bellows(0.04, 0.03, 0.012, 0.001, 0.002, 2, 6, 2, 8, 1),
    ),
    ("{length: 5 cm, diameter: 1 cm, layers: 9, rings: 2, order: 1}", SolidRod(0.05, 0.01, 9, 2, 1)),
    (
        "{wire_diameter: 2 mm, coil_diameter: 5 cm, turns: 3, pitch: 1 cm, left_handed: true, layers_per_turn: 9, "
        "rings: 2, order: 1}",
        SolidSpring(
            wire_diameter=0.002,
            coil_diameter=0.05,
            turns=3.0,
            pitch=0.01,
            left_handed=True,
            layers_per_turn=9,
            rings=2,
            order=1,
        ),
    ),
    (
        "{wire_diameter: 2 mm, coil_diameter: 5 cm, turns: 3, height: 3 cm}",
        SolidSpring(wire_diameter=0.002, coil_diameter=0.05, turns=3.0, height=0.03),
    ),
    (
        "{outer_diameter: 4 cm, n_bells: 3, bottom_link_height: 25 mm, link_pitch: 2 cm, dome_height: 1 cm, "
        "dome: [[10 %, 0.3], [0.5, 0.9]], "
        "waist_diameter: 21 mm, collar_diameter: 22 mm, collar_height: 8 mm, clamp_depth: 12 mm, waist_refinement: 3, "
        "sectors: 6, tets: 900, order: 1}",
        Neck(
            0.04, 3, 0.025, 0.02, 0.01, ((0.1, 0.3), (0.5, 0.9)), 0.021, 0.022, 0.008, 0.012, 3.0, 6, tets=900, order=1
        ),
    ),
    ("{size: 6 mm}", Neck(size=0.006)),
    ("{actuator: front}", ActuatorSensor("front")),
    ("{actuator: front}", CableSensor("front")),
    ("{actuator: main}", ChamberSensor("main")),
    (
        "{walls: {finger: cavity}, dead_volume: 6 ml, hose_compliance: 2 mm^3/kPa, polytropic_exponent: 1.2}",
        Chamber({"finger": "cavity"}, "gas", 6e-6, 2e-12, 1.2),
    ),
    ("{walls: {finger: cavity}, medium: liquid}", Chamber({"finger": "cavity"}, "liquid")),
    ("{actuator: servo}", DriveSensor("servo")),
    ("{cables: {left: 1, right: -80 %}, radius: 8 mm}", Drive({"left": 1.0, "right": -0.8}, 8e-3)),
    (
        "{cables: {left: 1}, radius: 8 mm, gear_ratio: -5, spring_rate: 5 N/mm, pretension: 1 N, "
        "gear_backlash: 0.1 rad, zero: 90 deg}",
        Drive({"left": 1.0}, 8e-3, -5.0, 5e3, 1.0, 0.1, np.pi / 2.0),
    ),
    (
        "{cables: {left: 1}, radius: 8 mm, rotor_inertia: 2e-6 kg*m^2}",
        Drive({"left": 1.0}, 8e-3, rotor_inertia=2e-6),
    ),
    ("{marker: m4}", MarkerSensor("m4")),
    ("{plate: top}", PlateSensor("top")),
    ("{diameter: 9 cm, thickness: 2 mm}", BaseDisc(0.09, 0.002)),
    ("{diameter: 9 cm, thickness: 2 mm, hole_diameter: 4 mm, mass: 3 kg}", Discs(0.09, 0.002, 0.004, 3.0)),
    (
        "{youngs_modulus: {spring1: 2 GPa, spring2: 3 Pa}, poissons_ratio: 0.4, density: 900 kg/m^3, "
        "wire_diameter: 5 mm, coil_diameter: 5 cm, turns: 4, left_handed: true, azimuth: 1 rad, model: solid, "
        "rings: 2, layers_per_turn: 9, element: P2}",
        Springs(
            youngs_modulus={"spring1": 2e9, "spring2": 3.0},
            poissons_ratio=0.4,
            density=900.0,
            wire_diameter=0.005,
            coil_diameter=0.05,
            turns=4.0,
            left_handed=True,
            azimuth=1.0,
            model="solid",
            rings=2,
            layers_per_turn=9,
            element="P2",
        ),
    ),
    (
        "{youngs_modulus: 1 GPa, poissons_ratio: 0.4, elements_per_turn: 20}",
        Springs(youngs_modulus=1e9, poissons_ratio=0.4, elements_per_turn=20),
    ),
    (
        "{radius: 3 cm, ends: {S1: 1 rad}, per_end: 2, exit: 3 mm, friction_coefficient: 0.1, line: {stiffness: 9 N}}",
        Cables(0.03, {"S1": 1.0}, 2, 0.003, 0.1, CableLine(9.0)),
    ),
    ("{radius: 1 cm, azimuth: 2 rad}", DiscMarkers(0.01, 2.0)),
    (
        "{count: 2, radius: 2 cm, first_angle: 1 rad, names: [a, b], centre: [0 m, 0 m, 1 m], axis: [0, 1, 0], "
        "zero: [0, 0, 1]}",
        Ring(2, 0.02, 1.0, ("a", "b"), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    ),
    (
        "{diameter: 6 cm, thickness: 8 mm, axis: [0, 3, 4], centre: [1 mm, 0 m, 2 cm], hole_diameter: 3 mm}",
        Disc(0.06, 0.008, np.array([0.0, 3.0, 4.0]), np.array([0.001, 0.0, 0.02]), 0.003),
    ),
    (
        "{total_length: 30 cm, sections: 2, hanging: false, base: {diameter: 9 cm}, discs: {mass: 1 kg}, "
        "springs: {youngs_modulus: 1 GPa, poissons_ratio: 0.4}, cables: {ends: {S2: 0 deg}}, markers: {radius: 0 m}}",
        Manipulator(
            total_length=0.3,
            sections=2,
            hanging=False,
            base=BaseDisc(0.09),
            discs=Discs(mass=1.0),
            springs=Springs(youngs_modulus=1e9, poissons_ratio=0.4),
            cables=Cables(ends={"S2": 0.0}),
            markers=DiscMarkers(0.0),
        ),
    ),
]

# Sections with names to resolve, what is made of them, and the fields that they state otherwise.
MADE_OF = [
    (MaterialSection, Material, set()),
    (BodySection, Body, {"mesh", "shape", "fixed", "history"}),
    (RodSection, Rod, {"section", "clamped", "fixed", "history", "law"}),
    (RodMaterialSection, Material, {"between"}),
    (PlateSection, Plate, {"holes"}),
    (TieSection, Tie, set()),
    (ViaSection, ViaPoint, set()),
    (CableSection, Cable, set()),
    (MarkerSection, Marker, set()),
    (LoadSection, PointLoad, {"force"}),
    (LoadSection, Moment, {"moment"}),
    (LoadSection, SurfaceLoad, set()),
    (
        RobotSection,
        Robot,
        {*KINDS, "contact", "limits", "actuator_limits"},
    ),
]


def read(cls: type[Declared], text: str) -> Declared:
    data = YAML(typ="safe").load(StringIO(text))
    findings = Findings(Document("project.yaml", data, {}))
    found = validated(cls, data, (), findings)
    findings.raise_if_any()
    assert found is not None
    return found


def descendants(cls: type = Declared) -> set[type]:
    return {one for sub in cls.__subclasses__() for one in (sub, *descendants(sub))}


def family() -> set[type]:
    """What a mapping of a project file is read into: no bases, nothing of several mappings, and nothing of the tests'
    own.
    """
    return {one for one in descendants() if one.__module__.startswith("softcal.") and not isabstract(one)} - {
        Coil,
        VariedSection,
    }


def plain(cls: type[Declared]) -> Declared | None:
    """The class as it is by default; None where something must be stated."""
    if any(field.default is MISSING and field.default_factory is MISSING for field in fields(cls)):
        return None
    try:
        return cls()
    except InputError:
        return None


def test_all_that_is_declared_is_here():
    assert SECTIONS  # whose module imports all of it
    assert family() == {type(made) for _, made in STATED}


@pytest.mark.parametrize(("text", "made"), STATED)
def test_text_with_units_is_what_python_makes_of_numbers(text: str, made: Declared):
    np.testing.assert_equal(vars(read(type(made), text)), vars(made))


@pytest.mark.parametrize("cls", sorted(family(), key=lambda cls: cls.__name__))
def test_every_field_is_stated_as_it_is_not_by_default(cls: type):
    told: set[str] = set()
    for text, made in STATED:
        if type(made) is cls:
            given = YAML(typ="safe").load(StringIO(text))
            usual = plain(cls)
            told |= {key for key in given if usual is None or repr(getattr(made, key)) != repr(getattr(usual, key))}
    assert told == {field.name for field in fields(cls)}


@pytest.mark.parametrize("cls", sorted(family(), key=lambda cls: cls.__name__))
def test_what_is_left_out_is_as_in_python(cls: type):
    if usual := plain(cls):
        np.testing.assert_equal(vars(read(cls, "{}")), vars(usual))


@pytest.mark.parametrize("cls", sorted(family(), key=lambda cls: cls.__name__))
def test_a_slip_in_a_key_is_told_with_the_nearest(cls: type):
    name = fields(cls)[-1].name
    with pytest.raises(ProjectFileError) as error:
        read(cls, f"{{{name}x: 5}}")
    assert any("unknown key" in fault.what and f"'{name}'" in fault.attempt for fault in error.value.faults)


def test_a_number_out_of_range_is_refused_alike_by_the_name_of_its_field():
    with pytest.raises(InputError) as here:
        TimeSettings(time_step=0.0, rayleigh_mass=float("nan"))
    with pytest.raises(ProjectFileError) as there:
        read(TimeSettings, "{time_step: 0 s, rayleigh_mass: -1 1/s}")
    assert [fault.where for fault in here.value.faults] == ["time_step", "rayleigh_mass"]
    assert [fault.where for fault in there.value.faults] == [
        "project.yaml:1: time_step",
        "project.yaml:1: rayleigh_mass",
    ]
    assert [(one.what, one.allowed) for one in here.value.faults] == [
        (one.what, one.allowed) for one in there.value.faults
    ]


def test_what_python_refuses_stands_at_its_key():
    with pytest.raises(ProjectFileError) as error:
        read(SofaSettings, "{time_steps: [1 ms, 2 ms], settle: {hold: 1 s, longest: 2 s}}")
    assert error.value.faults[0].where == "project.yaml:1: time_steps"
    with pytest.raises(ProjectFileError) as error:
        read(SofaSettings, "{ramp: 5 kg, settle: {hold: 2 s, longest: 1 s}}")
    assert [fault.where for fault in error.value.faults] == ["project.yaml:1: ramp", "project.yaml:1: settle"]


@pytest.mark.parametrize(("section", "made", "otherwise"), MADE_OF)
def test_a_section_has_the_kinds_and_defaults_of_what_is_made_of_it(
    section: type[Section], made: type, otherwise: set[str]
):
    theirs, ours = get_type_hints(section, include_extras=True), get_type_hints(made, include_extras=True)
    shared = theirs.keys() & ours.keys() - otherwise
    assert shared
    for name in shared:
        # What may be left out of a file, and is then chosen or not there, is None.
        assert some(theirs[name]) == some(ours[name]), name
    own = {field.name: field.default for field in fields(made)}
    given = {name: info.default for name, info in section.model_fields.items() if not info.is_required()}
    for name in shared & given.keys():
        assert given[name] == own[name] or given[name] in (None, PydanticUndefined), name


def some(hint: object) -> object:
    """An annotation without None."""
    kinds = [one for one in get_args(hint) if one is not NoneType]
    return kinds[0] if NoneType in get_args(hint) and len(kinds) == 1 else hint
