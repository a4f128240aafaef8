"""The model for a controller: the twin within the stated error over all inputs, in Python and in C, both ways."""

from __future__ import annotations

import ast
import ctypes
import json
import math
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mechanics_cases import blown_box, column_robot, elastic, side_cable
from project_case import bench_csv, write_project
from scipy.optimize import least_squares
from scipy.stats import chi2
from test_drives import project as drive_project
from typer.testing import CliRunner

from softcal import load, load_run, with_parameters
from softcal.cli import app
from softcal.errors import ParameterError, SimulationError
from softcal.export import reduced_model
from softcal.export.reduced import (
    Input,
    ReducedModelFit,
    Sampled,
    Span,
    _powers,
    evaluator_of,
    measured_error,
    reduced,
    write_reduced,
)
from softcal.export.reduced_model import KalmanFilter, ReducedModel
from softcal.export.rotations import quaternions
from softcal.export.shape_modes import shape_modes
from softcal.twin.cables import CableLine
from softcal.twin.parameters import robot_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate
from softcal.workflows.simulation import protocol_of
from softcal.workflows.study_source import load_calibrated

ROBOT = column_robot(
    "P1",
    parameters=elastic(1e6, 0.4),
    divisions=(1, 1, 4),
    density=1000.0,
    mass=0.05,
    gravity=(0.0, 0.0, -9.81),
    cables=[side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05)), side_cable("back", (-0.05, -0.01))],
)
NAMES = ("front", "left", "back")


def of_cables(names: tuple[str, ...], samples: int | None = None) -> ReducedModelFit:
    return reduced(ROBOT, dict.fromkeys(names, Span(0.0, 3.0, "N")), samples)


@pytest.fixture(scope="module")
def fit() -> ReducedModelFit:
    return of_cables(NAMES)


@pytest.fixture(scope="module")
def folder(fit: ReducedModelFit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reduced")
    assert {path.name for path in write_reduced(fit, folder)} == {path.name for path in folder.iterdir()}
    return folder


@pytest.fixture(scope="module")
def read(folder: Path) -> ReducedModel:
    return ReducedModel(folder / "model.json")


@pytest.mark.slow
def test_its_error_at_other_states_is_the_one_stated(fit: ReducedModelFit, read: ReducedModel) -> None:
    """A percentile of a hundred states is one of a thousand others, up to what chance makes of it."""
    inputs = [Input(**one) for one in fit.model["inputs"]]
    exact = Sampled.at(ROBOT, inputs, np.random.default_rng(7).uniform(size=(150, 3)))
    again = measured_error(ROBOT, fit.model, exact)
    assert again.keys() == fit.error.keys()
    for name, stated in fit.error.items():
        assert stated.p50 <= stated.p95 <= stated.largest < (1e-2 if name.startswith("d ") else 1e-3) * stated.change, (
            name
        )
        assert again[name].p50 <= 1.5 * stated.p50, name
        assert again[name].p95 <= 2.0 * stated.p95, name
        assert {key: read.error[name][key] for key in ("p50", "p95", "max")} == {
            "p50": stated.p50,
            "p95": stated.p95,
            "max": stated.largest,
        }


def test_it_grows_gently_with_the_inputs() -> None:
    assert [len(of_cables(NAMES[:n]).sampled.points) for n in (1, 2)] == [64, 128]
    assert len(_powers(np.ones(9), 4.0)) == math.comb(13, 4)
    assert len(_powers(np.array([1.0, 1.0, 9.0]), 4.0)) == math.comb(6, 2)
    one = of_cables(("front",), 10)
    assert one.error["plate.position"].p95 < 1e-3 * one.error["plate.position"].change


def test_the_channels_are_the_twins(read: ReducedModel, fit: ReducedModelFit) -> None:
    state = read.state({"front": 3.0, "left": 1.5})
    commands = {"front": Command("tension", np.array([3.0])), "left": Command("tension", np.array([1.5]))}
    twin = simulate(ROBOT, Protocol(commands))
    position = [twin.channels[f"plate.{axis}"][0] for axis in "xyz"]
    off = 3.0 * fit.error["plate.position"].largest  # at an edge of the range
    np.testing.assert_allclose(state["plates"]["plate"]["position"], position, atol=off)
    x, y, z, w = state["plates"]["plate"]["quaternion"]
    assert math.hypot(x, y, z, w) == pytest.approx(1.0, abs=1e-15)
    pitch = math.atan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y))
    assert pitch == pytest.approx(twin.channels["plate.pitch"][0], abs=3.0 * fit.error["plate.rotation"].largest)
    for name in (f"{cable}.shortening" for cable in NAMES):
        assert state["coordinates"][name] == pytest.approx(twin.channels[name][0], abs=3 * fit.error[name].largest)


