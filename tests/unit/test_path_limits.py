"""The work on a load path ends: with a sentence that names the place, or by Ctrl-C with what is ready."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic
from project_case import write_project
from typer.testing import CliRunner

from softcal.cli import app
from softcal.cli.calibration_bars import CalibrationBars, calibration_progress
from softcal.cli.calibration_lines import CalibrationLines
from softcal.cli.calibration_table import result_line, value_text
from softcal.cli.running import clock
from softcal.errors import SimulationError
from softcal.geometry.centreline import straight
from softcal.geometry.primitives import box_mesh
from softcal.geometry.section import RectangularBar
from softcal.mechanics import path, path_watch
from softcal.mechanics.node import Node
from softcal.mechanics.path import between
from softcal.mechanics.path_limits import PathLimits
from softcal.mechanics.path_watch import PathProgress, part_of_series, paths_watched
from softcal.mechanics.stability import overdamped_equilibrium
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Equilibrium, Statics
from softcal.mechanics.system import Controls
from softcal.project.project import load
from softcal.twin.barrier import Contact
from softcal.twin.build import build_twin
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Body, Cable, Plate, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import calibrate
from softcal.workflows.simulation import pull, simulate_each


def knotted_block() -> Robot:
    """A tendon that ends at a point of a soft block, which its elements do not carry far."""
    mesh = box_mesh([0.012, 0.012, 0.012], [4, 4, 4], origin=[-0.006, -0.006, 0.0])
    elastic = {"youngs_modulus": 0.9e6, "poissons_ratio": 0.45}
    body = Body("block", mesh, np.flatnonzero(mesh.points[:, 2] < 1e-9), elastic, element="P2P1")
    knot = ViaPoint(np.array([0.001, 0.0005, 0.0115]), "block", radius=0.0)
    return Robot((body,), cables=(Cable("tendon", (knot, ViaPoint(np.array([0.001, 0.0005, -0.02]), ""))),))


def with_two_tendons() -> Robot:
    robot, side = knotted_block(), ViaPoint(np.array([-0.004, 0.0, 0.012]), "block")
    return replace(robot, cables=(*robot.cables, Cable("other", (side, ViaPoint(np.array([-0.03, 0.0, 0.01]), "")))))


def buckling_column() -> Robot:
    """A rod on the ground with a plate on top, which a cable pulls to the foot."""
    top = np.array([0.0, 0.0, 0.2])
    line, section = straight((0, 0, 0), tuple(top), 20), RectangularBar(0.01, 0.004)
    rod = Rod("column", line, section, elastic(5e7, 0.3), clamped={"top": [20]}, fixed=[0])
    cable = Cable("front", (ViaPoint(np.zeros(3)), ViaPoint(top, "top")), pulled_end="first")
    return Robot(plates=(Plate("top", {}, top),), rods=(rod,), cables=(cable,))


def limited(**limits: float) -> Robot:
    return replace(column_robot("P1", divisions=(1, 1, 4)), limits=PathLimits(**limits))


def pressing(at: float) -> Callable[[PathProgress], None]:
    """Presses Ctrl-C where a path is as far as that."""

    def observe(progress: PathProgress) -> None:
        if progress.share > at:
            raise KeyboardInterrupt

    return observe


@pytest.mark.slow
def test_a_path_on_which_elements_fail_ends_and_names_the_place() -> None:
    robot = knotted_block()
    response = simulate(robot, pull(robot, "tendon", "shortening", 0.012), crossings=False)
    assert not response.succeeded
    assert 200 < response.n_factorisations < 260  # as docs/mechanics.md has it
    assert len(robot.bodies[0].mesh.tets) == 384
    assert len(response.channels["tendon.tension"]) == 27
    assert response.status.startswith("The load path was ended at 8.04")
    assert "(27 of 41 samples reached): the last 15 factorisations gained less than 1 % of it" in response.status
    where = "the elements of block at (1.5, 2.25, 9.75) mm, at via point 1 of tendon (1, 0.5, 11.5) mm, fail first: J"
    assert where in response.status


def test_each_sample_of_several_cables_ends_so_too() -> None:
    robot = with_two_tendons()
    far = Protocol({"tendon": Command("shortening", [0.008]), "other": Command("shortening", [1e-4])})
    response = simulate(robot, far, crossings=False)
    assert "Sample 1 of 1 was not reached" in response.status
    assert "the load path was ended at" in response.status
    assert "at via point 1 of tendon (1, 0.5, 11.5) mm, fail first" in response.status


def test_the_advice_is_of_what_the_robot_has_or_lacks() -> None:
    robot = column_robot("P1", divisions=(1, 1, 3))
    told = [
        path._advice(build_twin(one).system)
        for one in (robot, replace(robot, contact=Contact()), replace(robot, cables=()))
    ]
    assert ["via point" in one for one in told] == [True, True, False]
    assert ["contact where" in one for one in told] == [True, False, True]
    assert all("larger elements there" in one for one in told)


@pytest.mark.parametrize(
    ("limits", "why"),
    [
        ({"factorisations": 3}, "it took "),
        ({"cpu_time": 1e-6}, "the simulation took 1e-06 s (limits.cpu_time)"),
    ],
)
def test_a_path_ends_at_its_other_limits(limits: dict[str, float], why: str) -> None:
    robot = limited(**limits)
    response = simulate(robot, pull(robot, "front", "shortening", 0.03))
    assert not response.succeeded
    assert response.status.startswith("The load path was ended at ")
    assert why in response.status


def test_a_snap_through_ends_at_the_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, seen = buckling_column(), list[tuple[int, int]]()

    def watched(statics: Statics, *arguments: Any) -> Equilibrium:
        begin = statics.n_factorisations
        ended = overdamped_equilibrium(statics, *arguments)
        seen.append((begin, statics.n_factorisations))
        return ended

    monkeypatch.setattr("softcal.mechanics.snap_through.overdamped_equilibrium", watched)
    assert simulate(robot, pull(robot, "front", "shortening", 0.02)).succeeded
    begin, end = seen[0]
    assert end > begin + 12
    limited = replace(robot, limits=PathLimits(factorisations=begin + 4))
    response = simulate(limited, pull(robot, "front", "shortening", 0.02))
    assert response.status.startswith("The load path was ended at ")
    assert "(limits.factorisations)" in response.status
    assert response.n_factorisations < begin + 8


@pytest.mark.parametrize(("limits", "n"), [({"factorisations": 2}, 2), ({"cpu_time": 1e-6}, 0)])
def test_a_solve_ends_at_the_limits(limits: dict[str, float], n: int) -> None:
    robot = column_robot("P1", divisions=(1, 1, 4))
    twin = build_twin(robot)
    statics = Statics(twin.system, parameter_values(robot), PathLimits(**limits))
    statics.path_begin = 0
    far = Controls(np.array([False]), np.zeros(1), np.array([0.02]))
    solved = statics.equilibrium(rest_state(twin.system.layout), far)
    statics.release()
    assert not solved.converged
    assert "(limits." in solved.status
    assert statics.n_factorisations == n


def test_a_path_that_creeps_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = limited(creeping=1)
    monkeypatch.setattr("softcal.mechanics.path.strays", lambda *_: True)
    response = simulate(robot, pull(robot, "front", "shortening", 0.03))
    assert "factorisations gained less than 1 % of it (limits.creeping)" in response.status


def test_processor_time_ends_samples_of_several_cables() -> None:
    robot = replace(with_two_tendons(), limits=PathLimits(cpu_time=1e-6))
    near = Protocol({name: Command("shortening", [1e-4, 2e-4]) for name in ("tendon", "other")})
    assert "the simulation took 1e-06 s (limits.cpu_time)" in simulate(robot, near).status


@pytest.mark.parametrize("drive", ["shortening", "tension"])
def test_a_stop_keeps_the_samples_that_are_ready(drive: str) -> None:
    robot = column_robot("P1", divisions=(1, 1, 4))
    end = {"shortening": 0.04, "tension": 4.0}[drive]
    whole = simulate(robot, pull(robot, "front", drive, end))
    with paths_watched(pressing(0.25), keeps=True):
        response = simulate(robot, pull(robot, "front", drive, end))
    ready = response.channels["front.tension"]
    assert isinstance(response.stopped_by, KeyboardInterrupt)
    assert 1 < len(ready) < 41
    np.testing.assert_allclose(ready, whole.channels["front.tension"][: len(ready)], rtol=2e-2, atol=1e-3)
    assert response.status.startswith("The load path was ended at ")
    assert response.status.endswith(f"({len(ready)} of 41 samples reached): stopped by the user.")
    with paths_watched(pressing(0.3)), pytest.raises(KeyboardInterrupt):
        simulate(robot, pull(robot, "front", drive, end))


def test_a_stop_while_a_curve_is_refined_keeps_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def between(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("softcal.twin.equilibrium_path.between", between)
    robot = column_robot("P1", divisions=(1, 1, 4))
    with paths_watched(lambda path: None, keeps=True):
        response = simulate(robot, pull(robot, "front", "shortening", 0.04), curve_tolerance=1e-12)
    assert response.stopped_by is not None
    assert len(response.channels["front.tension"]) == 41


def test_a_curve_is_kept_where_its_refinement_takes_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def late(statics: Statics, *arguments: Any) -> Node:
        statics.begun = -np.inf
        return between(statics, *arguments)

    monkeypatch.setattr("softcal.twin.equilibrium_path.between", late)
    robot = limited(cpu_time=1e4)
    response = simulate(robot, pull(robot, "front", "shortening", 0.04), curve_tolerance=1e-12)
    assert response.status.startswith("The load path was ended at 40 mm")
    assert "(limits.cpu_time)" in response.status
    assert len(response.channels["front.tension"]) == 41


def test_a_stop_keeps_the_samples_of_several_cables() -> None:
    robot = with_two_tendons()
    pulls = Protocol({name: Command("shortening", np.linspace(0.0, 4e-4, 5)) for name in ("tendon", "other")})
    whole = simulate(robot, pulls)
    with paths_watched(pressing(0.5), keeps=True):
        response = simulate(robot, pulls)
    assert response.samples == (0, 1)
    assert response.status.startswith("Stopped by the user: 2 of 5 samples are solved.")
    np.testing.assert_array_equal(response.channels["tendon.tension"], whole.channels["tendon.tension"][:2])
    with paths_watched(pressing(0.5)), pytest.raises(KeyboardInterrupt):
        simulate(robot, pulls)


def test_a_series_of_paths_is_one_whole() -> None:
    told: list[PathProgress] = []
    with paths_watched(told.append):
        with part_of_series(1, 4):
            path_watch.path_watch().tell(0.5, 7)
        path_watch.path_watch().tell(1.0, 9)
    path_watch.path_watch().tell(1.0, 11)
    assert told == [PathProgress(0.375, 7), PathProgress(1.0, 9)]
    assert str(told[0]) == "38 %, 7 factorisations"


def test_into_a_file_a_path_is_told_where_a_minute_passed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setattr("softcal.cli.running.time.monotonic", lambda: now)
    with clock() as show:
        show("Solving")
        for k in range(1, 7):
            now += 25.0
            path_watch.path_watch().tell(k / 10, 3 * k)
    assert (
        capsys.readouterr().err == "Solving: 30 %, 9 factorisations (75 s)\nSolving: 60 %, 18 factorisations (150 s)\n"
    )


def test_a_calibration_says_how_far_a_path_is(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    now, seen = 0.0, list[str]()
    project = load(write_project(tmp_path))
    with CalibrationLines(lambda: now) as lines:

        def show(label: str, state: object) -> None:
            nonlocal now
            lines.show(label, state)
            now += 61.0

        calibrate(project, progress=show, trials=3)
    err = capsys.readouterr().err.splitlines()
    assert any("; load path at " in line and line.startswith("pull: ") for line in err)
    with CalibrationBars() as bars:
        calibrate(project, progress=bars.show, trials=3)
        seen += [str(task.fields["count"]) for task in bars._progress.tasks]
    assert any(count.endswith(" %") for count in seen)


def test_a_calibration_says_how_far_its_first_simulation_is(capsys: pytest.CaptureFixture[str]) -> None:
    """A minute apart, before any trial is ready."""
    times = iter([0.0, 59.0, 61.0, 120.0, 122.0])
    lines = CalibrationLines(lambda: next(times))
    for share in (0.1, 0.2, 0.3, 0.4):
        lines.follow(PathProgress(share, 7))
    assert capsys.readouterr().err.splitlines() == [
        f"First simulation; load path at {PathProgress(share, 7)} ({seconds} s)"
        for share, seconds in ((0.2, 61), (0.4, 122))
    ]


def test_what_is_printed_beside_a_stage_begins_a_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with clock() as show:
        show("Solving")
        path_watch.path_watch().tell(0.5, 3)
        show("")
        path_watch.path_watch().tell(0.9, 4)
        assert capsys.readouterr().err.endswith("\x1b[2K")
        show("Drawing")
    assert "Drawing" in capsys.readouterr().err


def press_in(monkeypatch: pytest.MonkeyPatch, at: float) -> None:
    """Ctrl-C in a command whose load path is as far as that."""
    real = path_watch.PathWatch.tell

    def tell(self: path_watch.PathWatch, share: float, n: int) -> None:
        real(self, share, n)
        if share > at:
            raise KeyboardInterrupt

    monkeypatch.setattr(path_watch.PathWatch, "tell", tell)


def test_check_prints_what_it_knew_before_it_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_project(tmp_path)
    whole = CliRunner().invoke(app, ["check", str(path), "--no-pictures"])
    press_in(monkeypatch, 0.2)
    done = CliRunner().invoke(app, ["check", str(path), "--no-pictures"])
    assert done.exit_code == 130
    known = whole.stdout[: whole.stdout.index("end of pull")]
    assert "calibration " in known
    assert done.stdout.startswith(known)
    assert "stopped by the user" in done.stdout[len(known) :].splitlines()[0]
    assert done.stderr.endswith("Stopped.\n")


def test_check_prints_the_bodies_before_the_twin_is_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(robot: Robot) -> None:
        raise KeyboardInterrupt

    path = write_project(tmp_path)
    whole = CliRunner().invoke(app, ["check", str(path), "--no-pictures", "--no-solve"])
    monkeypatch.setattr("softcal.workflows.checking.twin_of", stop)
    done = CliRunner().invoke(app, ["check", str(path), "--no-pictures"])
    assert done.stdout == whole.stdout[: whole.stdout.index("plate ")]


def test_simulate_writes_the_samples_that_are_ready(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, out = write_project(tmp_path), tmp_path / "out"
    press_in(monkeypatch, 0.2)
    done = CliRunner().invoke(app, ["simulate", str(path), "--pull", "front=20mm", "--out", str(out)])
    assert done.exit_code == 130, done.output
    assert "samples reached): stopped by the user." in done.stderr
    assert done.stderr.endswith("Stopped.\n")
    assert 2 < len((out / "response-pull.csv").read_text().splitlines()) < 42


def test_a_stop_keeps_the_cases_before_it() -> None:
    def simulated(ready: Response | None) -> Response:
        if ready is None:
            raise KeyboardInterrupt
        return ready

    done = Response({"force": np.ones(2)}, {"force": "N"}, "Solved.", True, 1)
    failed = Response({}, {}, "No equilibrium.", False, 1)
    cases, told = {"a": done, "b": failed, "c": None, "d": done}, list[str]()
    with paths_watched(lambda path: None, keeps=True):
        responses = simulate_each(cases, simulated, ready=lambda name, response: told.append(name))
        with pytest.raises(KeyboardInterrupt):
            simulate_each({"c": None}, simulated)
    assert list(responses) == ["a"]
    assert isinstance(responses["a"].stopped_by, KeyboardInterrupt)
    assert told == ["a", "b"]
    with pytest.raises(KeyboardInterrupt):
        simulate_each(cases, simulated)
    with pytest.raises(SimulationError, match="b: No equilibrium"):
        simulate_each({"a": done, "b": failed}, simulated)


def test_simulate_in_time_keeps_its_steps(tmp_path: Path) -> None:
    from softcal.twin.in_time import simulate_in_time
    from softcal.twin.schedule import Schedule
    from softcal.twin.time_settings import TimeSettings

    robot = column_robot("P1", divisions=(1, 1, 4), density=1000.0)
    schedule = Schedule(np.array([0.0, 1.0]), {"front": Command("shortening", [0.0, 0.01])})

    def press(time: float, over: float) -> None:
        if time > 0.05:
            raise KeyboardInterrupt

    with paths_watched(lambda path: None, keeps=True):
        response = simulate_in_time(robot, schedule, TimeSettings(), progress=press)
    assert response.status.startswith("Stopped by the user after 0.06 s.")
    assert response.channels["time"][-1] == pytest.approx(0.06)
    with pytest.raises(KeyboardInterrupt):
        simulate_in_time(robot, schedule, TimeSettings(), progress=press)


def test_a_calibration_is_printed_while_others_are_still_to_come(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_project(tmp_path)
    text = path.read_text()
    first, last = text.index("  pull:\n"), text.index("parameters:")
    path.write_text(text[:last] + text[first:last].replace("pull:", "again:") + text[last:])
    with calibration_progress() as lines:
        found = calibrate(
            load(path), fit="each", mesh_error=False, ready=lambda label, result: lines.say(result_line(label, result))
        )
    (line,) = capsys.readouterr().err.splitlines()
    values = found.results["pull"].parameters
    assert list(found.results) == ["pull", "again"]
    assert line.startswith(f"pull: bar.youngs_modulus {value_text(values['bar.youngs_modulus'])}, front.slack")
    assert "; loss " in line
