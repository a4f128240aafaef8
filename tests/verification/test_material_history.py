"""Materials that relax, soften and flow: closed forms at a point and in robots, exact derivatives."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, held, irregular_box, placed
from scipy.integrate import solve_ivp
from scipy.special import erf

from softcal.checks import Floats
from softcal.errors import InputError
from softcal.materials.catalogue import LAWS
from softcal.materials.components import ISOCHORIC, PAIRS
from softcal.materials.histories import history_of
from softcal.materials.inelastic import Stressed
from softcal.materials.law import compile_law
from softcal.materials.neo_hooke import NEO_HOOKE_ISOCHORIC
from softcal.materials.stress_at import Deformation, points
from softcal.mechanics.damping import Damping
from softcal.mechanics.dynamics import Dynamics
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.state import State
from softcal.mechanics.statics import Equilibrium, Statics
from softcal.mechanics.term import Controls
from softcal.mechanics.time_step import at_rest
from softcal.twin.build import build_twin
from softcal.twin.masses import robot_inertia
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Robot
from softcal.twin.simulate import simulate
from softcal.twin.start import loaded

MU = 1.0e6 / 3.0


def sheared(gamma: float) -> Stressed:
    """Simple shear F = 1 + gamma e1 e2 of the isochoric neo-Hookean law, mu 1 MPa / 3."""
    F = np.eye(3)
    F[0, 1] = gamma
    of = Deformation(compile_law(NEO_HOOKE_ISOCHORIC), points(F[None]))
    values = (1.0e6, 0.5 - 1e-9)
    S, D = of.stress(values)
    E = 0.5 * (F.T @ F - np.eye(3))
    return Stressed(np.array([[E[i, j] * (1.0 if i == j else 2.0) for i, j in PAIRS]]), of.energy(values), S, D)


def shear_stress(names: list[str], constants: dict[str, float], gamma: Floats, times: Floats) -> Floats:
    """Nominal shear stress P12 along a shear; before the first time it was at rest for long."""
    history = history_of(names)
    memory, out = np.zeros((1, history.size)), list[float]()
    for i, g in enumerate(gamma):
        dt = float(times[max(i, 1)] - times[max(i, 1) - 1])
        at, memory = history.respond(sheared(g), memory, dt, constants)
        S = at.S[0]
        out.append(float(S[3] + g * S[1]))
    return np.array(out)


PRONY = {"relaxing_share1": 0.3, "relaxation_time1": 0.5, "relaxing_share2": 0.2, "relaxation_time2": 8.0}
BETA = np.array([0.3, 0.2]) / 0.5
TAU = np.array([0.5, 8.0])
MULLINS = {"softening_amount": 1.7, "softening_energy": 2e4, "softening_range": 0.1}


def test_relaxation_after_a_small_step_is_the_prony_series() -> None:
    t = np.concatenate([[0.0, 1e-9], np.geomspace(1e-3, 50.0, 40)])
    got = shear_stress(["relaxation-2"], PRONY, np.where(t > 0.0, 1e-4, 0.0), t)[1:] / (MU * 1e-4)
    expected = 1.0 + (BETA * np.exp(-np.subtract.outer(t[1:], np.zeros(2)) / TAU)).sum(axis=1)
    np.testing.assert_allclose(got, expected, rtol=1e-6)


def test_a_constant_rate_is_the_closed_form_whatever_the_samples() -> None:
    for n in (5, 50):
        t = np.linspace(0.0, 3.0, n)
        got = shear_stress(["relaxation-2"], PRONY, 1e-4 * t, t)[1:] / (MU * 1e-4)
        x = t[1:, None] / TAU
        expected = t[1:] + (BETA * TAU * (1.0 - np.exp(-x))).sum(axis=1)
        np.testing.assert_allclose(got, expected, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("omega", [0.02, 0.2, 2.0, pytest.param(20.0, marks=pytest.mark.long)])
def test_storage_and_loss_modulus(omega: float) -> None:
    """Over three decades, at the end of an oscillation: G' and G'' of the generalised Maxwell model."""
    n, periods = 200, max(3, int(np.ceil(60.0 * omega / (2.0 * np.pi))))
    t = np.linspace(0.0, periods * 2.0 * np.pi / omega, periods * n + 1)
    stress = shear_stress(["relaxation-2"], PRONY, 1e-4 * np.sin(omega * t), t)[-n:] / (MU * 1e-4)
    last = omega * t[-n:]
    storage, loss = 2.0 * np.mean(stress * np.sin(last)), 2.0 * np.mean(stress * np.cos(last))
    w = (omega * TAU) ** 2
    assert storage == pytest.approx(1.0 + float((BETA * w / (1.0 + w)).sum()), rel=1e-4)
    assert loss == pytest.approx(float((BETA * omega * TAU / (1.0 + w)).sum()), rel=2e-3)


