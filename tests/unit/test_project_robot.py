"""The robot section of a project file: rods, rigid discs with holes, ties, markers, placements, the manipulator."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from changed_trials import undigested
from project_case import write_project
from robot_case import MANIPULATOR, write_robot

from softcal.errors import InputError, StorageError
from softcal.geometry.section import RectangularBar
from softcal.project.project import Project, load
from softcal.twin.manipulator import Discs, Manipulator, Springs, manipulator
from softcal.twin.masses import plate_inertia
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import PointLoad, Robot, Rod
from softcal.twin.simulate import simulate


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return load(write_robot(tmp_path))


def part(robot: Robot, name: str):
    kinds = (robot.bodies, robot.rods, robot.plates, robot.ties, robot.cables, robot.loads, robot.markers)
    return next(part for parts in kinds for part in parts if part.name == name)


def rod_of(folder: Path, *changes: tuple[str, str]) -> Rod:
    return load(write_robot(folder, *changes)).robot.rods[0]


def test_a_via_point_just_outside_its_body_is_warned_of(tmp_path: Path) -> None:
    def warned(x: str) -> list[str]:
        at = "{on: plate, at: [30 mm, 0 mm, 100 mm]}", f"{{on: bar, at: [{x}, 0 mm, 100 mm]}}"
        return [str(one) for one in load(write_project(tmp_path / x, at)).warnings]

    (told,) = warned("11 mm")
    assert "project.yaml:19: robot.cables.front.via[0].at: the point lies outside its body by 1 mm" in told
    assert warned("10.02 mm") == []


def test_everything_is_there_and_bends(project: Project):
    assert project.warnings == ()
    command = Protocol({"front": Command("tension", np.linspace(0, 0.5, 3))})
    response = simulate(project.robot, command)
    assert response.succeeded, response.status
    moved = response.channels["eye.y"][-1] - response.channels["eye.y"][0]
    assert moved > 1e-3, "the front cable pulls the mast towards +y"
    assert abs(response.channels["wall.x"][0] - 0.012) < 1e-3, "a marker may stand off its body"


def test_a_body_is_put_in_place_with_its_regions(project: Project):
    lower, upper = project.robot.bodies
    c, s = math.cos(math.radians(15)), math.sin(math.radians(15))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(upper.mesh.points, lower.mesh.points @ turn.T + [0, 0, 0.04], atol=1e-15)
    foot = upper.mesh.points[project.robot.ties[0].nodes]
    np.testing.assert_allclose(foot[:, 2], 0.04, atol=1e-12)
    assert project.qualities["upper"].upper[2] == pytest.approx(0.08)


def test_turns_follow_one_another(tmp_path: Path):
    twice = (
        "rotation: {axis: [0, 0, 1], angle: 15 deg}",
        "rotation: [{axis: [0, 0, 2], angle: 90 deg}, {axis: [1, 0, 0], angle: 90 deg}]",
    )
    away = ("position: [0 mm, 0 mm, 40 mm]", "position: [0 mm, 0 mm, 400 mm]")
    untied = ("  ties:\n    seam: {body: upper, region: foot, on: lower}\n", "")
    held = ("mass: 10 g", "mass: 10 g\n      fixed: true")
    elsewhere = ("centre: [0 mm, 0 mm, 82 mm]", "centre: [0 mm, 2 mm, 700 mm]")
    path = write_robot(tmp_path, twice, away, untied, held, elsewhere)
    lower, upper = load(path).robot.bodies
    # x -> y -> z, y -> -x -> -x, z -> z -> -y
    x, y, z = lower.mesh.points.T
    np.testing.assert_allclose(upper.mesh.points, np.column_stack([-y, -z, x]) + [0, 0, 0.4], atol=1e-12)


def test_plates_have_holes_and_a_shape(project: Project):
    top = part(project.robot, "top")
    assert list(top.holes) == ["a", "b", "c"]
    np.testing.assert_allclose(top.holes["a"], [0, 0.025, 0.08], atol=1e-12)
    for hole, angle in (("b", 210), ("c", 330)):
        x, y = 0.025 * math.cos(math.radians(angle)), 0.025 * math.sin(math.radians(angle))
        np.testing.assert_allclose(top.holes[hole], [x, y, 0.08], atol=1e-12)
    assert (top.disc.diameter, top.disc.thickness, top.disc.hole_diameter) == (0.06, 0.004, 0.002)
    np.testing.assert_allclose(top.disc.axis, [0, 0, 1])
    np.testing.assert_allclose(part(project.robot, "front").via_points[1].at, top.holes["a"])
    assert part(project.robot, "front").via_points[1].on == "top"


@pytest.mark.parametrize(
    ("written", "tensor"),
    [
        ("[20 kg*mm^2, 0.3 kg cm^2, 4e-5 kg*m^2]", np.diag([2e-5, 3e-5, 4e-5])),
        (
            "[[20 kg*mm^2, 1 kg*mm^2, 0], [1 kg*mm^2, 30 kg*mm^2, 0], [0, 0, 40 kg*mm^2]]",
            [[2e-5, 1e-6, 0.0], [1e-6, 3e-5, 0.0], [0.0, 0.0, 4e-5]],
        ),
    ],
)
def test_the_inertia_of_a_plate_stands_before_that_of_its_disc(tmp_path: Path, written: str, tensor: np.ndarray):
    project = load(write_robot(tmp_path, ("mass: 10 g", f"mass: 10 g\n      inertia: {written}")))
    np.testing.assert_allclose(plate_inertia(part(project.robot, "top")), tensor, rtol=1e-12)
    disc = plate_inertia(part(load(write_robot(tmp_path / "disc")).robot, "top"))
    np.testing.assert_allclose(disc[2, 2], 0.01 * 0.03**2 / 2, rtol=1e-12)


def test_a_plate_on_two_bodies(tmp_path: Path):
    """A rigid collar in the place of the tie."""
    both = "{bodies: {lower: head, upper: foot}, reference: [0 mm, 0 mm, 40 mm]}"
    project = load(
        write_robot(
            tmp_path,
            ("  ties:\n    seam: {body: upper, region: foot, on: lower}\n", ""),
            ("    tip:\n", f"    collar: {both}\n    tip:\n"),
        )
    )
    collar = part(project.robot, "collar")
    assert sorted(collar.nodes) == ["lower", "upper"]
    for body in project.robot.bodies:
        np.testing.assert_allclose(body.mesh.points[collar.nodes[body.name], 2], 0.04, atol=1e-12)


def test_loads_by_mass_and_by_direction(project: Project):
    weight, push = part(project.robot, "weight"), part(project.robot, "push")
    assert isinstance(weight, PointLoad)
    np.testing.assert_allclose(weight.force, [0, 0, -0.005 * 9.81])
    np.testing.assert_allclose(push.force, [0, 0.02, 0])
    np.testing.assert_allclose(push.at, part(project.robot, "top").holes["b"])
    assert project.parameters["weight.force"].value == pytest.approx(0.005 * 9.81)
    held = load(project.path, values={"weight.force": "2 gf"})
    np.testing.assert_allclose(part(held.robot, "weight").force, [0, 0, -0.002 * 9.80665])


def test_a_load_without_force_keeps_its_direction(tmp_path: Path):
    robot = load(write_robot(tmp_path, ("force: 0.02 N", "force: 0 N"))).robot
    np.testing.assert_allclose(part(robot, "push").direction, [0, 1, 0])


def test_a_straight_rod_with_a_plate_in_between(tmp_path: Path):
    rod = rod_of(tmp_path, ("{top: start, tip: end}", "{top: start, tip: 50 mm}"))
    stations = rod.centreline.stations
    assert stations[-1] == pytest.approx(0.118)
    assert stations[rod.clamped["tip"][0]] == pytest.approx(0.05, abs=1e-12)
    assert rod.clamped["top"].tolist() == [0]
    assert np.diff(stations).max() <= 0.118 / 40 + 1e-12
    assert rod.density == 900.0


def test_several_stations_and_a_number_of_elements(tmp_path: Path):
    change = ("{top: start, tip: end}", "{top: [start, 4 mm], tip: end}\n      elements: 5")
    rod = rod_of(tmp_path, change)
    np.testing.assert_allclose(rod.centreline.stations[rod.clamped["top"]], [0, 0.004], atol=1e-12)
    assert len(rod.centreline.lengths) == 6


def test_a_rod_that_is_fixed_by_itself(tmp_path: Path):
    rod = rod_of(tmp_path, ("{top: start, tip: end}", "{tip: end}\n      fixed: start"),
                 ("[0 mm, 0 mm, 82 mm], end", "[0 mm, 100 mm, 0 mm], end"))  # fmt: skip
    assert rod.fixed.tolist() == [0]


def test_a_helix_by_pitch_and_by_height(tmp_path: Path):
    straight = "straight: {start: [0 mm, 0 mm, 82 mm], end: [0 mm, 0 mm, 200 mm]}"
    head = "helix: {base: [0 mm, 0 mm, 84 mm], coil_diameter: 20 mm, turns: 4, towards: [1, 0, 0], "
    one = rod_of(tmp_path / "a", (straight, head + "pitch: 29 mm}"))
    two = rod_of(tmp_path / "b", (straight, head + "height: 116 mm, left_handed: true}"))
    np.testing.assert_allclose(one.centreline.nodes[0], [0.01, 0, 0.084], atol=1e-12)
    np.testing.assert_allclose(one.centreline.nodes[-1], [0.01, 0, 0.2], atol=1e-12)
    np.testing.assert_allclose(two.centreline.nodes, one.centreline.nodes * [1, -1, 1], atol=1e-12)
    assert len(one.centreline.lengths) == 48


def test_a_curve_through_points_with_a_station_between_them(tmp_path: Path):
    angle = np.linspace(0, 0.5 * math.pi, 10)
    arc = ", ".join(f"[{100 * math.sin(a):.9g} mm, 0 mm, {82 + 100 * (1 - math.cos(a)):.9g} mm]" for a in angle)
    straight = "straight: {start: [0 mm, 0 mm, 82 mm], end: [0 mm, 0 mm, 200 mm]}"
    rod = rod_of(
        tmp_path, (straight, f"polyline: {{points: [{arc}]}}"), ("{top: start, tip: end}", "{top: start, tip: 40 mm}")
    )
    x, _, z = rod.centreline.nodes.T
    np.testing.assert_allclose(np.hypot(x, z - 0.182), 0.1, atol=1e-6)
    at = rod.clamped["tip"][0]
    assert math.atan2(x[at], 0.182 - z[at]) * 0.1 == pytest.approx(0.04, abs=1e-6)
    assert rod.centreline.stations[-1] == pytest.approx(0.05 * math.pi, rel=1e-6)


@pytest.mark.parametrize(
    ("section", "expected"),
    [
        ("{width: 3 mm, height: 5 mm}", RectangularBar(0.003, 0.005).constants),
        ("{diameter: 4 mm, inner_diameter: 3 mm}", None),
        ("{area: 9 mm^2, I1: 5 mm^4, I2: 6 mm^4, J: 7 mm^4}", None),
    ],
)
def test_sections(tmp_path: Path, section: str, expected: object):
    found = rod_of(tmp_path, ("{diameter: 4 mm}", section)).section.constants
    if expected is not None:
        assert found == expected
    elif "inner" in section:
        assert found.outer_diameter == pytest.approx(0.004)
        assert found.area == pytest.approx(math.pi / 4 * 7e-6)
    else:
        np.testing.assert_allclose([found.area, found.I1, found.I2, found.J], [9e-6, 5e-12, 6e-12, 7e-12])


def test_a_rod_is_put_in_place(tmp_path: Path):
    rod = rod_of(
        tmp_path,
        (
            "{start: [0 mm, 0 mm, 82 mm], end: [0 mm, 0 mm, 200 mm]}",
            "{start: [0 mm, 0 mm, 0 mm], end: [118 mm, 0 mm, 0 mm]}",
        ),
        (
            "section: {diameter: 4 mm}",
            "section: {diameter: 4 mm}\n"
            "      placement: {position: [0 mm, 0 mm, 82 mm], rotation: {axis: [0, 1, 0], angle: -90 deg}}",
        ),
    )
    np.testing.assert_allclose(rod.centreline.nodes[-1], [0, 0, 0.2], atol=1e-12)
    np.testing.assert_allclose(rod.centreline.triads[:, :, 2], np.tile([0, 0, 1], (41, 1)), atol=1e-12)


def test_the_manipulator_and_more_parts(tmp_path: Path):
    project = load(write_robot(tmp_path, text=MANIPULATOR))
    robot = project.robot
    springs = Springs(youngs_modulus=1.6e9, poissons_ratio=0.43)
    expected = manipulator(Manipulator(springs=springs, discs=Discs(mass=0.02)), gravity=(0, 0, -9.81))
    assert [plate.name for plate in robot.plates] == ["base", "S1", "S2", "S3", "S4"]
    assert [cable.name for cable in robot.cables] == [*(f"cable{k}" for k in range(1, 7)), "extra"]
    assert [marker.name for marker in robot.markers] == ["marker1", "marker2", "marker3", "marker4", "tip"]
    for one, other in zip(robot.rods, expected.rods, strict=True):
        np.testing.assert_array_equal(one.centreline.nodes, other.centreline.nodes)
        assert one.section.constants.outer_diameter == pytest.approx(other.section.constants.outer_diameter)
        assert one.parameters == other.parameters
    np.testing.assert_array_equal(robot.cables[-1].via_points[1].at, part(robot, "S3").holes["h2"])
    assert [plate.mass for plate in robot.plates] == [0.0, 0.02, 0.02, 0.02, 0.02]
    assert part(robot, "cable2").via_points[-1].on == "S2"
    assert part(robot, "cable4").via_points[-1].on == "S4"


def test_a_modulus_for_each_spring(tmp_path: Path):
    moduli = "youngs_modulus: {spring1: 1 GPa, spring2: 2 GPa, spring3: 3 GPa, spring4: 4 GPa}"
    project = load(write_robot(tmp_path, ("youngs_modulus: 1.6 GPa", moduli), text=MANIPULATOR))
    assert [rod.parameters["youngs_modulus"] for rod in project.robot.rods] == [1e9, 2e9, 3e9, 4e9]


def test_discs_weigh_their_volume(tmp_path: Path):
    light = (", mass: 20 g", ""), ("turns: 3\n", "turns: 3\n      density: 900 kg/m^3\n")
    robot = load(write_robot(tmp_path, *light, text=MANIPULATOR)).robot
    volume = math.pi / 4 * (0.06**2 - 6 * 0.003**2) * 0.008
    assert part(robot, "S1").mass == pytest.approx(900 * volume)


def test_contact_is_off_unless_asked_for(tmp_path: Path):
    from softcal.twin.barrier import Contact

    gravity = "  gravity: [0"
    off = load(write_robot(tmp_path / "off", (gravity, f"  contact: false\n{gravity}"), text=MANIPULATOR)).robot
    assert off.contact is None
    assert load(write_robot(tmp_path / "left", text=MANIPULATOR)).robot.contact is None
    on = load(write_robot(tmp_path / "on", (gravity, f"  contact: true\n{gravity}"), text=MANIPULATOR)).robot
    assert on.contact == Contact()
    wrong = write_robot(tmp_path / "wrong", (gravity, f"  contact: perhaps\n{gravity}"), text=MANIPULATOR)
    with pytest.raises(InputError, match=r"robot\.contact: .*; got 'perhaps'; allowed: true, false, or a mapping"):
        load(wrong)
    mine = (gravity, "  contact: {gap: 0.3 mm, depth: 0.1 mm, friction_coefficient: 0.2, creep: 2 mm/s}\n" + gravity)
    contact = load(write_robot(tmp_path / "mine", mine, text=MANIPULATOR)).robot.contact
    assert contact is not None
    assert (contact.gap, contact.depth, contact.friction_coefficient, contact.creep) == (0.0003, 0.0001, 0.2, 0.002)
    assert contact.follows_moduli


def test_the_template_checks_and_pulls(tmp_path: Path):
    from softcal.workflows.cases import parse_pulls
    from softcal.workflows.checking import check
    from softcal.workflows.template import write_template

    project = load(write_template("manipulator", tmp_path / "m"))
    rows = dict(check(project).rows)
    assert rows["rod spring1"].startswith("298.5 mm long, 36 elements, 9 mm thick, attached: base at 0 mm")
    assert rows["marker marker4"] == "on S4"
    assert rows["plate S4"] == "on spring4, 6 holes, mass 20 g"
    text = (tmp_path / "m" / "project.yaml").read_text()
    assert text.count("assumption") >= 15
    by_force = simulate(project.robot, parse_pulls(project.robot, ["cable6=19.62N"]))
    by_mass = simulate(project.robot, parse_pulls(project.robot, ["cable6.mass=2kg"]))
    assert by_force.succeeded, by_force.status
    np.testing.assert_allclose(by_mass.channels["marker4.z"], by_force.channels["marker4.z"], atol=1e-12)
    assert by_force.channels["marker4.z"][-1] > -0.3, "2 kgf bend the nominal manipulator by some 75 deg"
    together = parse_pulls(project.robot, ["cable1=5N", "cable5=1kgf"])
    assert together.commands["cable5"].values[-1] == pytest.approx(9.80665)
    assert list(together.commands) == ["cable1", "cable5"]


def test_a_generated_mesh_is_put_in_place_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A run keeps the mesh as it was made: read back, it is placed again, and only once."""
    from softcal.project import building as module
    from softcal.workflows.run_folder import _copy_inputs  # pyright: ignore[reportPrivateUsage]

    monkeypatch.setattr(module, "is_generated", lambda body: body.placement is not None)
    path = write_robot(tmp_path)
    first = load(path)
    assert list(first.generated) == ["upper"]
    copies = _copy_inputs(first, tmp_path)
    again = load(path, copies=copies)
    np.testing.assert_allclose(again.robot.bodies[1].mesh.points, first.robot.bodies[1].mesh.points, atol=1e-12)


