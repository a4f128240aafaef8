"""Motion in time: closed forms, conservation, the order of the scheme, and rest where statics says it is."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, held, potential, side_cable

from softcal.errors import SimulationError
from softcal.geometry.centreline import helix, straight
from softcal.geometry.primitives import box_mesh
from softcal.geometry.section import RectangularBar, RoundBar
from softcal.mechanics import dynamics as dynamics_module
from softcal.mechanics.damping import Damping
from softcal.mechanics.dynamics import Drive, Dynamics
from softcal.mechanics.inertia import Rates
from softcal.mechanics.state import moved, rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls
from softcal.mechanics.time_step import InertialTerm, Instant, after, at_rest, in_step
from softcal.twin.build import build_twin
from softcal.twin.in_time import simulate_in_time
from softcal.twin.masses import robot_inertia
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Marker, Plate, Robot, Rod, ViaPoint
from softcal.twin.schedule import Schedule, ramp
from softcal.twin.simulate import simulate
from softcal.twin.time_settings import Settling, TimeSettings

SCHEMES = ("converged", "one-solve")


def still(n_cables: int = 0) -> Drive:
    return lambda time: held(n_cables)


def dynamics_of(robot: Robot, damping: Damping, scheme: str = "converged") -> Dynamics:
    twin = build_twin(robot)
    theta = parameter_values(robot)
    return Dynamics(twin.system, robot_inertia(twin, robot), theta, damping, scheme)


def mass_on_a_bar() -> tuple[Robot, float, float]:
    """One element that stretches, 50 mm, a disc at its end; the disc's mass [kg] and the bar's stiffness [N/m]."""
    section, E, length, mass = RoundBar(0.002), 2e5, 0.05, 0.03
    bar = straight((0.0, 0.0, 0.0), (0.0, 0.0, length), at=1)
    rod = Rod("bar", bar, section, elastic(E), {"disc": np.array([1])}, fixed=np.array([0]))
    disc = Plate("disc", {}, np.array([0.0, 0.0, length]), mass=mass, inertia=1e-6 * np.eye(3))
    return Robot(plates=(disc,), rods=(rod,)), mass, E * section.constants.area / length


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_mass_on_a_bar_is_the_damped_oscillator_to_order_one(scheme):
    robot, mass, k = mass_on_a_bar()
    damping = Damping(0.02, 1.5)
    speed, end = 1e-4, 0.4
    decay, omega0 = 0.5 * (damping.mass + damping.stiffness * k / mass), np.sqrt(k / mass)
    omega = np.sqrt(omega0**2 - decay**2)
    exact = speed / omega * np.exp(-decay * end) * np.sin(omega * end)

    errors = []
    for n in (50, 100, 200):
        dynamics = dynamics_of(robot, damping, scheme)
        rest = rest_state(dynamics.system.layout)
        velocities = Rates(np.zeros_like(rest.x), np.zeros((2, 3)), np.zeros((2, 3, 3)))
        velocities.frames[0, 2] = speed
        now = Instant(0.0, rest, velocities)
        for _ in range(n):
            now = dynamics.advance(now, end / n, still())
        errors.append(now.state.position[0, 2] - 0.05 - exact)

    assert abs(errors[-1]) < 0.04 * speed / omega
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders[0] < orders[1]
    assert orders[1] == pytest.approx(1.0, abs=0.12)


def cantilever(n: int) -> tuple[Robot, float]:
    """A steel strip of n elements under a little gravity, and its first natural frequency [rad/s]."""
    length, section, E, density = 0.3, RectangularBar(0.01, 0.001), 2e11, 7800.0
    line = straight((0.0, 0.0, 0.0), (length, 0.0, 0.0), at=n, first=(0.0, 1.0, 0.0))
    rod = Rod("strip", line, section, elastic(E), fixed=np.array([0]), density=density)
    robot = Robot(rods=(rod,), gravity=np.array([0.0, 0.0, -0.01]))
    return robot, 1.8751040687119611**2 * np.sqrt(
        E * section.constants.I1 / (density * section.constants.area * length**4)
    )


def test_a_cantilever_swings_at_euler_and_bernoullis_first_frequency():
    robot, omega = cantilever(24)
    dynamics = dynamics_of(robot, Damping())
    now = at_rest(rest_state(dynamics.system.layout))
    steps_per_period, n_periods = 200, 4
    h = 2.0 * np.pi / omega / steps_per_period
    heights = []
    for _ in range(n_periods * steps_per_period):
        now = dynamics.advance(now, h, still())
        heights.append(now.state.x[-1, 2])
    z = np.array(heights) - np.mean(heights[-steps_per_period:])
    # crossings after two periods, when higher modes are gone
    crossing = np.flatnonzero(np.diff(np.sign(z)))
    crossing = crossing[crossing > 2 * steps_per_period]
    at = crossing + z[crossing] / (z[crossing] - z[crossing + 1])
    period = 2.0 * np.mean(np.diff(at)) * h
    assert 2.0 * np.pi / period == pytest.approx(omega, rel=1.5e-3)


def dumbbell() -> Robot:
    """Two unequal discs on a short stiff rod, held by nothing."""
    line = straight((0.0, 0.0, 0.0), (0.0, 0.0, 0.04), at=3)
    ends = {"a": np.array([0]), "b": np.array([3])}
    rod = Rod("rod", line, RoundBar(0.008), elastic(1e9), ends, density=1000.0)
    plates = (
        Plate("a", {}, np.zeros(3), mass=0.02, inertia=np.diag([4e-6, 6e-6, 9e-6])),
        Plate("b", {}, np.array([0.0, 0.0, 0.04]), mass=0.05, inertia=np.diag([2e-5, 3e-5, 4e-5])),
    )
    return Robot(plates=plates, rods=(rod,))


def spinning(dynamics: Dynamics, omega: np.ndarray, v: np.ndarray) -> Instant:
    rest = rest_state(dynamics.system.layout)
    turn = np.cross(omega, np.swapaxes(rest.rotation, 1, 2)).swapaxes(1, 2)
    rates = Rates(v + np.cross(omega, rest.x), v + np.cross(omega, rest.position), turn)
    return Instant(0.0, rest, rates)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_free_body_keeps_its_momentum(scheme):
    """Linear momentum exactly; angular momentum, with gyroscopic moments about no principal axis, to order one."""
    lost, turned = [], []
    for n in (100, 200, 400):
        dynamics = dynamics_of(dumbbell(), Damping(), scheme)
        now = spinning(dynamics, np.array([3.0, -2.0, 8.0]), np.array([0.2, -0.1, 0.3]))
        before = dynamics.inertia.momentum(now.state, now.velocities)
        for _ in range(n):
            now = dynamics.advance(now, 0.1 / n, still())
        later = dynamics.inertia.momentum(now.state, now.velocities)
        np.testing.assert_allclose(later.linear, before.linear, rtol=1e-7)
        lost.append(np.linalg.norm(later.angular - before.angular) / np.linalg.norm(before.angular))
        turned.append(np.linalg.norm(now.state.rotation[1] - np.eye(3)))
    assert min(turned) > 0.5
    assert lost[-1] < 0.02
    assert np.log2(lost[0] / lost[1]) > 0.9
    assert np.log2(lost[1] / lost[2]) > 0.9


@pytest.mark.parametrize(
    ("element", "damping"),
    [
        ("P1", Damping()),
        ("P2P1", Damping()),
        ("P1", Damping(0.02, 1.0)),
        ("P2P1", Damping(0.02, 1.0)),
        ("P1", Damping(0.02, 1.0, "tangent")),
    ],
)
def test_energy_never_grows_and_damping_takes_more(element, damping):
    robot = column_robot(element, cables=(), density=1100.0, mass=0.04, divisions=(1, 1, 3), gravity=(3.0, 0.0, -9.0))
    dynamics = dynamics_of(robot, damping)
    now = at_rest(rest_state(dynamics.system.layout))
    energies = []
    for _ in range(40):
        now = dynamics.advance(now, 0.005, still())
        kinetic = dynamics.inertia.momentum(now.state, now.velocities).kinetic_energy
        energies.append(kinetic + potential(dynamics.system, now.state, held(), dynamics.theta))
    first = potential(dynamics.system, rest_state(dynamics.system.layout), held(), dynamics.theta)
    drops = -np.diff([first, *energies])
    assert drops.min() > -1e-12 * abs(first)
    assert drops.sum() > 0.0


def beam(**changes: float) -> Robot:
    """SOFA's beam on a coarser mesh: a cable along it, half way to its edge."""
    mesh = box_mesh((0.1, 0.015, 0.015), (10, 2, 2), origin=(0.0, -0.0075, -0.0075))
    density = changes.get("density", 1000.0)
    body = Body("beam", mesh, fixed=mesh.node_sets["x0"], parameters=elastic(1e5, 0.45), element="P1", density=density)
    via = tuple(ViaPoint(np.array([x, 0.005, 0.0]), "beam") for x in np.linspace(0.1, 0.005, 12))
    tip = Marker("tip", "beam", np.array([0.1, 0.0, 0.0]))
    return Robot((body,), (), (Cable("tendon", (*via, ViaPoint(np.array([0.0, 0.005, 0.0])))),), markers=(tip,))


