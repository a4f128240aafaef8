"""What every term of the potential must keep; one that has no case here fails, and a new one is one file."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest
from mechanics_cases import blown_box, column_robot, constants, elastic, full_matrix, side_cable, twin_and_theta
from slider_foundation import SliderFoundation

import softcal.mechanics
from softcal.checks import Floats, Ints
from softcal.geometry.centreline import straight
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.section import RectangularBar, RoundBar
from softcal.materials.catalogue import LAWS
from softcal.mechanics.cable import CableTerm
from softcal.mechanics.chamber import ChamberTerm
from softcal.mechanics.contact import ContactTerm
from softcal.mechanics.damping import Damping
from softcal.mechanics.drive import DriveTerm
from softcal.mechanics.layout import Layout
from softcal.mechanics.loads import Loads
from softcal.mechanics.moments import Moments
from softcal.mechanics.node import Line, node_at
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.rod import RodTerm
from softcal.mechanics.solid import SolidTerm
from softcal.mechanics.state import State, moved, rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import System, build_system
from softcal.mechanics.term import Connectivity, Controls, Given, Sum, Term
from softcal.mechanics.time_step import InertialTerm, after, at_rest, in_step
from softcal.mechanics.viscosity import ViscousTerm
from softcal.mechanics.wire_contact import WireContactTerm
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.drive import Drive
from softcal.twin.barrier import Contact
from softcal.twin.build import Twin
from softcal.twin.cables import CableLine, RoutingAxis
from softcal.twin.clamp import Clamp
from softcal.twin.masses import robot_inertia
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.robot import Body, Cable, Moment, Robot, Rod, ViaPoint

pytestmark = pytest.mark.usefixtures("small_balls")
STEP = 1e-4  # of the moves: central differences are right to its square


@dataclass(frozen=True)
class Foundation(Term):
    """An elastic bed under some points: k/2 |x - X|^2. A new term, and all that one takes."""

    points: Ints
    X: Floats
    diagonal: Ints | None = None

    parameters = ("bed.stiffness",)

    def connectivity(self, layout: Layout) -> Connectivity:
        return Connectivity([self.points[:, None]])

    def plan(self, layout: Layout, pattern: Pattern) -> Foundation:
        return replace(self, diagonal=pattern.blocks(self.points[:, None])[:, 0] + np.arange(3))

    def add(self, into: Sum, given: Given) -> None:
        into.points[self.points] += given.theta["bed.stiffness"] * self._way(given.state)
        if into.data is not None:
            np.add.at(into.data, self.diagonal, given.theta["bed.stiffness"])

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        if "bed.stiffness" in into:
            into["bed.stiffness"].points[self.points] += self._way(given.state)

    def energy(self, given: Given) -> float:
        return 0.5 * given.theta["bed.stiffness"] * float(np.square(self._way(given.state)).sum())

    def _way(self, state: State) -> Floats:
        return state.x[self.points] - self.X[self.points]


def bed(twin: Twin, kind: type[Foundation | SliderFoundation] = Foundation) -> Term:
    """Under a side of the column: free points, some that ride on its plate, and some that are fixed."""
    layout, pattern = twin.system.layout, twin.system.pattern
    return kind(np.flatnonzero(np.isclose(layout.X[:, 0], -0.015)), layout.X).plan(layout, pattern)


# Robots, and the terms in them.


def bent_column(element: str = "P1", law: str = "neo-hooke", friction: float = 0.0, **line: float) -> Robot:
    """With a plate on top and two cables: beside it, and through it with a routing offset."""
    via = (
        ([0.005, 0.002, 0.1], "plate"),
        ([0.006, 0.003, 0.06], "neck"),
        ([0.004, -0.003, 0.03], "neck"),
        ([0.005, 0.0, -0.02], ""),
    )
    axis = RoutingAxis((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    points = tuple(ViaPoint(np.array(at), on) for at, on in via)
    through = Cable("through", points, friction, routing_axis=axis, line=CableLine(**line))
    return column_robot(
        element,
        parameters=constants(LAWS[law], 1e5, 0.4),
        divisions=(1, 1, 3),
        law=law,
        gravity=(1.0, -2.0, -9.81),
        density=1100.0,
        mass=0.02,
        cables=(replace(side_cable("front", (0.05, 0.0)), friction_coefficient=friction), through),
    )


def driven_column() -> Robot:
    """Its two cables on a pulley."""
    drive = Drive({"front": 1.0, "through": -0.8}, 0.02, -3.0, 2e3, pretension=0.4, gear_backlash=0.3, zero=0.2)
    return replace(bent_column(**STRETCH), actuators=(NamedActuator("hand", drive),))


def clamped_column(element: str) -> Robot:
    """Its clamp deeper than drawn."""
    robot = bent_column(element)
    return replace(robot, bodies=(replace(robot.bodies[0], clamp=Clamp((0.0, 0.0, 1.0), 0.006)),))


def whip() -> Robot:
    """The column with a rod on its plate."""
    line = straight((0.0, 0.0, 0.1), (0.0, 0.05, 0.16), at=np.linspace(0.0, 1.0, 4))
    rod = Rod("whip", line, RectangularBar(0.004, 0.002), elastic(1e8), {"plate": np.array([0])}, density=1e4)
    return replace(bent_column(), rods=(rod,))


def lasting_whip() -> Robot:
    """The whip of a material that softens, relaxes and flows."""
    own = {"relaxing_share1": 0.3, "relaxation_time1": 1.5, "relaxing_share2": 0.1, "relaxation_time2": 20.0}
    own |= {"softening_amount": 1.8, "softening_energy": 2e5, "softening_range": 0.2}
    own |= {"flow_modulus": 2e7, "flow_threshold": 1e5, "flow_time": 2.0}
    (rod,) = whip().rods
    parameters = {**rod.parameters, **own}
    return replace(whip(), rods=(replace(rod, history=("softening", "relaxation-2", "flow"), parameters=parameters),))


def twisted_whip() -> Robot:
    """The whip with dead moments on its plate, on a node of it, and between two."""
    places = {"on_plate": ("plate", [0.0, 0.0, 0.1]), "at_node": ("whip", [0.0, 0.05, 0.16])}
    places["between"] = ("whip", [0.0, 0.02, 0.124])
    return replace(whip(), loads=tuple(Moment(name, on, [0.02, -0.03, 0.05], at) for name, (on, at) in places.items()))


def blocks(friction: float = 0.0) -> Robot:
    """One above the other."""
    side, gap = 0.02, 1e-3
    low, high = (box_mesh((side, side, side), (1, 1, 1)) for _ in range(2))
    high = TetMesh(high.points + [0.003, 0.002, side + 0.5 * gap], high.tets)
    below = Body("low", low, low.node_sets["z0"], elastic(), element="P1", density=1000.0)
    above = Body("high", high, [], elastic(), element="P1", density=1000.0)
    return Robot((below, above), contact=Contact(stiffness=1e5, friction_coefficient=friction, depth=gap))


def rough(layout: Layout, size: float = 1e-3, seed: int = 0) -> Floats:
    """Moves of all unknowns: points by some mm, frames turned by some degrees, pressures and tensions on."""
    dz = np.random.default_rng(seed).uniform(-1.0, 1.0, layout.n_unknowns)
    dz[: layout.first_pressure_unknown] *= size
    turns(layout, dz)[:] *= 100.0 * size / 1e-3
    dz[layout.first_pressure_unknown : layout.first_effort_unknown] *= 1e3
    return dz


def taut(layout: Layout, size: float = 1e-3, seed: int = 0) -> Floats:
    """As `rough`, with every cable under tension at the states, and further at the sample before."""
    dz = rough(layout, 1.8 * size if seed == 9 else size, seed)
    if seed in (0, 9):
        tensions = dz[layout.first_effort_unknown :]
        tensions[:] = 0.5 + np.abs(tensions)
    return dz


def pressed(layout: Layout, size: float = 1e-3, seed: int = 0) -> Floats:
    """The upper block moved down to half of the gap."""
    dz = rough(layout, 0.02 * size, seed)
    if seed == 0:
        high = layout.X[layout.free_points][:, 2] > 0.0203
        dz[: layout.first_frame_unknown].reshape(-1, 3)[high, 2] -= size
    return dz


def wires(friction: float = 0.0) -> Robot:
    """Two rods side by side, a little further apart than they push."""
    diameter, gap = 0.004, 1e-3
    both = [
        replace(
            rod,
            name=name,
            centreline=straight((x, 0.0, 0.0), (x, 0.0, 0.1), 3),
            section=RoundBar(diameter),
            clamped={},
            fixed=np.array([0]),
        )
        for (rod,) in [whip().rods]
        for name, x in (("left", 0.0), ("right", diameter + 1.5 * gap))
    ]
    return Robot(rods=tuple(both), contact=Contact(gap, 1e6, friction))


def squeezed(layout: Layout, size: float = 1e-3, seed: int = 0) -> Floats:
    """The right wire moved towards the left one by half of the gap and more."""
    dz = rough(layout, 0.02 * size, seed)
    if seed == 0:
        right = layout.references[: layout.n_moving_frames, 0] > 1e-3
        moves = dz[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)
        moves[right, 0] -= size
    return dz


def wound(layout: Layout, size: float = 1e-3, seed: int = 0) -> Floats:
    """As `taut`, with a torque within the backlash."""
    dz = taut(layout, size, seed)
    dz[layout.first_effort_unknown + 2] *= 1e-5
    return dz


def blown(layout: Layout, size: float = 1e-3, seed: int = 0) -> Floats:
    """As `rough`, with pressures of some 10 kPa."""
    dz = rough(layout, size, seed)
    dz[layout.first_effort_unknown :] *= 2e4
    return dz


def turns(layout: Layout, dz: Floats) -> Floats:
    """Those of the moving frames, a view (n, 3)."""
    return dz[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)[:, 3:]


Pick = Callable[[Twin, dict[str, float]], Term]


def first(kind: type[Term]) -> Pick:
    return lambda twin, theta: twin.system.of(kind)[0]


def in_motion(kind: type[Term], move: Callable[[Layout], Floats] = rough) -> Pick:
    """Within a time step from another state on."""

    def pick(twin: Twin, theta: dict[str, float]) -> Term:
        rest = rest_state(twin.system.layout)
        begun = after(at_rest(rest), moved(twin.system.layout, rest, 0.9 * move(twin.system.layout)), 0.02)
        damping = Damping(0.03, 2.0)
        return in_step(twin.system, robot_inertia(twin, twin.robot), damping, 0.01, begun, theta).of(kind)[0]

    return pick


@dataclass(frozen=True)
class Case:
    """A term as it stands in a robot's system, and the moves to a state where it acts."""

    kind: type[Term]
    robot: Callable[[], Robot]
    pick: Pick
    move: Callable[..., Floats] = rough
    has_energy: bool = True
    remembers: bool = False
    is_held: bool = True  # the first actuator, by its effort; all others are driven by their coordinates
    beside: tuple[type[Term], ...] = ()  # terms without which it is nothing, as a drive without its cables

    @cached_property
    def own(self) -> Alone:
        """The term alone."""
        return self.at({})

    def at(self, changes: Mapping[str, float]) -> Alone:
        """The term alone, with some parameters changed."""
        robot = self.robot()
        own = {name: value for name, value in changes.items() if name in robot_parameters(robot)}
        twin, theta = twin_and_theta(with_parameters(robot, own))
        theta = {**theta, **BEDS, **changes}
        layout, term = twin.system.layout, self.pick(twin, theta)
        n = layout.n_actuators
        controls = Controls(self.is_held & (np.arange(n) == 0), np.full(n, 0.7), np.full(n, 0.004), 0.8, elapsed=0.5)
        system = build_system(layout, (*(one for one in twin.system.terms if isinstance(one, self.beside)), term))
        state = moved(layout, rest_state(layout), self.move(layout))
        if system.remembers:  # as a sample elsewhere left it, at any parameters
            before = moved(layout, rest_state(layout), self.move(layout, seed=9))
            remembered = self.own.state if changes else system.advanced(before, controls, theta)
            state = replace(state, memory=remembered.memory)
        return Alone(twin, term, system, state, controls, theta)