def test_the_jacobian_is_the_derivative_of_the_poses(read: ReducedModel) -> None:
    at, h = {"front": 1.3, "left": 0.4, "back": 0.9}, 1e-5
    here = read.state(at)
    assert read.rows == [
        *(f"plate.{k}" for k in ("x", "y", "z", "rx", "ry", "rz")),
        *(f"{name}.shortening" for name in NAMES),
    ]
    for column, name in enumerate(read.inputs):
        ahead, behind = (read.state({**at, name: at[name] + sign * h}) for sign in (1, -1))
        moved = np.subtract(ahead["plates"]["plate"]["position"], behind["plates"]["plate"]["position"]) / (2 * h)
        np.testing.assert_allclose([row[column] for row in here["jacobian"][:3]], moved, rtol=1e-6, atol=1e-12)
        x, y, z, w = ahead["plates"]["plate"]["quaternion"]
        a, b, c, d = behind["plates"]["plate"]["quaternion"]
        turn = np.array(
            [w * -a + d * x + y * -c + z * b, w * -b + d * y + z * -a + x * c, w * -c + d * z - x * b + y * a]
        )
        np.testing.assert_allclose([row[column] for row in here["jacobian"][3:6]], turn / h, rtol=1e-5, atol=1e-9)
    by_tension = np.array(here["jacobian"])[6:]
    np.testing.assert_allclose(by_tension, by_tension.T, atol=1e-3 * abs(by_tension).max())  # Betti


def test_c_is_python(folder: Path, read: ReducedModel, tmp_path: Path) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("no C compiler")
    library = tmp_path / "reduced_model.so"
    strict = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off"]
    source = folder / "reduced_model.c"
    subprocess.run([compiler, *strict, "-shared", "-fPIC", str(source), "-o", str(library), "-lm"], check=True)
    function = ctypes.CDLL(str(library)).reduced_model
    output, jacobian = (ctypes.c_double * 10)(), (ctypes.c_double * 27)()
    for at in [*np.random.default_rng(2).uniform(0.0, 3.0, (50, 3)).tolist(), [0.0] * 3, [3.0] * 3]:
        assert function((ctypes.c_double * 3)(*at), output, jacobian) == 0
        state = read.state(dict(zip(NAMES, at, strict=True)))
        pose = state["plates"]["plate"]
        ours = [*pose["position"], *pose["quaternion"], *state["coordinates"].values()]
        np.testing.assert_allclose(output, ours, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(np.reshape(jacobian, (9, 3)), state["jacobian"], rtol=1e-12, atol=1e-13)
        before = list(output)
        assert function((ctypes.c_double * 3)(*at), output, None) == 0
        assert list(output) == before
    for k, value in ((0, -1e-9), (1, 3.0 + 1e-9), (2, float("nan"))):
        at = [1.0, 1.0, 1.0]
        at[k] = value
        assert function((ctypes.c_double * 3)(*at), output, jacobian) == k + 1


def channels_of(state: dict[str, Any]) -> dict[str, float]:
    pose = state["plates"]["plate"]
    x, y, z, w = pose["quaternion"]
    found = dict(zip(("plate.x", "plate.y", "plate.z"), pose["position"], strict=True))
    found["plate.pitch"] = math.atan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y))
    found["plate.roll"] = math.asin(-2 * (y * z - w * x))
    found["plate.yaw"] = math.atan2(2 * (x * y + w * z), 1 - 2 * (x * x + z * z))
    return found | state["coordinates"]


def test_the_inverse_leads_there(read: ReducedModel) -> None:
    rng = np.random.default_rng(3)
    for at in rng.uniform(0.0, 3.0, (40, 3)):
        channels = channels_of(read.state(dict(zip(NAMES, at.tolist(), strict=True))))
        for names in (
            ("plate.x", "plate.y", "plate.z"),
            ("plate.pitch", "plate.roll", "back.shortening"),
            ("plate.x",),
        ):
            found = read.inverse({name: channels[name] for name in names})
            back = channels_of(read.state(found["commands"]))
            assert [back[name] for name in names] == pytest.approx([channels[name] for name in names], abs=1e-9)
            assert max(map(abs, found["misses"].values())) < 1e-9