def test_mullins_unloading_is_the_closed_form() -> None:
    gamma = np.concatenate([np.linspace(0.0, 1.5, 30), np.linspace(1.5, 0.0, 30)[1:], np.linspace(0.0, 2.0, 41)[1:]])
    got = shear_stress(["softening"], MULLINS, gamma, np.arange(float(len(gamma))))
    most = 0.5 * MU * np.maximum.accumulate(gamma) ** 2
    W = 0.5 * MU * gamma**2
    eta = 1.0 - erf((most - W) / (2e4 + 0.1 * most)) / 1.7
    np.testing.assert_allclose(got, eta * MU * gamma, rtol=1e-6, atol=1e-3)
    assert eta.min() < 0.6


def test_flow_leaves_a_set_that_the_threshold_bounds() -> None:
    """Let go to no shear, the branch is left with no more than its threshold, as shear stress Y / sqrt(3)."""
    constants = {"flow_modulus": 2e5, "flow_threshold": 3e3, "flow_time": 0.0}
    gamma = 1e-2 * np.array([0.0, 1.0, 3.0, 1.0, 0.0])
    got = shear_stress(["flow"], constants, gamma, np.arange(5.0))
    assert got[2] - MU * gamma[2] == pytest.approx(3e3 / np.sqrt(3.0), rel=0.01)
    assert got[-1] == pytest.approx(-3e3 / np.sqrt(3.0), rel=0.01)


def test_what_is_beyond_the_threshold_flows_with_its_time() -> None:
    constants = {"flow_modulus": 2e5, "flow_threshold": 3e3, "flow_time": 2.0}
    t = np.array([0.0, 1e-9, 1.0, 3.0, 10.0])
    got = shear_stress(["flow"], constants, np.where(t > 0.0, 0.05, 0.0), t)[1:] - MU * 0.05
    Y = 3e3 / np.sqrt(3.0)
    expected = Y + (2e5 * 0.05 - Y) * np.exp(-t[1:] / 2.0)
    np.testing.assert_allclose(got, expected, rtol=2e-3)


def test_flow_at_a_constant_rate_is_the_closed_form_whatever_the_samples() -> None:
    """A small shear: elastic up to the threshold, and beyond it a Maxwell element."""
    mu_f, Y, tau, rate = 2e5, 30.0 * np.sqrt(3.0), 2.0, 1e-4
    yields = 30.0 / (mu_f * rate)
    for n in (2, 30):
        t = np.concatenate([[0.0, yields], yields + np.linspace(0.0, 12.0, n)[1:]])
        constants = {"flow_modulus": mu_f, "flow_threshold": Y, "flow_time": tau}
        got = shear_stress(["flow"], constants, rate * t, t) - MU * rate * t
        beyond = mu_f * rate * tau * (1.0 - np.exp(-(t[1:] - yields) / tau))
        np.testing.assert_allclose(got[1:], 30.0 + beyond, rtol=1e-4)