@dataclass(frozen=True)
class Alone:
    twin: Twin
    term: Term
    system: System
    state: State
    controls: Controls
    theta: dict[str, float]

    def gradient(self, dz: Floats | float = 0.0) -> Floats:
        state = moved(self.system.layout, self.state, dz + np.zeros(self.system.layout.n_unknowns))
        return self.system.linearise(state, self.controls, self.theta, tangent=False).reduced

    def energy(self, dz: Floats) -> float:
        state = moved(self.system.layout, self.state, dz)
        given = self.system.given(state, self.controls, self.theta)
        return sum(term.energy(one) for term, one in zip(self.system.terms, given, strict=True))

    def remembering(self, change: Floats | float) -> Alone:
        """With another memory."""
        memory = self.state.memory
        return replace(self, state=replace(self.state, memory=replace(memory, values=memory.values + change)))

    def advanced(self, dz: Floats | float = 0.0) -> Floats:
        """The memory that the state, moved by dz, leaves."""
        state = moved(self.system.layout, self.state, dz + np.zeros(self.system.layout.n_unknowns))
        return self.system.advanced(state, self.controls, self.theta).memory.values


STRETCH = {"stiffness": 60.0, "compliance": 2e-4, "pretension": 0.4}
MEMORY = {"friction_memory": True, "presliding": 1.5e-3}
PUMPED = (first(ChamberTerm), blown, True, False, False)
REMEMBERS = (first(CableTerm), taut, False, True)
CASES = {
    "solid, P1": Case(SolidTerm, bent_column, first(SolidTerm)),
    "solid, P2P1": Case(SolidTerm, lambda: bent_column("P2P1"), first(SolidTerm)),
    "solid, Mooney-Rivlin": Case(SolidTerm, lambda: bent_column("P2", "mooney-rivlin"), first(SolidTerm)),
    "solid, P1, clamped deeper": Case(SolidTerm, lambda: clamped_column("P1"), first(SolidTerm)),
    "solid, P2P1, clamped deeper": Case(SolidTerm, lambda: clamped_column("P2P1"), first(SolidTerm)),
    "rod": Case(RodTerm, whip, first(RodTerm)),
    "rod with a history": Case(RodTerm, lasting_whip, first(RodTerm), remembers=True),
    "cables": Case(CableTerm, bent_column, first(CableTerm)),
    "cables with friction": Case(CableTerm, lambda: bent_column(friction=0.3), first(CableTerm), has_energy=False),
    "cables that stretch": Case(CableTerm, lambda: bent_column(**STRETCH), first(CableTerm)),
    "friction and stretch": Case(
        CableTerm, lambda: bent_column(friction=0.3, **STRETCH), first(CableTerm), taut, False
    ),
    "friction with a memory": Case(CableTerm, lambda: bent_column(friction=0.3, **MEMORY), *REMEMBERS),
    "memory and stretch": Case(CableTerm, lambda: bent_column(friction=0.3, **MEMORY, **STRETCH), *REMEMBERS),
    "memory, stretch and a preload": Case(
        CableTerm, lambda: bent_column(friction=0.3, friction_preload=0.5, **MEMORY, **STRETCH), *REMEMBERS
    ),
    "chamber": Case(ChamberTerm, lambda: blown_box("P1", is_open=False, medium="gas"), *PUMPED),
    "chamber, P2, open": Case(ChamberTerm, lambda: blown_box("P2", is_open=True, medium="gas"), *PUMPED),
    "chamber of a liquid, P2P1": Case(ChamberTerm, lambda: blown_box("P2P1", is_open=True, medium="liquid"), *PUMPED),
    "drive": Case(DriveTerm, driven_column, first(DriveTerm), wound, is_held=False, beside=(CableTerm,)),
    "drive with a prescribed tension": Case(DriveTerm, driven_column, first(DriveTerm), wound, beside=(CableTerm,)),
    "loads": Case(Loads, bent_column, first(Loads)),
    "moments": Case(Moments, twisted_whip, first(Moments), has_energy=False),
    "contact": Case(ContactTerm, blocks, first(ContactTerm), pressed),
    "contact with friction": Case(ContactTerm, lambda: blocks(0.5), in_motion(ContactTerm, pressed), pressed),
    "contact of wires": Case(WireContactTerm, wires, first(WireContactTerm), squeezed),
    "wires with friction": Case(WireContactTerm, lambda: wires(0.5), in_motion(WireContactTerm, squeezed), squeezed),
    "viscosity": Case(ViscousTerm, bent_column, in_motion(ViscousTerm)),
    "viscosity, P2P1": Case(ViscousTerm, lambda: bent_column("P2P1"), in_motion(ViscousTerm)),
    "viscosity, clamped deeper": Case(ViscousTerm, lambda: clamped_column("P1"), in_motion(ViscousTerm)),
    "inertia": Case(InertialTerm, whip, in_motion(InertialTerm)),
    "foundation": Case(Foundation, bent_column, lambda twin, theta: bed(twin)),
    "sliders": Case(SliderFoundation, bent_column, lambda twin, theta: bed(twin, SliderFoundation), remembers=True),
}
BEDS = {"bed.stiffness": 300.0, "slider.stiffness": 300.0, "slider.yield_force": 0.3}
WITHOUT_PARAMETERS = (ContactTerm, WireContactTerm, ViscousTerm, InertialTerm)


