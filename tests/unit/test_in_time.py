"""Schedules, settings and the sentences of motion in time; the command line's way to it."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import column_robot
from project_case import write_project

from softcal.cli import main
from softcal.errors import InputError, ParameterError, ProjectFileError
from softcal.project.project import load
from softcal.twin.in_time import simulate_in_time
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Marker
from softcal.twin.schedule import Schedule, ramp
from softcal.twin.simulate import simulate
from softcal.twin.time_settings import Settling, TimeSettings
from softcal.workflows.cases import cases
from softcal.workflows.motion import schedule_of, simulate_each_in_time
from softcal.workflows.simulation import simulate as simulate_project

TENSION = {"front": ("tension", 2.0)}


def column():
    robot = column_robot("P1", density=1200.0, divisions=(1, 1, 3))
    return replace(robot, markers=(Marker("dot", "neck", np.array([0.0, 0.0, 0.08])),))


def test_a_schedule_is_straight_between_its_times_and_held_after():
    schedule = Schedule(np.array([0.0, 1.0, 3.0]), {"front": Command("tension", np.array([0.0, 4.0, 2.0]))})
    assert schedule.at(0.25)["front"] == pytest.approx(1.0)
    assert schedule.at(2.0)["front"] == pytest.approx(3.0)
    assert schedule.at(9.0)["front"] == 2.0
    assert ramp(TENSION, 4.0).at(1.0) == {"front": 0.5}


@pytest.mark.parametrize(
    ("times", "values", "message"),
    [
        ([0.0, 2.0, 1.0], [0, 0, 0], "the times of a schedule do not ascend from 0; got 0, 2, 1"),
        ([1.0, 2.0], [0, 0], "do not ascend from 0; got 1, 2"),
        ([], [0], "do not ascend from 0; got none"),
        ([0.0, 1.0], [0, 0, 0], "front: a command has not one value per time; got 3; allowed: 2"),
    ],
)
def test_a_schedule_that_is_none_is_refused(times, values, message):
    with pytest.raises(InputError, match=message):
        Schedule(np.array(times), {"front": Command("tension", np.array(values, dtype=float))})


@pytest.mark.parametrize(
    "bad",
    [
        {"time_step": 0.0},
        {"time_step": float("nan")},
        {"rayleigh_mass": -1.0},
        {"rayleigh_stiffness": float("inf")},
    ],
)
def test_settings_out_of_range_are_refused(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        TimeSettings(**bad)
    with pytest.raises(InputError, match="speed"):
        Settling(speed=0.0)


def test_channels_have_one_value_per_step_and_a_time():
    response = simulate_in_time(column(), ramp(TENSION, 0.1), TimeSettings(0.02))
    np.testing.assert_allclose(response.channels["time"], 0.02 * np.arange(6), rtol=1e-15)
    np.testing.assert_allclose(response.channels["front.tension"], 0.4 * np.arange(6), rtol=1e-12)
    assert response.units["time"] == "s"
    assert {len(values) for values in response.channels.values()} == {6}
    assert response.status.startswith("Moved for 0.1 s in 5 steps; speed at the end ")
    assert response.succeeded
    assert response.channels["plate.x"][0] == 0.0
    assert (np.diff(response.channels["plate.x"]) > 0.0).all()


@pytest.mark.parametrize("on", ["", "plate", "dot"])
def test_what_is_watched_comes_to_rest(on):
    settings = TimeSettings(0.05, settle=Settling(speed=1e-6, hold=0.2, on=on))
    response = simulate_in_time(column(), ramp(TENSION, 0.2), settings)
    assert response.succeeded
    t = response.channels["time"]
    assert f"Settled after {t[-1]:.6g} s, {len(t) - 1} steps: {on or 'every point'} slower than" in response.status
    last = {k: response.channels[f"{on or 'plate'}.{k}"][-5:] for k in "xyz"}
    assert max(np.abs(np.diff(values)).max() for values in last.values()) <= 0.05 * 1e-6
    # and it is not over before its time: the steps before the last 0.2 s were faster
    before = np.linalg.norm([np.diff(response.channels[f"{on or 'plate'}.{k}"])[-6] for k in "xyz"])
    assert before > (0.05 * 1e-6 if on else 0.0)


def test_one_that_does_not_settle_says_how_fast_it_still_is():
    settings = TimeSettings(0.005, 0.0, 0.0, settle=Settling(speed=1e-9, longest=0.1))
    response = simulate_in_time(column(), ramp(TENSION, 0.02), settings)
    assert not response.succeeded
    assert response.status.startswith("Not settled after 0.12 s, 24 steps: every point still at ")
    assert len(response.channels["time"]) == 25


def test_motion_starts_at_equilibrium_or_undeformed():
    heavy = replace(column(), gravity=np.array([2.0, 0.0, -9.8]))
    still = Schedule(np.array([0.0, 0.05]), {})
    expected = simulate(heavy, Protocol({})).channels["plate.x"][0]
    loaded = simulate_in_time(heavy, still, TimeSettings(0.01))
    np.testing.assert_allclose(loaded.channels["plate.x"], expected, rtol=1e-6)
    falling = simulate_in_time(heavy, still, TimeSettings(0.01, start="undeformed"))
    assert falling.channels["plate.x"][0] == 0.0
    assert 0.0 < falling.channels["plate.x"][-1] < expected


def test_lumped_and_consistent_masses_move_alike_but_not_the_same():
    moves = [
        simulate_in_time(column(), ramp(TENSION, 0.05), TimeSettings(0.005, 0.01, masses=kind)).channels["plate.x"][-1]
        for kind in ("consistent", "lumped")
    ]
    assert moves[0] == pytest.approx(moves[1], rel=0.1)
    assert moves[0] != pytest.approx(moves[1], rel=1e-4)


def test_shapes_are_kept_over_the_run():
    response = simulate_in_time(column(), ramp(TENSION, 0.2), TimeSettings(0.01), snapshots=5)
    labels = [shape.label for shape in response.snapshots]
    assert labels == ["0 s", "0.04 s", "0.08 s", "0.12 s", "0.16 s", "0.2 s"]
    assert response.snapshots[-1].efforts["front"] == pytest.approx(2.0)
    assert response.tets["neck"].shape[1] == 4


@pytest.mark.parametrize("settling", [None, Settling(speed=1e-6)])
def test_an_observer_is_told_of_every_step_in_order_and_to_the_end(settling: Settling | None):
    told: list[tuple[float, float]] = []
    settings = TimeSettings(0.03, settle=settling)
    response = simulate_in_time(
        column(), ramp(TENSION, 0.1), settings, progress=lambda time, over: told.append((time, over))
    )
    times, ends = np.array(told).T
    np.testing.assert_array_equal(times, response.channels["time"])
    np.testing.assert_array_equal(ends, 4 * 0.03)  # the schedule ends within the fourth step
    assert (times[-1] > ends[-1]) is np.bool_(settling is not None)


def test_what_the_robot_has_not_is_refused():
    with pytest.raises(ParameterError, match="side: there is no such cable"):
        simulate_in_time(column(), ramp({"side": ("tension", 1.0)}, 1.0))
    with pytest.raises(ParameterError, match="a cable cannot push"):
        simulate_in_time(column(), ramp({"front": ("tension", -1.0)}, 1.0))
    with pytest.raises(InputError, match="no such plate or marker; got 'nose'; allowed: plate, dot"):
        simulate_in_time(column(), ramp(TENSION, 1.0), TimeSettings(settle=Settling(on="nose")))
    with pytest.raises(ParameterError, match="nothing that moves has mass"):
        simulate_in_time(column_robot("P1", divisions=(1, 1, 2)), ramp(TENSION, 1.0))


DENSE = ("element: P1\n", "element: P1\n      density: 1200 kg/m^3\n")


def with_dynamics(text: str) -> tuple[str, str]:
    return "calibration: {", f"dynamics: {{{text}}}\ncalibration: {{"


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        main([str(argument) for argument in arguments])
    return int(left.value.code or 0)


def test_the_project_says_how_motion_is_computed(tmp_path: Path):
    given = (
        "time_step: 20 ms, rayleigh_stiffness: 50 ms, rayleigh_mass: 0.2 1/s, scheme: one-solve, settle: {on: plate}"
    )
    project = load(write_project(tmp_path, DENSE, with_dynamics(given)))
    assert project.dynamics == TimeSettings(0.02, 0.05, 0.2, "one-solve", settle=Settling(on="plate"))
    assert load(write_project(tmp_path / "other")).dynamics == TimeSettings(settle=Settling())
    held = load(write_project(tmp_path / "held", with_dynamics("hold: 2 s")))
    assert held.dynamics.settle is None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("settle: {on: nose}", r"dynamics\.settle\.on: there is no such plate or marker; got 'nose'; allowed: plate"),
        ("time_step: 0 s", r"dynamics\.time_step"),
        ("hold: 1 s, settle: {}", "the end of the motion is specified twice"),
        ("rayleigh_mass: 0.1 s", r"dynamics\.rayleigh_mass: the unit does not fit"),
        ("scheme: explicit", r"dynamics\.scheme: there is no such choice"),
        ("scheme: convergd", r"allowed: 'converged', 'one-solve'\. Try: 'converged'"),
    ],
)
def test_faults_of_the_dynamics_section_are_told_by_key(tmp_path: Path, given: str, message: str):
    with pytest.raises(ProjectFileError, match=message):
        load(write_project(tmp_path, with_dynamics(given)))


def test_simulate_in_time_writes_the_trajectory(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write_project(tmp_path, DENSE, with_dynamics("time_step: 20 ms, ramp: 0.2 s, rayleigh_stiffness: 50 ms"))
    out = tmp_path / "out"
    assert run("simulate", path, "--pull", "front=2mm", "--in-time", "--out", out) == 0
    told = capsys.readouterr()
    assert "pull: Settled after " in told.out
    assert told.err == ""  # no bar into a pipe
    with (out / "response-pull.csv").open(newline="") as stream:
        header, *rows = list(csv.reader(stream))
    table = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    assert table["time [s]"][0] == 0.0
    expected: Response = simulate(load(path).robot, Protocol({"front": Command("shortening", np.array([2e-3]))}))
    assert table["front.tension [N]"][-1] == pytest.approx(expected.channels["front.tension"][0], rel=1e-4)
    record = json.loads((out / "simulation.json").read_text())
    assert record["dynamics"]["ramp"] == 0.2
    assert (out / "twin-pull.png").exists()


QUICK = "time_step: 20 ms, ramp: 0.2 s, rayleigh_stiffness: 50 ms"
PREPARED = "    noise: {tension: 0.05 N, pitch: 0.2 deg}\n"


def with_steps(*steps: str) -> tuple[str, str]:
    return PREPARED, PREPARED + "    prepare:\n" + "".join(f"      - {step}\n" for step in steps)


def triangles(n_cycles: int) -> str:
    """A bench file of cycles from 0 to 10 mm and back, 2 s each, with what a spring of 100 N/m would read."""
    time = np.arange(0.0, 2.0 * n_cycles + 0.01, 0.05)
    d = 10.0 * (1.0 - np.abs(time % 2.0 - 1.0))
    rows = [f"{t:.3f},{x:.6f},{0.1 * x:.6f},{0.5 * x:.6f}" for t, x in zip(time, d, strict=True)]
    return "\n".join(["Time [s],Displacement [mm],Force [N],Pitch [deg]", *rows]) + "\n"


@pytest.mark.slow
def test_an_experiment_goes_by_the_times_of_its_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Its first sample is pulled already: the pull grows to it over the ramp, and the table's clock starts there."""
    path, out = write_project(tmp_path, DENSE, with_dynamics(QUICK)), tmp_path / "out"
    assert run("simulate", path, "--in-time", "--out", out) == 0, capsys.readouterr().err
    header, *_ = (out / "response-pull.csv").read_text().splitlines()
    values = np.loadtxt(out / "response-pull.csv", delimiter=",", skiprows=1)
    table = dict(zip(header.split(","), values.T, strict=True))
    data = load(path).experiments["pull"].dataset
    at = np.searchsorted(table["time [s]"], 0.2 + data.values("time") - 1e-9)
    np.testing.assert_allclose(table["front.shortening [m]"][at], data.values("shortening"), rtol=1e-9)
    still = simulate_project(load(path), experiment="pull")
    np.testing.assert_allclose(table["plate.pitch [rad]"][at[-1]], still.channels["plate.pitch"][-1], rtol=0.03)
    assert table["time [s]"][-1] > 0.2 + 2.4 + 0.1  # and then it settles


