"""The history of a material in a project file: its keys, its parameters, the times it needs, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from project_case import write_project
from robot_case import write_robot

from softcal import load
from softcal.calibration.problem.observation import protocol_told
from softcal.errors import ParameterError, ProjectFileError
from softcal.plugins.calculix.deck import deck_faults
from softcal.plugins.sofa.robot import linear_robot
from softcal.twin.parameters import robot_parameters
from softcal.twin.simulate import simulate
from softcal.twin.solid_rods import with_solid_rods
from softcal.workflows.checking import check

MODULI = "      youngs_modulus: 2 MPa\n      poissons_ratio: 0.42\n"
HISTORY = (
    f"{MODULI}      history: [relaxation-1, softening]\n      relaxing_share1: 0.3\n      relaxation_time1: 2 s\n"
    "      softening_amount: 2\n      softening_energy: 10 kPa\n"
)
FREE = "  bar.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}\n"
RELAXES = ((MODULI, HISTORY), (FREE, f"{FREE}  bar.relaxing_share1: {{bounds: [0, 0.9]}}\n"))


def test_its_constants_are_parameters_and_its_times_those_of_the_record(tmp_path: Path) -> None:
    project = load(write_project(tmp_path, *RELAXES))
    known = robot_parameters(project.robot)
    assert known["bar.relaxation_time1"].value == 2.0
    assert known["bar.softening_range"].value == 0.0  # by default
    assert project.robot.remembers
    assert project.robot.needs_time
    (experiment,) = project.experiments.values()
    protocol = protocol_told(project.robot, experiment, experiment.rig_values())
    assert protocol.times is not None
    np.testing.assert_array_equal(protocol.times, experiment.dataset.values("time"))
    at_once, long = (simulate(project.robot, p) for p in (protocol, type(protocol)(protocol.commands)))
    assert at_once.channels["front.tension"].max() > 1.02 * long.channels["front.tension"].max()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("[relaxation-1,", "[relaxing,"), r"no such part of a history; got 'relaxing'.*Try: 'relaxation-"),
        (
            ("[relaxation-1, softening]", "[relaxation-1, relaxation-2, softening]"),
            r"a history can have only one part of this kind",
        ),
        (("      relaxing_share1: 0.3\n", ""), r"bar\.relaxing_share1: .*missing"),
        (("relaxing_share1: 0.3", "relaxing_share1: 1.2"), r"bar\.relaxing_share1: the relaxing share is out of range"),
        (("relaxation_time1: 2 s", "relaxation_time1: 2 mm"), r"bar\.relaxation_time1: the unit does not fit"),
        (("history: [relaxation-1, softening]", "history: softening"), r"bar\.relaxing_share1: unknown key"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, change: tuple[str, str], told: str) -> None:
    assert change[0] in HISTORY
    with pytest.raises(ProjectFileError, match=told):
        load(write_project(tmp_path, (MODULI, HISTORY.replace(*change))))


def test_a_record_without_time_is_refused(tmp_path: Path) -> None:
    untimed = ("          time: {name: Time}\n", "")
    with pytest.raises(ProjectFileError, match=r"needs the time of every sample; got no time.*Try: columns: {time: "):
        load(write_project(tmp_path, *RELAXES, untimed))


def test_other_programs_get_no_history(tmp_path: Path) -> None:
    robot = load(write_project(tmp_path, *RELAXES)).robot
    with pytest.raises(ParameterError, match=r"bar\.history: the history of a material is not exported to SOFA"):
        linear_robot(robot)
    assert any("not exported to CalculiX" in fault.what for fault in deck_faults(robot))


# Rods.

ROD_HISTORY = (
    "      poissons_ratio: 0.35\n      history: [relaxation-1, flow-at-once]\n      relaxing_share1: 30 %\n"
    "      relaxation_time1: 2 s\n      flow_modulus: 100 MPa\n      flow_threshold: 200 kPa\n"
    "      materials: {upper: {between: [60 mm, end], flow_threshold: 300 kPa}}\n"
)
WITH_ROD = ("      poissons_ratio: 0.35\n", ROD_HISTORY)


def test_a_rod_has_a_history_and_its_stretches_constants_of_their_own(tmp_path: Path) -> None:
    project = load(write_robot(tmp_path, WITH_ROD))
    known = robot_parameters(project.robot)
    assert known["mast.relaxing_share1"].value == 0.3
    assert known["mast.upper.flow_threshold"].value == 3e5
    assert known["mast.upper.relaxation_time1"].value == 2.0
    assert "mast.flow_time" not in known
    assert project.robot.remembers
    assert project.robot.needs_time
    rows = [row for row in check(project).rows if row[0].startswith("  ")][-3:]
    constants = "E 1 GPa, ν 0.35, g1 0.3, τ1 2 s, μ_f 100 MPa, Y {}, 900 kg/m³"
    assert ("  history", "relaxation-1, flow-at-once") in rows
    assert ("  material", constants.format("200 kPa")) in rows
    assert dict(rows)["  material of upper"].endswith(constants.format("300 kPa"))


def test_flow_at_once_needs_no_time(tmp_path: Path) -> None:
    text = ROD_HISTORY.replace("[relaxation-1, flow-at-once]", "flow-at-once")
    text = "".join(line for line in text.splitlines(keepends=True) if "relax" not in line)
    robot = load(write_robot(tmp_path, ("      poissons_ratio: 0.35\n", text))).robot
    assert robot.remembers
    assert not robot.needs_time


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("[relaxation-1,", "[relaxing,"), r"mast.*no such part of a history; got 'relaxing'.*Try: 'relaxation-"),
        (("      flow_modulus: 100 MPa\n", ""), r"mast\.flow_modulus: .*missing"),
        (("flow_threshold: 300 kPa", "flow_threshold: 3 mm"), r"mast\.materials\.upper\.flow_threshold: the unit"),
        (("flow_threshold: 300 kPa", "flow_time: 3 s"), r"mast\.upper\.flow_time"),
        (("flow_threshold: 200 kPa", "flow_threshold: -1 Pa"), r"mast\.flow_threshold: the threshold is out of range"),
        (("history: [relaxation-1, flow-at-once]", "history: flow"), r"mast\.relaxing_share1: unknown key"),
    ],
)
def test_what_is_wrong_with_a_rods_is_said(tmp_path: Path, change: tuple[str, str], told: str) -> None:
    assert change[0] in ROD_HISTORY
    with pytest.raises(ProjectFileError, match=told):
        load(write_robot(tmp_path, (WITH_ROD[0], ROD_HISTORY.replace(*change))))


def test_other_programs_get_no_history_of_a_rod_but_its_solid_does(tmp_path: Path) -> None:
    text = ROD_HISTORY.replace("      materials: {upper: {between: [60 mm, end], flow_threshold: 300 kPa}}\n", "")
    robot = load(write_robot(tmp_path, (WITH_ROD[0], text))).robot
    with pytest.raises(ParameterError, match=r"mast\.history: the history of a material is not exported to SOFA"):
        linear_robot(robot)
    solid = next(body for body in with_solid_rods(robot).bodies if body.name == "mast")
    assert solid.history == ("relaxation-1", "flow-at-once")
    assert solid.parameters["flow_threshold"] == 2e5
