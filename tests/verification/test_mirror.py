"""A tangent that mirrors itself, split into its even and its odd half: the same solutions, stability and curves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanics_cases import column_robot, elastic, mirrored_box, pulled, side_cable, tensed

from softcal.mechanics import mirrored_factors
from softcal.mechanics.linear_solve import Factors
from softcal.mechanics.mirrored_factors import Halves
from softcal.mechanics.state import moved, rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import System
from softcal.mechanics.term import Controls
from softcal.project.project import load
from softcal.twin.build import Twin, build_twin
from softcal.twin.parameters import parameter_values
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

NECK = Path(__file__).parents[2] / "examples" / "neck" / "project.yaml"
IN_PLANE, BESIDE = (side_cable(name, at) for name, at in (("front", (0.0, 0.05)), ("side", (0.05, 0.0))))
PARAMETERS = {"neck.youngs_modulus": 1e6, "neck.poissons_ratio": 0.45}


def column(element: str = "P2P1") -> Robot:
    """A column whose mesh is its own mirror image in x, with a cable in that plane and one beside it."""
    mesh = mirrored_box((0.03, 0.03, 0.1), (1, 2, 5))
    return column_robot(element, mesh=mesh, parameters=elastic(1e6, 0.45), cables=(IN_PLANE, BESIDE))


def whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(System, "mirrors", ())


def statics_of(robot: Robot) -> tuple[Twin, Statics]:
    twin = build_twin(robot)
    return twin, Statics(twin.system, parameter_values(robot))


def taut(n: int, tension: float = 0.0) -> Controls:
    return Controls(np.ones(n, dtype=bool), np.array([tension] + [0.0] * (n - 1)), np.zeros(n))


class Watch:
    """Which factors were used."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.kinds: list[type[Factors]] = []
        own = mirrored_factors.MirroredPattern.factorise

        def factorise(pattern, *arguments):
            self.kinds.append(type(factors := own(pattern, *arguments)))
            return factors

        monkeypatch.setattr(mirrored_factors.MirroredPattern, "factorise", factorise)

    @property
    def share(self) -> float:
        """Of the tangents that were factorised in halves."""
        return float(np.mean([kind is Halves for kind in self.kinds]))


@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_solutions_by_halves_are_those_of_the_whole(element, monkeypatch):
    """At an even state, for an even force, an odd one, and one that is neither."""
    twin, statics = statics_of(column(element))
    (mirror,) = twin.system.mirrors
    forces = np.random.default_rng(2).standard_normal((len(mirror.partner), 1))
    image = mirror.sign[:, None] * forces[mirror.partner]
    solved = statics.equilibrium(rest_state(twin.system.layout), taut(2, 3.0))
    assert solved.converged
    at = twin.system.linearise(solved.state, taut(2, 3.0), statics.theta)
    b = np.concatenate([np.hstack([forces, forces + image, forces - image]), np.zeros((2, 3))])
    watch = Watch(monkeypatch)
    statics.factorise(at)
    found, n_unstable = statics.solve(b), statics.n_unstable()
    assert watch.share == 1.0
    whole(monkeypatch)
    other = Statics(build_twin(column(element)).system, statics.theta)
    other.factorise(at)
    assert watch.share == 0.5
    np.testing.assert_allclose(found, other.solve(b), rtol=0, atol=1e-9 * np.abs(found).max())
    assert n_unstable == other.n_unstable() == 0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["P1", "P2P1"]))
def test_forces_are_the_sum_of_their_halves(seed, element):
    (mirror,) = build_twin(column(element)).system.mirrors
    b = np.random.default_rng(seed).standard_normal((len(mirror.partner), 2))
    even, odd = (half.forces(half.reduced(b)) for half in (mirror.even, mirror.odd))
    np.testing.assert_allclose(even + odd, b, atol=1e-14)
    for part, parity in ((even, 1.0), (odd, -1.0)):
        np.testing.assert_allclose(mirror.sign[:, None] * part[mirror.partner], parity * part, atol=1e-14)
    np.testing.assert_allclose(mirror.even.reduced(odd), 0.0, atol=1e-14)


