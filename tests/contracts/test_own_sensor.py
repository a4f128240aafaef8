"""A sensor in one file of the user's own: registered, it works from the project file as softcal's own do."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from own_module import imported
from own_sensor import STRING
from project_case import MODULUS, write_project
from sensor_checks import CHECKS, robot_with

from softcal import ChannelKind, NamedSensor, Sensor, calibrate, load, register_sensor, with_parameters
from softcal.errors import ParameterError, ProjectFileError
from softcal.export.engine import ENGINES, Engine, register_engine, state_of
from softcal.plugins.calculix.crosscheck import crosscheck
from softcal.plugins.sofa.response import RecordPosture
from softcal.sensing.channel import kinds
from softcal.sensing.sensor import SENSORS
from softcal.sensing.sensors.actuators import TENSION
from softcal.twin.build import build_twin
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate as respond
from softcal.workflows.calibration import make_problem
from softcal.workflows.checking import check
from softcal.workflows.reporting import write_report

OFFSET = 0.004
SENSORS_SECTION = """  markers:
    low: {on: bar, at: [10 mm, 0 mm, 25 mm]}
    high: {on: plate, at: [10 mm, 0 mm, 105 mm]}
  sensors:
    pot: {sensor: string, between: [low, high]}
experiments:
"""
CHANGES = (
    ("experiments:\n", SENSORS_SECTION),
    ("          pitch: {name: Pitch, unit: deg}\n", "          pot.stretch: {name: String, unit: mm}\n"),
    ("noise: {tension: 0.05 N, pitch: 0.2 deg}", "noise: {tension: 0.05 N, pot.stretch: 0.05 mm}"),
    ("  front.slack: {bounds: [0 mm, 5 mm], per: experiment}\n", "  pot.stretch_offset: {bounds: [-20 mm, 20 mm]}\n"),
    ("{method: least-squares, starts: 1}", "{method: least-squares, starts: 1, loss: likelihood}"),
)


@pytest.fixture
def string(tmp_path: Path) -> Generator[ModuleType]:
    """The sensor, as a module of the user's registers it."""
    yield imported(tmp_path / "string_sensor.py", STRING)
    SENSORS.remove("string")


