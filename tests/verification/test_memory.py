"""Terms that remember: a loop's closed form, the protocol's order, exact derivatives through the history, in time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, side_cable, twin_and_theta
from slider_foundation import SliderFoundation

import softcal.twin.many
from softcal.errors import ParameterError, SimulationError
from softcal.mechanics.cable_routes import build_cables
from softcal.mechanics.damping import Damping
from softcal.mechanics.dynamics import Dynamics
from softcal.mechanics.layout import FIXED, FREE, Layout
from softcal.mechanics.march import Reached, Target, reach
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import System, build_system
from softcal.mechanics.term import Controls
from softcal.mechanics.time_step import at_rest
from softcal.twin.build import Twin
from softcal.twin.masses import robot_inertia
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import respond
from softcal.twin.start import loaded

# One point on a spring and a slider, pulled by a cable along x.

K, K_SLIDER, MOST, REACH = 400.0, 1000.0, 2.0, 0.2
BLOCK = {
    "spring.stiffness": K,
    "spring.yield_force": 1e9,
    "slider.stiffness": K_SLIDER,
    "slider.yield_force": MOST,
    "pull.friction_coefficient": 0.0,
}
YIELD = MOST / K_SLIDER


@dataclass(frozen=True)
class Alone(SliderFoundation):
    """With no body beside it: the equations are scaled by its own stiffness."""

    def measure(self, sizes, theta):
        sizes.shear_modulus, sizes.volume = theta[self.parameters[0]] / sizes.extent, sizes.extent**3


def block() -> System:
    X = np.array([[0.0, 0.0, 0.0], [-REACH, 0.0, 0.0]])
    layout = Layout(X, np.array([FREE, FIXED]), np.zeros((0, 3)), 0, 1)
    cable = build_cables(X, {"pull": [[(0, 1.0)], [(1, 1.0)]]}, np.array([True]))
    return build_system(layout, (*(Alone(np.array([0]), X, name) for name in ("spring", "slider")), cable))


def pulled(system: System, theta: dict[str, float], shortenings: np.ndarray) -> tuple[np.ndarray, list[Reached]]:
    """The tensions (n,) at the samples, in their order."""
    statics, one = Statics(system, theta), np.ones(1)
    last = Reached(rest_state(system.layout), Controls(one == 1.0, 0.0 * one, 0.0 * one), np.zeros((0, 0)))
    reached = []
    for d in shortenings:
        last = reach(statics, last, Target(Controls(one == 0.0, 0.0 * one, d * one)))
        reached.append(last)
    return np.array([one.state.effort[0] for one in reached]), reached


def test_a_cycle_dissipates_what_the_closed_form_says():
    """With samples at the corners, where it begins to slip: 2 f_y (D - 2 f_y / k) of a cycle of D."""
    low, high = 10e-3, 24e-3
    corners = np.array([YIELD, high, high - 2 * YIELD, low, low + 2 * YIELD, high])
    tensions, _ = pulled(block(), BLOCK, corners)
    slider = tensions - K * corners
    np.testing.assert_allclose(slider, MOST * np.array([1, 1, -1, -1, 1, 1]), rtol=0.0, atol=1e-8)
    area = np.trapezoid(tensions[1:], corners[1:])
    assert area == pytest.approx(2.0 * MOST * (high - low - 2.0 * YIELD), rel=1e-8)


def test_samples_in_another_order_are_another_way():
    """Through 10 mm from below the slider pulls back, from above it pushes on; what comes after does not matter."""
    shortenings = 1e-3 * np.array([4.0, 10.0, 20.0, 10.0])
    up_and_down, _ = pulled(block(), BLOCK, shortenings)
    down_first, _ = pulled(block(), BLOCK, shortenings[[2, 1, 3, 0]])
    assert up_and_down[1] - K * 10e-3 == pytest.approx(MOST)
    assert up_and_down[3] - K * 10e-3 == pytest.approx(-MOST)
    np.testing.assert_allclose(down_first[1:3] - K * 10e-3, -MOST)
    np.testing.assert_allclose(pulled(block(), BLOCK, shortenings[:2])[0], up_and_down[:2], rtol=1e-12)


# A column beside sliders.

SLIDERS = {"slider.stiffness": 2000.0, "slider.yield_force": 0.5}
FRONT = side_cable("front", (0.05, 0.0))
CYCLE = 1e-3 * np.array([2.0, 4.0, 7.0, 6.9, 5.0, 2.5, 4.0, 8.0])


def beside_sliders(*cables) -> tuple[Twin, dict[str, float]]:
    """Under gravity; the sliders hold some free points and some that ride on the plate."""
    robot = column_robot(
        "P1",
        parameters=elastic(5e5, 0.4),
        divisions=(1, 1, 3),
        gravity=(10.0, 0.0, -9.81),
        density=1e3,
        mass=0.15,
        cables=cables,
    )
    twin, theta = twin_and_theta(robot)
    layout = twin.system.layout
    side = np.flatnonzero(np.isclose(layout.X[:, 0], -0.015) & (layout.X[:, 2] > 0.0))
    sliders = SliderFoundation(side, layout.X)
    return replace(twin, system=build_system(layout, (*twin.system.terms, sliders))), {**theta, **SLIDERS}


ONE = Protocol({"front": Command("shortening", CYCLE)})
BY_TENSION = Protocol({"front": Command("tension", np.array([1.0, 2.5, 4.0, 3.0, 1.0, 0.0, 2.0]))})
SEVERAL = Protocol(
    {
        "front": Command("shortening", CYCLE),
        "left": Command("tension", np.array([0.5, 1.0, 1.5, 1.0, 0.0, 0.5, 0.8, 1.0])),
    }
)
WAYS = {"shortening": ONE, "tension": BY_TENSION, "several": SEVERAL}


@pytest.mark.parametrize("way", WAYS)
def test_derivatives_through_the_history_are_exact(way):
    """Of every channel at every sample, under weight, pulled and released: the error goes with the step's square."""
    protocol = WAYS[way]
    cables = (FRONT, side_cable("left", (0.0, 0.05))) if len(protocol.commands) > 1 else (FRONT,)
    twin, theta = beside_sliders(*cables)
    names = ("neck.youngs_modulus", "neck.density", *SLIDERS)
    found = respond(twin, theta, protocol, names)
    assert found.succeeded, found.status

    def changed(size: float) -> dict[str, float]:
        return {**theta, **{name: (1.0 + size * (-1) ** k) * theta[name] for k, name in enumerate(names)}}

    nearer = [respond(twin, changed(h), protocol) for h in (1e-3, 5e-4)]
    for channel, values in found.channels.items():
        rate = sum((-1) ** k * theta[name] * found.sensitivities[channel][name] for k, name in enumerate(names))
        left = [
            np.abs(one.channels[channel] - values - h * rate).max() for one, h in zip(nearer, (1e-3, 5e-4), strict=True)
        ]
        if (size := np.abs(rate).max()) > 1e-12:  # not a command
            assert left[0] < 3e-2 * 1e-3 * size, channel
            assert left[0] == pytest.approx(4.0 * left[1], rel=0.05), channel