def test_flow_is_of_second_order_in_the_samples() -> None:
    """Large shear to and fro, in which the branch's stress turns, against its differential equation."""
    constants, corners = {"flow_modulus": 2e5, "flow_threshold": 1.5e4, "flow_time": 2.0}, [0.0, 1.0, 0.1, 1.3]
    mu, Y, tau = constants.values()
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)) / 0.5)])

    def of(t: float, E_p: Floats) -> tuple[Floats, float]:
        gamma = np.interp(t, times, corners)
        strain = np.array([0.0, 0.5 * gamma**2, 0.0, gamma, 0.0, 0.0]) - E_p
        s = mu * ISOCHORIC[0] @ strain
        flowing = max(1.0 - Y / max(np.sqrt(3.0 * mu * s @ strain), 1e-9), 0.0)
        return strain * flowing / tau, float(s[3] + gamma * s[1])

    E_p, exact = np.zeros(6), [0.0]
    for begin, end in pairwise(times):
        at = np.linspace(begin, end, 31)[1:]
        solved = solve_ivp(lambda t, y: of(t, y)[0], (begin, end), E_p, t_eval=at, rtol=1e-9, atol=1e-11, max_step=0.02)
        E_p = solved.y[:, -1]
        exact += [of(*one)[1] for one in zip(at, solved.y.T, strict=True)]
    errors = list[float]()
    for n in (30, 60):
        t = np.concatenate([[0.0], *(np.linspace(a, b, n + 1)[1:] for a, b in pairwise(times))])
        gamma = np.interp(t, times, corners)
        got = shear_stress(["flow"], constants, gamma, t) - MU * gamma
        errors.append(float(np.abs(got[:: n // 30] - exact).max() / np.abs(exact).max()))
    assert errors[0] < 3e-4
    assert errors[1] < 0.3 * errors[0]


# What a history acts on, in uniaxial strain: the first part of an energy, as docs/mechanics.md has it in its table.
FIRST_PARTS = {
    "neo-hooke": (
        lambda x: 0.5 * (x**2 - 1.0) - np.log(x),
        lambda x: x - 1.0 / x,
        lambda x: np.log(x) / x,
    ),
    "stable-neo-hooke": (
        lambda x: 0.5 * (x**2 - 1.0) - (x - 1.0) + 0.5 * (x - 1.0) ** 2,
        lambda x: x - 1.0 + x - 1.0,
        lambda x: x - 1.0,
    ),
}


def strained(element: str, law: str, nu: float, names: tuple[str, ...], lengths: Floats, dt: float) -> Floats:
    """Nominal stresses along a block in uniaxial strain: the forces on its end over its area."""
    mesh = irregular_box((1.0, 1.0, 1.0), (1, 1, 1), element)
    own = {
        one.name: {**elastic(1e6, nu), **PRONY, **MULLINS}[one.name]
        for one in (*LAWS[law].parameters, *history_of(names).parameters)
    }
    body = Body("body", mesh, np.array([0]), own, law, element, history=names)
    robot = Robot((body,))
    system, theta = build_twin(robot).system, parameter_values(robot)
    bulk = body.elasticity.bulk_modulus(elastic(1e6, nu))
    state, out = placed(system, mesh.points.copy()), list[float]()
    for length in lengths:
        g = length - 1.0 if LAWS[law].volumetric_strain == "J - 1" else np.log(length)
        state = replace(state, x=mesh.points * [length, 1.0, 1.0])
        state.pressure[:] = bulk * g
        controls = replace(held(), elapsed=dt)
        at = system.linearise(state, controls, theta, tangent=False)
        assert np.abs(at.reduced[system.layout.first_pressure_unknown :]).max(initial=0.0) < 1e-12
        out.append(float(at.full[: 3 * mesh.n_points].reshape(-1, 3)[mesh.node_sets["x1"], 0].sum()))
        state = system.advanced(state, controls, theta)
    return np.array(out)


@pytest.mark.parametrize("law", FIRST_PARTS)
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
@pytest.mark.parametrize("element", ELEMENTS)
def test_histories_act_on_the_first_part_of_the_energy_as_the_table_of_laws_has_it(
    element: str, nu: float, law: str
) -> None:
    mu, lmbda = 0.5e6 / (1.0 + nu), 1e6 * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    energy, first, volumetric = FIRST_PARTS[law]

    once = np.array([1.8, 1.8, 1.8])
    x = 0.7 / TAU
    kept = (BETA * (1.0 - np.exp(-x)) / x) @ np.exp(-np.outer(x, np.arange(3.0)))
    expected = (1.0 + kept) * mu * first(once) + lmbda * volumetric(once)
    np.testing.assert_allclose(strained(element, law, nu, ("relaxation-2",), once, 0.7), expected, rtol=1e-9)

    cycle = np.array([1.4, 1.8, 1.6, 1.2, 1.5, 1.9])
    W = mu * energy(cycle)
    most = np.maximum.accumulate(W)
    r, m, b = MULLINS.values()
    eta = 1.0 - erf((most - W) / (m + b * most)) / r
    expected = eta * mu * first(cycle) + lmbda * volumetric(cycle)
    np.testing.assert_allclose(strained(element, law, nu, ("softening",), cycle, 1.0), expected, rtol=1e-9)
    assert eta.min() < 0.6


# Robots.

HISTORY = ("softening", "relaxation-1", "flow")
CONSTANTS = {
    "relaxing_share1": 0.3, "relaxation_time1": 2.0,
    "branch_modulus1": 2e5, "branch_time1": 1.5, "branch_exponent": 1.2,
    "softening_amount": 2.0, "softening_energy": 300.0, "softening_range": 0.1,
    "flow_modulus": 2e5, "flow_threshold": 4e3, "flow_time": 3.0,
}  # fmt: skip


def with_history(robot: Robot, history: tuple[str, ...], law: str = "neo-hooke-isochoric") -> Robot:
    (body,) = robot.bodies
    names = [one.name for part in history_of(history).parts for one in part.parameters]
    own = {**body.parameters, **{name: CONSTANTS[name] for name in names}}
    return replace(robot, bodies=(replace(body, law=law, history=history, parameters=own),))


def column(element: str, nu: float = 0.45) -> Robot:
    return column_robot(element, parameters=elastic(1e6, nu), divisions=(1, 1, 4), gravity=(0.0, 0.0, 0.0))


def test_a_pull_that_is_held_relaxes_as_the_series_says() -> None:
    robot = with_history(column("P2P1", 0.4999), ("relaxation-1",))
    t = np.concatenate([np.linspace(0.0, 0.02, 3), 0.02 + np.linspace(0.0, 8.0, 9)[1:]])
    pull = Command("shortening", 1e-6 * np.minimum(t / 0.02, 1.0))
    got = simulate(robot, Protocol({"front": pull}, t)).channels["front.tension"][2:]
    long = simulate(robot, Protocol({"front": pull})).channels["front.tension"][-1]
    a = (1.0 - np.exp(-0.01)) / 0.01
    expected = 1.0 + 0.3 / 0.7 * a * np.exp(-(t[2:] - 0.02) / 2.0)
    np.testing.assert_allclose(got / long, expected, rtol=1e-4)


def test_under_a_constant_pull_it_creeps_to_what_it_is_after_a_long_time() -> None:
    """Commands that stay exactly as they were: the material moves on all the same."""
    robot = with_history(column("P2P1", 0.4999), ("relaxation-1",))
    t = np.concatenate([[0.0, 1e-3], 1e-3 + np.geomspace(0.1, 40.0, 120)])
    pull = Command("tension", np.where(t > 0.0, 1e-3, 0.0))
    got = simulate(robot, Protocol({"front": pull}, t)).channels["plate.pitch"][1:]
    long = simulate(robot, Protocol({"front": pull})).channels["plate.pitch"][-1]
    # The retardation time is the relaxation time over 1 - g.
    expected = 1.0 - 0.3 * np.exp(-(t[1:] - 1e-3) * 0.7 / 2.0)
    np.testing.assert_allclose(got / long, expected, rtol=2e-3)


def test_a_hold_without_an_equilibrium_is_a_failed_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = with_history(column("P1"), ("relaxation-1",))
    hold = Protocol({"front": Command("tension", np.full(3, 0.05))}, np.array([0.0, 1.0, 4.0]))
    assert simulate(robot, hold).succeeded
    original = Statics.equilibrium

    def stalled(self: Statics, guess: State, controls: Controls) -> Equilibrium:
        found = original(self, guess, controls)
        return replace(found, converged=False, status="it stalled") if controls.elapsed == 3.0 else found

    monkeypatch.setattr(Statics, "equilibrium", stalled)
    response = simulate(robot, hold)
    assert not response.succeeded
    assert "no equilibrium after further time under the same commands: it stalled." in response.status


WAY = 1e-3 * np.array([0.0, 4.0, 8.0, 8.0, 3.0, 0.5, 5.0, 9.0])
LET_GO = 1e-3 * np.array([0.0, 4.0, 8.0, 8.0, 3.0, -0.5, -0.5, -0.7, 5.0, 9.0])
TIMES = np.array([0.0, 0.5, 1.0, 4.0, 4.5, 5.0, 5.3, 5.5, 6.0, 7.0])


@pytest.mark.slow
@pytest.mark.parametrize("element", ["P1", "P2P1"])
@pytest.mark.parametrize(
    ("history", "law"),
    [(HISTORY, "neo-hooke-isochoric"), (("maxwell-1",), "neo-hooke-isochoric"), (("softening",), "neo-hooke")],
)
def test_derivatives_through_a_history_are_exact(
    element: str, history: tuple[str, ...], law: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Loading, a hold, letting go until the cable is slack for a while, and loading again; by all constants of the
    history, and by the law's.
    """
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    robot = with_history(column(element, 0.3 if law == "neo-hooke" else 0.45), history, law)
    protocol = Protocol({"front": Command("shortening", LET_GO)}, TIMES)
    names = [f"neck.{name}" for name in robot.bodies[0].parameters]
    response = simulate(robot, protocol, sensitivities=names)
    assert response.succeeded, response.status
    values = parameter_values(robot)
    for name in names:
        h = 1e-4 * values[name]
        up, down = (simulate(robot, protocol, {name: values[name] + s * h}).channels for s in (1, -1))
        for channel in ("front.tension", "plate.pitch"):
            expected = (up[channel] - down[channel]) / (2.0 * h)
            largest = np.abs(expected).max()
            assert largest > 0.0
            np.testing.assert_allclose(response.sensitivities[channel][name], expected, rtol=0, atol=1e-5 * largest)


def test_slow_motion_is_the_way_in_statics() -> None:
    """A time step is a sample, with the time of the step between."""
    robot = with_history(replace(column("P1")), HISTORY)
    (body,) = robot.bodies
    robot = replace(robot, bodies=(replace(body, density=1e-3),))
    t = np.arange(8.0)
    static = simulate(robot, Protocol({"front": Command("shortening", WAY)}, t)).channels["front.tension"]
    twin, theta = build_twin(robot), parameter_values(robot)
    start = loaded(twin, Statics(twin.system, theta)).state
    dynamics = Dynamics(twin.system, robot_inertia(twin, robot), theta, Damping())
    now, got = at_rest(start, -1.0), list[float]()
    for d in WAY:
        controls = Controls(np.zeros(1, bool), np.zeros(1), np.array([d]))
        now = dynamics.advance(now, 1.0, lambda time, controls=controls: controls)
        got.append(float(now.state.effort[0]))
    np.testing.assert_allclose(got, static, rtol=0, atol=1e-4 * static.max())


def test_a_closed_cycle_loses_energy_and_a_second_one_less() -> None:
    robot = with_history(column("P1"), HISTORY)
    once = 8e-3 * np.concatenate([np.linspace(0.0, 1.0, 9), np.linspace(1.0, 0.0, 9)[1:]])
    d = np.concatenate([once, once[1:]])
    T = simulate(robot, Protocol({"front": Command("shortening", d)}, 0.1 * np.arange(len(d)))).channels[
        "front.tension"
    ]
    work = [float(np.trapezoid(T[a:b], d[a:b])) for a, b in ((0, 17), (16, 33))]
    assert work[0] > work[1] > 0.0


def test_shares_that_add_up_to_one_are_refused() -> None:
    robot = with_history(column("P1"), ("relaxation-1",))
    (body,) = robot.bodies
    own = {**body.parameters, "relaxing_share2": 0.7, "relaxation_time2": 5.0}
    with pytest.raises(InputError, match="shares that relax add up to 1, and must be below 1 together"):
        replace(body, history=("relaxation-2",), parameters=own)
    with pytest.raises(InputError, match=r"neck\.history: there is no such part of a history; got 'relax'"):
        replace(body, history=("relax",))