def string_project(folder: Path, *changes: tuple[str, str]) -> Path:
    """The project of a bar with a string on it, and bench data made by the twin."""
    path = write_project(folder, *CHANGES)
    empty = "Time [s],Displacement [mm],Force [N],String [mm]\n"
    (folder / "data" / "pull.csv").write_text(empty + "0,0,0,80\n1,1,1,80\n", encoding="utf-8")
    robot = with_parameters(load(path).robot, {"bar.youngs_modulus": MODULUS})
    shortening = np.linspace(0.0, 0.02, 25)
    seen = respond(robot, Protocol({"front": Command("shortening", shortening)}))
    assert seen.units["pot.stretch"] == "m"
    columns = [0.1 * np.arange(25), 1e3 * shortening, seen.channels["front.tension"]]
    rows = np.column_stack([*columns, 1e3 * (seen.channels["pot.stretch"] + OFFSET)])
    lines = [empty.strip(), *(",".join(f"{value:.8f}" for value in row) for row in rows)]
    (folder / "data" / "pull.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = path.read_text(encoding="utf-8")
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("made", CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_every_sensors_promise(string: ModuleType, made: Callable[..., None]) -> None:
    sensor = string.StringPotentiometer(("m1", "plate"))
    made(type(sensor), robot_with(NamedSensor("pot", sensor)))


def test_a_modulus_and_its_offset_are_calibrated_from_a_project_file(string: ModuleType, tmp_path: Path) -> None:
    project = load(string_project(tmp_path))
    assert ("sensor pot", "string: pot.stretch") in check(project).rows
    (result,) = calibrate(project, out=tmp_path / "run").results.values()
    assert "Converged" in result.status
    assert result.parameters["bar.youngs_modulus"].value == pytest.approx(MODULUS, rel=1e-4)
    assert result.parameters["pot.stretch_offset"].value == pytest.approx(OFFSET, abs=1e-6)
    (fit,) = result.experiments.values()
    assert fit.alone == ("tension", "pot.stretch")
    report = write_report(tmp_path / "run", figures=["trajectory"])
    drawn = next(path for path in report.figures if path.name == "trajectory-pull.svg").read_text(encoding="utf-8")
    assert "pot.stretch [mm]" in drawn
    table = next(path for path in report.tables if path.name.startswith("table-2")).read_text(encoding="utf-8")
    assert "pot.stretch RMSE [mm]" in table


def test_a_string_alone_identifies_where_a_cable_is_taut(string: ModuleType, tmp_path: Path) -> None:
    """Its derivatives by parameters are those of the problem's differences."""
    problem = make_problem(load(string_project(tmp_path)))
    theta = problem.space.start
    found = problem.evaluate(theta, jacobian=True)
    (block,) = (one for one in found.blocks if one.channel == "pot.stretch")
    for k, name in enumerate(theta):
        h = 1e-4 * max(abs(theta[name]), 1e-3)
        ends = [problem.evaluate({**theta, name: theta[name] + s * h}).blocks for s in (1, -1)]
        up, down = (next(b for b in blocks if b.channel == "pot.stretch").residual for blocks in ends)
        scale = np.abs(block.jacobian[:, k]).max() + 1e-12
        np.testing.assert_allclose(block.jacobian[:, k], (up - down) / (2.0 * h), atol=2e-3 * scale)


def test_an_unlikely_length_is_warned_of(string: ModuleType, tmp_path: Path) -> None:
    project = load(string_project(tmp_path, ("{name: String, unit: mm}", "{name: String, unit: mm, scale: 1000}")))
    assert any("pot.stretch reaches" in str(one) and "mm read as m" in str(one) for one in project.warnings)


def test_sofa_reads_it_from_its_own_states(string: ModuleType, tmp_path: Path) -> None:
    twin = build_twin(load(string_project(tmp_path)).robot)
    record = {"plates": {"top": [0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0]}, "markers": {"m": [0.0, 0.15, 0.0]}, "cables": {}}
    assert string.StringPotentiometer(("m", "top")).sense(RecordPosture(record, twin)) == [pytest.approx(0.25)]


def test_an_engine_is_compared_in_what_it_reads(string: ModuleType, tmp_path: Path) -> None:
    robot = load(string_project(tmp_path)).robot

    def solve(given, protocol, shape, running):
        softer = with_parameters(given, {"bar.poissons_ratio": 0.3})
        return state_of(respond(softer, protocol, snapshots=True, curve_tolerance=0.0))

    register_engine(Engine("other", lambda own: own, lambda: "", solve))
    try:
        found = crosscheck(robot, Protocol({"front": Command("shortening", np.array([0.01]))}), ["other"])
    finally:
        ENGINES.remove("other")
    assert not found.failed
    (one,) = (d for d in found.comparisons[0].differences if d.quantity == "pot.stretch")
    reached = respond(robot, Protocol({"front": Command("shortening", np.array([0.01]))})).channels["pot.stretch"][0]
    assert one.softcal == pytest.approx(reached, rel=1e-9)
    assert one.engine != one.softcal
    assert one.unit == "m"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("[low, high]", "[low, hihg]"), r"sensors\.pot: the robot has no such marker or plate; got 'hihg'.*'high'"),
        (("[low, high]", "[low]"), r"robot\.sensors\.pot\.between"),
        (("between", "betwene"), r"robot\.sensors\.pot\.betwene: unknown key; .*Try: 'between'"),
        (("sensor: string", "sensor: strnig"), r"pot\.sensor: there is no such sensor; got 'strnig'.*Try: 'string'"),
        (
            ("sensor: string, between: [low, high]", "sensor: cable, actuator: front"),
            "every one of the cables has",
        ),
        (("sensor: string, ", ""), r"robot\.sensors\.pot: a key is missing; allowed: 'sensor' must be given"),
        (("    pot: {", "    high: {"), "two parts of the robot share a name"),
        (("pot.stretch: {name", "pit.stretch: {name"), r"columns\.pit\.stretch: .*no such sensor; got 'pit'.*'pot'"),
        (("pot.stretch: {name", "front.stretch: {name"), r"no such sensor; got 'front'"),
    ],
)
def test_faults_of_its_fields_are_those_of_any_key(
    string: ModuleType, tmp_path: Path, change: tuple[str, str], told: str
) -> None:
    with pytest.raises(ProjectFileError) as error:
        load(string_project(tmp_path, change))
    assert re.search(told, str(error.value), flags=re.S), str(error.value)