@pytest.mark.slow
@pytest.mark.parametrize("damping", ["strain", "tangent"])
def test_one_solve_and_converged_steps_agree_as_the_step_shrinks(damping):
    schedule = ramp({"tendon": ("tension", 0.05)}, 0.1)
    apart = []
    for h in (0.01, 0.005, 0.0025):
        y = [
            simulate_in_time(beam(), schedule, TimeSettings(h, 0.01, 0.1, scheme, damping)).channels["tip.y"][-1]
            for scheme in SCHEMES
        ]
        apart.append(abs(y[0] - y[1]) / abs(y[0]))
    assert apart[-1] < 1e-2
    assert np.log2(apart[0] / apart[1]) == pytest.approx(1.0, abs=0.4)
    assert np.log2(apart[1] / apart[2]) == pytest.approx(1.0, abs=0.4)


@pytest.mark.slow
def test_damping_of_strains_lets_a_beam_settle_beyond_its_own_buckling_load():
    """SOFA's does not (tension about twice the load at which the beam alone buckles): it gives energy there."""
    robot, target = beam(), {"tendon": ("tension", 0.4)}
    settings = TimeSettings(time_step=0.02, settle=Settling(speed=1e-6, longest=3.0))
    expected = simulate(robot, Protocol({"tendon": Command("tension", np.array([0.4]))}), curve_tolerance=0.0)
    settled = simulate_in_time(robot, ramp(target, 0.5), settings)
    assert settled.succeeded, settled.status
    assert settled.channels["tip.y"][-1] == pytest.approx(expected.channels["tip.y"][0], rel=1e-4)
    swings = simulate_in_time(robot, ramp(target, 0.5), replace(settings, damping="tangent"))
    assert not swings.succeeded
    assert np.ptp(swings.channels["tip.y"][-50:]) > 1e-3


