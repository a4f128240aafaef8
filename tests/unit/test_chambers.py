"""Pressure chambers at every door: commands, vacuum, hoses, project files, tables."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import blown_box

from softcal.analysis.candidate import as_experiment
from softcal.analysis.default_candidates import default_candidates
from softcal.calibration.problem.observation import commands
from softcal.checks import Ints
from softcal.errors import InputError, MeshError, ProjectFileError
from softcal.export.reduced import evaluator_of
from softcal.geometry.cell import all_faces
from softcal.geometry.surface import boundary_faces
from softcal.geometry.write import write_mesh
from softcal.mechanics.chamber import ATMOSPHERE, ChamberTerm
from softcal.plugins.fleet.workflow import fleet
from softcal.plugins.watch.run_reader import RunReader
from softcal.plugins.watch.twin import simulated_twin
from softcal.project.project import load
from softcal.twin.actuated import NamedActuator
from softcal.twin.build import build_twin
from softcal.twin.in_time import simulate_in_time
from softcal.twin.live import LiveTwin
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Marker, Robot
from softcal.twin.schedule import Schedule
from softcal.twin.simulate import simulate
from softcal.twin.time_settings import TimeSettings
from softcal.workflows.calibrated_shapes import furthest_experiment
from softcal.workflows.calibration import calibrate, make_problem
from softcal.workflows.cases import commanded, parse_pulls
from softcal.workflows.next_test import next_test
from softcal.workflows.reach import reach
from softcal.workflows.reporting import write_report
from softcal.workflows.simulation import twin_view
from softcal.workflows.sweep import sweep
from softcal.workflows.twin_frame import twin_frame

DEAD = 1e-4  # [m^3], forty times the chamber


def box(**own: float | str) -> Robot:
    """A box with a closed chamber of gas."""
    robot = blown_box("P1", is_open=False, medium="liquid")
    (named,) = robot.actuators
    chamber = replace(named.actuator, **{"medium": "gas", "hose_compliance": None, **own})
    return replace(robot, actuators=(replace(named, actuator=chamber),))


def driven(robot: Robot, control: str, *values: float, **options: object):
    return simulate(robot, Protocol({"main": Command(control, np.array(values))}), **options)


def swallowed(robot: Robot, pressure: float) -> float:
    """What the gas at rest takes up [m^3]."""
    gas = build_twin(robot).system.of(ChamberTerm)[0].rest_volume + DEAD
    return gas * (1.0 - ATMOSPHERE / (ATMOSPHERE + pressure))


@pytest.mark.slow
@pytest.mark.parametrize("pressure", [4e4, 8e4, -4e4, -9e4])
def test_a_long_hose_takes_up_more_than_the_chamber_itself(pressure):
    robot = box(dead_volume=DEAD)
    response = driven(robot, "pressure", pressure)
    assert response.succeeded, response.status
    assert response.channels["main.volume"][0] == pytest.approx(swallowed(robot, pressure), rel=0.1)
    # the same state by the other command
    back = driven(robot, "volume", *response.channels["main.volume"])
    assert back.channels["main.pressure"][0] == pytest.approx(pressure, rel=1e-3)


def test_a_vacuum_alone_is_a_path_from_rest():
    robot, values = box(dead_volume=3e-6), (0.0, -1e4, -5e4)
    response = driven(robot, "pressure", *values, snapshots=True)
    assert response.succeeded, response.status
    np.testing.assert_array_equal(response.channels["main.pressure"], values)
    each = [driven(robot, "pressure", value).channels["main.volume"][0] for value in values[1:]]
    np.testing.assert_allclose(response.channels["main.volume"], [0.0, *each], rtol=1e-4, atol=1e-12)
    first, last = response.snapshots[0], response.snapshots[-1]
    assert first.efforts["main"] == pytest.approx(0.0, abs=1e-6)
    assert last.efforts["main"] == pytest.approx(-5e4, rel=1e-3)


def test_a_vacuum_before_a_pressure_is_shown_from_rest_on():
    response = driven(box(dead_volume=3e-6), "volume", -1e-6, 1e-6, snapshots=True)
    efforts = [shape.efforts["main"] for shape in response.snapshots]
    assert efforts[0] == pytest.approx(0.0, abs=1e-6)
    assert min(efforts) < 0.0 < efforts[-1] == max(efforts)


def test_a_wall_is_a_surface_of_one_chamber_alone():
    robot = box()
    (named,) = robot.actuators
    wall = named.actuator.walls["box"]
    outer = {frozenset(face) for face in boundary_faces(robot.bodies[0].mesh).tolist()}
    inner = [face for face in all_faces(robot.bodies[0].mesh.tets).tolist() if frozenset(face) not in outer]

    def refused(*walls: Ints) -> str:
        each = (replace(named.actuator, walls={"box": one}) for one in walls)
        with pytest.raises(MeshError) as error:
            build_twin(replace(robot, actuators=tuple(NamedActuator(f"a{i}", one) for i, one in enumerate(each))))
        return str(error.value)

    assert "the wall has no face" in refused(wall[:0])
    assert "12 of 24 faces are duplicated" in refused(np.concatenate([wall, wall]))
    assert "1 of 13 faces are inside the body" in refused(np.concatenate([wall, inner[:1]]))
    assert "12 of 12 faces are of a0.walls.box, too" in refused(wall, wall)


def test_one_solve_a_step_pumps_the_commanded_volume():
    schedule = Schedule(np.array([0.0, 0.1]), {"main": Command("volume", np.array([0.0, 2e-6]))})
    settings = TimeSettings(time_step=0.005, scheme="one-solve")
    response = simulate_in_time(box(dead_volume=3e-6), schedule, settings)
    assert response.channels["main.volume"][-1] == pytest.approx(2e-6, rel=2e-3)  # second order in the step


def test_a_chamber_that_a_live_twin_releases_is_open():
    live = LiveTwin(box(dead_volume=3e-6), {"main": "volume"})
    live.at({"main": 2e-6})
    released = live.at({}, released=["main"])
    assert released.channels["main.pressure"] == 0.0
    assert released.channels["main.volume"] == pytest.approx(0.0, abs=1e-12)


def test_a_pose_is_reached_by_volume():
    robot = replace(box(dead_volume=3e-6), markers=(Marker("tip", "box", np.array([0.02, 0.02, 0.02])),))
    wanted = driven(robot, "volume", 2e-6).channels["tip.x"][0]
    found = reach(robot, {"tip.x": wanted}, controls={"main": "volume"}).steps[0]
    assert found.commands["main.volume"] == pytest.approx(2e-6, rel=1e-2)


@pytest.mark.parametrize(
    ("pulls", "says"),
    [
        (["main=40kPa", "main=5ml"], "the chamber is pulled twice"),
        (["front=40mm"], "the robot has no such actuator; got 'front'; allowed: main"),
        (["main=4"], "got 'main=4'; allowed: a chamber and a pressure or volume: main=1Pa, main=1ml."),
        (["main.mass=1kg"], "a mass hangs from a cable, and this is a chamber; got 'main.mass=1kg'; allowed: pressure"),
    ],
)
def test_a_wrong_pull_of_a_chamber_is_told_in_its_own_words(pulls, says):
    with pytest.raises(InputError) as error:
        parse_pulls(box(), pulls)
    assert says in str(error.value)


def test_a_table_that_commands_a_chamber_twice_is_told_its_controls(tmp_path):
    table = tmp_path / "commands.csv"
    table.write_text("main.volume [ml],main.pressure [kPa]\n0,1\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"the chamber has two commands; got main; allowed: pressure or volume"):
        commanded(box(), table)


def test_the_slider_of_a_report_goes_along_the_pressure_of_a_chamber_drawn_as_a_surface():
    robot = replace(box(dead_volume=3e-6), markers=(Marker("tip", "box", np.array([0.02, 0.02, 0.02])),))
    response = driven(robot, "pressure", 0.0, 2e4, 4e4, snapshots=True)
    view = twin_view(robot, response)
    assert view is not None
    frame = twin_frame(view, response)
    assert frame is not None
    data = json.loads(re.search(r'id="twin-data">(.*?)</script>', frame.page, re.DOTALL)[1])
    (driven_by,) = data["model"]["inputs"]
    assert [driven_by[key] for key in ("name", "control", "unit")] == ["main", "pressure", "Pa"]
    assert driven_by["most"] == pytest.approx(4e4, rel=1e-3)
    assert data["units"]["main.pressure"] == ["kPa", 1e-3]
    assert data["efforts"] == ["main.pressure"]
    assert "tension" not in json.dumps(data)
    # The wall, and the body around it, which is seen through.
    assert {part["opacity"] for part in data["parts"] if "triangles" in part} == {0.4, 1.0}
    assert "of its largest" not in frame.caption


PROJECT = """\
softcal: 1
name: a box
robot:
  bodies:
    box:
      mesh: {file: box.msh, unit: m}
      element: P1
      youngs_modulus: 1 MPa
      poissons_ratio: 0.4
      regions:
        foot: {plane: {point: [0 mm, 0 mm, -20 mm], normal: [0, 0, 1]}}
        inside: {cavity: {at: [0 mm, 0 mm, 0 mm]}}
      fixed: foot
  actuators:
    main: {actuator: chamber, walls: {box: inside}, dead_volume: 3 ml}
  markers:
    tip: {on: box, at: [20 mm, 20 mm, 20 mm]}
