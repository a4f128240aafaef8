"""Grooves that close: nothing acts while they are open, cusps included, and contact begins when their walls meet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softcal.calibration.statistics.mesh_error import finer_twin
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.mechanics import bordered, linear_solve, touched_pattern
from softcal.mechanics.linearisation import Linearisation
from softcal.mechanics.node import Line, Node, node_at
from softcal.mechanics.state import State, difference, rest_state
from softcal.mechanics.statics import Equilibrium, Statics
from softcal.mechanics.term import Controls
from softcal.project.project import load
from softcal.twin import mesh_change
from softcal.twin.barrier import Contact
from softcal.twin.build import twin_of
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint
from softcal.twin.simulate import simulate

EXAMPLES = Path(__file__).parents[2] / "examples"
ELASTIC = {"youngs_modulus": 1e6, "poissons_ratio": 0.4}
HEIGHT, TIP, MOUTH = 0.03, -0.005, 0.01  # of the block, and where its groove begins and ends along x [m]
COARSE = (4, 1)  # divisions across the block, enough for what holds on any mesh


def grooved(
    width: float = 2e-3,
    power: float = 0.0,
    lean: float = 0.0,
    element: str = "P1",
    across: tuple[int, int] = (8, 2),
) -> Robot:
    """A block with a groove across, open to +x: `width` [m] at its mouth, and as x to a power on the way there.

    across: the divisions of the block along x and y.
    """
    mesh = box_mesh([0.02, 0.01, HEIGHT], [*across, 15], origin=[-0.01, -0.005, 0.0])
    centre = mesh.points[mesh.tets].mean(axis=1)
    tets = mesh.tets[~((np.abs(centre[:, 2] - 0.5 * HEIGHT) < 1e-3) & (centre[:, 0] > TIP))]
    used = np.unique(tets)
    points = mesh.points[used].copy()
    x, z = points[:, 0], points[:, 2] - 0.5 * HEIGHT
    along = np.clip((x - TIP) / (MOUTH - TIP), 0.0, 1.0)
    half = 0.5 * width * along**power if power else np.where(x > TIP - 1e-9, 0.5 * width, 1e-3)
    wall = np.abs(z) > 1e-4
    # The walls, at a millimetre in the box, move to half of the width, and all beyond with them.
    far = np.clip((np.abs(z) - 1e-3) / (0.5 * HEIGHT - 1e-3), 0.0, 1.0)
    opened = np.sign(z) * (np.where(x >= TIP, half, np.where(wall, 1e-3, 0.0)) * (1 - far) + far * 0.5 * HEIGHT)
    inside = x >= TIP - 1e-9
    points[:, 2] = np.where(wall & inside & (along > 0), opened, z) + 0.5 * HEIGHT
    points[:, 2] += lean * x * points[:, 2] / HEIGHT
    body = Body(
        "block", TetMesh(points, np.searchsorted(used, tets)), np.flatnonzero(z < -0.5 * HEIGHT + 1e-9), ELASTIC
    )
    top = Plate("top", {"block": np.flatnonzero(z > 0.5 * HEIGHT - 1e-9)}, np.array([0.0, 0.0, HEIGHT]))
    via = (ViaPoint(np.array([0.014, 0.0, HEIGHT]), "top"), ViaPoint(np.array([0.014, 0.0, 0.0])))
    return Robot((replace(body, element=element),), (top,), (Cable("front", via),))


def touching(robot: Robot) -> Robot:
    return replace(robot, contact=Contact())


def pulled(*shortening: float) -> Protocol:
    return Protocol({"front": Command("shortening", np.array(shortening))})


def force_at_rest(robot: Robot) -> float:
    """The largest force [N] that contact adds to the undeformed robot."""
    forces = list[np.ndarray]()
    for one in (robot, replace(robot, contact=None)):
        twin = twin_of(one)
        none = np.zeros(twin.system.layout.n_actuators)
        at = Controls(none == 0.0, none, none)
        forces.append(twin.system.linearise(rest_state(twin.system.layout), at, parameter_values(one)).full)
    return float(np.abs(forces[0] - forces[1][: len(forces[0])]).max())


@given(
    width=st.floats(2e-4, 3e-3),
    power=st.sampled_from([0.0, 1.0, 2.0]),
    lean=st.floats(-0.5, 0.5),
    element=st.sampled_from(["P1", "P2"]),
)
@settings(deadline=None, max_examples=12)
def test_nothing_acts_at_rest(width: float, power: float, lean: float, element: str):
    """Parallel walls, wedges, and cusps in which neighbouring walls are as close as one likes."""
    assert force_at_rest(touching(grooved(width, power, lean, element))) <= 1e-12


@pytest.mark.parametrize("example", ["neck", "neck-bench", "finger"])
def test_nothing_acts_at_rest_in_what_is_shipped(example: str):
    robot = load(EXAMPLES / example / "project.yaml").robot
    assert robot.bodies
    assert force_at_rest(touching(robot)) <= 1e-12


def test_the_pattern_has_room_for_what_touches_soon(monkeypatch: pytest.MonkeyPatch):
    """As a groove closes, its tangent is analysed less often than without room, with the same forces."""
    analysed, tensions = list[int](), list[np.ndarray]()
    for without in (False, True):
        count = list[int]()
        monkeypatch.setattr(touched_pattern, "factorisation", counted(count))
        if without:
            monkeypatch.setattr("softcal.mechanics.contact.ROOM", -1.0)
        response = simulate(touching(grooved(across=(8, 1))), pulled(*np.linspace(0.0, 5e-3, 6)))
        assert response.succeeded
        analysed.append(len(count))
        tensions.append(response.channels["front.tension"])
    assert analysed[0] <= 0.5 * analysed[1]
    np.testing.assert_allclose(*tensions, rtol=1e-8)


def counted(count: list[int]) -> Any:
    def factorisation(indptr: np.ndarray, indices: np.ndarray, *, single: bool) -> linear_solve.Factorisation:
        count.append(len(indices))
        return linear_solve.factorisation(indptr, indices, single=single)

    return factorisation


@pytest.mark.parametrize("element", ["P1", pytest.param("P2P1", marks=pytest.mark.slow)])
def test_contact_begins_where_the_walls_would_pass_through_each_other(element: str):
    robot = grooved(element=element)
    alone = simulate(robot, pulled(*np.linspace(0.0, 5e-3, 11)))
    begins = 1e-3 * float(alone.crossings.split("from ")[1].split(" ")[0])
    assert 5e-4 < begins < 4e-3
    protocol = pulled(begins - 3e-4, begins + 1e-3)
    free, pressed = (simulate(one, protocol).channels["front.tension"] for one in (robot, touching(robot)))
    assert pressed[0] == pytest.approx(free[0], rel=1e-3)
    assert pressed[1] > 1.1 * free[1]


@pytest.mark.slow
@pytest.mark.parametrize("element", ["P1", pytest.param("P2P1", marks=pytest.mark.long)])
def test_the_necks_force_does_not_depend_on_depth_and_stiffness(element: str):
    """Within 1 % up to its full pull; and before anything touches contact changes nothing."""
    (neck,) = load(EXAMPLES / "neck" / "project.yaml").robot.bodies
    robot = load(EXAMPLES / "neck" / "project.yaml").robot
    robot = replace(robot, bodies=(replace(neck, element=element),), contact=None)
    protocol = pulled(2e-4, 2e-3, 20e-3, 40e-3, 58e-3)
    free, usual = (simulate(one, protocol).channels["front.tension"] for one in (robot, touching(robot)))
    np.testing.assert_allclose(usual[:2], free[:2], rtol=1e-3)
    contact = touching(robot).contact
    assert contact is not None
    pressure = contact.pressure(robot.bodies).at(parameter_values(robot))
    other = replace(contact, stiffness=4.0 * pressure)
    changed = simulate(replace(robot, contact=other), protocol).channels["front.tension"]
    np.testing.assert_allclose(changed, usual, rtol=0.01)


@pytest.mark.long
@pytest.mark.parametrize("ratio", [0.4412, 0.415])
def test_points_that_slide_off_ridges_stop_no_path(ratio: float):
    """Across a ridge between two triangles the energy is concave: what leaves it is downhill beyond Newton's step. Cut
    there, these paths took some 240 and 330 factorisations.
    """
    robot = replace(load(EXAMPLES / "neck" / "project.yaml").robot, contact=Contact())
    commands = np.linspace(5e-3, 51e-3, 60)
    pulled = Protocol({"front": Command("shortening", commands)})
    response = simulate(robot, pulled, {"neck.poissons_ratio": ratio}, crossings=False)
    assert response.succeeded
    assert not response.instabilities
    assert response.n_factorisations < 150


def test_closing_and_opening_cost_no_energy():
    """The tension is the same on the way back."""
    d = np.linspace(0.0, 5e-3, 6)
    response = simulate(touching(grooved()), pulled(*d, *d[::-1]))
    assert response.succeeded, response.status
    tension = response.channels["front.tension"]
    np.testing.assert_allclose(tension[6:][::-1], tension[:6], rtol=1e-6, atol=1e-9)
    work = float(np.sum(tension * np.gradient(response.channels["front.shortening"])))
    assert abs(work) < 1e-6 * float(np.sum(tension)) * 1e-3


@pytest.mark.slow
def test_the_tension_is_in_proportion_to_the_modulus():
    """The default stiffness of contact follows it; a stiffness that is stated does not."""
    robot, protocol = touching(grooved(across=COARSE)), pulled(1e-3, 3e-3, 5e-3)
    E = ELASTIC["youngs_modulus"]
    tension = simulate(robot, protocol).channels["front.tension"]
    softer = simulate(robot, protocol, {"block.youngs_modulus": 0.1 * E}).channels["front.tension"]
    np.testing.assert_allclose(softer, 0.1 * tension, rtol=1e-7)
    stated = replace(robot, contact=Contact(stiffness=4.0 * E))
    np.testing.assert_allclose(simulate(stated, protocol).channels["front.tension"], tension, rtol=1e-7)
    softer = simulate(stated, protocol, {"block.youngs_modulus": 0.1 * E}).channels["front.tension"]
    assert softer[-1] > 0.1001 * tension[-1]


@pytest.mark.parametrize("constant", ["youngs_modulus", "poissons_ratio"])
def test_derivatives_through_closing_are_those_of_finite_differences(constant: str):
    robot, name, value = touching(grooved(element="P2P1", across=COARSE)), f"block.{constant}", ELASTIC[constant]
    protocol, h = pulled(1e-3, 3e-3), 2e-4 * value
    exact = simulate(robot, protocol, sensitivities=(name,), curve_tolerance=0.0)
    ahead, behind = (simulate(robot, protocol, {name: value + s * h}, curve_tolerance=0.0) for s in (1, -1))
    for channel in ("front.tension", "top.pitch"):
        difference = (ahead.channels[channel] - behind.channels[channel]) / (2 * h)
        rounding = 1e-9 * abs(ahead.channels[channel]).max() / value
        np.testing.assert_allclose(exact.sensitivities[channel][name], difference, rtol=1e-4, atol=rounding)


def test_derivatives_where_ridges_count_as_flat_are_exact(monkeypatch: pytest.MonkeyPatch):
    """At equilibria that are stable only with the ridges flat, of tension and shape."""
    robot, name, h = touching(grooved()), "block.poissons_ratio", 1e-6
    tangent_at, on_ridges = Statics.tangent_at, list[tuple[State, Controls]]()

    def watched(statics: Statics, state: State, controls: Controls) -> Linearisation:
        at = tangent_at(statics, state, controls)
        if at.is_convex and statics.n_unstable() == 0:
            on_ridges.append((state, controls))
        return at

    monkeypatch.setattr(Statics, "tangent_at", watched)
    assert simulate(robot, pulled(1e-3, 3e-3)).succeeded
    (state, controls), *_ = on_ridges
    system, theta = twin_of(robot).system, parameter_values(robot)

    def solver(ratio: float = 0.4) -> Statics:
        return Statics(system, {**theta, name: ratio})

    line = Line(controls.is_held, controls.effort, controls.coordinate, np.zeros(1), np.ones(1))
    node = node_at(solver(), line, 0.0, state, (name,))
    assert node.is_stable
    ahead, behind = (solver(0.4 + sign * h).equilibrium(state, controls) for sign in (1, -1))
    assert ahead.converged
    assert behind.converged
    numerical = difference(system.layout, ahead.state, behind.state) / (2 * h)
    np.testing.assert_allclose(node.by_parameter[:, 0], numerical, rtol=1e-4, atol=1e-5 * np.abs(numerical).max())
    further, nearer = (solver().equilibrium(state, line.at(sign * h)) for sign in (1e-3, -1e-3))
    numerical = difference(system.layout, further.state, nearer.state) / (2e-3 * h)
    np.testing.assert_allclose(node.slope, numerical, rtol=1e-4, atol=1e-5 * np.abs(numerical).max())


def test_kept_factors_serve_while_surfaces_touch(monkeypatch: pytest.MonkeyPatch):
    """The same equilibria, by fewer factorisations."""
    robot, protocol = touching(grooved(width=5e-4)), pulled(6e-4, 9e-4)
    fresh = simulate(robot, protocol, curve_tolerance=0.0)
    monkeypatch.setattr(bordered, "LARGE", 0)
    monkeypatch.setattr(linear_solve, "SOLVES", 1.0)  # a factorisation costs as much as in a large robot
    kept = simulate(touching(grooved(width=5e-4)), protocol, curve_tolerance=0.0)
    assert kept.n_factorisations < 0.6 * fresh.n_factorisations
    np.testing.assert_allclose(kept.channels["front.tension"], fresh.channels["front.tension"], rtol=1e-7)


@pytest.mark.slow
def test_equilibria_on_a_finer_mesh_are_those_of_newtons_method_with_the_exact_tangent(monkeypatch: pytest.MonkeyPatch):
    """From those of the coarse mesh, in which surfaces of the finer one overlap, within 0.2 % of the change."""
    robot = touching(grooved(width=5e-4, across=(8, 1)))
    equilibrium, errors, changes = Statics.equilibrium, list[float](), list[float]()

    def both(statics: Statics, guess: State, *args: Any, **how: Any) -> Equilibrium:
        solved = equilibrium(statics, guess, *args, **how)
        if how:
            exact = equilibrium(Statics(statics.system, statics.theta), solved.state, args[0])
            assert exact.converged
            errors.append(float(np.abs(solved.state.effort - exact.state.effort).max()))
            changes.append(float(np.abs(guess.effort - exact.state.effort).max()))
        return solved

    monkeypatch.setattr(Statics, "equilibrium", both)
    finer_twin(robot)(robot, pulled(*np.linspace(2e-4, 2e-3, 5)))
    assert len(errors) >= 2
    assert max(errors) < 2e-3 * max(changes)


@pytest.mark.slow
@pytest.mark.parametrize(("tolerance", "least", "most"), [(0.03, 2, 4), (0.01, 5, 8)])
def test_a_rough_change_gets_more_places_where_it_is_worst(
    tolerance: float, least: int, most: int, monkeypatch: pytest.MonkeyPatch
):
    """Within the tolerance of the load path on the finer mesh, whose stability is judged at its end alone."""
    robot, protocol = touching(grooved(width=3e-4, across=COARSE)), pulled(*np.linspace(2e-4, 8e-4, 25))
    finer, judged, places = finer_twin(robot), list[bool](), list[float]()
    on_finer = mesh_change._on_finer

    def watched(twin: Any, c: float, *args: Any, **how: Any) -> Node | None:
        judged.append(how["judged"])
        places.append(c)
        return on_finer(twin, c, *args, **how)

    with monkeypatch.context() as patched:
        patched.setattr(mesh_change, "CHANGE_TOLERANCE", tolerance)
        patched.setattr(mesh_change, "ROUGH_CURVE", 0.0)
        patched.setattr(mesh_change, "_on_finer", watched)
        patched.setattr(mesh_change, "simulate", None)
        changed = finer(robot, protocol).channels["front.tension"]
    assert least <= len(judged) <= most
    assert judged == [True, *(len(judged) - 1) * [False]]
    if len(places) > len(mesh_change.PLACES):
        before, after = places[4:6]
        assert after - before == pytest.approx(0.5 * (places[0] - places[1]))
        assert any(place == pytest.approx(0.5 * (before + after)) for place in places[1:4])
    here, there = (simulate(r, protocol).channels["front.tension"] for r in (robot, finer.robot))
    largest = np.abs(there - here).max()
    assert np.abs(changed - there).max() < 4 * tolerance * largest + 1e-4 * there.max()
