"""Limits of pumps, motors and winches: of a project or a robot, kept by reach and workspace, compared by check."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from project_case import bar_robot, write_project
from test_chambers import box

from softcal.errors import InputError, ParameterError, ProjectFileError
from softcal.project.project import load
from softcal.twin.live import LiveTwin
from softcal.twin.robot import Robot
from softcal.workflows.checking import check
from softcal.workflows.reach import asked


def bounds(robot: Robot, **limits: tuple[float, float]) -> dict[str, tuple[float, float]]:
    """The limits of a task by channel, with further ones by kind of channel."""
    task, _ = asked(LiveTwin(robot, "pressure"), None, limits=limits)
    return {name: (float(low), float(high)) for name, low, high in zip(task.units, task.lower, task.upper, strict=True)}


def test_the_limits_of_a_robot_are_those_of_its_channels():
    limits = {"pressure": (0.0, 6e4), "main.volume": (0.0, 2e-6)}
    robot = replace(box(), actuator_limits=limits)
    assert robot.limited == {"main.pressure": (0.0, 6e4), "main.volume": (0.0, 2e-6)}
    found = bounds(robot)
    assert found["main.pressure"] == (0.0, 6e4)
    assert found["main.volume"] == (0.0, 2e-6)
    # Options only narrow them.
    found = bounds(robot, pressure=(-1e4, 5e4))
    assert found["main.pressure"] == (0.0, 5e4)
    with pytest.raises(ParameterError, match="the limits contradict each other"):
        bounds(robot, pressure=(7e4, 8e4))


def test_a_channel_goes_before_its_kind_and_cables_that_do_not_drive_are_left_alone():
    bar = bar_robot()
    (front,) = bar.cables
    pair = (front, replace(front, name="back"))
    robot = replace(bar, cables=pair, actuator_limits={"front.tension": (1.0, 5.0), "tension": (0.5, 9.0)})
    assert robot.limited == {"front.tension": (1.0, 5.0), "back.tension": (0.5, 9.0)}
    task, _ = asked(LiveTwin(robot, {"front": "tension"}), None)
    number = [*task.units].index("back.tension")
    assert task.lower[number] == -np.inf  # slack


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"main.tension": (0.0, 1.0)}, "no actuator has such a channel"),
        ({"pressure": (2e3, 1.0)}, "actuator_limits.pressure: the limits contradict each other; got 2 kPa to 1 Pa"),
        ({"main.pressure": (-2e5, 0.0)}, "actuator_limits.main.pressure: the gauge pressure is out of range"),
    ],
)
def test_wrong_limits_are_refused(limits: dict[str, tuple[float, float]], says: str):
    with pytest.raises(InputError) as error:
        replace(box(), actuator_limits=limits)
    assert says in str(error.value)


def limited(folder: Path, text: str) -> Path:
    return write_project(folder, ("  cables:\n", f"  actuator_limits: {text}\n  cables:\n"))


def test_a_test_beyond_the_limits_is_told_by_check(tmp_path: Path):
    (tmp_path / "wide").mkdir()
    for name, most, n in (("narrow", "1 mm", 1), ("wide", "1 m", 0)):
        project = load(limited(tmp_path / name, f"{{shortening: [-1 mm, {most}], front.tension: [0 N, 5 kN]}}"))
        assert project.robot.limited["front.tension"] == (0.0, 5e3)
        told = [one for one in check(project, solve=False).warnings if "beyond the limits of front.shortening" in one]
        assert len(told) == n, told
    assert "pull: the test is beyond the limits of front.shortening; got " in " ".join(
        check(limited(tmp_path / "other", "{shortening: [0 mm, 1 mm]}"), solve=False).warnings
    )


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{front.tension: [0 mm, 5 N]}", r"actuator_limits\.front\.tension.*the unit does not fit"),
        ("{front.tension: [0 N]}", r"actuator_limits\.front\.tension"),
        ("{front.pressure: [0 Pa, 1 Pa]}", r"no actuator has such a channel.*front\.tension"),
    ],
)
def test_wrong_limits_of_a_project_are_refused_at_their_key(tmp_path: Path, text: str, says: str):
    with pytest.raises(ProjectFileError, match=says):
        load(limited(tmp_path, text))
