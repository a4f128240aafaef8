"""Bodies that pass through themselves or each other are told of, from where on; what touches or is bonded is not."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from project_case import write_project
from robot_case import write_robot
from typer.testing import CliRunner

from softcal.cli import app
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.write import write_mesh
from softcal.mechanics.contact import ContactTerm
from softcal.mechanics.path import follow
from softcal.project.project import load
from softcal.twin.barrier import Contact
from softcal.twin.build import twin_of
from softcal.twin.crossings import span_in_words
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, PointLoad, Robot, Tie, ViaPoint
from softcal.twin.simulate import simulate
from softcal.workflows.reporting import report_content
from softcal.workflows.run_folder import load_run
from softcal.workflows.template import write_template

ROOT = Path(__file__).parents[2]
GAP = 2e-3  # of the notch
ELASTIC = {"youngs_modulus": 1e6, "poissons_ratio": 0.4}


def notched_mesh(scale: float = 1.0) -> TetMesh:
    """A block of 20 x 10 x 30 mm with a slot of 2 mm in the middle of its height, open to +x."""
    mesh = box_mesh([0.02, 0.01, 0.03], [8, 2, 15], origin=[-0.01, -0.005, 0.0])
    centre = mesh.points[mesh.tets].mean(axis=1)
    tets = mesh.tets[~((np.abs(centre[:, 2] - 0.015) < 0.5 * GAP) & (centre[:, 0] > -0.005))]
    used = np.unique(tets)
    return TetMesh(scale * mesh.points[used], np.searchsorted(used, tets))


def notched(element: str = "P1") -> Robot:
    mesh = notched_mesh()
    z = mesh.points[:, 2]
    body = Body("finger", mesh, np.flatnonzero(z < 1e-9), ELASTIC, element=element)
    top = Plate("top", {"finger": np.flatnonzero(z > 0.03 - 1e-9)}, np.array([0.0, 0.0, 0.03]))
    via = (ViaPoint(np.array([0.014, 0, 0.03]), "top"), ViaPoint(np.array([0.014, 0, 0.0])))
    return Robot((body,), (top,), (Cable("front", via),))


def pulled(*ends: float, samples: int = 31, cable: str = "front") -> Protocol:
    return Protocol({cable: Command("shortening", np.linspace(*((0.0, *ends)[-2:]), samples))})


def mouth(robot: Robot, samples: np.ndarray) -> np.ndarray:
    """The gap of the notch at its mouth [m], sample by sample."""
    protocol = Protocol({"front": Command("shortening", samples)})
    shots = simulate(robot, protocol, snapshots="samples").snapshots
    X = robot.bodies[0].mesh.points
    edge = [np.flatnonzero(np.all(np.abs(X - [0.01, 0.0, z]) < 1e-9, axis=1))[0] for z in (0.014, 0.016)]
    return np.array([shot.points["finger"][edge[1], 2] - shot.points["finger"][edge[0], 2] for shot in shots])


@pytest.mark.slow
@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_a_notch_that_closes_is_told_of_from_where_on(element: str) -> None:
    robot = notched(element)
    d = np.linspace(0.0, 6e-3, 13)
    gap = mouth(robot, d)
    closes = float(np.interp(0.0, -gap, d))
    assert 1e-3 < closes < 5e-3
    response = simulate(robot, pulled(6e-3))
    told = re.fullmatch(
        r"finger intersects itself from ([\d.]+) mm of shortening of front on, "
        r"by about ([\d.]+) mm: set contact: true\.",
        response.crossings,
    )
    assert told, response.crossings
    assert float(told[1]) == pytest.approx(1e3 * closes, abs=0.15)
    assert response.status.endswith(response.crossings)
    assert simulate(robot, pulled(0.9 * closes)).crossings == ""
    assert simulate(robot, pulled(6e-3), crossings=False).crossings == ""


def test_a_crossing_that_contact_would_hardly_change_is_no_doubt() -> None:
    robot, protocol = notched(), pulled(2.52e-3)
    touching = replace(robot, contact=Contact())
    alone, pressed = simulate(robot, protocol), simulate(touching, protocol)
    free, work = (
        np.trapezoid(one.channels["front.tension"], one.channels["front.shortening"]) for one in (alone, pressed)
    )
    assert 0.0 < work / free - 1.0 < 1e-3
    told = r"finger intersects itself from 2.5\d mm of shortening of front on, by about 0.0\d+ mm, "
    assert re.search(rf"{told}where contact would change the work of front by less than 0.1 %\.$", alone.status)
    assert (alone.crossings, alone.doubts, alone.warnings) == ("", "", ())
    # Where contact changes the work by more, and where bodies are deep inside each other, there is doubt.
    for further in (2.6e-3, 3.5e-3):
        alone, pressed = (simulate(one, pulled(further)) for one in (robot, touching))
        free, work = (
            np.trapezoid(one.channels["front.tension"], one.channels["front.shortening"]) for one in (alone, pressed)
        )
        assert work / free - 1.0 > 1e-3
        assert alone.doubts == "bodies intersect"
        assert "would change the work" not in alone.status


def test_what_crosses_under_the_loads_does_so_from_the_start_on() -> None:
    weight = PointLoad("weight", "top", np.array([0.0, 0.0, 0.03]), np.array([0.0, 0.0, -15.0]))
    told = simulate(replace(notched(), loads=(weight,)), pulled(2e-3)).crossings
    assert told.startswith("finger intersects itself from the start on, by about "), told


@pytest.mark.parametrize(
    ("begin", "stop", "words"),
    [
        (None, None, "from the start on"),
        (None, 2e-3, "from the start to 2 mm of shortening of a"),
        (1e-3, None, "from 1 mm of shortening of a on"),
        (1e-3, 2e-3, "from 1 to 2 mm of shortening of a"),
    ],
)
def test_spans_in_words(begin: float | None, stop: float | None, words: str) -> None:
    assert span_in_words(begin, stop, "a") == words


def test_by_tension_it_is_told_up_to_the_largest_that_is_asked_for() -> None:
    robot = notched()
    response = simulate(robot, pulled(6e-3))
    (onset,) = re.findall(r"from ([\d.]+) mm", response.crossings)
    c, tension = response.channels["front.shortening"], response.channels["front.tension"]
    closing = float(np.interp(1e-3 * float(onset), c, tension))

    def told(largest: float) -> str:
        return simulate(robot, Protocol({"front": Command("tension", np.linspace(0.0, largest, 7))})).crossings

    assert told(0.9 * closing) == ""
    (by_tension,) = re.findall(r"from ([\d.]+) mm of shortening", told(1.3 * closing))
    assert float(by_tension) == pytest.approx(float(onset), abs=0.1)


def test_where_a_drive_by_tension_ends_short_what_crosses_on_the_way_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be why."""
    robot = notched()
    tension = simulate(robot, pulled(6e-3)).channels["front.tension"]

    def short(*args, **options):
        path = follow(*args, **options)
        return replace(path, reached=False, status="it ends here")

    monkeypatch.setattr("softcal.twin.equilibrium_path.follow", short)
    asked = Protocol({"front": Command("tension", np.array([0.05, 3.0]) * tension[-1])})
    monkeypatch.setattr(
        "softcal.twin.equilibrium_path.WOUND_UP", 1.0 - 6e-3 / 0.03
    )  # of its length: the path ends there
    response = simulate(robot, asked)
    assert not response.succeeded
    assert "it ends here" in response.status
    assert "intersects itself" in response.crossings


