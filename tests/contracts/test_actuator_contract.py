"""What an actuator must keep: its gradient is its coordinate's, and its effort and its coordinate give one state.

Beside the cables, a pressure chamber that no part of softcal knows: its coordinate is the volume that a closed set of
faces surrounds, its effort the pressure inside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, full_matrix, side_cable

from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quality import drop_unreferenced
from softcal.geometry.surface import boundary_faces
from softcal.mechanics.actuator import ActuatorLimits, ActuatorTerm
from softcal.mechanics.cable import CableTerm
from softcal.mechanics.damping import Damping
from softcal.mechanics.dynamics import Dynamics
from softcal.mechanics.march import Reached, Target, reach
from softcal.mechanics.node import Line, node_at
from softcal.mechanics.path import follow
from softcal.mechanics.state import State, moved, rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import System, build_system
from softcal.mechanics.term import Connectivity, Controls
from softcal.mechanics.time_step import at_rest
from softcal.twin.build import Twin, build_twin
from softcal.twin.masses import robot_inertia
from softcal.twin.parameters import parameter_values
from softcal.twin.robot import Body, Robot

EDGE = 0.04
PRESSURE = 4.0e4


@dataclass(frozen=True)
class ChamberTerm(ActuatorTerm):
    """V = sum over faces of s a . (b x c) / 6. faces: points (n, 3), ascending; sign (n,): whether that turned them."""

    faces: np.ndarray
    sign: np.ndarray
    rest: float
    most: float = np.inf
    places: tuple[np.ndarray, ...] = ()

    @property
    def actuators(self):
        return (ActuatorLimits("chamber", "volume", "pressure", most_effort=self.most),)

    def connectivity(self, layout):
        return Connectivity([self.faces])

    def plan(self, layout, pattern):
        pairs = ((0, 1), (0, 2), (1, 2))
        return replace(self, places=tuple(pattern.pair(self.faces[:, i], self.faces[:, j]) for i, j in pairs))

    def shape_coordinates(self, x):
        a, b, c = np.moveaxis(x[self.faces], 1, 0)
        return np.array([self.sign @ np.einsum("ni,ni->n", a, np.cross(b, c)) / 6.0])

    def shape_gradient(self, x, i, size):
        corners = np.moveaxis(x[self.faces], 1, 0)
        gradient = np.zeros(size)
        points = gradient[: x.size].reshape(-1, 3)
        for k in range(3):
            normal = np.cross(corners[k - 2], corners[k - 1])
            np.add.at(points, self.faces[:, k], self.sign[:, None] * normal / 6.0)
        return gradient

    def add_forces(self, given, effort, into, transmission):
        x = given.state.x
        into.full -= effort[0] * self.shape_gradient(x, 0, len(into.full))
        if into.data is None:
            return
        a, b, c = np.moveaxis(x[self.faces], 1, 0)
        for places, arm in zip(self.places, (-c, b, -a), strict=True):
            block = -effort[0] / 6.0 * self.sign[:, None, None] * np.cross(arm[:, None, :], np.eye(3)).swapaxes(1, 2)
            np.add.at(into.data, places[:, :, None] + np.arange(3), block)

    def coordinate_scales(self, extent):
        return np.array([self.rest])


def hollow() -> TetMesh:
    """A box with a cavity of half its edges in the middle."""
    mesh = box_mesh((EDGE,) * 3, (4, 4, 4), origin=(-EDGE / 2,) * 3)
    inside = (np.abs(mesh.points[mesh.tets].mean(axis=1)) < EDGE / 4).all(axis=1)
    return drop_unreferenced(TetMesh(mesh.points, mesh.tets[~inside], {"foot": mesh.node_sets["z0"]}))


def chamber(most: float = np.inf) -> Twin:
    """Of a robot without a cable, and so of a system without their term; most: limit of its pressure [Pa]."""
    mesh = hollow()
    body = Body("box", mesh, fixed=mesh.node_sets["foot"], parameters=elastic(1e6, 0.4), element="P1", density=1e3)
    twin = build_twin(Robot((body,)))
    outwards = boundary_faces(mesh)
    faces = outwards[(np.abs(mesh.points[outwards]) < 0.26 * EDGE).all(axis=(1, 2))]
    order = np.argsort(faces, axis=1)
    # Out of the body is into the cavity, whose own faces look the other way.
    sign = -np.linalg.det(np.eye(3)[order])
    term = ChamberTerm(np.take_along_axis(faces, order, axis=1), sign, (EDGE / 2) ** 3, most)
    others = [other for other in twin.system.terms if not isinstance(other, CableTerm)]
    return replace(twin, system=build_system(replace(twin.system.layout, n_actuators=1), (*others, term)))


def cables() -> Twin:
    sides = (side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05)))
    return build_twin(column_robot(cables=sides, density=1e3))


def both() -> Twin:
    """A cable across the hollow box and its chamber, numbered one after the other."""
    without = chamber()
    (term,), corner = without.system.of(ChamberTerm), EDGE / 2
    cable = side_cable("front", (corner, corner))
    via = (replace(cable.via_points[0], on="box", at=np.array([corner] * 3)), cable.via_points[-1])
    twin = build_twin(replace(without.robot, cables=(replace(cable, via_points=via),)))
    layout = replace(twin.system.layout, n_actuators=2)
    return replace(twin, system=build_system(layout, (*twin.system.terms, term)))


TWINS: dict[str, Callable[[], Twin]] = {"cables": cables, "chamber": chamber, "both": both}
every_case = pytest.mark.parametrize("case", TWINS)


def built(case: str) -> tuple[System, dict[str, float]]:
    twin = TWINS[case]()
    return twin.system, parameter_values(twin.robot)


EFFORT = {"tension": 0.4, "pressure": PRESSURE}


def efforts(system: System) -> np.ndarray:
    return np.array([EFFORT[actuator.effort] for actuator in system.actuators])


def coordinates(system: System, state: State) -> np.ndarray:
    return np.concatenate([term.shape_coordinates(state.x) for term in system.actuated])


def some_state(system: System) -> State:
    rng = np.random.default_rng(3)
    state = moved(system.layout, rest_state(system.layout), 1e-3 * rng.uniform(-1, 1, system.layout.n_unknowns))
    return replace(state, effort=efforts(system))


@every_case
def test_actuators_are_numbered_one_after_the_other_and_told_in_words(case):
    system, _ = built(case)
    assert [i for term in system.actuated for i in range(term.own.start, term.own.stop)] == [
        *range(len(system.actuators))
    ]
    assert len({actuator.name for actuator in system.actuators}) == system.layout.n_actuators
    for actuator in system.actuators:
        assert actuator.coordinate
        assert actuator.effort
        assert actuator.least_effort < actuator.most_effort


@every_case
def test_gradients_are_those_of_the_coordinates(case):
    system, theta = built(case)
    layout, state = system.layout, some_state(system)
    dz = np.random.default_rng(5).uniform(-1, 1, layout.n_unknowns)
    h = 1e-7
    ahead, behind = (coordinates(system, moved(layout, state, s * h * dz)) for s in (1, -1))
    for i, rate in enumerate((ahead - behind) / (2 * h)):
        drive = system.drive(state, i, theta)
        assert -drive.rows[:, 0] @ dz[: len(drive.rows)] == pytest.approx(rate, rel=1e-6)
        np.testing.assert_allclose(drive.columns, drive.rows, rtol=1e-12)
        assert not drive.corner.any()


@every_case
@pytest.mark.parametrize("is_held", [True, False])
def test_tangent_is_that_of_the_gradient(case, is_held):
    system, theta = built(case)
    layout, state = system.layout, some_state(system)
    n = layout.n_actuators
    controls = Controls(np.full(n, is_held), efforts(system), 1.01 * coordinates(system, state))
    K = full_matrix(system, system.linearise(state, controls, theta))
    rng = np.random.default_rng(7)
    dz = rng.uniform(-1, 1, layout.n_unknowns)
    dz[layout.first_effort_unknown :] *= 0.0 if is_held else efforts(system)
    h = 1e-6
    ahead, behind = (
        system.linearise(moved(layout, state, s * h * dz), controls, theta, tangent=False).reduced for s in (1, -1)
    )
    slope, found = (ahead - behind) / (2 * h), K @ dz
    parts = slice(layout.first_effort_unknown), slice(layout.first_effort_unknown, None)
    for part in parts:
        np.testing.assert_allclose(found[part], slope[part], atol=1e-5 * max(np.abs(slope[part]).max(), 1e-12))


@every_case
def test_driven_by_the_effort_or_by_the_coordinate_it_comes_to_one_state(case):
    system, theta = built(case)
    n, statics = system.layout.n_actuators, Statics(system, theta)
    rest, none = rest_state(system.layout), np.zeros(system.layout.n_actuators)
    line = Line(np.full(n, True), none, none, efforts(system), none)
    start = node_at(statics, line, 0.0, rest, ())
    by_effort = follow(statics, line, start, 1.0, first_step=0.5)
    assert by_effort.reached, by_effort.status
    found = by_effort.nodes[-1].state
    way = coordinates(system, found) - coordinates(system, rest)
    assert (np.abs(way) > 0.01 * np.abs(coordinates(system, found))).all()

    line = Line(np.full(n, False), none, coordinates(system, rest), none, way)
    by_coordinate = follow(statics, line, node_at(statics, line, 0.0, rest, ()), 1.0, first_step=0.5)
    assert by_coordinate.reached, by_coordinate.status
    again = by_coordinate.nodes[-1].state
    np.testing.assert_allclose(again.effort, efforts(system), rtol=1e-6)
    np.testing.assert_allclose(again.x, found.x, atol=1e-8 * EDGE)
    statics.release()


SHARES = np.array([0.3, 1.0, 0.5])


def marched(system: System, theta: dict[str, float], samples: np.ndarray, driven: bool) -> list[State]:
    """The equilibria at samples (n, n_actuators) of all coordinates (driven) or efforts, each from the one before."""
    statics, rest, none = Statics(system, theta), rest_state(system.layout), np.zeros(system.layout.n_actuators)
    last = Reached(rest, Controls(none == 0.0, none, coordinates(system, rest)), np.zeros((0, 0)))
    states: list[State] = []
    for wanted in samples:
        target = Controls(
            np.full(len(none), not driven), none if driven else wanted, wanted if driven else last.controls.coordinate
        )
        last = reach(statics, last, Target(target))
        states.append(last.state)
    statics.release()
    return states


def moved_slowly(twin: Twin, samples: np.ndarray, driven: bool, step: float = 1e3) -> list[State]:
    """The same in time: one step [s] for each sample, so long that mass does not matter."""
    theta = parameter_values(twin.robot)
    dynamics = Dynamics(twin.system, robot_inertia(twin, twin.robot), theta, Damping())
    is_held, none = np.full(samples.shape[1], not driven), np.zeros(samples.shape[1])

    def drive(time: float) -> Controls:
        wanted = samples[round(time / step) - 1]
        return Controls(is_held, none if driven else wanted, wanted if driven else none)

    now, states = at_rest(rest_state(twin.system.layout)), list[State]()
    for _ in samples:
        now = dynamics.advance(now, step, drive)
        states.append(now.state)
    dynamics.release()
    return states


@every_case
def test_samples_are_marched_through_and_moved_through(case):
    """By efforts, by the coordinates that these give, and both in time: the same states."""
    twin = TWINS[case]()
    system, theta = twin.system, parameter_values(twin.robot)
    pressed = SHARES[:, None] * efforts(system)
    states = marched(system, theta, pressed, driven=False)
    ways = np.array([coordinates(system, state) for state in states])
    assert (np.abs(np.diff(ways, axis=0)) > 0.0).all()
    others = [
        marched(system, theta, ways, driven=True),
        moved_slowly(twin, pressed, driven=False),
        moved_slowly(twin, ways, driven=True),
    ]
    for found in others:
        for one, other in zip(states, found, strict=True):
            np.testing.assert_allclose(other.effort, one.effort, rtol=1e-5)
            np.testing.assert_allclose(other.x, one.x, rtol=0.0, atol=1e-7 * EDGE)


@every_case
def test_one_linear_solve_drives_by_either(case):
    """A small part of the efforts, and of what they move, in one step."""
    twin = TWINS[case]()
    system, theta = twin.system, parameter_values(twin.robot)
    rest, small = rest_state(system.layout), 1e-4 * efforts(system)
    (state,) = marched(system, theta, small[None], driven=False)
    inertia = robot_inertia(twin, twin.robot)
    for controls in (
        Controls(np.full(len(small), True), small, coordinates(system, rest)),
        Controls(np.full(len(small), False), 0.0 * small, coordinates(system, state)),
    ):
        dynamics = Dynamics(system, inertia, theta, Damping(), "one-solve")
        found = dynamics.advance(at_rest(rest), 1e3, lambda time, controls=controls: controls).state
        np.testing.assert_allclose(found.effort, small, rtol=1e-3)
        np.testing.assert_allclose(found.x, state.x, rtol=0.0, atol=1e-3 * np.abs(state.x - rest.x).max())
        dynamics.release()


def test_an_effort_stays_within_its_limits():
    """A chamber whose pressure is limited is not blown up further, and comes back from there."""
    free, limited = chamber(), chamber(most=0.6 * PRESSURE)
    theta = parameter_values(free.robot)
    (end,) = marched(free.system, theta, np.array([[PRESSURE]]), driven=False)
    volumes = (EDGE / 2) ** 3 + SHARES[:, None] * (coordinates(free.system, end)[0] - (EDGE / 2) ** 3)
    without = marched(free.system, theta, volumes, driven=True)
    for found in (marched(limited.system, theta, volumes, driven=True), moved_slowly(limited, volumes, driven=True)):
        pressures = [state.effort[0] for state in found]
        assert pressures[1] == 0.6 * PRESSURE < without[1].effort[0]
        assert coordinates(limited.system, found[1])[0] < volumes[1, 0]
        np.testing.assert_allclose([pressures[0], pressures[2]], [without[k].effort[0] for k in (0, 2)], rtol=1e-6)


def test_a_chamber_swells_as_its_walls_give_way():
    """A small pressure does the work that the walls store: dV/dp = 2 U / p^2."""
    system, theta = built("chamber")
    statics, pressure = Statics(system, theta), 20.0
    rest = rest_state(system.layout)
    controls = Controls(np.array([True]), np.array([pressure]), np.zeros(1))
    found = statics.equilibrium(rest, controls)
    assert found.converged
    swollen = coordinates(system, found.state)[0] - coordinates(system, rest)[0]
    zero = replace(controls, effort=np.zeros(1))
    stored = sum(
        term.energy(given) - term.energy(begun)
        for term in system.terms
        if not isinstance(term, ActuatorTerm)
        for given in [_given(found.state, zero, theta)]
        for begun in [_given(rest, zero, theta)]
    )
    assert coordinates(system, rest)[0] == pytest.approx((EDGE / 2) ** 3)
    assert swollen > 0.0
    assert stored == pytest.approx(0.5 * pressure * swollen, rel=1e-3)
    statics.release()


def test_more_actuators_than_efforts_are_refused():
    system, _ = built("chamber")
    with pytest.raises(ValueError, match="1 actuators, and 0 efforts in the layout"):
        build_system(replace(system.layout, n_actuators=0), system.terms)


def _given(state, controls, theta):
    from softcal.mechanics.term import Given

    return Given(state, controls, theta)
