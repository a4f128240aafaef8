"""An actuator in one file of the user's own: a linear push rod, simulated, calibrated and reported like a cable."""

from __future__ import annotations

import re
import sys
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from own_module import brought, imported
from project_case import MODULUS, write_project
from sofa_case import use_fake

from softcal import calibrate, load, shape_grid, with_parameters
from softcal.errors import MeshError, ParameterError, ProjectFileError
from softcal.executors.shared import call, packed
from softcal.geometry.shape import DrawnShape
from softcal.plugins.calculix.crosscheck import crosscheck
from softcal.plugins.sofa.simulator import sofa_engine
from softcal.report.check_figures import robot_scenes
from softcal.report.robot_view import ROUTE, actuator_legend
from softcal.report.scene import Tube
from softcal.report.scene_twin import twin_scenes
from softcal.sensing.sensor import SENSORS
from softcal.twin.actuated import ACTUATORS, register_actuator
from softcal.twin.live import LiveTwin
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.workflows.checking import check
from softcal.workflows.export import EXPORTS, ExportRequest, write_export
from softcal.workflows.reporting import write_report
from softcal.workflows.simulation import twin_view

PUSH_ROD = '''
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from softcal import Actuator, ActuatorLimits, ActuatorSensor, ActuatorTerm, ChannelKind, Connectivity, ViaPoint
from softcal import quantity, register_actuator, register_sensor
from softcal.mechanics.actuator import Drives

EXTENSION = ChannelKind("extension", "m", "Extension", drives="coordinate", offset=("play", quantity("length")))
THRUST = ChannelKind("thrust", "N", "Thrust", drives="effort", gain=("thrust_gain", quantity("positive ratio")))


@register_sensor
@dataclass(frozen=True)
class PushRodSensor(ActuatorSensor):
    """Extension [m] and thrust [N] of a push rod."""

    name: ClassVar = "push-rod"
    kinds: ClassVar = (EXTENSION, THRUST)
    of: ClassVar = "push-rod"


@dataclass(frozen=True)
class PushRodTerm(ActuatorTerm):
    """A force along the line from a point in space to a point of the robot; its machine gives way by `softness`."""

    name: str
    foot: np.ndarray
    points: np.ndarray
    weights: np.ndarray
    rest: float
    starts: object = None

    @property
    def parameters(self):
        return (f"{self.name}.softness",)

    @property
    def actuators(self):
        return (ActuatorLimits(self.name, "extension", "thrust"),)

    def connectivity(self, layout):
        return Connectivity([np.sort(self.points)[None]])

    def plan(self, layout, pattern):
        order = np.argsort(self.points)
        own = replace(self, points=self.points[order], weights=self.weights[order])
        return replace(own, starts=pattern.blocks(own.points[None])[0])

    def _arm(self, x):
        arm = self.weights @ x[self.points] - self.foot
        return arm, np.linalg.norm(arm)

    def shape_coordinates(self, x):
        return np.array([self._arm(x)[1] - self.rest])

    def shape_gradient(self, x, i, size):
        arm, length = self._arm(x)
        out = np.zeros(size)
        np.add.at(out[: x.size].reshape(-1, 3), self.points, self.weights[:, None] * arm / length)
        return out

    def add_forces(self, given, effort, into, transmission):
        into.full -= effort[0] * self.shape_gradient(given.state.x, 0, len(into.full))
        if into.data is None:
            return
        arm, length = self._arm(given.state.x)
        block = -effort[0] * (np.eye(3) - np.outer(arm, arm) / length**2) / length
        i, j = np.triu_indices(len(self.points))
        for start, weight, is_diagonal in zip(self.starts, self.weights[i] * self.weights[j], i == j):
            for row in range(3):
                first = row if is_diagonal else 0
                into.data[start[row] + first : start[row] + 3] += weight * block[row, first:]

    def coordinates(self, given, transmission):
        softness = given.theta[f"{self.name}.softness"]
        return self.shape_coordinates(given.state.x) + softness * given.state.effort[self.own]

    def drives(self, given, which, size, transmission):
        columns = super().drives(given, which, size, transmission).columns
        return Drives(columns, columns, np.full(len(which), -given.theta[f"{self.name}.softness"]))

    def add_by_parameters(self, into, given):
        name = f"{self.name}.softness"
        if name in into and not given.controls.is_held[self.own][0]:
            into[name].efforts[self.own] -= given.state.effort[self.own]

    def energy(self, given):
        softness, effort = given.theta[f"{self.name}.softness"], given.state.effort[self.own][0]
        return super().energy(given) - 0.5 * softness * effort**2


@register_actuator
@dataclass(frozen=True)
class PushRod(Actuator):
    """A linear motor between a point in space and a point of the robot."""

    foot: tuple[float, float, float]
    head: tuple[float, float, float]
    on: str
    softness: float = 1e-5

    name: ClassVar = "push-rod"
    channels: ClassVar = (EXTENSION, THRUST)
    ranges: ClassVar = (quantity("length"), quantity("force"))
    quantities: ClassVar = {"softness": quantity("compliance")}

    @property
    def route(self):
        return ViaPoint(self.foot), ViaPoint(self.head, self.on, radius=0.0)

    def term(self, name, places):
        points, weights = map(np.array, zip(*places.support(np.array(self.head), self.on, name)))
        foot = np.array(self.foot)
        rest = np.linalg.norm(weights @ places.X[points] - foot)
        return PushRodTerm(name, foot, points, weights, rest)
'''
# In a project file a number has its unit, by the annotations of the fields.
IN_FILES = PUSH_ROD.replace("foot: tuple[float, float, float]", "foot: Point").replace(
    "head: tuple[float, float, float]", "head: Point"
)
IN_FILES = IN_FILES.replace("softness: float = 1e-5", "softness: Compliance = 1e-5").replace(
    "from softcal.mechanics", "from softcal.quantities import Compliance, Point\nfrom softcal.mechanics"
)
OWN = """  actuators:
    motor: {actuator: push-rod, foot: [60 mm, 0 mm, 60 mm], head: [10 mm, 0 mm, 80 mm], on: bar, softness: 0.02 mm/N}
experiments:
  thrust:
    drive: [motor.thrust]
    plate: plate
    files:
      - path: data/thrust.csv
        columns: {motor.thrust: {name: "thrust [N]"}, motor.extension: {name: "extension [mm]"}, pitch: {name: "pitch [deg]"}}
    noise: {motor.extension: 0.02 mm, pitch: 0.1 deg}
"""  # noqa: E501
FREE = """parameters:
  bar.youngs_modulus: {bounds: [0.5 MPa, 20 MPa], scale: log}
  motor.softness: {bounds: [0 mm/N, 0.2 mm/N]}
calibration: {method: least-squares, starts: 1, loss: likelihood}
"""