def test_of_several_cables_the_samples_are_told() -> None:
    robot = notched()
    back = Cable("back", (ViaPoint(np.array([-0.014, 0, 0.03]), "top"), ViaPoint(np.array([-0.014, 0, 0.0]))))
    both = replace(robot, cables=(*robot.cables, back))
    protocol = Protocol(
        {
            "front": Command("shortening", np.array([0.0, 1e-3, 5e-3, 6e-3])),
            "back": Command("tension", np.full(4, 0.01)),
        }
    )
    response = simulate(both, protocol)
    assert "finger intersects itself at sample 3" in response.crossings
    assert "and 1 more" in response.crossings


def test_contact_that_is_on_needs_no_telling() -> None:
    robot = notched()
    assert twin_of(replace(robot, contact=Contact())).skins is None


def column(name: str, x: float, *, free: bool = False) -> Body:
    mesh = box_mesh([0.01, 0.01, 0.04], [2, 2, 8], origin=[x, -0.005, 0.0])
    foot = np.flatnonzero(mesh.points[:, 2] < 1e-9)
    return Body(name, mesh, foot[:0] if free else foot, ELASTIC, element="P1")


def two_columns(apart: float) -> Robot:
    """Two columns side by side, the left one bent to the right one by a cable across."""
    left, right = column("left", 0.0), column("right", 0.01 + apart)
    top = Plate("top", {"left": np.flatnonzero(left.mesh.points[:, 2] > 0.04 - 1e-9)}, np.array([0.005, 0.0, 0.04]))
    via = (ViaPoint(np.array([0.005, 0.0, 0.04]), "top"), ViaPoint(np.array([0.08, 0.0, 0.04])))
    return Robot((left, right), (top,), (Cable("across", via),))


