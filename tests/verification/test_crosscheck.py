"""Engines compared: they agree where they should, a difference is seen and told, and what is absent is named."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, side_cable
from project_case import write_project
from typer.testing import CliRunner

from softcal.cli import app
from softcal.cli.printing import print_table
from softcal.errors import SimulationError
from softcal.export.engine import ENGINES, Engine, EngineState, Running, state_of
from softcal.geometry.centreline import straight
from softcal.geometry.section import RoundBar
from softcal.plugins.calculix.command import _table
from softcal.plugins.calculix.crosscheck import Difference, EngineComparison, crosscheck
from softcal.plugins.calculix.engine import _fitted_pose, _needed
from softcal.plugins.calculix.load_path import LoadPath, load_path
from softcal.plugins.sofa import engine as sofa_module
from softcal.plugins.sofa.settings import SofaSettings
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol, furthest_state
from softcal.twin.robot import Cable, Plate, PointLoad, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate
from softcal.workflows import cases

assert set(ENGINES) == {"calculix", "sofa"}  # softcal's own are there before others take their names in a test
needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed; Debian: calculix-ccx"
)
ROBOT = column_robot(
    "P2P1",
    parameters=elastic(1e6, 0.4),
    divisions=(1, 1, 3),
    cables=[side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05))],
)


def softer(factor: float, modulus: str = "neck.youngs_modulus", value: float = 1e6) -> Engine:
    """softcal itself with every modulus off by a factor."""

    def solve(robot: Robot, protocol: Protocol, shape, running) -> EngineState:
        off = with_parameters(robot, {modulus: factor * value})
        return state_of(simulate(off, protocol, snapshots=True, curve_tolerance=0.0))

    return Engine("stand-in", lambda robot: robot, lambda: "", solve)


@needs_ccx
def test_calculix_agrees_with_two_cables():
    commands = {
        "front": Command("shortening", np.array([0.0, 0.006])),
        "left": Command("tension", np.array([0.0, 0.4])),
    }
    found = crosscheck(ROBOT, Protocol(commands), ["softcal", "calculix"])
    (one,) = found.comparisons
    assert one.agrees
    assert one.verdict.startswith("calculix and softcal agree to 0.0001")
    assert one.changed == ("neck: law neo-hooke becomes neo-hooke-isochoric", "neck: element P2P1 becomes P2")
    by_name = {d.quantity: d for d in one.differences}
    assert by_name["front.shortening"].softcal == pytest.approx(0.006)
    assert by_name["left.shortening"].engine == pytest.approx(by_name["left.shortening"].softcal, rel=1e-4)
    assert by_name["plate.rotation"].softcal > 0.05
    for cable in ("front", "left"):
        given = by_name[f"{cable}.tension (by slope)"]
        assert given.engine == pytest.approx(given.softcal, rel=1e-4)
        assert given.engine != given.softcal
    assert by_name["neck: largest displacement"].engine > 0.005


def test_an_engine_that_is_itself_agrees_and_one_that_is_not_is_told(monkeypatch):
    monkeypatch.setitem(ENGINES._members, "same", softer(1.0))
    monkeypatch.setitem(ENGINES._members, "softer", softer(0.9))
    same, other = crosscheck(ROBOT, pulled(0.0, 0.006), ["same", "softer"]).comparisons
    assert same.agrees
    assert max(d.absolute for d in same.differences) == 0.0
    assert not other.agrees
    assert "softer and softcal differ by" in other.verdict
    assert "in front.tension, 1.0e-01 relative" in other.verdict
    # At a given shortening the modulus changes no shape.
    assert {d.quantity for d in other.differences if d.relative > 1e-6} == {"front.tension"}


NAN = float("nan")


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (lambda a: replace(a, efforts={"left": NAN}), "no finite number of the tension of left"),
        (lambda a: replace(a, needed={"front": NAN}), "no finite number of the tension of front"),
        (lambda a: replace(a, coordinates={"left": np.inf}), "no finite number of the shortening of left"),
        (
            lambda a: replace(a, plates={"plate": (np.zeros(3), np.full((3, 3), NAN))}),
            "no finite number of the pose of plate",
        ),
        (
            lambda a: replace(a, points={"neck": np.where(a.points["neck"] > 0.09, NAN, a.points["neck"])}),
            "no finite number of the shape of neck",
        ),
        (lambda a: replace(a, points={}), "no position of each of the .* nodes of neck"),
        (lambda a: replace(a, points={"neck": a.points["neck"][:1]}), "no position of each of the .* nodes of neck"),
    ],
    ids=["tension", "needed tension", "shortening", "pose", "shape", "no body", "one node"],
)
def test_no_engine_agrees_by_what_is_no_number(changed, told, monkeypatch):
    def solve(*given) -> EngineState:
        return changed(softer(1.0).solve(*given))

    monkeypatch.setitem(ENGINES._members, "odd", Engine("odd", lambda robot: robot, lambda: "", solve))
    found = crosscheck(ROBOT, pulled(0.0, 0.006), ["odd"])
    assert found.comparisons == ()
    assert not found.agrees
    assert re.search(told, found.failed["odd"])


def test_what_an_engine_leaves_out_is_no_fault_and_is_named(monkeypatch):
    """Above the usual limit a difference needs an explanation of at least its size."""
    for name, strain in (("explained", 6e-4), ("unexplained", 4e-4)):
        left_out = (strain, "the strain of its rods")
        monkeypatch.setitem(
            ENGINES._members, name, replace(softer(1.0 - 5e-4), leaves_out=lambda shape, given=left_out: given)
        )
    good, bad = crosscheck(ROBOT, pulled(0.0, 0.006), ["explained", "unexplained"]).comparisons
    assert good.agrees
    assert good.verdict.startswith("explained and softcal agree to 0.0006 (worst: 5.0e-04, front.tension): more than")
    assert good.verdict.endswith("explained neglects the strain of its rods")
    assert not bad.agrees
    assert bad.verdict.endswith("5.0e-04 relative; the limit is 0.0004")


def test_sofas_beams_leave_out_the_strain_of_rods():
    """Of a straight wire pulled along its axis it is F / (E A), and of a robot without rods nothing."""
    wire = Rod(
        "wire", straight((0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 4), RoundBar(0.002), elastic(1e9, 0.3),
        clamped={"end": np.array([4])}, fixed=np.array([0]),
    )  # fmt: skip
    end = Plate("end", {}, np.array([0.0, 0.0, 0.1]))
    load = PointLoad("weight", "end", np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, 3.0]))
    slack = Cable("slack", (ViaPoint((0.01, 0.0, 0.1), "end"), ViaPoint((0.01, 0.0, 0.0))))
    robot = Robot(plates=(end,), rods=(wire,), cables=(slack,), loads=(load,))
    shape = simulate(robot, Protocol({}), snapshots=True).snapshots[-1]
    limit, why = ENGINES["sofa"].leaves_out(shape)
    assert limit == pytest.approx(3.0 / (1e9 * np.pi * 1e-6), rel=2e-3)
    assert f"{limit:.1e} in wire" in why
    bare = simulate(ROBOT, pulled(0.006), snapshots=True).snapshots[-1]
    assert ENGINES["sofa"].leaves_out(bare) == (0.0, "")


def test_the_tension_that_a_shortening_needs_is_exact_to_first_order():
    """A robot whose cables lack a little shortening under our tensions needs what softcal finds at those lengths."""
    commands = {"front": Command("shortening", np.array([0.01])), "left": Command("shortening", np.array([0.006]))}
    shape = simulate(ROBOT, Protocol(commands), snapshots=True).snapshots[-1]
    lacks = {"front": 2e-5, "left": -1e-5}
    longer = {n: Command("shortening", c.values + lacks[n]) for n, c in commands.items()}
    there = simulate(ROBOT, Protocol(longer)).channels
    ours = {n: float(c.values[0]) for n, c in commands.items()}
    needed = _needed(load_path(ROBOT, shape), shape, ours, {n: ours[n] - lacks[n] for n in ours})
    for name, tension in needed.items():
        change = there[f"{name}.tension"][0] - shape.efforts[name]
        assert tension - shape.efforts[name] == pytest.approx(change, rel=1e-2)
        assert abs(change) > 1e-4
    assert set(needed) == {"front", "left"}


def test_what_a_shortening_needs_is_not_told_where_its_slope_is_unknown():
    shape = simulate(ROBOT, pulled(0.01), snapshots=True).snapshots[-1]
    assert _needed(LoadPath((shape,), ("front",), None), shape, {"front": 0.01}, {"front": 0.01}) == {}


def test_an_engine_is_run_as_it_is_asked_to_and_named_while_it_works(monkeypatch):
    seen = []

    def solve(robot, protocol, shape, running):
        seen.append(running)
        return softer(1.0).solve(robot, protocol, shape, running)

    monkeypatch.setitem(ENGINES._members, "same", replace(softer(1.0), solve=solve))
    monkeypatch.setitem(ENGINES._members, "absent", replace(softer(1.0), missing=lambda: "get it"))
    at_work: list[str] = []
    found = crosscheck(ROBOT, pulled(0.006), ["absent", "same"], timeout=12.0, progress=at_work.append)
    assert found.agrees
    assert seen == [Running(12.0)]
    assert at_work == ["same"]


def test_sofa_is_run_with_the_settings_and_the_timeout(monkeypatch):
    settings = SofaSettings(states=5, timeout=60.0)
    asked: list[SofaSettings] = []

    def engine(given):
        asked.append(given)
        return lambda robot, protocol, snapshots: simulate(robot, protocol, snapshots=snapshots)

    monkeypatch.setattr(sofa_module, "sofa_engine", engine)
    robot = ENGINES["sofa"].own(ROBOT)
    shape = simulate(robot, pulled(0.006), snapshots=True).snapshots[-1]
    for timeout in (None, 7.0):
        ENGINES["sofa"].solve(robot, pulled(0.006), shape, Running(timeout, settings))
    assert asked == [settings, replace(settings, timeout=7.0)]


def test_an_engine_that_fails_or_is_absent_stops_no_other(monkeypatch):
    def fail(robot, protocol, shape, running):
        raise SimulationError("it fell over")

    monkeypatch.setitem(ENGINES._members, "broken", replace(softer(1.0), solve=fail))
    monkeypatch.setitem(ENGINES._members, "absent", replace(softer(1.0), missing=lambda: "get it at the shop"))
    monkeypatch.setitem(ENGINES._members, "same", softer(1.0))
    found = crosscheck(ROBOT, pulled(0.0, 0.006), ["broken", "absent", "same"])
    assert found.failed == {"broken": "it fell over"}
    assert found.absent == {"absent": "get it at the shop"}
    assert [one.engine for one in found.comparisons] == ["same"]


def test_what_calculix_cannot_be_given_is_a_reason():
    cable = replace(side_cable("front", (0.05, 0.0)), friction_coefficient=0.1)
    found = crosscheck(replace(ROBOT, cables=(cable,)), pulled(0.0, 0.004), ["calculix"])  # installed or not
    assert "a cable in CalculiX has no friction" in found.refused["calculix"]
    assert not found.absent
    assert not found.failed


def test_a_robot_that_nothing_moves_is_no_comparison_and_no_failure(monkeypatch):
    def fail(*given):
        raise AssertionError

    monkeypatch.setitem(ENGINES._members, "same", replace(softer(1.0), solve=fail))
    monkeypatch.setitem(ENGINES._members, "absent", replace(softer(1.0), missing=lambda: "get it at the shop"))
    found = crosscheck(ROBOT, Protocol({}), ["same", "absent"])
    assert found.still == ("same",)
    assert (found.comparisons, found.failed) == ((), {})
    assert found.absent == {"absent": "get it at the shop"}


def test_the_furthest_state_is_where_the_cables_are_pulled_most():
    protocol = Protocol(
        {"a": Command("shortening", np.array([0.0, 0.02, 0.01])), "b": Command("tension", np.array([0.0, 4.0, 8.0]))}
    )
    assert {name: command.values.tolist() for name, command in furthest_state(protocol).commands.items()} == {
        "a": [0.02],
        "b": [4.0],
    }
    assert furthest_state(Protocol({})).commands == {}


def test_a_fitted_pose_is_the_motion_that_was_put_in():
    rng = np.random.default_rng(3)
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    R *= np.sign(np.linalg.det(R))
    X = rng.normal(size=(6, 3)) * [1.0, 1.0, 0.0]  # a flat plate
    at, turn = _fitted_pose(X, X @ R.T + [1.0, 2.0, 3.0], np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(turn, R, atol=1e-12)
    np.testing.assert_allclose(at, R @ [0.1, 0.2, 0.3] + [1.0, 2.0, 3.0], atol=1e-12)


@needs_ccx
def test_the_command_prints_a_table_and_a_verdict_and_writes_them(tmp_path):
    project, out = write_project(tmp_path), tmp_path / "out"
    pull = ["--engines", "softcal,calculix", "--pull", "front=3mm", "--timeout", "1min", "--out", str(out)]
    done = CliRunner().invoke(app, ["crosscheck", str(project), *pull])
    assert done.exit_code == 0, done.output
    assert "plate.rotation" in done.output
    assert "pull: calculix and softcal agree to 0.0001" in done.output
    with (out / "differences.csv").open() as file:
        rows = {row["quantity"]: row for row in csv.DictReader(file)}
    assert rows["front.tension (by slope)"]["unit"] == "N"
    assert float(rows["front.shortening"]["in_softcal"]) == pytest.approx(0.003, rel=1e-6)
    assert float(rows["plate.rotation"]["relative"]) < 1e-4
    record = json.loads((out / "crosscheck.json").read_text())
    assert record["states"]["pull"]["calculix"]["agrees"]
    assert record["states"]["pull"]["calculix"]["verdict"] in done.output
    assert record["parameters"]["bar.youngs_modulus"] == {"value": 2e6, "unit": "Pa"}


@pytest.mark.parametrize("value", [1.234567e-5, -0.01234567, 123456.7])
def test_the_table_has_all_its_columns_in_a_terminal_of_80(value, monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "80")
    names = ("front.tension (by slope)", "neck: largest displacement")
    rows = tuple(Difference(name, "rad", value, value, 1e-12, 1e-10) for name in names)
    print_table(_table(EngineComparison("calculix", rows, ())))
    lines = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capsys.readouterr().out).splitlines()
    assert max(map(len, lines)) <= 80
    (row,) = [line for line in lines if "tension" in line]
    assert row.count(f"{value:.6g}") == 2
    assert "1.0e-12" in row
    assert "1.0e-10" in row


def test_a_disagreement_where_the_robot_falls_says_so():
    falls = "Not stable at 12 mm of shortening of front, the robot buckles or snaps to another equilibrium."
    apart = (Difference("plate.x", "m", 0.01, -0.01, 0.02, 2.0),)
    assert EngineComparison("sofa", apart, (), falls).verdict.endswith(
        f"{falls} Two engines may reach different ones of several equilibria"
    )
    assert "stable" not in EngineComparison("sofa", apart, ()).verdict
    assert (
        "stable" not in EngineComparison("sofa", (Difference("plate.x", "m", 0.01, 0.01, 0.0, 0.0),), (), falls).verdict
    )


def test_a_disagreement_ends_with_1_and_is_written(tmp_path, monkeypatch):
    monkeypatch.setitem(ENGINES._members, "calculix", softer(0.9, "bar.youngs_modulus", 2e6))
    project, out = write_project(tmp_path), tmp_path / "out"
    arguments = ["--engines", "calculix", "--pull", "front=3mm", "--out", str(out)]
    done = CliRunner().invoke(app, ["crosscheck", str(project), *arguments])
    assert done.exit_code == 1
    assert "calculix and softcal differ by" in done.output
    assert not json.loads((out / "crosscheck.json").read_text())["states"]["pull"]["calculix"]["agrees"]


def test_an_absent_engine_beside_one_that_agrees_is_told_and_no_failure(tmp_path, monkeypatch):
    monkeypatch.setitem(ENGINES._members, "calculix", softer(1.0, "bar.youngs_modulus", 2e6))
    monkeypatch.setitem(ENGINES._members, "sofa", replace(softer(1.0), missing=lambda: "get it at the shop"))
    project, out = write_project(tmp_path), tmp_path / "out"
    done = CliRunner().invoke(app, ["crosscheck", str(project), "--pull", "front=3mm", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "sofa was skipped, it is not installed: get it at the shop" in done.output
    assert json.loads((out / "crosscheck.json").read_text())["states"]["pull"]["sofa"] == {
        "absent": "get it at the shop"
    }


@pytest.mark.parametrize(("other", "code"), [("sofa", 0), ("", 1)])
def test_an_engine_that_cannot_have_the_robot_is_no_failure_beside_one_that_can(tmp_path, monkeypatch, other, code):
    monkeypatch.setitem(ENGINES._members, "sofa", softer(1.0, "bar.youngs_modulus", 2e6))
    rubbing = ("  cables:\n    front:\n", "  cables:\n    front:\n      friction_coefficient: 0.1\n")
    project, out = write_project(tmp_path, rubbing), tmp_path / "out"
    arguments = ["--engines", f"calculix,{other}".rstrip(","), "--pull", "front=3mm", "--out", str(out)]
    done = CliRunner().invoke(app, ["crosscheck", str(project), *arguments])
    assert done.exit_code == code, done.output
    assert (
        "calculix was skipped, it does not support this robot: front: a cable in CalculiX has no friction"
        in done.output
    )
    assert "failed" not in done.output
    record = json.loads((out / "crosscheck.json").read_text())
    assert record["states"]["pull"]["calculix"]["refused"].startswith("front: a cable in CalculiX")


def test_an_absent_engine_is_named_with_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("SOFA_ROOT", raising=False)
    done = CliRunner().invoke(app, ["crosscheck", str(write_project(tmp_path)), "--pull", "front=3mm"])
    assert done.exit_code == 1
    assert "apt-get install calculix-ccx" in done.output
    assert "conda install -c sofa-framework sofa-softrobots" in done.output


@pytest.fixture
def given(tmp_path, monkeypatch):
    """The command on a project with these states."""

    def run(protocols, factor=1.0):
        monkeypatch.setitem(ENGINES._members, "calculix", softer(factor, "bar.youngs_modulus", 2e6))
        monkeypatch.setattr(
            cases, "cases", lambda project, pulls: {name: cases.Case(project.robot, p) for name, p in protocols.items()}
        )
        project, out = write_project(tmp_path), tmp_path / "out"
        done = CliRunner().invoke(app, ["crosscheck", str(project), "--engines", "calculix", "--out", str(out)])
        return done, out

    return run


def test_states_in_which_nothing_moves_are_a_fault_of_the_user(given):
    done, out = given({"idle": Protocol({}), "slack": pulled(0.0)})
    assert done.exit_code == 2, done.output
    assert "nothing moves the robot, so there is nothing to compare" in done.output
    assert "--pull ACTUATOR=VALUE" in done.output
    assert "failed" not in done.output
    assert not out.exists()


@pytest.mark.parametrize(("factor", "code"), [(1.0, 0), (0.9, 1)])
def test_a_state_in_which_nothing_moves_leaves_the_verdict_to_the_others(given, factor, code):
    done, out = given({"idle": Protocol({}), "pull": pulled(0.003)}, factor)
    assert done.exit_code == code, done.output
    assert "idle: nothing moves the robot, so there is nothing to compare." in done.output
    states = json.loads((out / "crosscheck.json").read_text())["states"]
    assert states["idle"] == {"calculix": {"still": "nothing moves the robot, so there is nothing to compare"}}
    assert states["pull"]["calculix"]["agrees"] == (code == 0)


def test_a_folder_that_holds_files_is_refused_before_any_engine_works(tmp_path, monkeypatch):
    def fail(*given):
        raise AssertionError

    monkeypatch.setitem(ENGINES._members, "calculix", replace(softer(1.0), solve=fail))
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    project = write_project(tmp_path / "project")
    arguments = ["--engines", "calculix", "--pull", "front=3mm", "--out", str(out)]
    done = CliRunner().invoke(app, ["crosscheck", str(project), *arguments])
    assert done.exit_code == 2
    assert "nothing is overwritten" in done.output
    assert [path.name for path in out.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("timeout", "sentence"),
    [
        ("10", "--timeout: the unit is missing"),
        ("10 mm", "--timeout: the unit does not fit"),
        ("0 s", "--timeout: the duration is out of range"),
        ("-1 s", "--timeout: the duration is out of range"),
    ],
)
def test_a_timeout_that_is_none_is_refused(tmp_path, timeout, sentence):
    arguments = ["--engines", "calculix", "--pull", "front=3mm", f"--timeout={timeout}"]
    done = CliRunner().invoke(app, ["crosscheck", str(write_project(tmp_path)), *arguments])
    assert done.exit_code == 2
    assert sentence in done.output


@pytest.mark.parametrize(
    ("engines", "sentence"),
    [("softcal,calculx", "Try: 'calculix'"), ("softcal", "nothing to compare softcal with")],
)
def test_engines_that_make_no_comparison_are_refused(tmp_path, engines, sentence):
    done = CliRunner().invoke(app, ["crosscheck", str(write_project(tmp_path)), "--engines", engines])
    assert done.exit_code == 2
    assert sentence in done.output
