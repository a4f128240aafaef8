"""The twin on a finer mesh by the change of its channels: against the load path followed on that mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import side_cable
from project_case import bar_robot

from softcal.calibration.statistics.mesh_error import finer_twin
from softcal.geometry.quadratic import to_quadratic
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Statics
from softcal.twin.build import build_twin
from softcal.twin.mesh_change import PLACES, FinerTwin, _Change
from softcal.twin.prolongation import prolongation
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import PointLoad, Robot
from softcal.twin.simulate import simulate

PULL = Protocol({"front": Command("shortening", np.linspace(-0.001, 0.02, 43))})
ACCURACY = 0.01  # of the largest change of all channels of one unit
EXACT = 1e-5  # tolerance of curves to compare with


def robot(element: str, order: int = 1) -> Robot:
    bar = bar_robot()
    body = replace(bar.bodies[0], element=element)
    if order == 2:
        mesh = to_quadratic(body.mesh)
        fixed = np.flatnonzero(mesh.points[:, 2] < 1e-9)
        body = replace(body, mesh=mesh, fixed=fixed)
    return replace(bar, bodies=(body,))


@pytest.mark.parametrize(("element", "order"), [("P1", 1), ("P2", 1), ("P2P1", 1), ("P2P1", 2)])
def test_the_change_is_that_between_the_load_paths(element: str, order: int, monkeypatch: pytest.MonkeyPatch) -> None:
    coarse = robot(element, order)
    finer = finer_twin(coarse)
    with monkeypatch.context() as without_path:
        without_path.setattr("softcal.twin.mesh_change.simulate", None)
        changed = finer(coarse, PULL)
    here, there = (simulate(r, PULL, curve_tolerance=EXACT) for r in (coarse, finer.robot))
    changes = {name: there.channels[name] - values for name, values in here.channels.items()}
    largest = {unit: max(np.abs(changes[n]).max() for n, u in here.units.items() if u == unit) for unit in ("N", "m")}
    largest["rad"] = max(np.abs(changes[n]).max() for n, u in here.units.items() if u == "rad")
    assert largest["N"] > 1e-3 * np.abs(there.channels["front.tension"]).max()
    for name, values in changed.channels.items():
        unit = here.units[name]
        # The response on the coarse mesh has the error of its curve.
        curve = 1e-4 * max(np.abs(there.channels[n]).max() for n, u in here.units.items() if u == unit)
        assert np.abs(values - there.channels[name]).max() < ACCURACY * largest[unit] + curve, name


def test_the_change_is_scaled_with_the_modulus_from_the_load_path_of_the_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The coarse path is not followed again at a modulus that the search has come to."""
    coarse, E = robot("P1"), {"bar.youngs_modulus": 3e6}
    finer = finer_twin(coarse)
    simulate(coarse, PULL, {"bar.youngs_modulus": 2e6}, crossings=False)
    solved, solve = list[int](), Statics.equilibrium
    monkeypatch.setattr(
        Statics,
        "equilibrium",
        lambda self, *a, **how: (solved.append(self.system.layout.n_points), solve(self, *a, **how))[1],
    )
    changed = finer(coarse, PULL, E)
    at_places = len(PLACES) - 1  # the first one is the path's end
    assert solved.count(build_twin(coarse).system.layout.n_points) <= at_places
    there = simulate(finer.robot, PULL, E, curve_tolerance=EXACT)
    scale = np.abs(there.channels["front.tension"]).max()
    assert np.abs(changed.channels["front.tension"] - there.channels["front.tension"]).max() < 1e-3 * scale


