"""Newton's method and the curve of equilibria: what they cost, how they fail, and that a node between two is found."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, twin_and_theta

from softcal.errors import SimulationError
from softcal.mechanics import path as path_module
from softcal.mechanics.cable import cables_of
from softcal.mechanics.node import Line, node_at
from softcal.mechanics.path import between, follow
from softcal.mechanics.stability import is_stable
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls
from softcal.twin.simulate import simulate

PULL = Line(np.array([False]), np.zeros(1), np.zeros(1), np.zeros(1), np.ones(1))


def started(element="P1", **options):
    twin, theta = twin_and_theta(column_robot(element, divisions=(1, 1, 4), **options))
    statics = Statics(twin.system, theta)
    start = node_at(statics, PULL, 0.0, rest_state(twin.system.layout), ())
    return statics, start


def test_equilibrium_is_one():
    statics, start = started()
    found = statics.equilibrium(start.state, Controls(np.array([False]), np.zeros(1), np.array([0.01])))
    assert found.converged
    assert found.residual < 1e-9
    at = statics.system.linearise(found.state, PULL.at(0.01), statics.theta, tangent=False)
    assert np.abs(at.reduced).max() < 1e-8 * np.abs(at.full).max()
    assert cables_of(statics.system).lengths(found.state.x)[0] == pytest.approx(0.09, abs=1e-10)


def test_newton_is_quadratic_with_fresh_tangents(monkeypatch):
    """Residuals r, r^2, r^4, down to rounding: what an inexact tangent does not give."""
    monkeypatch.setattr("softcal.mechanics.statics.REUSE_BELOW", 0.0)
    monkeypatch.setattr("softcal.mechanics.statics.SMALL_START", 0.0)
    seen = []
    original = Statics.norm
    monkeypatch.setattr(Statics, "norm", lambda self, at: seen.append(original(self, at)) or seen[-1])
    statics, start = started("P2P1")
    assert statics.equilibrium(start.state, PULL.at(0.02)).converged
    r = np.array(seen)
    tail = r[(r < 1e-1) & (r > 1e-13)]
    assert len(tail) >= 3
    assert np.all(tail[1:] < np.maximum(2.0 * tail[:-1] ** 2, 1e-12))


def test_a_hopeless_guess_ends_in_a_sentence():
    statics, start = started()
    inside_out = start.state.x.copy()
    inside_out[statics.system.layout.free_points] *= -1.0
    found = statics.equilibrium(type(start.state)(**{**vars(start.state), "x": inside_out}), PULL.at(0.01))
    assert not found.converged
    assert "inverts an element" in found.status


def test_path_ends_where_it_is_told():
    statics, start = started()
    path = follow(statics, PULL, start, 0.03, first_step=0.004)
    assert path.reached
    c = [node.c for node in path.nodes]
    assert c[0] == 0.0
    assert c[-1] == 0.03
    assert np.all(np.diff(c) > 0.0)
    stopped = follow(statics, PULL, start, 0.03, first_step=0.004, share=lambda node: node.c / 0.01)
    assert 0.01 < stopped.nodes[-1].c < 0.03


def test_steps_are_cut_where_newton_fails_and_grow_again(monkeypatch):
    statics, start = started()
    original = statics.equilibrium
    refused = []

    def picky(guess, controls):
        found = original(guess, controls)
        if controls.coordinate[0] > 0.01 and len(refused) < 3:
            refused.append(controls.coordinate[0])
            return type(found)(found.state, False, 25, 1.0, "refused")
        return found

    monkeypatch.setattr(statics, "equilibrium", picky)
    path = follow(statics, PULL, start, 0.03, first_step=0.03)
    assert path.reached
    assert len(refused) == 3
    assert len(path.nodes) > 3


def test_path_without_an_end_says_how_far_it_came(monkeypatch):
    statics, start = started()
    original = statics.equilibrium

    def wall(guess, controls):
        found = original(guess, controls)
        return found if controls.coordinate[0] < 0.0123 else type(found)(found.state, False, 25, 1.0, "a wall")

    monkeypatch.setattr(statics, "equilibrium", wall)
    path = follow(statics, PULL, start, 0.03, first_step=0.004)
    assert not path.reached
    assert path.status == "a wall"
    assert path.nodes[-1].c == pytest.approx(0.0123, abs=1e-5)
    assert statics.n_factorisations < 60  # no fall goes on where it stands and no equilibrium is found


def test_node_between_two_is_on_the_curve():
    statics, start = started("P2P1")
    path = follow(statics, PULL, start, 0.04, first_step=0.02)
    node = between(statics, PULL, path, 0.033)
    direct = follow(statics, PULL, start, 0.033, first_step=0.005).nodes[-1]
    np.testing.assert_allclose(node.state.x, direct.state.x, atol=1e-9)
    np.testing.assert_allclose(node.state.effort, direct.state.effort, rtol=1e-7)


def test_node_between_two_is_found_in_small_steps_where_the_guess_fails(monkeypatch):
    statics, start = started()
    path = follow(statics, PULL, start, 0.04, first_step=0.02)
    monkeypatch.setattr(path_module, "interpolated", lambda layout, before, after, c: _turned_inside_out(start.state))
    node = between(statics, PULL, path, 0.033)
    direct = follow(statics, PULL, start, 0.033, first_step=0.005).nodes[-1]
    np.testing.assert_allclose(node.state.effort, direct.state.effort, rtol=1e-7)
    original = statics.equilibrium
    failing = lambda guess, controls: replace(original(guess, controls), converged=False, status="no way")  # noqa: E731
    monkeypatch.setattr(statics, "equilibrium", failing)
    with pytest.raises(SimulationError, match=r"No equilibrium between two neighbouring ones: no way\.$"):
        between(statics, PULL, path, 0.033)


def _turned_inside_out(state):
    return type(state)(**{**vars(state), "x": -state.x})


def test_predictor_saves_iterations():
    """The slope at a node is exact: a step of half the size leaves a quarter of the first residual, or less."""
    statics, start = started()
    node = follow(statics, PULL, start, 0.01, first_step=0.01).nodes[-1]
    residuals = []
    for h in (0.004, 0.002):
        step = path_module._predicted_step(statics.system.layout, [node], 0.01 + h)
        guess = statics.reachable(node.state, step)
        residuals.append(statics.norm(statics.system.linearise(guess, PULL.at(0.01 + h), statics.theta)))
    assert residuals[1] < 0.3 * residuals[0]


def test_interpolated_curve_keeps_its_tolerance():
    """Read off between the nodes, against every sample solved."""
    robot = column_robot("P1", parameters=elastic(1e6, 0.45))
    d = np.linspace(0.0, 0.05, 41)
    exact = simulate(robot, pulled(*d), curve_tolerance=0.0)
    for tolerance in (1e-3, 1e-4, 1e-5):
        read = simulate(robot, pulled(*d), curve_tolerance=tolerance)
        for name in ("front.tension", "plate.pitch"):
            error = np.abs(read.channels[name] - exact.channels[name]).max()
            assert error < 2.0 * tolerance * np.abs(exact.channels[name]).max()
    assert read.n_factorisations < exact.n_factorisations


def test_predictor_takes_no_parabola_through_a_fall():
    """After a fall the first steps follow the slope alone: past a buckling load branches turn as roots do."""
    statics, start = started()
    path = follow(statics, PULL, start, 0.02, first_step=0.005)
    one, two = path.nodes[-2:]
    layout = statics.system.layout
    smooth = path_module._predicted_step(layout, [one, two], 0.021)
    assert np.abs(smooth - 0.001 * two.slope).max() > 1e-6
    for nodes in ([replace(one, is_snapped=True), two], [one, replace(two, is_snapped=True)]):
        np.testing.assert_allclose(path_module._predicted_step(layout, nodes, 0.021), 0.001 * two.slope, rtol=1e-9)


class Wavering:
    """Statics of a tangent with so many falling directions without drag, and with the least."""

    def __init__(self, without, with_drag):
        self.counts, self.drag = (without, with_drag), 0.0

    def stiffness(self, at):
        return 1.0

    def factorise(self, at, drag=0.0):
        self.drag = drag

    def n_unstable(self):
        return self.counts[self.drag > 0.0]


@pytest.mark.parametrize(("counts", "stable"), [((0, 0), True), ((1, 0), True), ((2, 1), False)])
def test_what_rounding_makes_negative_is_stable(counts, stable):
    statics = Wavering(*counts)
    assert is_stable(statics, None) == stable
    assert statics.drag == 0.0  # the factors stay those of the tangent itself: sensitivities follow