@pytest.fixture
def push_rod(tmp_path: Path) -> Generator[ModuleType]:
    """The actuator, as a module of the user's registers it."""
    yield imported(tmp_path / "push_rod.py", IN_FILES)
    ACTUATORS.remove("push-rod")
    SENSORS.remove("push-rod")


def rod_project(folder: Path, **values: float) -> Path:
    """The project of a bar with a motor at its side, and a test by thrust, made by the twin at some values."""
    path = write_project(folder, ("experiments:\n", OWN))
    table = folder / "data" / "thrust.csv"
    table.write_text("thrust [N],extension [mm],pitch [deg]\n0,0,0\n-1,0,0\n", encoding="utf-8")
    robot = with_parameters(load(path).robot, values)
    thrust = -np.linspace(0.0, 6.0, 13)
    seen = simulate(robot, Protocol({"motor": Command("thrust", thrust)}), curve_tolerance=0.0)
    columns = [thrust, 1e3 * seen.channels["motor.extension"], np.degrees(seen.channels["plate.pitch"])]
    rows = (",".join(f"{value:.8f}" for value in row) for row in zip(*columns, strict=True))
    table.write_text("\n".join(["thrust [N],extension [mm],pitch [deg]", *rows]) + "\n", encoding="utf-8")
    return path


def test_it_is_refused_on_a_body_whose_lengths_vary(push_rod: ModuleType, tmp_path: Path) -> None:
    robot = load(rod_project(tmp_path)).robot
    (bar,) = robot.bodies
    drawn = replace(robot, bodies=(replace(bar, shape=DrawnShape()),))
    with pytest.raises(MeshError, match="other parts would have to move along; got actuator motor"):
        with_parameters(drawn, {"bar.scale": 1.01})