def kinds_of(base: type[Term]) -> set[type[Term]]:
    """Every class of terms that there can be one of."""
    own = {kind for kind in base.__subclasses__() if not inspect.isabstract(kind)}
    return own.union(*(kinds_of(kind) for kind in base.__subclasses__()))


every_case = pytest.mark.parametrize("name", CASES)


def test_every_term_has_a_case():
    for module in pkgutil.iter_modules(softcal.mechanics.__path__, "softcal.mechanics."):
        importlib.import_module(module.name)
    assert {kind for kind in kinds_of(Term) if kind.__module__.startswith("softcal.")} <= {
        case.kind for case in CASES.values()
    }


@every_case
def test_the_term_acts_at_its_state(name):
    alone = CASES[name].own
    assert isinstance(alone.term, CASES[name].kind)
    assert np.abs(alone.gradient()).max() > 0.0


def direction(case: Case, alone: Alone, seed: int) -> Floats:
    """Of all that is unknown: a held cable's tension is not."""
    d = case.move(alone.system.layout, seed=seed)
    d[alone.system.layout.first_effort_unknown :][alone.controls.is_held] = 0.0
    return d


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.has_energy])
def test_the_gradient_is_the_energys_derivative(name):
    case, alone = CASES[name], CASES[name].own
    gradient = alone.gradient()
    for seed in (1, 2, 3):
        d = direction(case, alone, seed)
        slope = (alone.energy(STEP * d) - alone.energy(-STEP * d)) / (2.0 * STEP)
        assert slope == pytest.approx(gradient @ d, abs=1e-6 * np.abs(gradient * d).sum())