def test_a_run_whose_generated_mesh_is_not_known_to_be_the_same_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from softcal.project import building as module
    from softcal.workflows.run_folder import RECORD, begin_run, load_run, reopen_run

    monkeypatch.setattr(module, "is_generated", lambda body: body.placement is not None)
    project, folder = load(write_robot(tmp_path)), tmp_path / "run"
    begin_run(project, project.calibration, ["pull"], folder)
    reopen_run(project, folder)
    record, mesh = undigested(json.loads((folder / RECORD).read_text())), folder / "inputs" / "meshes" / "upper.vtu"
    as_made = mesh.read_bytes()
    mesh.write_bytes(as_made + b"\n")
    with pytest.raises(StorageError, match=r"^\S*upper\.vtu: the file was changed after the calibration"):
        load_run(folder)
    mesh.write_bytes(as_made)
    del record["hashes"]["mesh of upper"]
    (folder / RECORD).write_text(json.dumps(record))
    for read in (load_run, lambda folder: reopen_run(project, folder)):
        with pytest.raises(StorageError, match=r"^\S*upper\.vtu: the run has no hash of the file"):
            read(folder)


def test_fingerprints_tell_the_new_parts_apart(tmp_path: Path):
    from softcal.calibration.problem.fingerprint import fingerprint

    changes = [
        (),
        (("section: {diameter: 4 mm}", "section: {diameter: 5 mm}"),),
        (("tip: end}", "tip: 110 mm}"),),
        (("region: foot, on: lower", "region: foot, on: lower, tolerance: 3 mm"),),
        (("{on: lower, at: [12 mm", "{on: lower, at: [11 mm"),),
        (("angle: 15 deg", "angle: 16 deg"),),
        (("first_angle: 90 deg", "first_angle: 91 deg"),),
        (("direction: [0, 2, 0]", "direction: [1, 2, 0]"),),
        (("mass: 5 g", "mass: 6 g"),),
    ]
    prints = [fingerprint(load(write_robot(tmp_path / str(k), *change)).robot) for k, change in enumerate(changes)]
    assert len(set(prints)) == len(changes)
    assert fingerprint(load(write_robot(tmp_path / "again")).robot) == prints[0]


def test_a_twin_of_is_not_mistaken_for_another(tmp_path: Path):
    """Robots that differ in a clamp or a marker alone do not share a system."""
    command = Protocol({"front": Command("tension", np.array([0.0, 0.3]))})
    seen = [
        simulate(load(write_robot(tmp_path / name, *change)).robot, command).channels["eye.y"][-1]
        for name, change in {
            "a": (),
            "b": (("tip: end}", "tip: 110 mm}"),),
            "c": (("{on: tip, hole: p1}", "{on: top, hole: c}"),),
        }.items()
    ]
    assert len({round(value, 9) for value in seen}) == 3