def test_sliders_slip_both_ways_in_the_cycle():
    """Else the derivatives above would be those of springs."""
    twin, theta = beside_sliders(FRONT)
    statics = Statics(twin.system, theta)
    last = Reached(loaded(twin, statics).state, Controls(np.ones(1, bool), np.zeros(1), np.zeros(1)), np.zeros((0, 0)))
    assert np.abs(last.state.memory.values).max() > 1e-4  # under the weight alone
    slips = []
    for d in CYCLE:
        last = reach(statics, last, Target(Controls(np.zeros(1, bool), np.zeros(1), np.array([d]))))
        slips.append(last.state.memory.values.reshape(-1, 3)[:, 0])
    way = np.diff(slips, axis=0)
    assert (way.max(axis=0) > 1e-4).sum() >= 2
    assert ((way.max(axis=0) > 1e-4) & (way.min(axis=0) < -1e-4)).any()
    assert (way == 0.0).any()


@pytest.mark.parametrize(("step", "error"), [(1.0, 3e-4), (30.0, 3e-7)])
def test_slow_motion_is_the_quasi_static_way(step, error):
    """A time step is a sample; what remains of the mass goes with the square of the steps."""
    twin, theta = beside_sliders(FRONT)
    static = respond(twin, theta, ONE).channels["front.tension"]
    dynamics = Dynamics(twin.system, robot_inertia(twin, twin.robot), theta, Damping())
    now, tensions = at_rest(loaded(twin, Statics(twin.system, theta)).state), []

    def drive(time: float) -> Controls:
        return Controls(np.zeros(1, bool), np.zeros(1), CYCLE[[round(time / step) - 1]])

    for _ in CYCLE:
        now = dynamics.advance(now, step, drive)
        tensions.append(now.state.effort[0])
    assert np.abs(tensions - static).max() < error * static.max()


def test_one_linear_solve_a_step_slips_as_well():
    """Pulled and released in small, slow steps, as SOFA moves a robot."""
    twin, theta = beside_sliders(FRONT)
    shortenings = 1e-3 * np.concatenate([np.linspace(0.05, 7.0, 140), np.linspace(6.95, 4.0, 60)])
    static = respond(twin, theta, Protocol({"front": Command("shortening", shortenings)})).channels["front.tension"]
    dynamics = Dynamics(twin.system, robot_inertia(twin, twin.robot), theta, Damping(), "one-solve")
    now, tensions = at_rest(loaded(twin, Statics(twin.system, theta)).state), []
    for d in shortenings:
        controls = Controls(np.zeros(1, bool), np.zeros(1), np.array([d]))
        now = dynamics.advance(now, 10.0, lambda time, controls=controls: controls)
        tensions.append(now.state.effort[0])
    assert np.abs(tensions - static).max() < 0.03 * static.max()  # it falls with the step


def test_beyond_a_sample_that_was_not_reached_nothing_is_solved():
    """A sample is reached through those before it alone."""
    twin, theta = beside_sliders(FRONT)
    found = respond(twin, theta, Protocol({"front": Command("shortening", np.array([2e-3, 0.15, 2e-3]))}))
    assert not found.succeeded
    assert found.samples == (0,)
    assert "Sample 3 of 3 was not reached (front 2 mm): it comes after sample 2, whose memory is un" in found.status


def test_every_sample_is_reached_from_the_one_before_it(monkeypatch):
    """Not from rest again where that fails: this would forget the history."""
    begun = []

    def fails_late(statics, last, *others):
        begun.append(last)
        if len(begun) > 2:
            raise SimulationError("Enough.")
        return reach(statics, last, *others)

    monkeypatch.setattr(softcal.twin.many, "reach", fails_late)
    twin, theta = beside_sliders(FRONT)
    assert respond(twin, theta, ONE).samples == (0, 1)
    assert len({id(last) for last in begun}) == len(begun) == 3


def test_derivatives_by_commands_are_refused_where_they_would_lack_the_history():
    twin, theta = beside_sliders(FRONT)
    with pytest.raises(ParameterError, match="commands of all samples before") as told:
        respond(twin, theta, ONE, ["front.shortening"])
    assert "parameters of the robot" in str(told.value)