def test_the_inverse_is_the_nearest_within_the_ranges(read: ReducedModel) -> None:
    """Of targets that are out of reach: as by another solver, from many starts, and no better."""
    for target in ({"plate.x": 0.05, "plate.z": 0.05}, {"plate.pitch": -2.0, "plate.y": 0.02}, {"plate.yaw": 0.5}):
        found = read.inverse(target)

        def apart(u: np.ndarray, target: dict[str, float] = target) -> list[float]:
            here = channels_of(read.state(dict(zip(NAMES, u.tolist(), strict=True))))
            weigh = {name: 0.1 if name[6:] in ("pitch", "roll", "yaw") else 1.0 for name in target}
            return [weigh[name] * (here[name] - value) for name, value in target.items()]

        starts = np.random.default_rng(4).uniform(0.1, 2.9, (8, 3))
        costs = [least_squares(apart, at, bounds=(0.0, 3.0), xtol=1e-14, ftol=1e-14).cost for at in starts]
        ours = np.array(apart(np.array([found["commands"][name] for name in NAMES])))
        assert 0.5 * ours @ ours <= min(costs) * (1.0 + 1e-6)
        assert found["limits"], target
        assert all(found["commands"][name] in (0.0, 3.0) for name in found["limits"])


def test_of_several_commands_those_near_to_the_start_are_taken(read: ReducedModel) -> None:
    start = {"front": 2.0, "left": 1.0, "back": 2.5}
    wanted = channels_of(read.state(start))["plate.x"] + 1e-5
    found = read.inverse({"plate.x": wanted}, start=start)["commands"]
    assert max(abs(found[name] - start[name]) for name in NAMES) < 0.05
    assert read.inverse({"plate.x": wanted}, start=found)["commands"] == pytest.approx(found, abs=1e-9)


@pytest.mark.slow
def test_a_load_is_an_input_and_the_inverse_leaves_it(tmp_path: Path) -> None:
    fit = reduced(ROBOT, {"front": Span(0.0, 2.0, "N"), "plate.mass": Span(0.0, 0.2, "kg")}, 40)
    read = evaluator_of(fit.model)
    assert (read.inputs, read.units, read.default.tolist()) == (["front", "plate.mass"], ["N", "kg"], [0.0, 0.05])
    heavy = with_parameters(ROBOT, {"plate.mass": 0.17})
    twin = simulate(heavy, Protocol({"front": Command("tension", np.array([1.2]))})).channels
    state = read.state({"front": 1.2, "plate.mass": 0.17})
    off = 3.0 * fit.error["plate.position"].largest
    assert off < 1e-3 * fit.error["plate.position"].change
    assert state["plates"]["plate"]["position"][2] == pytest.approx(twin["plate.z"][0], abs=off)
    assert read.state({"front": 1.2}) == read.state({"front": 1.2, "plate.mass": 0.05})
    found = read.inverse({"plate.x": twin["plate.x"][0]}, inputs={"plate.mass": 0.17})
    assert found["commands"] == pytest.approx({"front": 1.2}, abs=1e-2)


@pytest.fixture(scope="module")
def loaded() -> ReducedModel:
    """With a payload and a modulus as inputs."""
    spans = {"front": Span(0.0, 3.0, "N"), "left": Span(0.0, 3.0, "N"), "plate.mass": Span(0.0, 0.3, "kg")}
    modulus = next(name for name in robot_parameters(ROBOT) if name.endswith("youngs_modulus"))
    return evaluator_of(reduced(ROBOT, {**spans, modulus: Span(0.7e6, 1.4e6, "Pa")}, 120).model)