def test_two_bodies_that_cross_are_named() -> None:
    response = simulate(two_columns(3e-3), pulled(6e-3, cable="across"))
    (onset,) = re.findall(r"left and right intersect from ([\d.]+) mm of shortening of across on", response.crossings)
    assert float(onset) == pytest.approx(3.0, abs=0.3)
    assert simulate(two_columns(3e-3), pulled(2.5e-3, cable="across")).crossings == ""


@pytest.mark.parametrize("apart", [0.0, 1e-9, -1e-9, 1e-5])
def test_bodies_that_touch_do_not_cross(apart: float) -> None:
    skins = twin_of(two_columns(apart)).skins
    assert skins is not None
    assert skins.crossings(twin_of(two_columns(apart)).system.layout.X) == {}


def test_bodies_that_overlap_at_rest_are_meant_to() -> None:
    response = simulate(two_columns(-2e-3), pulled(2e-3, cable="across"))
    assert response.succeeded
    assert response.crossings == ""


def test_bodies_that_are_bonded_do_not_cross(tmp_path: Path) -> None:
    robot = load(write_robot(tmp_path)).robot
    response = simulate(robot, pulled(1e-3))
    assert response.succeeded, response.status
    assert response.crossings == ""


def test_nor_do_those_that_are_tied_and_bulge() -> None:
    lower = column("lower", 0.0)
    upper = column("upper", 0.0, free=True)
    above = replace(upper, mesh=TetMesh(upper.mesh.points * [0.9, 0.8, 1.0] + [0.0005, 0.0, 0.04], upper.mesh.tets))
    z = above.mesh.points[:, 2]
    tie = Tie("seam", "upper", np.flatnonzero(z < 0.04 + 1e-9), "lower")
    top = Plate("top", {"upper": np.flatnonzero(z > 0.08 - 1e-9)}, np.array([0.005, 0.0, 0.08]))
    via = (ViaPoint(np.array([0.008, 0.0, 0.08]), "top"), ViaPoint(np.array([0.008, 0.0, 0.0])))
    robot = Robot((lower, above), (top,), (Cable("front", via),), ties=(tie,))
    response = simulate(robot, pulled(0.02))
    assert response.channels["front.tension"][-1] > 0.0
    assert response.crossings == ""


@pytest.mark.parametrize("where", ["neck", "neck-bench", "beam"])
def test_no_example_crosses_at_rest(where: str) -> None:
    robot = load(ROOT / "examples" / where / "project.yaml").robot
    twin = twin_of(replace(robot, contact=None))  # with contact surfaces are not compared
    assert twin.skins is not None
    assert twin.skins.crossings(twin.system.layout.X) == {}
    assert simulate(twin.robot, Protocol({})).crossings == ""


