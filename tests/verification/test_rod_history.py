"""Rods whose material relaxes, softens and flows: closed forms of sections and robots, energy, exact derivatives."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rod_cases import compliances, on_own_frames
from scipy.special import erf

from softcal.checks import Floats
from softcal.errors import InputError
from softcal.geometry.centreline import straight
from softcal.geometry.section import CrossSection, RectangularBar, RoundBar
from softcal.geometry.varied_section import VariedSection
from softcal.materials.histories import history_of
from softcal.mechanics.damping import Damping
from softcal.mechanics.dynamics import Dynamics
from softcal.mechanics.rod import RodTerm
from softcal.mechanics.state import State
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls, Given
from softcal.mechanics.time_step import at_rest
from softcal.twin.build import build_twin
from softcal.twin.masses import robot_inertia
from softcal.twin.material import Material
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Cable, Marker, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate
from softcal.twin.start import loaded

E, NU, LONG = 2e6, 0.4, 0.1
BAR = RoundBar(0.008)
OF = BAR.constants
CONSTANTS = {
    "relaxing_share1": 0.3, "relaxation_time1": 0.5, "relaxing_share2": 0.2, "relaxation_time2": 8.0,
    "softening_amount": 2.0, "softening_energy": 400.0, "softening_range": 0.1,
    "flow_modulus": 3e5, "flow_threshold": 1e4, "flow_time": 0.0,
}  # fmt: skip
BETA, TAU = np.array([0.3, 0.2]) / 0.5, np.array([0.5, 8.0])


def constants(history: tuple[str, ...], **changes: float) -> dict[str, float]:
    """Those of a rod with this history."""
    known = {**CONSTANTS, **changes}
    names = [one.name for one in history_of(history).parameters]
    return {"youngs_modulus": E, "poissons_ratio": NU, **{name: known[name] for name in names}}


class Element:
    """One straight element of a rod, its strains given at sample after sample."""

    def __init__(self, history: tuple[str, ...], section: CrossSection = BAR, **changes: float) -> None:
        rod, _ = on_own_frames(section, straight((0.0, 0.0, 0.0), (0.0, 0.0, LONG), at=np.array([0.0, 1.0])))
        self.term: RodTerm = replace(rod, history=history_of(history))
        self.theta = {f"rod.{name}": value for name, value in constants(history, **changes).items()}
        self.memory = self.term.first_memory()

    def to(self, strain: Floats, elapsed: float) -> Floats:
        """Forces and moments (6,) at strains over the element (6,), from which the next sample goes on."""
        none = np.zeros(0)
        state = State(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)), none, none)
        controls = Controls(none == 0.0, none, none, elapsed=elapsed)
        known = (self.term.xi_rest + strain, np.zeros(1))
        at = Given(state, controls, self.theta, known, self.memory)
        forces, _ = self.term._response(at, tangent=False)
        self.memory = self.term.advance(at)
        return forces[0]


def bent(kappa: float) -> Floats:
    return LONG * kappa * np.eye(6)[4]


def moments(element: Element, kappa: Floats, times: Floats) -> Floats:
    """Along curvatures [1/m]; at rest for long before the first time."""
    steps = np.diff(times, prepend=times[0] - 1.0)
    return np.array([element.to(bent(k), dt)[4] for k, dt in zip(kappa, steps, strict=True)])


# A section.


@pytest.mark.slow
@pytest.mark.parametrize("omega", [0.02, 0.6, 20.0])
def test_storage_and_loss_modulus_of_bending(omega: float) -> None:
    """Over three decades, at the end of an oscillation: those of the generalised Maxwell model, times E I."""
    n, periods = 200, max(3, int(np.ceil(min(60.0 * omega, 200.0) / (2.0 * np.pi))))
    t = np.linspace(0.0, periods * 2.0 * np.pi / omega, periods * n + 1)
    found = moments(Element(("relaxation-2",)), 3.0 * np.sin(omega * t), t)[-n:] / (3.0 * E * OF.I2)
    last, w = omega * t[-n:], omega * TAU
    storage, loss = 2.0 * np.mean(found * np.sin(last)), 2.0 * np.mean(found * np.cos(last))
    assert storage == pytest.approx(1.0 + float((BETA * w**2 / (1.0 + w**2)).sum()), rel=1e-4)
    assert loss == pytest.approx(float((BETA * w / (1.0 + w**2)).sum()), rel=2e-3)


@pytest.mark.parametrize("section", [BAR, RectangularBar(0.012, 0.003)], ids=["round", "flat"])
def test_a_loop_in_pure_bending_is_the_closed_form(section: CrossSection) -> None:
    """E I kappa, and beside it an elastic and then plastic branch: both branches of the loop, and its area."""
    of = section.constants
    k, most = 3.0 * CONSTANTS["flow_modulus"] * of.I2, CONSTANTS["flow_threshold"] * np.sqrt(of.I2 * of.area)
    first = most / k
    way = np.concatenate([np.linspace(0.0, 8.0, 33), np.linspace(8.0, -8.0, 65)[1:], np.linspace(-8.0, 8.0, 65)[1:]])
    # With samples where it begins to slip, so that the area by the trapezoidal rule is exact.
    way *= first
    found = moments(Element(("flow-at-once",), section), way, np.zeros_like(way)) - E * of.I2 * way
    loading = np.minimum(k * way[:33], most)
    letting_go = np.maximum(most - k * (8.0 * first - way[33:97]), -most)
    again = np.minimum(k * (way[97:] + 8.0 * first) - most, most)
    np.testing.assert_allclose(found, np.concatenate([loading, letting_go, again]), rtol=0.0, atol=1e-9 * most)
    area = np.trapezoid(found[32:], way[32:])
    assert area == pytest.approx(2.0 * most * (16.0 * first - 2.0 * first), rel=1e-9)


def test_the_threshold_is_round_in_the_plane_of_bending() -> None:
    """Of a round bar whose curvature turns once: the branch's moment keeps its size and lags behind its direction."""
    element, most = Element(("flow-at-once",)), CONSTANTS["flow_threshold"] * np.sqrt(OF.I1 * OF.area)
    found = []
    for angle in np.linspace(0.0, 4.0 * np.pi, 721):
        strain = LONG * 20.0 * np.array([0.0, 0.0, 0.0, np.cos(angle), np.sin(angle), 0.0])
        found.append((element.to(strain, 0.0) - E * OF.I1 * strain / LONG)[3:5])
    sizes = np.linalg.norm(found[360:], axis=1)
    np.testing.assert_allclose(sizes, most, rtol=1e-9)
    # Steadily what slips is at right angles to E_p, and so most / (k kappa) the cosine of its angle to the radius; the
    # samples lag by half a step.
    ahead = np.arccos(most / (3.0 * CONSTANTS["flow_modulus"] * OF.I1) / 20.0) - 0.5 * np.radians(1.0)
    assert np.arctan2(found[-1][1], found[-1][0]) == pytest.approx(ahead, rel=1e-4)