def test_what_is_no_single_smooth_curve_is_simulated_on_the_finer_mesh() -> None:
    coarse = robot("P1")
    load = PointLoad("weight", "plate", np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.1, 0.0]))
    two = replace(coarse, cables=(*coarse.cables, side_cable("back", [-0.03, 0.0])))
    both = Protocol({name: Command("shortening", np.array([1e-4, 2e-4])) for name in ("front", "back")})
    body = coarse.bodies[0]
    softening = {"softening_amount": 2.0, "softening_energy": 1e4}
    softens = replace(body, history=("softening",), parameters={**body.parameters, **softening})
    cases: list[tuple[Robot, Protocol]] = [
        (coarse, Protocol({"front": Command("tension", np.array([0.01, 0.02]))})),
        (coarse, Protocol({"front": Command("shortening", np.array([-0.002, -0.001]))})),
        (replace(coarse, loads=(load,)), PULL),
        (two, both),
        (replace(coarse, bodies=(softens,)), PULL.take(np.arange(2, 43, 8))),
    ]
    for case, protocol in cases:
        finer = finer_twin(case)
        assert_same(finer(case, protocol).channels, simulate(finer.robot, protocol).channels)


def test_derivatives_are_those_on_the_finer_mesh() -> None:
    coarse = robot("P1")
    finer = finer_twin(coarse)
    found = finer(coarse, PULL, sensitivities=["bar.youngs_modulus"])
    wanted = simulate(finer.robot, PULL, sensitivities=["bar.youngs_modulus"])
    assert_same(found.sensitivities["front.tension"], wanted.sensitivities["front.tension"])


def assert_same(found: Mapping[str, np.ndarray], wanted: Mapping[str, np.ndarray]) -> None:
    assert found.keys() == wanted.keys()
    for name, values in wanted.items():
        assert found[name] == pytest.approx(values, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize(("element", "order"), [("P1", 1), ("P2P1", 1), ("P2P1", 2)])
def test_a_state_of_constant_strain_is_the_same_on_the_finer_mesh(element: str, order: int) -> None:
    coarse = robot(element, order)
    finer: FinerTwin = finer_twin(coarse)
    own, other = build_twin(coarse), build_twin(finer.robot)
    F = np.array([[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.2]])
    rest = rest_state(own.system.layout)
    pressure = np.full(len(rest.pressure), 7.0)
    state = prolongation(own, other, finer.corners)(replace(rest, x=rest.x @ F.T, pressure=pressure))
    free = other.system.layout.free_points
    assert state.x[free] == pytest.approx((other.system.layout.X @ F.T)[free], abs=1e-15)
    assert state.pressure == pytest.approx(np.full(len(state.pressure), 7.0 if own.pressure_nodes else 0.0))


def test_a_rough_change_goes_through_its_values_whatever_their_slopes():
    """Its error is half of what a place makes of it, which is left out; none where they are on a line."""
    start, c = 0.001, 0.001 + 0.04 * np.array([1.0, 0.5, 0.25, 0.75])
    line = np.stack([3.0 * (c - start), -(c - start)], axis=1)
    off = line + np.array([[0.0, 0.0], [0.01, 0.0], [0.0, 0.0], [0.0, 0.0]])
    for values, error in ((line, 0.0), (off, 0.01)):
        change = _Change(start, c, values, np.full_like(values, 7.0), is_rough=True)
        np.testing.assert_allclose(change.at(c), values, rtol=0, atol=1e-15)
        np.testing.assert_allclose(change.at(np.array([start])), 0.0, atol=1e-15)
        errors = change.errors()
        np.testing.assert_allclose(errors[0], [0.5 * error, 0.0], rtol=0.05, atol=1e-12)
        assert np.all(errors[1:, 0] <= errors[0, 0])
        assert np.all(errors[:, 1] < 1e-12)


def test_further_places_are_half_way_to_those_beside():
    start, c = 0.001, 0.001 + 0.04 * np.array([1.0, 0.5, 0.75, 0.25])
    change = _Change(start, c, np.zeros((4, 1)), np.zeros((4, 1)), is_rough=True)
    for k, beside in ((1, (0.375, 0.625)), (2, (0.625, 0.875)), (3, (0.125, 0.375))):
        assert change.beside(k) == pytest.approx(beside)