def test_newtons_method_converges_quadratically_in_a_step():
    robot = beam()
    dynamics = dynamics_of(robot, Damping(0.2, 0.1))
    system, theta = dynamics.system, dynamics.theta
    step = in_step(system, dynamics.inertia, dynamics.damping, 0.05, at_rest(rest_state(system.layout)), theta)
    statics = Statics(step, theta)
    controls = held(1, 0.2)
    state = replace(rest_state(system.layout), effort=np.array([0.2]))
    residuals = []
    for _ in range(6):
        at = step.linearise(state, controls, theta)
        residuals.append(statics.norm(at))
        statics.factorise(at)
        state = moved(system.layout, state, -statics.solve(at.reduced))
    r = np.array(residuals)
    tail = np.flatnonzero((r < 1e-2) & (r > 1e-12))
    assert len(tail) >= 2
    for i in tail[:-1]:
        assert r[i + 1] < max(50.0 * r[i] ** 2, 1e-11)


def manipulator() -> Robot:
    """Two discs hung below a fixed one on helical springs as rods, with a cable to the second."""
    heights = (0.0, -0.1, -0.2)
    plates = tuple(
        Plate(f"S{i}", {}, np.array([0.0, 0.0, z]), mass=0.02 if i else 0.0, fixed=i == 0)
        for i, z in enumerate(heights)
    )
    rods = []
    for i in range(2):
        base = (0.0, 0.0, heights[i] - 0.004)
        line = helix(base, (0.0, 0.0, -1.0), diameter=0.03, pitch=0.046, turns=2, at=20, towards=(1.0, 0.0, 0.0))
        ends = {f"S{i}": np.array([0]), f"S{i + 1}": np.array([20])}
        rods.append(Rod(f"spring{i + 1}", line, RoundBar(0.008), elastic(8e8, 0.43), ends, density=900.0))
    via = [ViaPoint(np.array([0.025, 0.0, 0.05]))]
    via += [ViaPoint(np.array([0.025, 0.0, z]), f"S{i}") for i, z in enumerate(heights)]
    marker = Marker("m2", "S2", np.array([0.02, 0.0, -0.2]))
    return Robot(
        plates=plates,
        rods=tuple(rods),
        cables=(Cable("cable", tuple(via), pulled_end="first"),),
        gravity=np.array([0.0, 0.0, -9.81]),
        markers=(marker,),
    )