def test_a_softened_section_is_that_of_ogden_and_roxburgh() -> None:
    kappa = np.concatenate([np.linspace(0.0, 18.0, 20), np.linspace(18.0, 0.0, 20), np.linspace(0.0, 24.0, 20)])
    found = moments(Element(("softening",)), kappa, np.arange(60.0))
    W = 0.5 * E * OF.I2 * kappa**2 / OF.area
    most = np.maximum.accumulate(W)
    eta = 1.0 - erf((most - W) / (400.0 + 0.1 * most)) / 2.0
    np.testing.assert_allclose(found, eta * E * OF.I2 * kappa, rtol=1e-9, atol=1e-12)
    assert eta.min() < 0.6


strains = st.lists(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), min_size=2, max_size=6)


@settings(max_examples=60, deadline=None)
@given(strains)
def test_what_a_closed_way_takes_is_stored_or_lost_by_slip(corners: list[list[float]]) -> None:
    """Any way through stretch, shear, bending and twist and back. The branch is a spring of the section's stiffness and
    a slip: energy in is what both springs store and the forces at work on the slip, which is never negative.
    """
    element = Element(("flow-at-once",))
    elastic, branch = (1.0 / compliances(BAR, *of) / LONG for of in ((E, NU), (3.0 * CONSTANTS["flow_modulus"], 0.5)))
    elastic[:2], branch[:2] = (1.0 / (LONG / k + LONG**3 / 12.0 / m) for k, m in _shear_and_bending())
    size = LONG * np.array([0.02, 0.02, 0.01, 8.0, 8.0, 8.0])
    turns = [np.zeros(6), *(size * np.array(corner) for corner in corners), np.zeros(6)]
    last, force, slip, held = np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6)
    work = lost = stored = 0.0
    for begin, end in pairwise(turns):
        for share in (0.4, 1.0):
            strain = begin + share * (end - begin)
            total = element.to(strain, 0.0)
            now, of_branch = element.memory[:6].copy(), total - elastic * strain
            work += float(0.5 * (total + force) @ (strain - last))
            lost += float(0.5 * (of_branch + held) @ (now - slip))
            assert of_branch @ (now - slip) >= -1e-12
            stored = float(0.5 * strain @ (elastic * strain) + 0.5 * of_branch @ (of_branch / branch))
            assert work == pytest.approx(stored + lost, rel=1e-9, abs=1e-12)
            last, force, slip, held = strain, total, now, of_branch
    assert work >= stored - 1e-12