def test_cycles_are_replayed_where_the_samples_have_lost_their_times(tmp_path: Path):
    """A branch averaged over cycles has no times; the record that it was taken from, corrections and all, has."""
    corrected = with_steps("zero: {channel: tension, by: min}", "find_cycles", "take_branch: loading")
    path = write_project(tmp_path, DENSE, with_dynamics("hold: 1 s"), corrected, data=triangles(3))
    project = load(path)
    assert "time" not in project.experiments["pull"].dataset.channels
    schedule = schedule_of(project, cases(project)["pull"])
    assert schedule.times[-1] == pytest.approx(6.0)
    schedule = schedule.held(project.dynamics.hold)
    assert schedule.times[-1] == pytest.approx(7.0)
    np.testing.assert_allclose(
        [schedule.at(t)["front"] for t in (0.5, 1.0, 1.5, 2.0, 5.0, 6.5)],
        np.array([5, 10, 5, 0, 10, 0]) * 1e-3,
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("changes", "data", "message"),
    [
        (
            (("          time: {name: Time}\n", ""),),
            None,
            "pull: a transient simulation needs ascending sample times; got no column `time`",
        ),
        (
            (with_steps("find_cycles", "take_branch: loading", "zero: {channel: shortening, by: 1 mm}"),),
            triangles(3),
            "pull, prepare: the whole record lacks a correction that the compared samples have; got zero",
        ),
    ],
)
def test_an_experiment_without_times_says_what_to_give(tmp_path: Path, changes, data, message: str):
    project = load(write_project(tmp_path, *changes, data=data))
    with pytest.raises(InputError, match=message):
        simulate_each_in_time(project, cases(project))


def test_motion_is_a_film_timed_in_seconds(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    pytest.importorskip("pyvista")
    path, out = write_project(tmp_path, DENSE, with_dynamics(QUICK + ", hold: 0.2 s")), tmp_path / "out"
    assert run("export", "vtk", path, "--pull", "front=2mm", "--in-time", "--shapes", "4", "--out", out) == 0
    steps = [float(text) for text in re.findall(r'timestep="([^"]*)"', (out / "shapes.pvd").read_text())]
    np.testing.assert_allclose(steps, [0.0, 0.1, 0.2, 0.3, 0.4])
    assert capsys.readouterr().err == ""


def test_each_case_is_told_of_by_its_name(tmp_path: Path):
    project = load(write_project(tmp_path, DENSE, with_dynamics(QUICK + ", hold: 0.2 s")))
    told: list[tuple[str, float, float]] = []
    chosen = cases(project, ["front=2mm"])
    both = {"one": chosen["pull"], "other": chosen["pull"]}
    simulate_each_in_time(project, both, progress=lambda *state: told.append(state))
    assert [name for name, time, _ in told if time == 0.0] == ["one", "other"]
    assert [name for name, time, over in told if time == over] == ["one", "other"]
