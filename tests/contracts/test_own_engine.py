"""An engine in one file of the user's own: compared with softcal's statics, and in their place."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from own_module import imported
from project_case import write_project
from typer.testing import CliRunner

from softcal import load, register_engine
from softcal.cli import app
from softcal.errors import ParameterError
from softcal.export.engine import ENGINES, Engine
from softcal.twin.response import Response
from softcal.workflows.calibration import calibrate

SOFTER = """
from dataclasses import replace
from functools import partial

from softcal import Engine, register_engine, with_parameters
from softcal.export.engine import state_of
from softcal.twin.simulate import simulate

SHARE = 0.9


def softer(robot):
    name = f"{robot.bodies[0].name}.youngs_modulus"
    return with_parameters(robot, {name: SHARE * robot.bodies[0].parameters["youngs_modulus"]})


def solve(robot, protocol, shape, running):
    return state_of(simulate(softer(robot), protocol, snapshots=True, curve_tolerance=0.0))


def simulator(settings, robot):
    def answer(robot, protocol, theta=None, *, sensitivities=(), snapshots=False):
        name = f"{robot.bodies[0].name}.youngs_modulus"
        theta = {name: robot.bodies[0].parameters["youngs_modulus"], **(theta or {})}
        given = {**theta, name: SHARE * theta[name]}
        response = simulate(robot, protocol, given, sensitivities=sensitivities, snapshots=snapshots)
        by = {c: {k: v * SHARE if k == name else v for k, v in d.items()} for c, d in response.sensitivities.items()}
        return replace(response, sensitivities=by)
    return answer


engine = register_engine(Engine("softer", lambda robot: robot, lambda: "", solve, simulator=simulator))
"""


@pytest.fixture
def softer(tmp_path: Path) -> Generator[ModuleType]:
    """The engine, as a module of the user's registers it."""
    yield imported(tmp_path / "softer_engine.py", SOFTER)
    ENGINES.remove("softer")


def test_it_takes_softcals_place(softer: ModuleType, tmp_path: Path) -> None:
    project = load(write_project(tmp_path))
    own = calibrate(project).headline.parameters["bar.youngs_modulus"]
    theirs = calibrate(project, engine="softer").headline.parameters["bar.youngs_modulus"]
    assert theirs.value == pytest.approx(own.value / 0.9, rel=1e-4)


def test_it_is_compared_with_softcal(softer: ModuleType, tmp_path: Path) -> None:
    path = write_project(tmp_path)
    found = CliRunner().invoke(app, ["crosscheck", str(path), "--engines", "softer", "--pull", "front=5mm"])
    assert found.exit_code == 1
    assert "softer and softcal differ by" in found.output.replace("\n", " ")
    assert "1.0e-01 relative" in found.output.replace("\n", " ")


def test_an_engine_that_only_compares_or_does_not_exist_is_refused(tmp_path: Path) -> None:
    path = str(write_project(tmp_path))
    for name, nearest in (("calculix", ""), ("soffa", "Try: 'sofa'")):
        found = CliRunner().invoke(app, ["simulate", path, "--engine", name, "--out", str(tmp_path / "out")])
        told = found.output.replace("\n", " ")
        assert found.exit_code == 2
        assert f"--engine: there is no such engine; got '{name}'; allowed: softcal, sofa" in told
        assert nearest in told


def test_what_is_no_engine_is_refused() -> None:
    sofa = ENGINES["sofa"]
    with pytest.raises(ParameterError, match="this is not an engine"):
        register_engine(load)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="softcal is the engine that others are compared with"):
        register_engine(Engine("softcal", sofa.own, sofa.missing, sofa.solve))
    with pytest.raises(
        ParameterError, match=r"another engine of this name.*Try: another name, or .*: restart the kernel"
    ):
        register_engine(Engine("sofa", sofa.own, sofa.missing, sofa.missing))  # type: ignore[arg-type]


def test_derivatives_of_a_strangers_engine_are_one_array_by_name():
    each = {
        "front.tension": {"E": np.array([1.0, 2.0]), "nu": np.zeros(2)},
        "tip.pitch": {"nu": np.ones(2), "E": np.ones(2)},
    }
    response = Response({}, {}, "", succeeded=True, n_factorisations=0, sensitivities=each)
    assert response.sensitivities.rates.shape == (2, 2, 2)
    assert response.sensitivities["front.tension"]["E"].tolist() == [1.0, 2.0]
    assert response.sensitivities.by("E", ["tip.pitch", "front.tension"]).tolist() == [[1.0, 1.0], [1.0, 2.0]]
    assert "tip.roll" not in response.sensitivities
    assert not Response({}, {}, "", succeeded=True, n_factorisations=0).sensitivities
    del each["tip.pitch"]["E"]
    with pytest.raises(ParameterError, match=r"^tip\.pitch: every channel .*; got nu; allowed: E, nu"):
        replace(response, sensitivities=each)
