"""What a project file can state is declared once: text with units reads as what Python makes of numbers in SI."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from io import StringIO

import pytest
from ruamel.yaml import YAML

from softcal.declare import Declared
from softcal.errors import InputError, ProjectFileError
from softcal.export.sofa_settings import Engines, Rest, SofaSettings
from softcal.geometry.disc import DiscShape
from softcal.geometry.neck import NeckShape
from softcal.geometry.placement import Placement, Turn
from softcal.geometry.regions import Box, Cylinder, Plane, Sphere
from softcal.geometry.wire import SpringShape
from softcal.materials.infill import PrintInfill
from softcal.project.document import Document, Findings
from softcal.project.mesh_schema import MeshDisc, MeshNeck, MeshSpring
from softcal.project.robot_schema import BodySection, CableSection, ContactSection, DiscSection, PlateSection
from softcal.project.rod_schema import RodSection
from softcal.project.section import Section, validated
from softcal.project.sections import SECTIONS
from softcal.twin.cables import Cable
from softcal.twin.robot import Body, Contact, Disc, Plate, Rod
from softcal.twin.time_settings import Settling, TimeSettings

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
    ("{sofa: {states: 3}}", Engines(SofaSettings(states=3))),
    (
        "{bulk_youngs_modulus: [8 MPa, 12 MPa], infill: 30 %, exponent: [1.2, 1.6]}",
        PrintInfill((8e6, 12e6), 0.3, (1.2, 1.6)),
    ),
    ("{gap: 0.1 mm, stiffness: 2 MPa, friction_coefficient: 0.5, creep: 2 mm/s}", Contact(1e-4, 2e6, 0.5, 2e-3)),
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
    ("{centre: [0 m, 0 m, 1 m], radius: 5 mm}", Sphere((0.0, 0.0, 1.0), 0.005)),
]

# Sections with names to resolve, and what is made of them.
MADE_OF = [
    (BodySection, Body), (RodSection, Rod), (PlateSection, Plate), (DiscSection, Disc), (CableSection, Cable),
    (ContactSection, Contact), (MeshDisc, DiscShape), (MeshNeck, NeckShape), (MeshSpring, SpringShape),
]  # fmt: skip


def read(cls: type[Declared], text: str) -> Declared:
    data = YAML(typ="safe").load(StringIO(text))
    findings = Findings(Document("project.yaml", data, {}))
    found = validated(cls, data, (), findings)
    findings.raise_if_any()
    assert found is not None
    return found


def family(cls: type = Declared) -> set[type]:
    return {one for sub in cls.__subclasses__() for one in (sub, *family(sub)) if one.__module__.startswith("softcal.")}


def required(cls: type) -> set[str]:
    return {f.name for f in fields(cls) if f.default is MISSING and f.default_factory is MISSING}


def test_all_that_is_declared_is_here():
    assert SECTIONS  # whose module imports all of it
    assert family() == {type(made) for _, made in STATED}


@pytest.mark.parametrize(("text", "made"), STATED)
def test_text_with_units_is_what_python_makes_of_numbers(text: str, made: Declared):
    assert read(type(made), text) == made


@pytest.mark.parametrize("cls", sorted(family(), key=lambda cls: cls.__name__))
def test_every_field_is_stated_as_it_is_not_by_default(cls: type):
    told: set[str] = set()
    for text, made in STATED:
        if type(made) is cls:
            given = YAML(typ="safe").load(StringIO(text))
            plain = None if required(cls) else cls()
            told |= {key for key in given if plain is None or getattr(made, key) != getattr(plain, key)}
    assert told == {field.name for field in fields(cls)}


@pytest.mark.parametrize("cls", sorted(family(), key=lambda cls: cls.__name__))
def test_what_is_left_out_is_as_in_python(cls: type):
    if not required(cls):
        assert read(cls, "{}") == cls()


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
        read(Engines, "{sofa: {time_steps: [1 ms, 2 ms], settle: {hold: 1 s, longest: 2 s}}}")
    assert error.value.faults[0].where == "project.yaml:1: sofa.time_steps"
    with pytest.raises(ProjectFileError) as error:
        read(Engines, "{sofa: {ramp: 5 kg, settle: {hold: 2 s, longest: 1 s}}}")
    assert [fault.where for fault in error.value.faults] == ["project.yaml:1: sofa.ramp", "project.yaml:1: sofa.settle"]


@pytest.mark.parametrize(("section", "made"), MADE_OF)
def test_a_section_has_the_defaults_of_what_is_made_of_it(section: type[Section], made: type):
    own = {field.name: field.default for field in fields(made) if isinstance(field.default, float | int | str)}
    given = {
        name: info.default for name, info in section.model_fields.items() if name in own and info.default is not None
    }
    shared = {name: value for name, value in given.items() if not section.model_fields[name].is_required()}
    assert shared
    assert shared == {name: own[name] for name in shared}