def test_without_the_sensor_its_channel_is_unknown(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError, match="there is no such sensor; got 'string'"):
        load(write_project(tmp_path, *CHANGES))
    assert "stretch" not in kinds()


def test_a_sensor_that_cannot_be_told_from_others_is_refused(string: ModuleType) -> None:
    def made(**of: object) -> type[Sensor]:
        body = {"sense": lambda self, robot: [], "rates": lambda self, robot, moving: [], **of}
        return type("Other", (Sensor,), body)

    strange = ChannelKind("tension", "Pa")
    for sensor, told in (
        (made(name="string", kinds=(TENSION,)), "another sensor of this name"),
        (made(name="other", kinds=(strange,)), "that are of another kind"),
        (made(name="other", kinds=(ChannelKind("time", "s"),)), "cannot be called so"),
        (made(name="other", kinds=(ChannelKind("bend_sd", "rad"),)), "cannot be called so"),
        (made(name="other", kinds=(ChannelKind("bend", ""),)), "has no unit"),
        (made(name="other", kinds=()), "one or more channels"),
        (made(name="other", kinds=(TENSION,), of="rods"), "no such parts have sensors"),
        (made(kinds=(TENSION,)), "'name' must be there"),
        (made(name="other", kinds=("tension",)), "this is not a kind of channel; got 'tension'"),
        (Sensor, "'sense' must be there"),
        (load, "this is not a sensor"),
    ):
        with pytest.raises(ParameterError, match=told):
            register_sensor(sensor)  # type: ignore[type-var]
    assert "other" not in SENSORS


def test_names_of_parts_and_channels_are_judged_with_all_other_faults(string: ModuleType, tmp_path: Path) -> None:
    """Without the robot, whatever is wrong with it elsewhere."""
    drive = ("    plate: plate\n", "    plate: plate\n    drive: [back.shortening, pitch]\n")
    tied = "  tied: {of: [baz.youngs*, spring*.youngs_modulus, b*.youngs_modulus], bounds: [1 MPa, 9 MPa]}"
    free = ("  bar.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}", tied)
    sensor = ("experiments:\n", "  sensors:\n    pot: {sensor: string, between: [plate, plat]}\nexperiments:\n")
    with pytest.raises(ProjectFileError) as error:
        load(write_project(tmp_path, drive, free, sensor, ("element: P1", "element: P9")))
    told = [str(fault).partition(": ")[2] for fault in error.value.faults]
    begins = (
        "robot.bodies.bar.element: there is no such element; got 'P9'",
        "robot.sensors.pot: the robot has no such marker or plate; got 'plat'",
        "experiments.pull.drive: this channel cannot drive the twin; got pitch",
        "experiments.pull.drive[0]: there is no such channel among the columns; got 'back.shortening'",
        "parameters.tied.of: there is no such part of the robot or the rig; got 'baz'",
        "parameters.tied.of: there is no such part of the robot or the rig; got 'spring'",
    )
    assert len(told) == len(begins), told
    assert [begin for begin in begins if not any(text.startswith(begin) for text in told)] == []