def assert_close(layout: Layout, found: Floats, expected: Floats, rounding: float) -> None:
    """To a millionth of the largest of each unit: forces, moments, volumes and lengths."""
    n = [layout.first_frame_unknown, layout.first_pressure_unknown, layout.first_effort_unknown]
    for one, other in zip(np.split(found, n), np.split(expected, n), strict=True):
        atol = 1e-6 * np.abs(other).max(initial=0.0) + rounding
        np.testing.assert_allclose(one, other, rtol=0.0, atol=atol)


@every_case
def test_the_tangent_is_the_gradients_derivative(name):
    """Between two turns of a frame half the moment stands in the gradient's, and does no work; it is left out."""
    case, alone = CASES[name], CASES[name].own
    layout = alone.system.layout
    at = alone.system.linearise(alone.state, alone.controls, alone.theta)
    for seed in (1, 2, 3, 4):
        d = direction(case, alone, seed)
        if seed % 2:
            turns(layout, d)[:] = 0.0
        rate = (alone.gradient(STEP * d) - alone.gradient(-STEP * d)) / (2.0 * STEP)
        product = alone.system.tangent_times(at, d[:, None])[:, 0]
        assert d @ rate == pytest.approx(d @ product, abs=1e-6 * np.abs(d * product).sum() + 1e-12)
        if not seed % 2:
            turns(layout, rate)[:] = turns(layout, product)
        assert_close(layout, rate, product, 1e-14 * np.abs(at.reduced).max() / STEP)


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.kind not in WITHOUT_PARAMETERS])
def test_derivatives_by_parameters_are_those_of_differences(name):
    """Of everything that is built from them too, such as a cable's routing; at a state with the same moves."""
    case, alone = CASES[name], CASES[name].own
    names = alone.term.parameters
    at = alone.system.linearise(alone.state, alone.controls, alone.theta)
    exact = alone.system.gradient_by_parameters(
        alone.system.given(alone.state, at.controls, alone.theta), (*names, "no.parameter")
    )
    assert exact.any()
    assert not exact[:, -1].any()
    for k, parameter in enumerate(names):
        value = alone.theta.get(parameter, 0.0)  # of no cable without an axis is there an offset
        h = 1e-4 * value or 1e-6
        # To one side: friction is never negative.
        f = [alone.gradient(), *(case.at({parameter: value + i * h}).gradient() for i in (1, 2))]
        rate = (-3.0 * f[0] + 4.0 * f[1] - f[2]) / (2.0 * h)
        assert_close(alone.system.layout, exact[:, k], rate, 1e-14 * np.abs(f[0]).max() / h)