def _shear_and_bending():
    for of in ((E, NU), (3.0 * CONSTANTS["flow_modulus"], 0.5)):
        rigidities = 1.0 / compliances(BAR, *of)
        yield rigidities[:2], rigidities[[4, 3]]


# Robots.


def arm(history: tuple[str, ...], *, varied: bool = False, **changes: float) -> Robot:
    """A rod that stands, pulled sideways at its tip by a cable; varied: tapered, and of two materials."""
    at = np.linspace(0.0, 1.0, 7)
    section = VariedSection((0.0, 1.0), (RoundBar(0.009), RoundBar(0.006))) if varied else BAR
    parts = (Material("foot", np.array([0, 1]), {"youngs_modulus": 0.7 * E}),) if varied else ()
    rod = Rod(
        "arm",
        straight((0.0, 0.0, 0.0), (0.0, 0.0, LONG), at=at),
        section,
        constants(history, **changes),
        fixed=np.array([0]),
        density=1000.0 if varied else 0.0,
        inclusions=parts,
        history=history,
    )
    via = (ViaPoint([0.0, 0.0, LONG], "arm"), ViaPoint([0.5, 0.0, LONG]))
    gravity = (0.0, 60.0, -9.81) if varied else (0.0, 0.0, 0.0)
    return Robot(
        rods=(rod,), cables=(Cable("side", via),), markers=(Marker("tip", "arm", [0.0, 0.0, LONG]),), gravity=gravity
    )


def test_a_cantilever_that_is_held_relaxes_as_the_series_says() -> None:
    """From 3 E I / L^3, with the section's shear, on."""
    t = np.concatenate([np.linspace(0.0, 0.02, 3), 0.02 + np.geomspace(0.01, 40.0, 12)])
    d = 1e-6 * np.minimum(t / 0.02, 1.0)
    robot = arm(("relaxation-2",))
    found = simulate(robot, Protocol({"side": Command("shortening", d)}, t)).channels["side.tension"][2:]
    shear, bending = compliances(BAR, E, NU)[[0, 4]]
    long = 1e-6 / (LONG * shear + LONG**3 / 3.0 * bending)
    a = (1.0 - np.exp(-0.02 / TAU)) * TAU / 0.02
    after = t[2:, None] - 0.02
    np.testing.assert_allclose(found / long, 1.0 + (BETA * a * np.exp(-after / TAU)).sum(axis=1), rtol=1e-4)


def test_friction_keeps_an_arm_on_the_side_that_it_was_bent_to() -> None:
    """Let go, the tip stays off, by what the threshold can hold; from the other side as far the other way."""
    still = [0.0, 0.02, 0.0]
    robot = arm(("flow-at-once",))
    tip = simulate(robot, Protocol({"side": Command("tension", np.array(still) * 20.0)})).channels["tip.x"]
    assert tip[1] > 0.02
    assert 5e-4 < tip[2] < 0.3 * tip[1]
    free = arm(("flow-at-once",), flow_threshold=1e7)
    assert simulate(free, Protocol({"side": Command("tension", np.array(still) * 20.0)})).channels["tip.x"][2] < 1e-8


