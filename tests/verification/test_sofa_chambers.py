"""Chambers in a SOFA scene: its triangles have softcal's forces and volumes, and the scene settles where softcal does.

Without SOFA the scene runs in the stand-in of tests/fake_sofa. Where SOFA_ROOT is set, the last test runs SOFA itself.
"""

from __future__ import annotations

import csv
import importlib
import os
from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import blown_box, hanging_finger
from sofa_case import scene_modules, use_fake

from softcal.errors import ParameterError
from softcal.mechanics.chamber import ChamberTerm
from softcal.plugins.calculix.crosscheck import crosscheck
from softcal.plugins.sofa.robot import linear_robot
from softcal.plugins.sofa.scene import scene_parameters, write_scene
from softcal.plugins.sofa.simulator import SofaEngine, sofa_engine
from softcal.plugins.sofa.writing import write_sofa
from softcal.twin.build import build_twin
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Cable, Robot, ViaPoint
from softcal.twin.simulate import simulate

needs_sofa = pytest.mark.skipif("SOFA_ROOT" not in os.environ, reason="SOFA is not installed: SOFA_ROOT is not set")


def pressed(*values: float, control: str = "pressure") -> Protocol:
    return Protocol({"main": Command(control, np.array(values))})


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> SofaEngine:
    use_fake(monkeypatch, mechanics="twin")
    return sofa_engine()


def forces_of(chamber: dict, n_points: int) -> np.ndarray:
    """SOFA's forces of a unit pressure: each triangle's vector area, a third to each corner."""
    at, triangles = np.array(chamber["positions"]), np.array(chamber["triangles"])
    a, b, c = np.swapaxes(at[triangles], 0, 1)
    forces = np.zeros((n_points, 3))
    for corner in np.array(chamber["nodes"])[triangles].T:
        np.add.at(forces, corner, np.cross(b - a, c - a) / 6.0)
    return forces


@pytest.mark.parametrize("is_open", [False, True])
def test_the_triangles_have_softcals_forces_and_its_volume(is_open):
    """Node by node; on the rim of an opening the sum and the moment."""
    robot = blown_box("P1", is_open=is_open, medium="liquid")
    linear = linear_robot(robot)
    chamber = scene_parameters(linear, pressed(1e4))["chambers"]["main"]
    twin = build_twin(linear.robot)
    term, X = twin.system.of(ChamberTerm)[0], twin.system.layout.X
    ours, theirs = term.shape_gradient(X, 0, X.size).reshape(-1, 3), forces_of(chamber, len(X))
    rim = np.zeros(len(X), dtype=bool)
    rim[[node for wall in term.walls for loop in wall.rims for node in loop]] = True
    scale = np.abs(ours).max()
    np.testing.assert_allclose(theirs[~rim], ours[~rim], atol=1e-12 * scale)
    for weight in (np.ones((len(X), 1)), *X.T[:, :, None]):
        np.testing.assert_allclose((weight * theirs).sum(axis=0), (weight * ours).sum(axis=0), atol=1e-12 * scale)
    np.testing.assert_allclose(theirs.sum(axis=0), 0.0, atol=1e-12 * scale)
    assert rim.any() == is_open
    assert chamber["key_step"] == pytest.approx(200.0)


def test_the_scene_has_the_pressure_as_an_impulse_and_tells_it_as_a_pressure(monkeypatch, tmp_path):
    """p dt is what SOFA takes; so the state does not depend on the step."""
    use_fake(monkeypatch, mechanics="twin")
    linear = linear_robot(blown_box("P1", is_open=False, medium="liquid"))
    parameters = scene_parameters(linear, pressed(1e4))
    write_scene(linear, parameters, tmp_path)
    volume = build_twin(linear.robot).system.of(ChamberTerm)[0].rest_volume
    with scene_modules(tmp_path) as modules:
        it = importlib.import_module("run").SofaRun(modules.scene.read_parameters(), parameters["rest"])
        assert it.read()["chambers"]["main"] == {"pressure": 0.0, "volume": pytest.approx(volume, rel=1e-12)}
        for dt in (0.05, 0.01):
            it.go_back(dt)
            it.step({"main": 1e4})
            (constraint,) = it.scene.root.find("SurfacePressureConstraint")
            assert constraint.value.value == [1e4 * dt]
            assert constraint.valueType.value == "pressure"
            assert it.read()["chambers"]["main"]["pressure"] == pytest.approx(1e4, rel=1e-12)


def assert_rests_alike(engine: SofaEngine, robot: Robot, protocol: Protocol, tolerance: float) -> None:
    theirs, ours = engine(robot, protocol, snapshots=True), simulate(robot, protocol, curve_tolerance=0.0)
    assert theirs.succeeded, theirs.status
    assert ours.succeeded, ours.status
    for channel, values in ours.channels.items():
        scale = float(np.abs(values).max())
        np.testing.assert_allclose(theirs.channels[channel], values, rtol=0, atol=tolerance * scale, err_msg=channel)
    assert theirs.snapshots[-1].efforts["main"] == pytest.approx(ours.channels["main.pressure"][-1], rel=1e-9)


@pytest.mark.slow
def test_a_finger_rests_where_softcal_has_it_by_pressure_and_vacuum(engine):
    """A gas too, whose dead volume SOFA does not know."""
    assert_rests_alike(engine, hanging_finger("P1", is_open=True), pressed(1e4, 4e4, -1e4), 1e-5)


def test_a_cable_beside_a_chamber(engine):
    points = (ViaPoint(np.array([0.015, 0.012, 0.02]), "box"), ViaPoint(np.array([0.015, 0.012, -0.03])))
    robot = replace(blown_box("P1", is_open=False, medium="gas"), cables=(Cable("front", points),))
    protocol = Protocol({"front": Command("tension", np.array([2.0])), "main": Command("pressure", np.array([2e4]))})
    assert_rests_alike(engine, robot, protocol, 1e-4)


def test_a_volume_is_refused_but_compared_at_softcals_pressure(engine):
    robot = blown_box("P1", is_open=False, medium="liquid")
    with pytest.raises(ParameterError, match="a chamber in SOFA is driven by pressure; got volume; allowed: pressure"):
        engine(robot, pressed(1e-7, control="volume"))
    (found,) = crosscheck(robot, pressed(1e-7, control="volume"), ["sofa"]).comparisons
    by_name = {one.quantity: one for one in found.differences}
    assert found.agrees, found.verdict
    assert by_name["main.volume"].engine == pytest.approx(1e-7, rel=1e-3)
    assert "main.pressure" not in by_name


def test_what_is_exported_has_a_schedule_and_says_how_it_is_driven(tmp_path):
    robot = hanging_finger("P2", is_open=True)
    written = write_sofa(robot, pressed(0.0, 5e3, 1e4), tmp_path, "finger")
    (schedule,) = (path for path in written if path.name == "schedule.csv")
    with schedule.open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["time [s]", "main.pressure [Pa]"]
    assert [float(row[1]) for row in rows[1:]] == [0.0, 0.0, 5e3, 1e4]
    assert float(rows[-1][0]) == pytest.approx(20.0, rel=1e-2)
    readme = (tmp_path / "README.md").read_text()
    assert "main by pressure" in readme
    assert "re-identified on this mesh" in readme
    assert "main.volume" in readme
    assert " ml of " in readme


@needs_sofa
@pytest.mark.parametrize("is_open", [False, True])
def test_sofa_itself_finger(is_open):
    assert_rests_alike(sofa_engine(), hanging_finger("P1", is_open=is_open), pressed(1e4, 2e4, 4e4), 1e-4)