@pytest.mark.slow
def test_a_filter_is_consistent_and_leads_to_the_payload(loaded: ReducedModel) -> None:
    """Over 200 robots: normalised innovations are chi squared, and 95 % intervals have the truth in 92 to 98 %."""
    rng, names = np.random.default_rng(8), [name for name in loaded.inputs if "." in name]
    values, deviations = dict(zip(names, (0.1, 1.0e6), strict=True)), dict(zip(names, (0.03, 0.06e6), strict=True))
    noise = {"plate.x": 3e-5, "plate.z": 3e-5, "plate.pitch": 5e-4}
    squares, inside, freedom = 0.0, np.zeros(2), 0
    for _ in range(200):
        truth = {name: float(rng.normal(values[name], deviations[name])) for name in names}
        estimate = KalmanFilter(loaded, values, deviations)
        for at in rng.uniform(0.5, 3.0, (12, 2)).tolist():
            commands = dict(zip(("front", "left"), at, strict=True))
            exact, _ = loaded.read({**commands, **truth}, list(noise))
            measured = {name: float(v + rng.normal(0.0, noise[name])) for name, v in zip(noise, exact, strict=True)}
            square, n = estimate.update(commands, measured, noise)
            squares, freedom = squares + square, freedom + n
        off = np.abs(estimate.mean - np.array([truth[name] for name in names]))
        inside += off <= 1.96 * np.sqrt(np.diag(estimate.covariance))
        assert np.sqrt(np.diag(estimate.covariance))[0] < 0.5 * deviations["plate.mass"]
    assert chi2.cdf(squares, freedom) == pytest.approx(0.5, abs=0.495)
    assert np.all(np.abs(inside / 200 - 0.95) <= 0.03), inside / 200


def test_a_filter_is_not_misled_by_a_value_that_is_far_off(loaded: ReducedModel) -> None:
    """Its first linearisation is: the estimate is that of the measurement all the same, within its interval."""
    noise, truth, rng = {"plate.x": 2e-6, "plate.z": 2e-6}, 0.29, np.random.default_rng(3)
    estimate, away = KalmanFilter(loaded, {"plate.mass": 0.0}, {"plate.mass": 0.2}), list[float]()
    for _ in range(6):
        exact, _ = loaded.read({"front": 3.0, "plate.mass": truth}, list(noise))
        estimate.update(
            {"front": 3.0}, {name: v + rng.normal(0.0, noise[name]) for name, v in zip(noise, exact)}, noise
        )
        away.append(abs(estimate.mean[0] - truth) / float(np.sqrt(estimate.covariance[0, 0])))
    assert max(away) < 3.0, away


def test_a_filter_follows_what_drifts(loaded: ReducedModel) -> None:
    noise = {"plate.x": 1e-5, "plate.z": 1e-5}
    estimate = KalmanFilter(loaded, {"plate.mass": 0.02}, {"plate.mass": 0.02}, {"plate.mass": 0.01})
    for mass in np.linspace(0.02, 0.2, 40).tolist():
        exact, _ = loaded.read({"front": 2.0, "plate.mass": mass}, list(noise))
        estimate.update({"front": 2.0}, dict(zip(noise, exact.tolist(), strict=True)), noise)
    assert estimate.mean[0] == pytest.approx(0.2, abs=0.02)
    with pytest.raises(ValueError, match="The model has no input 'mass'"):
        KalmanFilter(loaded, {"mass": 0.1}, {"mass": 0.1})


def test_channels_are_those_of_the_twin(loaded: ReducedModel, read: ReducedModel) -> None:
    twin = simulate(ROBOT, Protocol({name: Command("tension", np.array([1.5])) for name in NAMES})).channels
    values, rates = read.read(dict.fromkeys(NAMES, 1.5), read.channels)
    for name, value in zip(read.channels, values.tolist(), strict=True):
        assert value == pytest.approx(twin[name][0], abs=2e-5), name
    h = 1e-5
    for k, name in enumerate(read.inputs):
        ends = [read.read({**dict.fromkeys(NAMES, 1.5), name: 1.5 + sign * h}, read.channels)[0] for sign in (1, -1)]
        np.testing.assert_allclose(rates[:, k], (ends[0] - ends[1]) / (2 * h), rtol=1e-5, atol=1e-9)