@pytest.mark.slow  # of the other examples: tests/unit/test_documented_commands.py
@pytest.mark.parametrize("where", ["beam", "neck-bench/cycles.yaml"])
def test_no_example_without_contact_intersects_itself_within_its_data(where: str, tmp_path: Path) -> None:
    path = ROOT / "examples" / where
    path = path if path.suffix else path / "project.yaml"
    assert load(path).robot.contact is None
    said = run("check", path, "--out", tmp_path / "check")
    assert "intersects itself" not in said
    assert "The project is in order." in said


def test_no_template_crosses_at_rest(tmp_path: Path) -> None:
    robot = load(write_template("neck", tmp_path / "neck")).robot
    twin = twin_of(replace(robot, contact=None))
    assert twin.skins is not None
    assert twin.skins.crossings(twin.system.layout.X) == {}


def notched_project(folder: Path) -> Path:
    """The project of the bar with the notched block in its place, and the end of the test beyond where it closes."""
    changes = (
        ("reference: [0 mm, 0 mm, 100 mm]", "reference: [0 mm, 0 mm, 30 mm]"),
        ("{on: plate, at: [30 mm, 0 mm, 100 mm]}", "{on: plate, at: [14 mm, 0 mm, 30 mm]}"),
        ("{at: [30 mm, 0 mm, 0 mm]}", "{at: [14 mm, 0 mm, 0 mm]}"),
    )
    response = simulate(notched(), pulled(6e-3, samples=7))
    rows = zip(
        1e3 * response.channels["front.shortening"],
        response.channels["front.tension"],
        np.rad2deg(response.channels["top.pitch"]),
        strict=True,
    )
    lines = [f"{0.1 * i:.1f},{d:.6f},{f:.6f},{p:.6f}" for i, (d, f, p) in enumerate(rows)]
    data = "\n".join(["Time [s],Displacement [mm],Force [N],Pitch [deg]", *lines]) + "\n"
    path = write_project(folder, *changes, data=data)
    mesh = notched_mesh(1e3)
    write_mesh(mesh, folder / "bar.msh")
    path.write_text(
        path.read_text().replace("head: {group: z1}", "head: {plane: {point: [0 mm, 0 mm, 30 mm], normal: [0, 0, 1]}}")
    )
    return path


def run(*arguments: object) -> str:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.slow
def test_check_states_what_presses_and_how_much_of_it_is_near_at_rest(tmp_path: Path) -> None:
    path = write_project(tmp_path)
    assert "near a surface at rest" not in run("check", path)
    path.write_text(path.read_text().replace("robot:\n", "robot:\n  contact: true\n", 1))
    (term,) = twin_of(load(path).robot).system.of(ContactTerm)
    said = " ".join(run("check", path).split())
    assert f"contact {len(term.reach):,} points, 0 of them near a surface at rest; " in said
    assert "1 of them" in replace(term, reach=np.append(term.reach[1:], 0.5 * term.depth)).in_words()


@pytest.mark.long
def test_every_command_tells_of_it_once(tmp_path: Path) -> None:
    path = notched_project(tmp_path)
    told = "bar intersects itself from"
    assert run("simulate", path, "--out", tmp_path / "simulated").count(told) == 1
    assert run("export", "vtk", path, "--out", tmp_path / "vtk").count(told) == 1
    deck = run("export", "calculix", path, "--out", tmp_path / "ccx")
    assert deck.count(told) == 1
    assert "set contact: true" not in deck  # which is not exported
    reduced = run("export", "reduced", path, "--reach", "5mm", "--samples", 10, "--out", tmp_path / "reduced")
    assert reduced.count(told) == 1
    end = run("calibrate", path, "--no-report", "--out", tmp_path / "run")
    assert end.count(told) == 1
    first = next(line for line in end.splitlines() if " E = " in line or line.startswith("E = "))
    assert first.startswith("The solved shapes are in doubt (bodies intersect); E = ")
    results = load_run(tmp_path / "run")
    twin = report_content(results).twin
    assert twin is not None
    assert told in twin.crossings
    before = run("simulate", path, "--pull", "front=1mm", "--out", tmp_path / "less")
    assert "intersects" not in before
