"""What a project file states of a cable's line and of pulleys that reverse, and what it is refused for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from project_case import bar_robot, write_project
from test_friction_branches import NOISE, loop_csv, prepared

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.problem.rig import Rig
from softcal.errors import InputError, ParameterError, ProjectFileError
from softcal.experiments.dataset import Channel, Dataset
from softcal.export.reduced import Span, reduced
from softcal.plugins.calculix.deck import deck_faults
from softcal.plugins.sofa.robot import scene_faults
from softcal.project.project import load
from softcal.twin.cables import Cable, CableLine
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.robot import Robot
from softcal.twin.schedule import Schedule

AT = "  cables:\n    front:\n"
MEMORY = "friction_coefficient: 0.1\n      line: {friction_memory: true}"
PULLEYS = "rig:\n  pulleys: {count: 2, wrap: 180 deg, friction_coefficient: 0.1, friction_memory: true}\nexperiments:\n"


def line(text: str) -> tuple[str, str]:
    return AT, f"{AT}      {text}\n"


def told(folder: Path, *changes: tuple[str, str], data: str | None = None) -> str:
    with pytest.raises(ProjectFileError) as caught:
        load(write_project(folder, *changes, data=data))
    return str(caught.value)


def test_what_is_stated_is_a_parameter(tmp_path: Path) -> None:
    stated = "line: {spring_rate: 20 N/mm, rest_length: 99 mm, compliance: 0.05 mm/N, friction_memory: true}"
    free = ("  front.slack:", "  front.spring_rate: {bounds: [1 N/mm, 1 kN/mm], scale: log}\n  front.slack:")
    project = load(write_project(tmp_path, line(stated), free))
    known = robot_parameters(project.robot)
    assert known["front.spring_rate"].value == pytest.approx(2e4)
    assert known["front.compliance"].value == pytest.approx(5e-5)
    assert known["front.rest_length"].value == pytest.approx(0.099)
    assert project.robot.cables[0].stiffness == pytest.approx(2000.0)
    assert project.robot.cables[0].pretension == pytest.approx(1e-3 / (1.0 / 2e4 + 5e-5))
    assert known["front.presliding"].value == pytest.approx(1e-5)
    changed = with_parameters(project.robot, {"front.spring_rate": 5e3, "front.presliding": 1e-4})
    assert changed.cables[0].properties == {
        **project.robot.cables[0].properties,
        "spring_rate": 5e3,
        "presliding": 1e-4,
    }
    assert project.robot.remembers
    assert not any(name.startswith("front.s") for name in robot_parameters(bar_robot()))


@pytest.mark.parametrize(
    ("stated", "sentence"),
    [
        ("{stiffness: 10000}", "stiffness"),
        ("{stiffness: 0 N}", "the stiffness of a cable is out of range; got 0 N"),
        ("{stiffness: -2 kN}", "the stiffness of a cable is out of range; got -2 kN"),
        ("{stiffness: 2 N/mm}", "stiffness"),
        ("{compliance: -1 mm/N}", "the compliance is out of range"),
        ("{stiffness: 1 kN, spring_rate: 2 N/mm}", "stiffness and spring_rate exclude each other"),
        ("{pretension: 2 N}", "a cable without stretch has no pretension at zero shortening"),
        ("{stiffness: 1 kN, pretension: -2 N}", "the tension is out of range"),
        ("{friction_memory: 0.1}", "friction_memory"),
        ("{friction_preload: -1 N}", "the tension is out of range; got -1 N"),
        ("{friction_preload: 1}", "friction_preload"),
        ("{friction_speed: 0 m/s}", "the speed is out of range; got 0 m/s"),
        ("{friction_memory: true, presliding: 0 mm}", "the presliding displacement is out of range"),
        ("{presliding: 0.02 mm}", "friction without a memory has no presliding displacement; got 0.02 mm"),
        ("{stifness: 1 kN}", "stiffness"),
    ],
)
def test_a_line_that_cannot_be_is_refused(tmp_path: Path, stated: str, sentence: str) -> None:
    found = told(tmp_path, line(f"line: {stated}"))
    assert sentence in found
    assert "project.yaml:" in found


def test_a_memory_without_friction_is_warned_of(tmp_path: Path) -> None:
    idle = "there is no friction for a memory, a preload or a speed to act on"
    memory, *others = (
        line(f"line: {{friction_{stated}}}") for stated in ("memory: true", "preload: 1 N", "speed: 1 m/s")
    )
    for change in (memory, *others):
        (found,) = (one for one in load(write_project(tmp_path, change)).warnings if one.what == idle)
        assert found.got == "front.friction_coefficient 0, and not free"
    free = ("  front.slack:", "  front.friction_coefficient: {bounds: [0, 0.5]}\n  front.slack:")
    for changes in ((memory, free), (line(MEMORY),)):
        assert idle not in [one.what for one in load(write_project(tmp_path, *changes)).warnings]
    held = load(write_project(tmp_path, line(MEMORY)), values={"front.friction_coefficient": 0.0})
    assert idle in [one.what for one in held.warnings]
    smooth = "rig:\n  pulleys: {count: 2, wrap: 180 deg, friction_memory: true}\nexperiments:\n"
    warned = load(write_project(tmp_path, ("experiments:\n", smooth), data=loop_csv())).warnings
    assert "pulleys.friction_coefficient 0, and not free" in [one.got for one in warned]


def test_pulleys_without_a_memory_have_no_presliding(tmp_path: Path) -> None:
    stated = "rig:\n  pulleys: {wrap: 180 deg, presliding: 0.1 mm}\nexperiments:\n"
    assert "friction without a memory has no presliding displacement" in told(tmp_path, ("experiments:\n", stated))


def test_a_record_of_both_branches_is_a_load_path_of_friction_with_a_memory(tmp_path: Path) -> None:
    assert "it reverses where the cable is released" in told(
        tmp_path, line("friction_coefficient: 0.1"), data=loop_csv(0.0)
    )
    assert load(write_project(tmp_path, line(MEMORY), data=loop_csv(0.0))).robot.remembers
    load(write_project(tmp_path, line(MEMORY), prepared("take_branch: loading"), data=loop_csv(0.0)))
    for branch in ("unloading", "mean"):
        found = told(tmp_path, line(MEMORY), prepared(f"take_branch: {branch}"), data=loop_csv(0.0))
        assert f"samples in the order in which they were made; got take_branch: {branch}" in found


def test_a_drive_with_backlash_takes_a_record_as_it_was_made(tmp_path: Path) -> None:
    loose = ("    cable: front\n", "    cable: front\n    backlash: 0.2 mm\n")
    project = load(write_project(tmp_path, loose, data=loop_csv(0.0)))
    assert project.experiments["pull"].rig_values()["front.backlash"] == pytest.approx(2e-4)
    found = told(tmp_path, loose, prepared("take_branch: mean"), data=loop_csv(0.0))
    assert "a drive with backlash needs the samples in the order in which they were made" in found


def test_pulleys_that_reverse_take_a_record_as_it_was_made(tmp_path: Path) -> None:
    rig = ("experiments:\n", PULLEYS)
    project = load(write_project(tmp_path, rig, data=loop_csv()))
    experiment = project.experiments["pull"]
    assert not any(step.name == "correct_pulley_friction" for step in experiment.dataset.provenance)
    assert experiment.rig_values()["pulleys.presliding"] == pytest.approx(1e-4)
    found = told(tmp_path, rig, prepared("take_branch: loading"), data=loop_csv())
    assert "the samples are no load path in their order; got take_branch: loading" in found
    unseen = ("          shortening: {name: Displacement, unit: mm}\n", "")
    drive = ("    files:\n", "    drive: tension\n    files:\n")
    noise = (NOISE, "    noise: {pitch: 0.2 deg}\n")
    free = ("  front.slack: {bounds: [0 mm, 5 mm], per: experiment}\n", "")
    assert "no shortening of front" in told(tmp_path, rig, unseen, drive, noise, free, data=loop_csv())


def elastic(**stated: float):
    robot = bar_robot()
    return replace(robot, cables=(replace(robot.cables[0], line=CableLine(**stated)),))


def test_other_programs_say_that_their_cables_do_not_stretch() -> None:
    robot = elastic(stiffness=1e3, pretension=1.0)
    for program, faults in (("SOFA", scene_faults(robot)), ("CalculiX", deck_faults(robot))):
        assert f"a cable in {program} does not stretch" in [fault.what for fault in faults]
    assert "friction of a cable in SOFA has no memory" in [
        one.what for one in scene_faults(elastic(friction_memory=True))
    ]
    assert not scene_faults(bar_robot())
    rough = elastic(friction_preload=0.3, friction_speed=0.01)
    rough = replace(rough, cables=(replace(rough.cables[0], friction_coefficient=0.2),))
    for faults in (scene_faults(rough), deck_faults(rough)):
        assert [fault.got for fault in faults if "has no friction" in fault.what] == [
            "0.2, friction_preload, friction_speed"
        ]
    with pytest.raises(ParameterError, match="a reduced model has no memory"):
        reduced(elastic(friction_memory=True), {"front": Span(0.0, 1.0, "N")})


def test_a_cable_made_in_python_is_checked_too() -> None:
    with pytest.raises(InputError, match="no pretension at zero shortening"):
        CableLine(pretension=1.0)
    with pytest.raises(InputError, match="out of range"):
        CableLine(stiffness=0.0)


def test_an_unstretched_length_beyond_the_cable_is_refused(tmp_path: Path) -> None:
    found = told(tmp_path, line("line: {stiffness: 1 kN, rest_length: 101 mm}"))
    assert "the unstretched cable is longer than its path" in found
    assert "got 101 mm" in found


def test_backlash_without_a_shortening_that_drives_is_refused(tmp_path: Path) -> None:
    loose = ("    cable: front\n", "    cable: front\n    drive: tension\n    backlash: 0.2 mm\n")
    noise = (NOISE, "    noise: {pitch: 0.2 deg}\n")
    assert "backlash is lost travel, and no shortening drives this test" in told(tmp_path, loose, noise)


def test_a_cable_with_a_pretension_is_held_in_a_schedule_without_commands() -> None:
    held = Schedule(np.linspace(0.0, 1.0, 5), {}).completed(elastic(stiffness=1e3, pretension=1.0))
    np.testing.assert_array_equal(held.commands["front"].values, np.zeros(5))


def antagonists() -> Robot:
    """A bar pulled by one cable, with one on its other side that has a pretension and that nothing drives."""
    robot = bar_robot()
    (front,) = robot.cables
    mirrored = tuple(replace(via, at=via.at * [-1, 1, 1]) for via in front.via_points)
    back = Cable("back", mirrored, line=CableLine(stiffness=1e4, pretension=0.5))
    return replace(robot, cables=(front, back))


def pulled(name: str, backlash: float | None = None) -> Experiment:
    channels = {"shortening": Channel(np.array([2e-3, 4e-3, 3e-3]), "m"), "tension": Channel(np.ones(3), "N", 0.1)}
    rig = Rig(slack=5e-4, backlash=backlash)
    return Experiment(name, Dataset(name, channels), cable="front", plate="plate", rig=rig)


def rates(problem: Problem, name: str) -> tuple[np.ndarray, np.ndarray]:
    """The jacobian's column of a parameter, and central differences."""
    j, theta = problem.space.labels.index(name), problem.space.start

    def seen(step: float) -> np.ndarray:
        blocks = problem.evaluate({**theta, name: theta[name] + step}).blocks
        return np.concatenate([block.residual for block in blocks])

    found = np.concatenate([block.jacobian[:, j] for block in problem.evaluate(theta, jacobian=True).blocks])
    return found, (seen(1e-6) - seen(-1e-6)) / 2e-6


def test_the_slack_of_a_cable_is_fitted_beside_one_that_is_held_by_its_pretension() -> None:
    slack = FreeParameter("front.slack", "m", 0.0, 2e-3, start=5e-4)
    found, central = rates(make_problem(antagonists(), [pulled("pull")], [slack]), "front.slack")
    np.testing.assert_allclose(found, central, rtol=1e-4)


@pytest.mark.parametrize("order", [1, -1])
def test_one_of_two_tests_in_a_trajectory_has_a_backlash_that_is_fitted(order: int) -> None:
    tests = [pulled("tight"), pulled("loose", 2e-4)][::order]
    backlash = FreeParameter("front.backlash", "m", 0.0, 1e-3, start=2e-4, per_experiment=True)
    problem = make_problem(bar_robot(), tests, [backlash])
    (label,) = problem.space.labels
    found, central = rates(problem, label)
    np.testing.assert_allclose(found, central, rtol=1e-4, atol=1e-6 * np.abs(central).max())