WAY = 1e-3 * np.array([0.0, 8.0, 16.0, 16.0, 6.0, 1.0, 9.0, 20.0])
TIMES = np.array([0.0, 0.5, 1.0, 4.0, 4.5, 5.0, 6.0, 7.0])
HISTORY = ("softening", "relaxation-1", "flow")


@pytest.mark.slow
def test_derivatives_through_a_history_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loading, a hold, letting go and loading again, of a tapered rod of two materials on a centrifuge."""
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    robot = arm(HISTORY, varied=True, flow_time=2.0)
    protocol = Protocol({"side": Command("shortening", WAY)}, TIMES)
    names = [f"arm.{name}" for name in constants(HISTORY)] + ["arm.density"]
    names += [f"arm.foot.{name}" for name in ("youngs_modulus", "relaxing_share1", "flow_threshold")]
    response = simulate(robot, protocol, sensitivities=names)
    assert response.succeeded, response.status
    values = parameter_values(robot)
    for name in names:
        h = 5e-4 * values[name]
        up, down = (simulate(robot, protocol, {name: values[name] + s * h}).channels for s in (1, -1))
        for channel in ("side.tension", "tip.y", "tip.z"):
            expected = (up[channel] - down[channel]) / (2.0 * h)
            largest = np.abs(expected).max()
            assert largest > 0.0
            got = response.sensitivities[channel][name]
            np.testing.assert_allclose(got, expected, rtol=0, atol=1e-5 * largest, err_msg=f"{channel} by {name}")


def tensions(robot: Robot, damping: Damping, step: float) -> Floats:
    """In motion along WAY, a sample every step [s]."""
    twin, theta = build_twin(robot), parameter_values(robot)
    dynamics = Dynamics(twin.system, robot_inertia(twin, robot), theta, damping)
    now, found = at_rest(loaded(twin, Statics(twin.system, theta)).state, -step), list[float]()
    for d in WAY:
        controls = Controls(np.zeros(1, bool), np.zeros(1), np.array([d]))
        now = dynamics.advance(now, step, lambda time, controls=controls: controls)
        found.append(float(now.state.effort[0]))
    return np.array(found)


def test_slow_motion_is_the_way_in_statics() -> None:
    """A time step is a sample, with the time of the step between."""
    robot = arm(HISTORY, flow_time=2.0)
    robot = replace(robot, rods=(replace(robot.rods[0], density=1e-3),))
    static = simulate(robot, Protocol({"side": Command("shortening", WAY)}, np.arange(8.0))).channels["side.tension"]
    np.testing.assert_allclose(tensions(robot, Damping(), 1.0), static, rtol=0, atol=1e-4 * static.max())


def test_damping_stands_beside_a_history() -> None:
    """Of a material that hardly softens, it is that of an elastic one; without it the tension is another."""
    soft, elastic = arm(("softening",), softening_amount=1e6), arm(())
    one, other = (replace(robot, rods=(replace(robot.rods[0], density=1e3),)) for robot in (soft, elastic))
    damping = Damping(stiffness=0.05)
    expected = tensions(other, damping, 0.02)
    np.testing.assert_allclose(tensions(one, damping, 0.02), expected, rtol=0, atol=1e-5 * expected.max())
    assert np.abs(tensions(other, Damping(), 0.02) - expected).max() > 0.1 * expected.max()


def test_what_is_wrong_is_said() -> None:
    with pytest.raises(InputError, match="shares that relax add up to 1, and must be below 1 together"):
        arm(("relaxation-2",), relaxing_share2=0.7)
    with pytest.raises(InputError, match=r"arm\.history: there is no such part of a history; got 'flows'"):
        replace(arm(("flow",)).rods[0], history=("flows",))
    with pytest.raises(InputError, match=r"arm\.history: the sections of a rod have no such.*'maxwell-1'.*softening"):
        replace(arm(("flow",)).rods[0], history=("maxwell-1",))
    with pytest.raises(InputError, match=r"a history can have only one part of this kind.*2 of flow"):
        replace(arm(("flow",)).rods[0], history=("flow", "flow-at-once"))