def free_rod_project(folder: Path, **values: float) -> Path:
    """The same with the test by thrust alone, and free parameters."""
    path = rod_project(folder, **values)
    path.write_text(path.read_text(encoding="utf-8").partition("  pull:\n")[0] + FREE, encoding="utf-8")
    return path


def test_it_is_driven_by_either_and_differentiated(push_rod: ModuleType, tmp_path: Path) -> None:
    robot = load(rod_project(tmp_path)).robot
    names = ["bar.youngs_modulus", "motor.softness"]
    thrust = Command("thrust", np.array([-4.0, 0.0, 3.0]))
    by_effort = simulate(robot, Protocol({"motor": thrust}), sensitivities=names, curve_tolerance=0.0)
    assert by_effort.succeeded, by_effort.status
    extension = Command("extension", by_effort.channels["motor.extension"])
    by_coordinate = simulate(robot, Protocol({"motor": extension}), sensitivities=names, curve_tolerance=0.0)
    np.testing.assert_allclose(by_coordinate.channels["motor.thrust"], thrust.values, rtol=1e-8, atol=1e-9)
    for protocol, of in ((thrust, "motor.extension"), (extension, "motor.thrust")):
        found = by_effort if protocol is thrust else by_coordinate
        for name, value in zip(names, (robot.bodies[0].parameters["youngs_modulus"], 2e-5), strict=True):
            ends = [
                simulate(robot, Protocol({"motor": protocol}), {name: value * (1 + s)}, curve_tolerance=0.0)
                for s in (1e-4, -1e-4)
            ]
            slope = (ends[0].channels[of] - ends[1].channels[of]) / (2e-4 * value)
            np.testing.assert_allclose(
                found.sensitivities.by(name, (of,))[:, 0], slope, rtol=1e-5, atol=1e-6 * np.abs(slope).max()
            )


def test_with_a_cable_it_moves_a_live_twin(push_rod: ModuleType, tmp_path: Path) -> None:
    twin = LiveTwin(load(rod_project(tmp_path)).robot, {"front": "tension", "motor": "thrust"})
    state = twin.at({"front": 2.0, "motor": -1.0})
    assert state.succeeded, state.status
    by = state.by_commands()
    assert by["front.shortening", "motor.thrust"] == pytest.approx(by["motor.extension", "front.tension"], rel=1e-8)


def test_it_is_drawn_by_its_route_and_written_with_its_thrust(push_rod: ModuleType, tmp_path: Path) -> None:
    robot = load(rod_project(tmp_path)).robot
    kinds = {"cable": "front", "push-rod": "motor"}
    scenes, _ = robot_scenes(robot)
    assert {label.text for label in (*scenes[0].labels, *scenes[1].labels)} >= {*kinds.values()}
    assert actuator_legend(robot) == {" and ".join(kinds): ROUTE}
    response = simulate(robot, Protocol({"motor": Command("thrust", np.array([0.0, -5.0]))}), snapshots=True)
    rest, bent = (shape.routes["motor"] for shape in (response.snapshots[0], response.snapshots[-1]))
    np.testing.assert_allclose(rest, [[0.06, 0.0, 0.06], [0.01, 0.0, 0.08]], atol=1e-12)
    np.testing.assert_allclose(bent[0], rest[0])
    change = np.linalg.norm(bent[1] - bent[0]) - np.linalg.norm(rest[1] - rest[0])
    extension, thrust = (of["motor"] for of in (response.snapshots[-1].coordinates, response.snapshots[-1].efforts))
    assert extension == pytest.approx(response.channels["motor.extension"][-1], rel=1e-5)
    assert change == pytest.approx(extension - thrust * 2e-5, rel=1e-9), "without what its machine gives way"
    view = twin_view(robot, response)
    assert view is not None
    assert view.bent.label == "motor: -5 N"
    tubes = [part.path for part in twin_scenes(view).scenes[1].parts if isinstance(part, Tube)]
    assert any(np.array_equal(path, bent) for path in tubes)
    pytest.importorskip("pyvista")
    grid = shape_grid(robot, response.snapshots[-1])
    assert "motor" in grid.field_data["parts"]
    assert grid.field_data["motor.thrust [N]"][0] == pytest.approx(-5.0, rel=1e-4)
    assert grid.field_data["motor.extension [m]"][0] == pytest.approx(extension)