@pytest.mark.slow
def test_bands_are_the_intervals_carried_into_each_state(tmp_path: Path) -> None:
    """A band is 1.96 standard errors of E times the derivative by E, here by differences; none of a project file."""
    head, *lines = bench_csv().splitlines()
    # Noise in which no usual cause is suspected: its part would depend on how closely the curve is interpolated.
    chance = np.random.default_rng(1)
    rows = [[float(cell) for cell in line.split(",")] for line in lines]
    noisy = [
        f"{t},{d},{f + 0.1 * chance.standard_normal()},{p + 0.3 * chance.standard_normal()}" for t, d, f, p in rows
    ]
    project = write_project(tmp_path, data="\n".join([head, *noisy]) + "\n")
    run, out = tmp_path / "run", tmp_path / "out"
    options = ["--out", str(run), "--no-report", "--no-mesh-error"]
    assert CliRunner().invoke(app, ["calibrate", str(project), *options]).exit_code == 0
    written = CliRunner().invoke(app, ["export", "reduced", str(run), "--out", str(out), "--reach", "4N"])
    assert written.exit_code == 0, written.output
    assert "The bands are the 95 % intervals of the calibration carried into" in " ".join(written.output.split())
    read, robot = ReducedModel(out / "model.json"), load_calibrated(run).robot
    estimate = load_run(run).headline.parameters["bar.youngs_modulus"]
    step = 1e-4 * estimate.value
    for tension in (0.3, 1.7, 4.0):
        pulled = Protocol({"front": Command("tension", np.array([tension]))})
        ends = [
            simulate(
                with_parameters(robot, {"bar.youngs_modulus": estimate.value + sign * step}),
                pulled,
                curve_tolerance=0.0,
            ).channels
            for sign in (-1, 1)
        ]
        bands = read.state({"front": tension})["bands"]
        for channel in ("plate.x", "plate.z", "plate.pitch", "front.shortening"):
            half = 1.959964 * estimate.standard_error * abs(ends[1][channel][0] - ends[0][channel][0]) / (2 * step)
            assert bands[channel] == pytest.approx(half, rel=1e-3), (tension, channel)
    assert read.state({"front": 0.0})["bands"] == pytest.approx(dict.fromkeys(read.channels, 0.0), abs=1e-5)
    plain = CliRunner().invoke(app, ["export", "reduced", str(project), "--out", str(tmp_path / "p"), "--reach", "4N"])
    assert "There are no bands: the values are those of a project file" in " ".join(plain.output.split())
    assert "bands" not in ReducedModel(tmp_path / "p" / "model.json").state({"front": 1.0})


@pytest.mark.parametrize("reach", [Span(-2e3, 6e3, "Pa"), Span(0.0, 2e-7, "m^3")])
def test_a_chamber_is_an_input(reach: Span) -> None:
    robot = blown_box("P1", is_open=True, medium="gas")
    name = robot.actuators[0].name
    fit = reduced(robot, {name: reach}, 16)
    (one,) = fit.model["inputs"]
    assert one["unit"] == "Pa"
    assert f"{name}.volume" in fit.model["coordinates"]
    at = 0.6 * one["most"] + 0.4 * one["least"]
    exact = simulate(robot, Protocol({name: Command("pressure", np.array([at]))})).channels[f"{name}.volume"][0]
    volume = evaluator_of(fit.model).state({name: at})["coordinates"][f"{name}.volume"]
    assert volume == pytest.approx(exact, abs=3.0 * fit.error[f"{name}.volume"].largest)
    if reach.unit == "m^3":
        most = evaluator_of(fit.model).state({name: one["most"]})["coordinates"][f"{name}.volume"]
        assert most == pytest.approx(2e-7, rel=1e-3)


def test_a_drive_is_an_input_to_both_sides(tmp_path: Path) -> None:
    """Its torque; its cables have no command of their own, but their shortenings are outputs."""
    robot = drive_project(tmp_path).robot
    fit = reduced(robot, {"servo": Span(-0.4, 0.4, "rad")}, 24)
    read = evaluator_of(fit.model)
    assert read.units == ["N*m"]
    assert read.least[0] < -1e-3 < 1e-3 < read.most[0]
    assert {"servo.angle", "left.shortening", "right.shortening"} <= set(read.coordinates)
    at = 0.7 * float(read.most[0])
    twin = simulate(robot, Protocol({"servo": Command("torque", np.array([at]))})).channels
    off = 4.0 * fit.error["servo.angle"].largest
    assert read.state({"servo": at})["coordinates"]["servo.angle"] == pytest.approx(twin["servo.angle"][0], abs=off)
    with pytest.raises(ParameterError, match="there is no such actuator or parameter"):
        reduced(robot, {"left": Span(0.0, 1.0, "N")})