SETTLED = {
    "beam": (beam(), "tendon", "tension", 0.05),
    "beam by length": (beam(), "tendon", "shortening", 0.5e-3),
    "neck with a plate": (
        column_robot("P1", density=1200.0, mass=0.05, gravity=(0.0, 0.0, -9.81)), "front", "tension", 4.0,
    ),
    "manipulator": (manipulator(), "cable", "tension", 10.0),
}  # fmt: skip


@pytest.mark.parametrize("name", list(SETTLED))
def test_a_slow_ramp_settles_where_statics_says(name):
    robot, cable, control, value = SETTLED[name]
    settling = Settling(speed=1e-8, hold=0.2, longest=60.0)
    settings = TimeSettings(time_step=0.05, rayleigh_stiffness=0.05, settle=settling)
    response = simulate_in_time(robot, ramp({cable: (control, value)}, 0.5), settings)
    expected = simulate(robot, Protocol({cable: Command(control, np.array([value]))}), curve_tolerance=0.0)

    assert response.succeeded, response.status
    assert response.status.startswith("Settled after ")
    assert expected.succeeded, expected.status
    for channel, unit in expected.units.items():
        size = max(abs(expected.channels[k][0]) for k, u in expected.units.items() if u == unit)
        assert response.channels[channel][-1] == pytest.approx(expected.channels[channel][0], abs=1e-6 * size), channel


@pytest.mark.slow
def test_one_solve_settles_there_too():
    settings = TimeSettings(time_step=0.02, scheme="one-solve", settle=Settling(speed=1e-9, hold=0.2))
    for control, value in (("tension", 0.05), ("shortening", 0.4e-3)):
        response = simulate_in_time(beam(), ramp({"tendon": (control, value)}, 0.5), settings)
        expected = simulate(beam(), Protocol({"tendon": Command(control, np.array([value]))}), curve_tolerance=0.0)
        assert response.succeeded, response.status
        for channel in ("tip.x", "tip.y", "tendon.tension", "tendon.shortening"):
            assert response.channels[channel][-1] == pytest.approx(expected.channels[channel][0], rel=1e-6), channel


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_cable_paid_out_faster_than_the_robot_follows_is_slack(scheme):
    """Pulled in slowly, then let go at once: inertia and damping keep the beam bent, and no cable pushes it back."""
    times = np.array([0.0, 0.5, 0.501, 1.5])
    schedule = Schedule(times, {"tendon": Command("shortening", np.array([0.0, 1e-3, 0.0, 0.0]))})
    response = simulate_in_time(beam(), schedule, TimeSettings(0.01, 0.02, 0.1, scheme))
    assert response.succeeded, response.status
    tension, time = response.channels["tendon.tension"], response.channels["time"]
    assert tension.min() >= 0.0
    assert tension[np.searchsorted(time, 0.495)] > 0.05
    assert tension[np.searchsorted(time, 0.515)] == 0.0
    at = np.searchsorted(time, 0.515)
    assert response.channels["tendon.shortening"][at] == pytest.approx(schedule.at(time[at])["tendon"], abs=1e-15)
    assert abs(response.channels["tip.y"][at]) > 0.5e-3