@every_case
def test_it_writes_where_it_said_it_would(name):
    """Alone, in a pattern of what it connects, or among the others: the tangent is the same."""
    alone, beside = CASES[name].own, CASES[name].beside
    others = (one for one in alone.twin.system.terms if isinstance(one, beside))
    among = replace(alone.twin.system, terms=(*others, alone.term))
    one, other = (system.linearise(alone.state, alone.controls, alone.theta) for system in (alone.system, among))
    K, K_among = full_matrix(alone.system, one), full_matrix(among, other)
    np.testing.assert_allclose(K, K_among, rtol=0.0, atol=1e-13 * np.abs(K_among).max())
    np.testing.assert_allclose(one.reduced, other.reduced, rtol=0.0, atol=1e-13 * np.abs(one.reduced).max())


REMEMBERING = [name for name, case in CASES.items() if case.remembers]
every_memory = pytest.mark.parametrize("name", REMEMBERING)


@every_memory
def test_what_a_sample_leaves_keeps_its_equilibrium(name):
    """Otherwise the robot would move between two samples with the same controls."""
    alone = CASES[name].own
    state = alone.system.advanced(alone.state, alone.controls, alone.theta)
    after = replace(alone, state=state, controls=replace(alone.controls, elapsed=0.0))
    assert np.abs(after.state.memory.values - alone.state.memory.values).max() > 0.0
    before = alone.gradient()
    np.testing.assert_allclose(after.gradient(), before, rtol=0.0, atol=1e-12 * np.abs(before).max())
    np.testing.assert_allclose(after.advanced(), after.state.memory.values, rtol=1e-12, atol=1e-12)