experiments:
  vacuum:
    drive: [main.pressure]
    files:
      - path: vacuum.csv
        columns:
          main.pressure: {name: p, unit: mmHg}
          main.volume: {name: v, unit: ml}
          tip.x: {name: x, unit: mm}
    noise: {tip: 0.001 mm, main.volume: 0.01 ml}
parameters:
  box.youngs_modulus: {bounds: [0.1 MPa, 10 MPa], scale: log}
  main.dead_volume: {bounds: [0 ml, 30 ml]}
  main.pressure_offset: {bounds: [-3 kPa, 3 kPa]}
calibration: {method: least-squares, starts: 1, loss: likelihood, mesh_error: false}
"""


CAVITY = "inside: {cavity: {at: [0 mm, 0 mm, 0 mm]}}"
MAIN = "    main: {actuator: chamber, walls: {box: inside}, dead_volume: 3 ml}"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (CAVITY, "inside: {plane: {point: [0 mm, 0 mm, 20 mm], normal: [0, 0, 1]}}", "main.walls: the walls of the"),
        (
            MAIN,
            f"{MAIN}\n    b: {{actuator: chamber, walls: {{box: inside}}}}",
            "b.walls: b.walls.box: this is no wall",
        ),
    ],
)
def test_a_wall_that_encloses_nothing_is_told_with_its_line(tmp_path, old, new, says):
    write_mesh(box().bodies[0].mesh, tmp_path / "box.msh")
    (tmp_path / "vacuum.csv").write_text("p,v,x\n0,0,20\n1,1,20\n", encoding="utf-8")
    (tmp_path / "project.yaml").write_text(PROJECT.replace(old, new), encoding="utf-8")
    line = 1 + PROJECT.replace(old, new).splitlines().index(new.splitlines()[-1] if old == MAIN else MAIN)
    with pytest.raises(ProjectFileError) as error:
        load(tmp_path / "project.yaml")
    assert f"project.yaml:{line}: robot.actuators.{says}" in str(error.value)


def test_a_robot_of_chambers_alone_is_told_of_no_cable():
    assert simulate(box(), Protocol({})).status == "Solved: no actuator is driven."


@pytest.mark.slow
def test_a_vacuum_gauge_with_an_offset_is_calibrated(tmp_path):
    robot = replace(box(dead_volume=5e-6), markers=(Marker("tip", "box", np.array([0.02, 0.02, 0.02])),))
    truth = driven(with_parameters(robot, {"box.youngs_modulus": 7e5}), "pressure", *np.linspace(0, -5e4, 8)).channels
    read = (truth["main.pressure"] + 300.0) / 133.322387415, 1e6 * truth["main.volume"], 1e3 * truth["tip.x"]
    rows = "".join(f"{p:.9g},{v:.9g},{x:.9g}\n" for p, v, x in zip(*read, strict=True))
    (tmp_path / "vacuum.csv").write_text("p,v,x\n" + rows, encoding="utf-8")
    (tmp_path / "project.yaml").write_text(PROJECT, encoding="utf-8")
    write_mesh(robot.bodies[0].mesh, tmp_path / "box.msh")
    found = calibrate(tmp_path / "project.yaml").headline.parameters
    assert found["box.youngs_modulus"].value == pytest.approx(7e5, rel=1e-2)
    assert found["main.dead_volume"].value == pytest.approx(5e-6, rel=1e-2)
    assert found["main.pressure_offset"].value == pytest.approx(300.0, rel=2e-2)


def test_the_slider_of_a_vacuum_goes_from_the_lowest_pressure_to_none():
    robot = replace(box(dead_volume=3e-6), markers=(Marker("tip", "box", np.array([0.02, 0.02, 0.02])),))
    response = driven(robot, "pressure", *np.linspace(0.0, -4e4, 5), snapshots=True)
    view = twin_view(robot, response)
    assert view is not None
    frame = twin_frame(view, response)
    assert frame is not None
    model = json.loads(re.search(r'id="twin-data">(.*?)</script>', frame.page, re.DOTALL)[1])["model"]
    (driven_by,) = model["inputs"]
    assert (driven_by["name"], driven_by["control"], driven_by["default"]) == ("main", "pressure", 0.0)
    assert (driven_by["least"], driven_by["most"]) == (pytest.approx(-4e4, rel=1e-3), 0.0)
    read = evaluator_of({**model, "rows": [], "error": {}})
    for shape in response.snapshots:
        shown = read.state({"main": shape.drive})["coordinates"]["tip.x"]
        assert shown == pytest.approx(shape.markers["tip"][0], abs=1e-7)
    assert frame.caption.startswith("The twin along its load path: ")
    assert "within" in frame.caption


# Two tests of a box, blown up and evacuated; the table's units are a pump's.
RUN = (
    PROJECT[: PROJECT.index("  vacuum:\n")]
    + """\
  blow:
    drive: [main.pressure]
    files:
      - path: blow.csv
        columns: &columns
          main.pressure: {name: p, unit: bar}
          main.volume: {name: v, unit: ml}
          tip.x: {name: x, unit: mm}
          tip.y: {name: y, unit: mm}
          tip.z: {name: z, unit: mm}
    noise: &noise {tip: 0.001 mm, main.volume: 0.01 ml}
  suck:
    drive: [main.pressure]
    files:
      - {path: suck.csv, columns: {<<: *columns, main.pressure: {name: p, unit: psi}}}
    noise: *noise
