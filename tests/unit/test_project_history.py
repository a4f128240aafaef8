"""The history of a material in a project file: its keys, its parameters, the times it needs, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from project_case import write_project

from softcal import load
from softcal.calibration.observation import protocol_told
from softcal.errors import ParameterError, ProjectFileError
from softcal.export.calculix import deck_faults
from softcal.export.sofa_robot import linear_robot
from softcal.twin.parameters import robot_parameters
from softcal.twin.simulate import simulate

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
        (("[relaxation-1, softening]", "[relaxation-1, relaxation-2, softening]"), r"a history has one such part"),
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
    with pytest.raises(ProjectFileError, match="relaxes or flows needs the time of every sample; got no time"):
        load(write_project(tmp_path, *RELAXES, untimed))


def test_other_programs_get_no_history(tmp_path: Path) -> None:
    robot = load(write_project(tmp_path, *RELAXES)).robot
    with pytest.raises(ParameterError, match=r"bar\.history: the history of a material is not exported to SOFA"):
        linear_robot(robot)
    assert any("not exported to CalculiX" in fault.what for fault in deck_faults(robot))