@every_memory
def test_derivatives_by_the_memory_are_those_of_differences(name):
    alone = CASES[name].own
    values = alone.state.memory.values
    rate = np.abs(values) * np.random.default_rng(5).uniform(-1.0, 1.0, len(values))
    sums = Sum(alone.system.layout)
    (given,) = alone.system.given(alone.state, alone.controls, alone.theta)
    alone.term.add_by_memory(sums, given, rate)
    into = replace(alone.state, memory=replace(alone.state.memory, by_parameter={"any": rate}))
    at = alone.system.linearise(into, alone.controls, alone.theta)
    exact = alone.system.gradient_by_parameters(alone.system.given(into, at.controls, alone.theta), ("any",))[:, 0]
    ends = [alone.remembering(s * STEP * rate).gradient() for s in (1, -1)]
    assert max(np.abs(sums.full).max(), np.abs(sums.own).max()) > 0.0
    assert_close(alone.system.layout, exact, (ends[0] - ends[1]) / (2.0 * STEP), 1e-12)


@every_memory
def test_the_memorys_derivatives_are_those_of_differences(name):
    """By each parameter, with rates of the state and of the old memory by it."""
    case, alone = CASES[name], CASES[name].own
    layout, rng = alone.system.layout, np.random.default_rng(6)
    old = alone.state.memory
    for k, parameter in enumerate((*alone.term.parameters, "no.parameter")):
        value = alone.theta.get(parameter, 1.0)
        size = value or 1e-2
        dz, rate = case.move(layout, seed=k + 1) / size, 1e-3 / size * rng.uniform(-1.0, 1.0, len(old.values))
        state = replace(alone.state, memory=replace(old, by_parameter={parameter: rate}))
        told = alone.system.advanced(state, alone.controls, alone.theta, dz[:, None], (parameter,))
        h = STEP * size
        ends = [case.at({parameter: value + s * h}).remembering(s * h * rate).advanced(s * h * dz) for s in (1, -1)]
        exact, expected = told.memory.by_parameter[parameter], (ends[0] - ends[1]) / (2.0 * h)
        np.testing.assert_allclose(exact, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


def test_a_term_that_connects_more_than_it_said_is_refused():
    @dataclass(frozen=True)
    class Rope(Foundation):
        def plan(self, layout, pattern):
            return replace(self, diagonal=pattern.blocks(self.points[None])[:, 0])

    twin, _ = twin_and_theta(bent_column())
    with pytest.raises(LookupError, match="connects"):
        build_system(twin.system.layout, (Rope(np.arange(8), twin.system.layout.X),))


@pytest.mark.parametrize("robot", [whip, lambda: bent_column("P2P1", friction=0.3)], ids=["whip", "column"])
def test_a_robots_equations_are_the_sum_of_its_terms(robot):
    twin, theta = twin_and_theta(robot())
    system, layout = twin.system, twin.system.layout
    state = moved(layout, rest_state(layout), rough(layout))
    controls = Controls(np.array([False, True]), np.full(2, 0.7), np.full(2, 0.004))
    names = tuple(theta)
    assert set(names) <= {name for term in system.terms for name in term.parameters}

    def parts(system: System) -> tuple[Floats, Floats, Floats]:
        at = system.linearise(state, controls, theta)
        return (
            at.reduced,
            full_matrix(system, at),
            system.gradient_by_parameters(system.given(state, at.controls, theta), names),
        )

    whole, each = parts(system), [parts(build_system(layout, (term,))) for term in system.terms]
    for k, found in enumerate(whole):
        total = sum(one[k] for one in each)
        np.testing.assert_allclose(found, total, rtol=0.0, atol=1e-13 * np.abs(total).max())


def test_a_new_term_is_solved_with_and_has_exact_sensitivities():
    """The column on its elastic bed: the sag of its plate by the bed's stiffness."""
    robot = bent_column()
    twin, theta = twin_and_theta(robot)
    system = build_system(twin.system.layout, (*twin.system.terms, bed(twin)))
    held = np.ones(2, dtype=bool)
    line = Line(held, np.array([0.3, 0.0]), np.zeros(2), np.array([1.0, 0.0]), np.zeros(2))

    def solved(k: float):
        statics = Statics(system, {**theta, "bed.stiffness": k})
        found = statics.equilibrium(rest_state(system.layout), line.at(0.0))
        assert found.converged, found.status
        return statics, found.state

    statics, state = solved(200.0)
    without = Statics(twin.system, theta).equilibrium(rest_state(system.layout), line.at(0.0)).state
    assert abs(state.position[0, 0]) < 0.9 * abs(without.position[0, 0])
    node = node_at(statics, line, 0.0, state, ("bed.stiffness",))
    exact = node.by_parameter[system.layout.first_frame_unknown :][:3, 0]
    ends = [solved(k)[1].position[0] for k in (200.2, 199.8)]
    np.testing.assert_allclose(exact, (ends[0] - ends[1]) / 0.4, rtol=0.0, atol=1e-5 * np.abs(exact).max())
