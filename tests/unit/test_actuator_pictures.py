"""What pictures, charts and ParaView show of actuators that are no cables: chambers, and drives with their cables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mechanics_cases import blown_box, column_robot, elastic, side_cable

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.observation import Observation
from softcal.calibration.results.fit import experiment_fit
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.driven import DrivenChannels, driven_whole
from softcal.export.vtk import write_vtk
from softcal.mechanics.elements import ELEMENTS
from softcal.report.check_figures import robot_scenes
from softcal.report.cycles import cycle_sentence, loops_tables
from softcal.report.figures.force_displacement import draw_record
from softcal.report.figures.loops import draw_loops
from softcal.report.plots import furthest_shape
from softcal.report.robot_view import ROUTE, WALL, actuator_legend
from softcal.report.scene import Part, Surface
from softcal.report.scene_twin import twin_scenes
from softcal.sensing.channel import channel_unit
from softcal.twin.actuated import NamedActuator, effort_shares
from softcal.twin.actuators.drive import Drive
from softcal.twin.loads import walls
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Derivatives, Response
from softcal.twin.simulate import simulate
from softcal.workflows.simulation import twin_view

BOX = blown_box("P1", is_open=False, medium="liquid")
(MAIN,) = BOX.actuators
N_FACES = len(MAIN.surfaces["box"])


@pytest.fixture(scope="module")
def pumped() -> Response:
    volumes = 1e-7 * np.array([0.0, 1.0, 2.0])
    return simulate(BOX, Protocol({"main": Command("volume", volumes)}), snapshots="samples")


def of_chamber(parts: Sequence[Part]) -> tuple[list[Surface], list[Surface]]:
    """The surfaces of the chamber, and all others."""
    surfaces = [part for part in parts if isinstance(part, Surface)]
    is_wall = [isinstance(one.colour, str) and one.colour == WALL for one in surfaces]
    return [one for one, is_own in zip(surfaces, is_wall, strict=True) if is_own], [
        one for one, is_own in zip(surfaces, is_wall, strict=True) if not is_own
    ]


def test_a_chamber_is_seen_inside_its_body_in_every_picture(pumped: Response) -> None:
    checked, _ = robot_scenes(BOX)
    view = twin_view(BOX, pumped)
    assert view is not None
    assert (view.rest.label, view.bent.label.split(":")[0]) == ("At rest", "main")
    for parts in (checked[0].parts, furthest_shape(pumped)[0], *(scene.parts for scene in twin_scenes(view).scenes)):
        (wall,), others = of_chamber(parts)
        assert (len(wall.triangles), wall.opacity) == (N_FACES, 1.0)
        assert others
        assert all(one.opacity < 1.0 for one in others)
    assert "main" in {label.text for scene in checked for label in scene.labels}
    assert actuator_legend(BOX) == {"chamber": WALL}
    (wall,), _ = of_chamber(furthest_shape(pumped)[0])
    moved = pumped.snapshots[-1].points["box"][np.unique(MAIN.surfaces["box"])]
    assert set(map(tuple, moved)) == set(map(tuple, wall.extent)), "it moves with its body"


def test_walls_are_found_in_the_mesh_of_an_element_of_lower_order() -> None:
    (body,) = BOX.bodies
    mesh = ELEMENTS["P2"].mesh(body.mesh)
    robot = replace(BOX, bodies=(replace(body, mesh=mesh),))
    used = ELEMENTS["P1"].mesh(mesh)
    found = walls(robot, {"box": used})["main"]["box"]
    corners = body.mesh.points[np.asarray(MAIN.surfaces["box"])]
    np.testing.assert_allclose(np.sort(used.points[found], axis=1), np.sort(corners, axis=1), atol=1e-15)


def test_cables_of_a_drive_have_its_name() -> None:
    cables = (side_cable("left", (0.05, 0.0)), side_cable("right", (-0.05, 0.0)))
    robot = column_robot("P1", parameters=elastic(1e6, 0.3), divisions=(1, 1, 4), cables=cables)
    servo = NamedActuator("servo", Drive({"left": 1.0, "right": -1.0}, 8e-3))
    robot = replace(robot, actuators=(servo,))
    scenes, _ = robot_scenes(robot)
    assert {"left (servo)", "right (servo)"} <= {label.text for scene in scenes for label in scene.labels}
    assert actuator_legend(robot) == {"cable": ROUTE}


@pytest.mark.parametrize(
    ("names", "pair"),
    [
        (["time", "tension", "shortening", "pitch"], ("shortening", "tension")),
        (["main.pressure", "m1.x", "main.volume"], ("main.volume", "main.pressure")),
        (["servo.torque", "left.tension", "right.tension", "servo.angle"], ("servo.angle", "servo.torque")),
        (["main.pressure", "other.volume", "main.volume_sd"], None),
        (["tension", "a.pressure", "a.volume"], ("a.volume", "a.pressure")),
        (["a.pressure", "a.volume", "b.pressure", "b.volume"], None),
    ],
)
def test_a_record_has_the_one_actuator_with_both(names: list[str], pair: tuple[str, str] | None) -> None:
    record = Dataset("of names", {name: Channel(np.ones(2), channel_unit(name) or "s") for name in names})
    of = driven_whole(record)
    assert (of and of.names) == pair


def test_of_two_actuators_the_cycles_are_those_of_one() -> None:
    """The other one has both channels too, so that names alone do not say which."""
    record = strokes()
    other = {"b.volume": record.channels["main.volume"], "b.pressure": record.channels["main.pressure"]}
    by = (Step("find_cycles", {"by": "main.volume"}),)
    record = replace(record, channels={**other, **record.channels}, provenance=by)
    experiment = Experiment("stroke", record, drive=("main.volume", "b.volume"), compared=("main.pressure",))
    fit = experiment_fit(
        experiment, Observation({"main.pressure": strokes(2e-6).values("main.pressure")}, Derivatives(), {}, {})
    )
    assert fit.driven == PUMP
    assert "the pressure vanishes at 1.20 ml" in cycle_sentence("a", fit)
    assert draw_loops("stroke", record, fit, PUMP).axes[0].get_ylabel() == "Pressure [kPa]"


def test_efforts_are_shares_of_the_largest_of_their_kind() -> None:
    cables = tuple(side_cable(name, (0.05, 0.0)) for name in ("a", "b"))
    parts = (*cables, MAIN)
    assert effort_shares(parts, {"a": 2.0, "b": -1.0, "main": 0.0}) == {"a": 1.0, "b": 0.5}
    assert effort_shares(parts, {"main": 1e3}, {"main": -4e3}) == {"main": 0.25}


PUMP = DrivenChannels("main.volume", "main.pressure")


def strokes(lag: float = 1e-6) -> Dataset:
    """A stroke of a pump there and back: 10 kPa/ml, and on the way back as if a lag [m^3] were left behind."""
    volume = 1e-6 * np.concatenate([np.linspace(0.0, 10.0, 101), np.linspace(10.0, 0.0, 101)[1:]])
    back = np.arange(len(volume)) > 100
    pressure = 1e10 * np.where(back, np.maximum(volume - lag, 0.0), volume)
    values = {"main.volume": volume, "main.pressure": pressure, "m1.x": 0.1 * volume**0.5}
    channels = {name: Channel(of, channel_unit(name) or "") for name, of in values.items()}
    return Dataset("stroke", channels, cycle=np.zeros(len(volume)))


def test_charts_of_a_chamber_are_of_pressure_over_volume() -> None:
    record = strokes()
    assert [axes.get_ylabel() for axes in draw_record(record).axes] == ["Pressure [kPa]", "m1.x [mm]"]
    assert {axes.get_xlabel() for axes in draw_record(record).axes} == {"Pumped volume [ml]"}
    experiment = Experiment("stroke", record, drive=("main.volume",), compared=("main.pressure",))
    fit = experiment_fit(
        experiment, Observation({"main.pressure": strokes(2e-6).values("main.pressure")}, Derivatives(), {}, {})
    )
    figure = draw_loops("stroke", record, fit, PUMP)
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("Pumped volume [ml]", "Pressure [kPa]")
    measured, simulated = (np.asarray(line.get_xydata()) for line in figure.axes[0].lines)
    np.testing.assert_allclose([measured[100], simulated[100]], [[10.0, 100.0], [10.0, 100.0]])
    # What is left of 0.5 J of loading is the triangle back: of 9 ml from 90 kPa, and the step between.
    (cycle,) = fit.cycles
    assert cycle.measured.loading_energy == pytest.approx(0.5)
    assert cycle.measured.lost_energy == pytest.approx(0.5 - 0.405, rel=2e-2)
    content: Any = SimpleNamespace(results={"joint": SimpleNamespace(experiments={"stroke": fit})})
    (table,) = loops_tables(content)
    headers = {column.header: cell for column, cell in zip(table.columns, table.rows[0], strict=True)}
    assert table.key == "loops-pressure"
    assert headers["Peak pressure [kPa]"] == pytest.approx(100.0)
    assert headers["Pressure vanishes at, twin [ml]"] == pytest.approx(2.2, rel=1e-3)
    assert "In the last cycle the pressure vanishes at 1.20 ml; the twin's, at 2.20 ml." in cycle_sentence("a", fit)


def test_paraview_gets_walls_efforts_and_coordinates_and_the_volume_as_its_time(
    pumped: Response, tmp_path: Path
) -> None:
    pyvista = pytest.importorskip("pyvista")
    series, *shapes = write_vtk(BOX, pumped, tmp_path)
    times = [float(line.split('"')[1]) for line in series.read_text().split("timestep=")[1:]]
    assert times == pytest.approx([0.0, 0.1, 0.2]), "in ml"
    last = pyvista.read(shapes[-1])
    parts = list(last.field_data["parts"])
    wall = last.extract_cells(np.flatnonzero(last.cell_data["part"] == parts.index("main")))
    assert wall.n_cells == N_FACES
    at_rest = wall.points - wall.point_data["displacement"]
    assert set(map(tuple, at_rest.round(9))) == set(
        map(tuple, BOX.bodies[0].mesh.points[np.unique(MAIN.surfaces["box"])].round(9))
    )
    assert last.field_data["main.volume [m^3]"][0] == pytest.approx(2e-7, rel=1e-6)
    assert last.field_data["main.pressure [Pa]"][0] == pytest.approx(pumped.channels["main.pressure"][-1], rel=1e-6)