def test_a_small_odd_part_counts_where_it_is_asked_for():
    twin, statics = statics_of(column())
    (mirror,) = twin.system.mirrors
    statics.factorise(twin.system.linearise(rest_state(twin.system.layout), taut(2), statics.theta))
    b = np.random.default_rng(4).standard_normal((len(mirror.partner), 1))
    image = mirror.sign[:, None] * b[mirror.partner]
    small = np.concatenate([1e-5 * (b - image), np.zeros((2, 1))])
    both = small + np.concatenate([b + image, np.zeros((2, 1))])
    exact, rough = statics.solve(both), statics.solve(both, 1e-3)
    np.testing.assert_allclose(exact - rough, statics.solve(small), rtol=0, atol=1e-9 * np.abs(exact).max())
    assert np.abs(exact - rough).max() > 0.0


def test_a_loss_of_stability_to_the_side_is_one_of_the_odd_half(monkeypatch):
    """A slender column under the pull of a cable along its axis buckles out of the plane first, where it is thinner."""
    mesh = mirrored_box((0.01, 0.02, 0.1), (1, 2, 8))
    robot = column_robot("P2P1", mesh=mesh, parameters=elastic(1e6, 0.3), cables=(side_cable("front", (0.0, 0.0)),))
    twin, statics = statics_of(robot)
    euler = np.pi**2 * 1e6 * (0.02 * 0.01**3 / 12) / (0.5 * 0.1) ** 2  # the cable keeps to the axis: n = 1/2 and above
    counts: list[list[int]] = []
    for halves in (True, False):
        if not halves:
            whole(monkeypatch)
            twin, statics = statics_of(robot)
        own, state = list[int](), rest_state(twin.system.layout)
        for tension in np.linspace(0.05, 1.5, 8) * euler:
            solved = statics.equilibrium(state, taut(1, tension))
            assert solved.converged, solved.status
            state = solved.state
            statics.tangent_at(state, taut(1, tension))
            own.append(statics.n_unstable())
        counts.append(own)
    assert counts[0] == counts[1]
    assert counts[0][0] == 0
    assert max(counts[0]) >= 1


@pytest.mark.parametrize("protocol", [pulled(0.01, 0.02, 0.03), pulled(0.01, 0.02, cable="side"), tensed(1.0, 2.0)])
def test_curves_and_derivatives_are_those_of_the_whole(protocol, monkeypatch):
    """Also of a cable beside the plane, with which the robot leaves it."""
    watch = Watch(monkeypatch)
    halves = simulate(column(), protocol, sensitivities=tuple(PARAMETERS))
    assert (watch.share == 1.0) == ("side" not in protocol.commands)
    whole(monkeypatch)
    other = simulate(column(), protocol, sensitivities=tuple(PARAMETERS))
    assert halves.n_factorisations == other.n_factorisations
    units = halves.units
    for name, values in other.channels.items():
        scale = max(np.abs(other.channels[one]).max() for one, unit in units.items() if unit == units[name])
        np.testing.assert_allclose(halves.channels[name], values, rtol=0, atol=1e-8 * scale)
        for parameter, value in PARAMETERS.items():
            mine, theirs = (each.sensitivities[name][parameter] for each in (halves, other))
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-7 * (np.abs(theirs).max() + scale / value))


def test_grooves_close_in_halves(monkeypatch):
    """The shipped neck with contact is its own mirror image to 30 mm and beyond: no tangent needs the whole."""
    robot = load(NECK).robot
    watch = Watch(monkeypatch)
    halves = simulate(robot, pulled(0.01, 0.03))
    assert watch.share == 1.0
    assert len(watch.kinds) > 10
    whole(monkeypatch)
    other = simulate(robot, pulled(0.01, 0.03))
    np.testing.assert_allclose(halves.channels["front.tension"], other.channels["front.tension"], rtol=1e-7)


def test_what_does_not_mirror_itself_has_no_plane():
    mesh = mirrored_box((0.03, 0.03, 0.1), (1, 2, 5))
    points = mesh.points.copy()
    inner = np.flatnonzero((mesh.points[:, 2] > 0.01) & (mesh.points[:, 2] < 0.09))
    points[inner[3], 0] += 1e-6
    robot = column_robot("P1", mesh=replace(mesh, points=points), cables=(IN_PLANE,))
    assert build_twin(robot).system.mirrors == ()


def test_a_state_beside_the_plane_has_no_halves():
    twin, statics = statics_of(column("P1"))
    (mirror,) = twin.system.mirrors
    layout = twin.system.layout
    dz = np.zeros(layout.n_unknowns)
    dz[0] = 1e-6
    rest = rest_state(layout)
    for state, mirrors_itself in ((rest, True), (moved(layout, rest, dz), False)):
        data = twin.system.linearise(state, taut(2), statics.theta).data
        assert (mirror.split(data, None) is not None) == mirrors_itself