@pytest.mark.slow
def test_it_is_calibrated_and_reported_from_a_project_file(push_rod: ModuleType, tmp_path: Path) -> None:
    truth = {"bar.youngs_modulus": MODULUS, "motor.softness": 5e-5}
    project = load(free_rod_project(tmp_path, **truth))
    assert any(row[0] == "push-rod motor" for row in check(project).rows)
    (result,) = calibrate(project, out=tmp_path / "run").results.values()
    for name, value in truth.items():
        assert result.parameters[name].value == pytest.approx(value, rel=1e-3)
    report = write_report(tmp_path / "run", figures=["trajectory", "overview"])
    drawn = {path.stem: path.read_text(encoding="utf-8") for path in report.figures if path.suffix == ".svg"}
    assert {"Extension [mm]", "Thrust [N]"} <= set(re.findall("<!-- (.*) -->", drawn.pop("overview")))
    assert all("motor.extension [mm]" in text for text in drawn.values())


def test_a_package_brings_it_by_an_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The module that the package names registers the sensor too."""
    (tmp_path / "own_rods.py").write_text(PUSH_ROD, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with brought(ACTUATORS, "own_rods:PushRod", "softcal.actuators", "push-rod", monkeypatch) as kind:
        assert kind.channels[1].name == "thrust"
        assert SENSORS["push-rod"].of == "push-rod"
    SENSORS.remove("push-rod")
    del sys.modules["own_rods"]


def test_other_processes_get_it_with_what_is_shared(
    push_rod: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also one that is registered elsewhere than in the module of its class."""
    monkeypatch.setitem(sys.modules, "push_rod", push_rod)
    path, parcel = rod_project(tmp_path / "project"), packed(None)
    ACTUATORS.remove("push-rod")
    SENSORS.remove("push-rod")
    with pytest.raises(ProjectFileError, match="no such actuator"):
        load(path)
    (motor,) = call(parcel, lambda _: load(path)).robot.actuators
    assert type(motor.actuator) is push_rod.PushRod


@pytest.mark.slow
def test_workers_calibrate_it(push_rod: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "push_rod", push_rod)
    monkeypatch.syspath_prepend(tmp_path)
    path = free_rod_project(tmp_path / "project")
    here, there = (calibrate(load(path), method="grid", trials=4, workers=n) for n in (1, 2))
    assert here.headline.loss == there.headline.loss


REFUSED = {"calculix": "CalculiX", "sofa": "SOFA"}


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[] if one in REFUSED else [pytest.mark.slow]) for one in EXPORTS]
)
def test_an_export_has_it_or_refuses_it(name: str, push_rod: ModuleType, tmp_path: Path) -> None:
    request = ExportRequest(free_rod_project(tmp_path / "project"))
    if name not in REFUSED:
        assert write_export(name, request, tmp_path / "out")
        return
    told = f"motor: this actuator is not exported to {REFUSED[name]}; got push-rod; allowed: cable, chamber, drive"
    with pytest.raises(ParameterError, match=told):
        write_export(name, request, tmp_path / "out")


def test_an_engine_refuses_it(push_rod: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use_fake(monkeypatch, mechanics="twin")
    robot, thrust = load(rod_project(tmp_path)).robot, Protocol({"motor": Command("thrust", np.array([0.0, -1.0]))})
    with pytest.raises(ParameterError, match="motor: this actuator is not exported to SOFA; got push-rod"):
        sofa_engine()(robot, thrust)
    refused = crosscheck(robot, thrust, ["calculix"]).refused
    assert refused["calculix"].startswith("motor: this actuator is not exported to CalculiX; got push-rod")


def test_a_class_that_is_no_actuator_is_refused() -> None:
    with pytest.raises(ParameterError, match="this is not an actuator"):
        register_actuator(object)


def test_an_unknown_kind_names_those_that_there_are(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError, match=r"push-rod.*chamber"):
        load(write_project(tmp_path, ("experiments:\n", OWN)))