@pytest.mark.parametrize(("line", "told"), [(CableLine(1e3, pretension=0.5), True), (CableLine(1e3), False)])
def test_it_says_what_the_other_cables_do(tmp_path: Path, line: CableLine, told: bool) -> None:
    front, left, back = ROBOT.cables
    robot = replace(ROBOT, cables=(front, replace(left, line=line), back))
    write_reduced(reduced(robot, {"front": Span(0.0, 1.0, "N")}, 10), tmp_path)
    text = (tmp_path / "README.txt").read_text()
    assert ("At zero shortening, with their pretension: left." in text) == told
    assert "All other cables have no effort. Statics only" in text


def test_quaternions_are_of_the_twins_angles() -> None:
    angles = np.array([[[0.4, 1.0]], [[-0.3, 0.5]], [[0.7, -0.2]]])
    q = quaternions(*angles)[0]
    (p, r, y), h = angles[:, 0, 0], 1e-6

    def rotation(p: float, r: float, y: float) -> np.ndarray:
        Ry = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
        Rx = np.array([[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]])
        Rz = np.array([[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]])
        return Ry @ Rx @ Rz

    a, b, c, w = q[0]
    cross = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    np.testing.assert_allclose(np.eye(3) + 2 * w * cross + 2 * cross @ cross, rotation(p, r, y), atol=1e-14)
    moved = quaternions(*(angles + np.array([[[h, 0.0]], [[0.5 * h, 0.0]], [[-0.2 * h, 0.0]]])))[0]
    np.testing.assert_allclose((moved[0] - q[0]) / h, q[1], atol=1e-5)


def test_the_evaluator_needs_numpy_alone_and_old_pythons_read_it(folder: Path, read: ReducedModel) -> None:
    ast.parse(Path(reduced_model.__file__).read_text(), feature_version=(3, 8))
    command = [sys.executable, "-I", str(folder / "reduced_model.py"), "front=1.25", "left=0.5"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd="/")
    assert json.loads(done.stdout) == read.state({"front": 1.25, "left": 0.5})
    code = f"import sys; sys.path.insert(0, {str(folder)!r}); import reduced_model; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-I", "-c", code], capture_output=True, text=True, check=True).stdout
    assert {"softcal", "scipy", "pydantic"}.isdisjoint(loaded.split())


def test_the_readme_states_the_error(fit: ReducedModelFit, folder: Path) -> None:
    text, stated = (folder / "README.txt").read_text(), fit.error["plate.position"]
    assert f"plate.position: {stated.p50:.2g}, {stated.p95:.2g} and {stated.largest:.2g} m (" in text
    assert f"with {len(fit.model['powers'])} terms, from 192 equilibria." in text