parameters:
  box.youngs_modulus: {bounds: [0.1 MPa, 10 MPa], scale: log}
  main.dead_volume: {bounds: [0 ml, 30 ml]}
calibration: {method: least-squares, starts: 1, loss: likelihood, mesh_error: false}
candidates:
  harder: {like: blow, pressure: 60 kPa}
  vacuum: {like: blow, pressure: -40 kPa}
  deeper: {like: suck, pressure: -60 kPa}
  pumped: {like: blow, volume: 4 ml}
  beyond: {like: suck, pressure: -101 kPa}
sweep:
  over: {main.dead_volume: [0 ml, 5 ml], box.youngs_modulus: [0.6 MPa, 0.7 MPa]}
"""
)
TESTS = {"blow": (np.linspace(0.0, 3e4, 8), 1e5), "suck": (np.linspace(0.0, -5e4, 8), 6894.757293168361)}


def write_run(folder: Path, modulus: float = 7e5, dead_volume: float = 5e-6, specimen: str = "") -> Path:
    """The project with the tables that the twin has at these values, with noise."""
    folder.mkdir(parents=True, exist_ok=True)
    write_mesh(box().bodies[0].mesh, folder / "box.msh")
    robot = replace(box(dead_volume=dead_volume), markers=(Marker("tip", "box", np.array([0.02, 0.02, 0.02])),))
    robot, rng = with_parameters(robot, {"box.youngs_modulus": modulus}), np.random.default_rng(4)
    for name, (pressures, unit) in TESTS.items():
        seen = driven(robot, "pressure", *pressures).channels
        columns = [pressures / unit, 1e6 * seen["main.volume"] + 0.01 * rng.standard_normal(len(pressures))]
        columns += [1e3 * seen[f"tip.{axis}"] + 1e-3 * rng.standard_normal(len(pressures)) for axis in "xyz"]
        rows = "".join(",".join(f"{value:.9g}" for value in row) + "\n" for row in zip(*columns, strict=True))
        (folder / f"{name}{specimen}.csv").write_text(f"p,v,x,y,z\n{rows}", encoding="utf-8")
    (folder / "project.yaml").write_text(RUN, encoding="utf-8")
    return folder / "project.yaml"


def test_the_tests_of_a_chamber_are_read_in_a_pumps_units_and_may_go_further_on_either_side(tmp_path):
    project = load(write_run(tmp_path))
    for name, (pressures, _) in TESTS.items():
        read = project.experiments[name].dataset.values("main.pressure")
        np.testing.assert_allclose(read, pressures, rtol=1e-8, atol=1e-6)
    assert furthest_experiment(project, ["blow", "suck"]) == "suck"
    ends = {"harder": 6e4, "vacuum": -4e4, "deeper": -6e4, "beyond": -1.01e5, "pumped": 4e-6}
    for candidate in project.candidates:
        (told,) = commands(
            test := as_experiment(candidate, project.experiments[candidate.like]), test.rig_values()
        ).values()
        assert told.values[-1] == pytest.approx(ends[candidate.name], rel=1e-6)
    made = {one.name: one for one in default_candidates(make_problem(project))}
    assert made["suck 1.5 times as far"].reach == pytest.approx(-7.5e4)
    pumped = as_experiment(made["suck by volume"], project.experiments["suck"])
    volume = project.experiments["suck"].dataset.values("main.volume")
    assert pumped.dataset.values("main.volume")[-1] == volume.min() < -1e-6


def words(page: Path) -> str:
    """What a page says, without what its frames and pictures hold."""
    unseen = r'<(script|style|svg).*?</\1>|srcdoc="[^"]*"'
    text = re.sub(unseen, "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text))


@pytest.mark.slow
def test_the_run_of_a_chamber_is_reported_and_watched_and_has_a_next_test(tmp_path):
    result = calibrate(write_run(tmp_path / "project"), out=tmp_path / "run").headline
    for name, value in {"box.youngs_modulus": 7e5, "main.dead_volume": 5e-6}.items():
        low, high = result.parameters[name].interval
        assert low < value < high < 1.05 * low
    drawn = {path.stem for path in write_report(tmp_path / "run").figures}
    assert drawn >= {"twin", "places", "trajectory-blow-by-joint", "trajectory-suck-by-joint", "configurations"}
    said = words(tmp_path / "run" / "report.html")
    assert "suck (main.pressure -50 kPa)" in said  # the furthest state
    assert "The twin reproduces the volume with an RMS error" in said
    assert not re.search(r"\b(cable|tension|shortening|pull|force|travel)", said), said
    ranking = next_test(tmp_path / "run")
    shares = {one.candidate.name: one.share for one in ranking.outlooks}
    assert shares["deeper"] < shares["vacuum"] < 1.0
    assert shares["suck by volume"] < 0.95
    (search,) = (reader := RunReader(tmp_path / "run")).read().searches
    about, picture = simulated_twin(tmp_path / "run", reader.whole(search))
    assert not about["trouble"]
    assert about["title"] == "main: -50 kPa"
    assert [fit.caption for fit in about["fits"]]
    assert picture.startswith(b"glTF")


@pytest.mark.slow
def test_a_chamber_is_swept_and_has_a_fleet(tmp_path):
    path = write_run(tmp_path / "project")
    best = sweep(path, out=tmp_path / "sweep").best[0].trial
    assert best.theta == pytest.approx({"main.dead_volume": 5e-6, "box.youngs_modulus": 7e5})
    for specimen, modulus in (("1", 6e5), ("2", 8e5)):
        write_run(path.parent, modulus, specimen=specimen)
    rows = [f"p{k},blow{k}.csv,suck{k}.csv,{mix}" for k, mix in ((1, "A"), (2, "B"))]
    head = "specimen,experiments.blow.file,experiments.suck.file,silicone"
    (path.parent / "fleet.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    found = fleet(path.parent, out=tmp_path / "fleet")
    moduli = [one.parameters["box.youngs_modulus"].value for one in found.specimens]
    assert moduli == pytest.approx([6e5, 8e5], rel=0.01)


PUMP = """\
  pumped:
    drive: [main.volume]
    files:
      - path: pumped.csv
        columns:
          time: {name: t, unit: s}
          main.flow: {name: q, unit: ml/min}
          main.pressure: {name: p, unit: kPa}
          tip.x: {name: x, unit: mm}
    prepare: [integrate_flow, find_cycles, {take_branch: {n_samples: 12}}]
    noise: {tip: 0.001 mm, main.pressure: 10 Pa}