def test_several_cables_of_given_length_are_taut_or_slack_in_every_step():
    sides = (side_cable("front", (0.05, 0.0)), side_cable("back", (-0.05, 0.0)), side_cable("left", (0.0, 0.05)))
    robot = column_robot("P1", density=1200.0, mass=0.02, cables=sides)
    targets = {"front": ("shortening", 0.006), "back": ("shortening", -0.008), "left": ("shortening", 0.002)}
    settings = TimeSettings(0.05, 0.05, settle=Settling(speed=1e-8))
    for scheme in SCHEMES:
        response = simulate_in_time(robot, ramp(targets, 0.5), replace(settings, scheme=scheme))
        commands = {name: Command(control, np.array([value])) for name, (control, value) in targets.items()}
        expected = simulate(robot, Protocol(commands))
        assert response.succeeded, response.status
        assert response.channels["back.tension"][-1] == 0.0
        for name in ("front.tension", "left.tension", "plate.pitch", "plate.roll"):
            assert response.channels[name][-1] == pytest.approx(expected.channels[name][0], rel=1e-5), name


def test_a_step_that_fails_is_taken_in_halves(monkeypatch):
    """Newton's method is made to fail on steps longer than 3 ms."""
    original = Statics.equilibrium

    def fails_on_long_steps(self, guess, controls):
        solved = original(self, guess, controls)
        (mass,) = self.system.of(InertialTerm)
        return solved if mass.step.length <= 0.003 else replace(solved, converged=False, status="it was too long")

    dynamics = dynamics_of(beam(), Damping(0.1, 0.1))
    start = at_rest(rest_state(dynamics.system.layout))
    tension = 0.03

    def drive(time: float) -> Controls:
        return held(1, tension * time / 0.01)

    monkeypatch.setattr(Statics, "equilibrium", fails_on_long_steps)
    end = dynamics.advance(start, 0.01, drive)
    assert dynamics.n_halvings == 3
    assert end.time == pytest.approx(0.01)
    monkeypatch.undo()
    fine = dynamics_of(beam(), Damping(0.1, 0.1))
    now = start
    for _ in range(4):
        now = fine.advance(now, 0.0025, drive)
    np.testing.assert_allclose(end.state.x, now.state.x, rtol=0, atol=1e-12)

    monkeypatch.setattr(Statics, "equilibrium", fails_on_long_steps)
    monkeypatch.setattr(dynamics_module, "MAX_HALVINGS", 1)
    with pytest.raises(
        SimulationError, match=r"No motion found from 0 s on: with a step of 0\.005 s, it was too long\."
    ):
        dynamics.advance(start, 0.01, drive)


def test_one_linear_solve_that_inverts_an_element_says_so():
    """SOFA goes on with NaN here."""
    schedule = Schedule(np.array([0.0, 0.5]), {"tendon": Command("tension", np.array([100.0, 300.0]))})
    response = simulate_in_time(beam(), schedule, TimeSettings(0.01, scheme="one-solve"))
    assert not response.succeeded
    assert "inverts an element" in response.status
    assert "converged steps" in response.status
    assert all(np.isfinite(values).all() for values in response.channels.values())


def test_velocities_are_differences():
    system = build_twin(beam()).system
    rest = rest_state(system.layout)
    later = moved(system.layout, rest, np.full(system.layout.n_unknowns, 1e-3))
    now = after(at_rest(rest, 1.0), later, 0.1)
    assert now.time == pytest.approx(1.1)
    np.testing.assert_allclose(now.velocities.points[system.layout.free_points], 1e-2)