@pytest.mark.parametrize(
    ("tensions", "sentence"),
    [
        ({"front": 3.01}, "front: 3.01 N is outside the model, which holds from 0 to 3 N"),
        ({"front": -0.1}, "front: -0.1 N is outside"),
        ({"front": float("nan")}, "front: nan N is outside"),
        ({"right": 1.0}, "The model has no input 'right'; it has front, left, back."),
    ],
)
def test_the_evaluator_does_not_extrapolate(read: ReducedModel, tensions: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        read.state(tensions)
    with pytest.raises(ValueError, match=sentence):
        read.inverse({"plate.x": 0.0}, start=tensions)


def test_the_inverse_has_the_models_channels_alone(read: ReducedModel) -> None:
    with pytest.raises(ValueError, match=r"The model has no channel 'plate.rx'; it has plate.x, plate.y"):
        read.inverse({"plate.rx": 0.0})


@pytest.mark.parametrize("begin", [(-1.9, 3.0), (-1.0, -1.0), (0.0, 0.0), (-2.0, 0.5)])
def test_the_inverse_follows_a_curved_valley_to_its_end(begin: tuple[float, float]) -> None:
    """Rosenbrock's: x = 10 (b - a^2) and y = 0.03 a, as two places that nearly depend on each other."""
    ends = {"a": (-2.0, 2.0), "b": (-1.0, 3.0)}
    inputs = [
        {"name": name, "unit": "N", "least": low, "most": high, "default": 0.0, "control": "tension"}
        for name, (low, high) in ends.items()
    ]
    valley = {
        "inputs": inputs, "plates": [], "coordinates": [], "markers": ["p"], "rows": ["p.x", "p.y", "p.z"],
        "directions": [[1.0, 0.0], [0.0, 1.0]], "powers": [[0, 0], [1, 0], [0, 1], [2, 0]], "bands": None, "error": {},
        "coefficients": [[-10.0, 0.0, 0.0], [0.0, 0.06, 0.0], [20.0, 0.0, 0.0], [-20.0, 0.0, 0.0]],
    }  # fmt: skip
    found = evaluator_of(valley).inverse({"p.x": 0.0, "p.y": 0.03}, start=dict(zip("ab", begin, strict=True)))
    assert found["commands"] == pytest.approx({"a": 1.0, "b": 1.0}, abs=1e-5)


def test_values_that_are_no_numbers_are_refused_and_change_nothing(loaded: ReducedModel) -> None:
    """A place that a camera lost, or a goal of nan, must not become a command."""
    nan = float("nan")
    for targets, weights, told in (
        ({"plate.x": nan}, {}, "plate.x: nan is no finite number"),
        ({}, {}, "no target"),
        ({"plate.x": 0.0}, {"plate.z": 1.0}, "The model has no target 'plate.z'; it has plate.x"),
        ({"plate.x": 0.0}, {"plate.x": 0.0}, "positive"),
        ({"plate.x": 0.0}, {"plate.x": nan}, "positive"),
    ):
        with pytest.raises(ValueError, match=told):
            loaded.inverse(targets, weights=weights)
    estimate = KalmanFilter(loaded, {"plate.mass": 0.1}, {"plate.mass": 0.02})
    for commands, measured, noise, told in (
        ({"front": 1.0}, {"plate.x": nan}, {"plate.x": 1e-4}, "plate.x: nan is no finite number"),
        ({"front": 1.0}, {"plate.x": 0.01}, {}, "The noise of plate.x is missing"),
        ({"plate.mass": 0.2}, {"plate.x": 0.01}, {"plate.x": 1e-4}, "plate.mass: this is estimated"),
    ):
        with pytest.raises(ValueError, match=told):
            estimate.update(commands, measured, noise)
    assert estimate.update({"front": 1.0}, {}, {}) == (0.0, 0)
    assert estimate.mean == pytest.approx([0.1])
    with pytest.raises(ValueError, match=r"The deviation of plate\.mass is missing"):
        KalmanFilter(loaded, {"plate.mass": 0.1}, {})


def test_inputs_that_change_nothing_make_no_model() -> None:
    with pytest.raises(ParameterError, match="no output changes with the inputs"):
        reduced(replace(ROBOT, gravity=np.zeros(3)), {"plate.mass": Span(0.0, 0.1, "kg")}, 10)


def test_a_reach_in_length_ends_there() -> None:
    read = evaluator_of(reduced(ROBOT, {"front": Span(0.0, 0.02, "m")}, 16).model)
    at_end = read.state({"front": float(read.most[0])})
    assert at_end["coordinates"]["front.shortening"] == pytest.approx(0.02, rel=1e-4)
    assert read.least[0] == 0.0


@pytest.mark.parametrize(
    ("spans", "samples", "why"),
    [
        ({"rear": Span(0.0, 1.0, "N")}, None, "there is no such cable or parameter"),
        ({}, None, "the model has no inputs"),
        ({"front": Span(0.0, 0.0, "N")}, None, "the range of an input must not be empty"),
        ({"front": Span(-1.0, 2.0, "N")}, None, "tension"),
        ({"front": Span(0.0, float("nan"), "N")}, None, "must not be empty"),
        ({"plate.mass": Span(0.1, 0.2, "kg")}, None, "the range must contain the robot's own value"),
        ({"plate.mass": Span(-0.1, 0.2, "kg")}, None, "the mass is out of range"),
        ({"front": Span(0.0, 1.0, "N")}, 3, "there are too few samples"),
        ({"front": Span(0.0, 1.0, "N")}, 0, "there are too few samples; got 0; allowed: 10 to 20000 samples"),
        ({"front": Span(0.0, 1.0, "N")}, 10**9, "there are too many samples"),
        ({"front": Span(0.0, 1.0, "Pa")}, None, "this is no range of the actuator"),
        ({"front": Span(0.0, 0.5, "m")}, None, "front"),
    ],
)
def test_what_makes_no_model_is_refused(spans: dict[str, Span], samples: int | None, why: str) -> None:
    with pytest.raises((ParameterError, SimulationError), match=why):
        reduced(ROBOT, spans, samples)


def test_every_fault_is_told_at_once() -> None:
    rough = replace(ROBOT.cables[0], friction_coefficient=0.1, line=CableLine(friction_memory=True))
    robot: Robot = replace(ROBOT, cables=(rough, *ROBOT.cables[1:]))
    with pytest.raises(ParameterError, match=r"(?s)no memory.*no such cable.*must not be empty"):
        reduced(robot, {"rear": Span(0.0, 1.0, "N"), "left": Span(2.0, 1.0, "N")})


def test_shapes_are_few_modes_over_the_same_inputs() -> None:
    """Known shapes: a column that bends and twists with the inputs; the modes have them at other places, too."""
    rng = np.random.default_rng(1)
    places, others, along = rng.uniform(-1.0, 1.0, (60, 2)), rng.uniform(-1.0, 1.0, (40, 2)), np.linspace(0.0, 1.0, 30)

    def at(inputs: np.ndarray) -> np.ndarray:
        a, b = inputs.T[..., None]
        return np.stack([0.1 * a * along**2, 0.05 * a * b * along, along + 0.02 * np.sin(b) * along], axis=-1)

    none = np.zeros((60, 0))
    sampled = Sampled(places, places, none, none, np.ones(2), none)
    directions = np.array([[0.8, 0.2], [-0.1, 0.9]])
    few, many = (_powers(np.ones(2), degree) for degree in (1, 9))
    assert len(many) > len(places) / 2
    rest = at(np.zeros((1, 2)))[0]
    distances = []
    for powers in (few, many):
        modes = shape_modes(rest, at(places), lambda values: sampled.fitted(directions, powers, values))  # noqa: B023
        assert modes.data["n_modes"] <= 3
        assert len(modes.data["powers"]) == min(len(powers), 30)
        distances.append(modes.distance(directions, others, at(others)))
    assert distances[1] < 5e-5 < 1e-2 < distances[0]


def test_without_ranges_they_are_those_of_the_experiments(tmp_path: Path) -> None:
    project, out = write_project(tmp_path), tmp_path / "out"
    done = CliRunner().invoke(app, ["export", "reduced", str(project), "--out", str(out), "--samples", "10"])
    assert done.exit_code == 0, done.output
    read = ReducedModel(out / "model.json")
    assert read.inputs == ["front"]
    furthest = max(command.values.max() for command in protocol_of(load(project), "pull").commands.values())
    shortening = read.state({"front": float(read.most[0])})["coordinates"]["front.shortening"]
    assert shortening == pytest.approx(furthest, rel=1e-3)


@pytest.mark.slow
def test_the_command_writes_it(tmp_path: Path) -> None:
    project = write_project(tmp_path / "project")
    out = tmp_path / "out"
    arguments = ["export", "reduced", str(project), "--out", str(out), "--reach", "10mm", "--samples", "10"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in out.iterdir()) == [
        "README.txt",
        "model.json",
        "reduced_model.c",
        "reduced_model.py",
    ]
    assert "plate.rotation: " in done.output
    ranges = CliRunner().invoke(
        app,
        [
            *arguments[:4],
            str(tmp_path / "c"),
            "--reach",
            "front=1N..2N,bar.youngs_modulus=1MPa..3MPa",
            "--samples",
            "20",
        ],
    )
    assert ranges.exit_code == 0, ranges.output
    inputs = json.loads((tmp_path / "c" / "model.json").read_text())["inputs"]
    assert [(one["name"], one["least"], one["most"], one["control"]) for one in inputs] == [
        ("front", 1.0, 2.0, "tension"),
        ("bar.youngs_modulus", 1e6, 3e6, ""),
    ]


@pytest.mark.parametrize(
    ("reach", "why"),
    [
        ("front=8N,10mm", "a range has no name of an input"),
        ("front=1N,front=2N", "an input has two ranges"),
        ("frnt=8N", "no such cable or parameter"),
        ("front=5px", "front"),
        ("bar.youngs_modulus=2MPa", "the range of a parameter has two ends"),
        ("front=2N..1N", "must not be empty"),
    ],
)
def test_a_bad_range_is_refused(tmp_path: Path, reach: str, why: str) -> None:
    project = write_project(tmp_path / "project")
    done = CliRunner().invoke(app, ["export", "reduced", str(project), "--out", str(tmp_path / "b"), "--reach", reach])
    assert done.exit_code == 2
    assert why in " ".join(done.output.split())
    assert not (tmp_path / "b").exists()