parameters:
  box.youngs_modulus: {bounds: [0.1 MPa, 10 MPa], scale: log}
  main.volume_gain: {bounds: [0.8, 1.2]}
"""


def test_a_record_of_flow_drives_the_twin_by_its_volume(tmp_path):
    time, flow = np.linspace(0.0, 8.0, 41), np.where(np.arange(41) < 20, 1e-6, -1e-6)
    flow[[0, 20, 40]] = 0.0
    volume = np.concatenate([[0.0], np.cumsum(0.5 * (flow[1:] + flow[:-1]) * np.diff(time))])
    read = time, 6e7 * flow, 5e6 * volume, 2e5 * volume
    rows = "".join(f"{t:.9g},{q:.9g},{p:.9g},{x:.9g}\n" for t, q, p, x in zip(*read, strict=True))
    (tmp_path / "pumped.csv").write_text("t,q,p,x\n" + rows, encoding="utf-8")
    start, _, rest = PROJECT.partition("  vacuum:")
    text = start + PUMP + rest[rest.index("calibration:") :]
    (tmp_path / "project.yaml").write_text(text, encoding="utf-8")
    write_mesh(box().bodies[0].mesh, tmp_path / "box.msh")
    project = load(tmp_path / "project.yaml")
    test = project.experiments["pumped"]
    assert [*test.dataset.channels] == ["main.volume", "main.pressure", "tip.x"]
    assert test.compared == ("main.pressure", "tip.x")
    np.testing.assert_allclose(test.dataset.values("main.pressure"), 5e9 * test.dataset.values("main.volume"))
    assert test.dataset.values("main.volume")[-1] == pytest.approx(volume.max(), rel=0.1)
    assert "main.volume_gain" in project.parameters  # that of the flow sensor
    (tmp_path / "without.yaml").write_text(text.replace("[integrate_flow, ", "["), encoding="utf-8")
    with pytest.raises(ProjectFileError, match=r"flow is no channel of the twin; got main\.flow\. Try: integrate_flow"):
        load(tmp_path / "without.yaml")


def test_the_last_shape_is_the_furthest_on_either_side():
    robot = box(dead_volume=3e-6)
    for values in ((300.0, -1e4, -5e4), (-300.0, 1e4, 5e4)):
        efforts = [shape.efforts["main"] for shape in driven(robot, "pressure", *values, snapshots=True).snapshots]
        assert efforts[0] == pytest.approx(0.0, abs=1e-6)
        assert efforts[-1] == pytest.approx(values[-1], rel=1e-3)
