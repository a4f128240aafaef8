"""The linear system of small motions, against closed forms, the dense eigenproblem, exact derivatives and motion in
time.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from command_line import run
from manipulator_case import manipulator
from mechanics_cases import blown_box, column_robot, elastic, full_matrix, mirrored_box, side_cable, twin_and_theta
from project_case import write_project

import softcal
from softcal.errors import InputError, ParameterError, SimulationError
from softcal.geometry.shape import PrimitiveShape
from softcal.geometry.wire import SolidRod
from softcal.mechanics.damping import Damping
from softcal.mechanics.dynamics import Dynamics
from softcal.mechanics.small_motions import mass_tangent, small_motions
from softcal.mechanics.stability import overdamped_equilibrium
from softcal.mechanics.state import State, rest_state
from softcal.mechanics.statics import Equilibrium, Statics
from softcal.mechanics.system import System
from softcal.mechanics.term import Controls
from softcal.mechanics.time_step import at_rest
from softcal.twin.masses import robot_inertia
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.robot import Body, Plate, Robot
from softcal.twin.sensors import channel_units, sense
from softcal.twin.time_settings import TimeSettings

HEAVY = (2.0, 0.0, -9.81)
CABLES = (side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05)))


def neck(element: str = "P1", **changes) -> Robot:
    """A heavy column with a plate of 50 g and two cables."""
    return column_robot(
        element, density=1200.0, mass=0.05, gravity=HEAVY, cables=CABLES, divisions=(1, 1, 4), **changes
    )


def cantilever(element: str, length: float, side: float, divisions: tuple[int, int, int], E: float) -> Robot:
    """A bar of a square section of 1000 kg/m^3 along z, clamped at its foot."""
    mesh = mirrored_box((side, side, length), divisions)
    body = softcal.Body("bar", mesh, mesh.node_sets["z0"], elastic(E, 0.3), element=element, density=1000.0)
    tip = softcal.Marker("tip", "bar", np.array([0.0, 0.0, length]))
    return Robot((body,), markers=(tip,))


def dense_frequencies(robot: Robot, controls: dict[str, str], commands: dict[str, float], n: int) -> np.ndarray:
    """The lowest frequencies [Hz] by the dense bordered tangent: K^-1 M on what has mass, in M's scalar product."""
    live = softcal.LiveTwin(robot, controls)
    state = live.at(commands)
    assert state.succeeded
    place = state._place
    system = place.twin.system
    K = full_matrix(system, system.linearise(place.state, place.reached.controls, place._steps.statics.theta))
    M = full_matrix(system, mass_tangent(system, robot_inertia(place.twin, robot), place.state))
    first = system.layout.first_effort_unknown
    free = [*range(first), *(first + np.flatnonzero(~place.reached.controls.is_held))]
    K, M = K[np.ix_(free, free)], M[np.ix_(free, free)]
    share, axes = np.linalg.eigh(M)
    root = axes[:, share > 1e-12 * share[-1]] * np.sqrt(share[share > 1e-12 * share[-1]])
    scale = 1.0 / np.sqrt(np.abs(K).max(axis=1))[:, None]
    inverse = scale * scipy.linalg.solve(scale * K * scale.T, scale * root)
    values = np.linalg.eigvalsh(root.T @ inverse)[::-1][:n]
    return 1.0 / np.sqrt(values) / (2.0 * np.pi)


GUIDE = ((0.07, 0.0, 0.05), (0.05, 0.0, 0.0))  # via points on the ground, at which a cable bends
CASES = {
    "P1": (neck("P1"), {"front": "tension", "left": "tension"}, {"front": 3.0}),
    "P2P1": (neck("P2P1"), {"front": "tension", "left": "tension"}, {"front": 3.0, "left": 1.0}),
    "held": (neck("P2P1"), {"front": "shortening", "left": "tension"}, {"front": 0.003, "left": 1.0}),
    "two held": (neck("P1"), {"front": "shortening", "left": "shortening"}, {"front": 0.003, "left": 0.002}),
    "chamber": (
        replace(blown_box("P2P1", is_open=False, medium="gas"), gravity=np.array(HEAVY)),
        {"main": "pressure"},
        {"main": 2e3},
    ),
}


@pytest.mark.parametrize("case", [name for name in CASES if name != "chamber"])
def test_frequencies_are_those_of_the_dense_eigenproblem(case: str) -> None:
    robot, controls, commands = CASES[case]
    found = softcal.linearise(robot, commands, controls=controls, modes=5)
    expected = dense_frequencies(robot, controls, commands, 6)
    np.testing.assert_allclose(found.frequencies, expected[:5], rtol=1e-8)
    assert found.next_frequency == pytest.approx(expected[5], rel=1e-8)
    assert found.frequency_errors.max() < 1e-9


def test_frequencies_of_a_manipulator_are_those_of_the_dense_eigenproblem() -> None:
    robot = manipulator()
    controls = {f"cable{k}": "tension" for k in range(1, 7)}
    found = softcal.linearise(robot, {"cable1": 4.0, "cable5": 2.0}, controls=controls, modes=5)
    expected = dense_frequencies(robot, controls, {"cable1": 4.0, "cable5": 2.0}, 6)
    np.testing.assert_allclose(found.frequencies, expected[:5], rtol=1e-6)
    assert found.static_error < 1e-8
    assert len(found.inputs) == 6


def test_frequencies_of_a_slender_bar_are_those_of_euler_and_bernoulli() -> None:
    """In pairs, less some tenths of a percent by shear, rotary inertia and the Poisson's effect of the clamp."""
    length, side, E = 0.2, 0.01, 1e6
    found = softcal.linearise(cantilever("P2", length, side, (1, 2, 20), E), modes=4)
    scale = np.sqrt(E * side**4 / 12 / (1000.0 * side**2 * length**4)) / (2.0 * np.pi)
    np.testing.assert_allclose(found.frequencies[:2], 1.8751041**2 * scale, rtol=0.01)
    np.testing.assert_allclose(found.frequencies[2:4], 4.6940911**2 * scale, rtol=0.03)


def rod_robot(length: float, *cables: softcal.Cable) -> Robot:
    """A round rod of 4 mm along z, clamped at its foot, with a disc of no mass at its end."""
    rod = softcal.Rod(
        "rod",
        softcal.straight((0.0, 0.0, 0.0), (0.0, 0.0, length), 60),
        softcal.RoundBar(0.004),
        {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
        clamped={"base": np.array([0]), "plate": np.array([60])},
        density=1200.0,
    )
    base = softcal.Plate("base", {}, np.zeros(3), fixed=True)
    plate = softcal.Plate("plate", {}, np.array([0.0, 0.0, length]))
    return Robot(plates=(base, plate), rods=(rod,), cables=cables)


EULER = np.pi**2 * 1e9 * np.pi * 0.004**4 / 64 / 0.3**2  # [N]
ALONG = softcal.Cable("middle", (softcal.ViaPoint(np.array([0.0, 0.0, 0.3]), "plate"), softcal.ViaPoint(np.zeros(3))))


def test_a_rod_swings_as_euler_and_bernoulli_say() -> None:
    found = softcal.linearise(rod_robot(0.3), modes=6)
    section = np.pi * 0.004**2 / 4
    scale = np.sqrt(1e9 * section * 0.004**2 / 16 / (1200.0 * section * 0.3**4)) / (2.0 * np.pi)
    expected = np.repeat(np.array([1.8751041, 4.6940911, 7.8547574]) ** 2 * scale, 2)
    np.testing.assert_allclose(found.frequencies, expected, rtol=5e-3)


def test_an_unstable_equilibrium_is_refused_and_one_that_turns_freely() -> None:
    """A straight rod beyond the tension on its axis at which it buckles; buckled, its plane of bending may be any."""
    robot = rod_robot(0.3, ALONG)
    twin, theta = twin_and_theta(robot)
    statics, inertia = Statics(twin.system, theta), robot_inertia(twin, robot)

    def lowest(tension: float, solver: Callable[[State, Controls], Equilibrium]) -> float:
        pushed = Controls(np.ones(1, dtype=bool), np.array([tension]), np.zeros(1))
        solved = solver(rest_state(twin.system.layout), pushed)
        assert solved.converged, solved.status
        return float(small_motions(statics, inertia, Damping(), solved.state, pushed, np.array([0]), 2).frequencies[0])

    assert lowest(0.98 * EULER, statics.equilibrium) < 0.25 * lowest(0.0, statics.equilibrium)
    with pytest.raises(SimulationError, match="not stable"):
        lowest(1.3 * EULER, statics.equilibrium)
    with pytest.raises(SimulationError, match="moves freely"):
        lowest(1.3 * EULER, lambda state, pushed: overdamped_equilibrium(statics, state, pushed))


@pytest.mark.parametrize("case", CASES)
def test_the_static_gain_is_exact(case: str) -> None:
    robot, controls, commands = CASES[case]
    live = softcal.LiveTwin(robot, controls)
    state = live.at(commands)
    found = state.linearised(2)
    exact = state.by_commands()
    columns = [exact.names.index(name) for name in found.inputs]
    assert found.inputs == tuple(name for name in exact.names if name.endswith((".tension", ".pressure")))
    size = np.maximum(np.abs(exact.values[:, columns]).max(axis=1, initial=0.0), 1e-12)[:, None]
    np.testing.assert_allclose(found.static_gain / size, exact.values[:, columns] / size, atol=1e-8)
    assert found.static_error < 1e-8


SHAPED = SolidRod(length=0.1, diameter=0.03, layers=4)
BAR = Body(
    "bar", SHAPED.mesh(), SHAPED.mesh().node_sets["start"], elastic(0.4e6, 0.43), density=1100.0,
    shape=PrimitiveShape(SHAPED),
)  # fmt: skip
CASES_OF_RATES = CASES | {
    "shape": (
        Robot(
            (BAR,),
            (Plate("plate", {"bar": SHAPED.mesh().node_sets["end"]}, np.array([0.0, 0.0, 0.1]), 0.05),),
            gravity=np.array([0.0, 1.0, -9.81]),
        ),
        {},
        {},
    )
}


@pytest.mark.parametrize("case", CASES_OF_RATES)
def test_rates_of_frequencies_and_poles_are_their_differences_at_other_values(case: str) -> None:
    """Along the equilibria at the same commands: these move, and constraints turn."""
    robot, controls, commands = CASES_OF_RATES[case]
    settings = TimeSettings(rayleigh_stiffness=2e-5, rayleigh_mass=0.5)
    kinds = ("youngs_modulus", "poissons_ratio", "density", "mass", "diameter", "length")
    known = robot_parameters(robot)
    names = [name for name in known if name.rpartition(".")[2] in kinds and known[name].value]
    found = softcal.linearise(robot, commands, controls=controls, modes=3, settings=settings, parameters=names)
    for k, name in enumerate(names):
        step = 3e-5 * known[name].value  # two modes of the chamber are near to each other
        before, after = (
            softcal.linearise(
                robot, commands, controls=controls, modes=3, settings=settings, theta={name: known[name].value + sign}
            )
            for sign in (-step, step)
        )
        expected = (after.frequencies - before.frequencies) / (2.0 * step)
        largest = np.abs(expected).max() + 1e-9 * found.frequencies.max() / step
        np.testing.assert_allclose(found.frequency_rates[:, k], expected, atol=1e-5 * largest)
        poles = (after.poles - before.poles) / (2.0 * step)
        slowest = slice(0, 4)  # those of two modes; poles at other values lack what the modes left out do to them
        largest = np.abs(poles[slowest]).max() + 1e-9 * np.abs(found.poles[slowest]).max() / step
        np.testing.assert_allclose(found.pole_rates[slowest, k], poles[slowest], atol=3e-4 * largest)


def test_rates_of_frequencies_by_where_via_points_are():
    """These move the lines of action, so that K changes although no unknown does."""
    front, left = CABLES
    named = replace(
        front, via_points=tuple(replace(via, name=n) for via, n in zip(front.via_points, "ab", strict=True))
    )
    robot = replace(neck(), cables=(named, replace(left, routing_axis=softcal.RoutingAxis())))
    controls, commands = {"front": "shortening", "left": "tension"}, {"front": 0.003, "left": 1.0}
    infos = robot_parameters(robot)
    names = [name for name in infos if name.endswith("_offset") or ".routing_" in name]
    assert len(names) == 9
    found = softcal.linearise(robot, commands, controls=controls, modes=3, parameters=names)
    for k, name in enumerate(names):
        step = {"m": 1e-5, "rad": 1e-4, "rad/m": 1e-3}[infos[name].unit]
        before, after = (
            softcal.linearise(robot, commands, controls=controls, modes=3, theta={name: by}).frequencies
            for by in (-step, step)
        )
        expected = (after - before) / (2.0 * step)
        largest = np.abs(expected).max() + 1e-9 * found.frequencies.max() / step
        np.testing.assert_allclose(found.frequency_rates[:, k], expected, atol=1e-4 * largest, err_msg=name)


def test_a_live_twin_has_the_masses_of_its_values() -> None:
    robot, controls, commands = CASES["P2P1"]
    (density,) = (name for name in robot_parameters(robot) if name.endswith(".density"))
    values = {density: 2000.0}
    live = softcal.LiveTwin(robot, controls, values).at(commands).linearised(3)
    stated = softcal.LiveTwin(with_parameters(robot, values), controls).at(commands).linearised(3)
    np.testing.assert_allclose(live.frequencies, stated.frequencies, rtol=1e-9)


@pytest.mark.parametrize("damping", ["strain", "tangent"])
@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_a_small_step_of_tension_moves_it_as_in_time(element: str, damping: str) -> None:
    robot, small, h = neck(element), 1e-3, 2.5e-4
    settings = softcal.TimeSettings(h, 1e-3, 0.5, damping=damping)
    found = softcal.LiveTwin(robot, "tension").at({"front": 2.0}).linearised(6, settings)
    before = softcal.simulate(robot, softcal.Protocol({"front": softcal.Command("tension", np.array([2.0]))}))
    times = h * np.arange(1 + 240)
    motion = _in_time(robot, settings, times, 2.0, 2.0 + small)
    k = found.channels.index("plate.x")
    A, B, C, D = found.state_matrices
    # Backward Euler of the linear system: the step's own error is the same in both.
    x, moved = np.zeros(len(A)), [0.0]
    for _ in times[1:]:
        x = np.linalg.solve(np.eye(len(A)) - h * A, x + h * B[:, 0] * small)
        moved.append(float(C[k] @ x + D[k, 0] * small))
    step = found.static_gain[k, 0] * small
    np.testing.assert_allclose(motion - before.channels["plate.x"][0], moved, atol=0.01 * abs(step))
    assert max(moved) > 1.05 * abs(step) or min(moved) < -1.05 * abs(step)  # it swings


def _in_time(robot: Robot, settings: softcal.TimeSettings, times: np.ndarray, before: float, after: float):
    """plate.x (n,) after a step of tension, from rest at the tension before it."""
    live = softcal.LiveTwin(robot, "tension")
    place = live.at({"front": before})._place
    twin, theta = place.twin, place._steps.statics.theta
    k = list(channel_units(twin)).index("plate.x")
    dynamics = Dynamics(twin.system, robot_inertia(twin, robot), theta, settings.rayleigh)
    pulled = Controls(np.ones(2, dtype=bool), np.array([after, 0.0]), np.zeros(2))
    now, out = at_rest(place.reached.state), [sense(twin, place.reached.state, theta)[k]]
    for _ in times[1:]:
        now = dynamics.advance(now, settings.time_step, lambda time: pulled)
        out.append(sense(twin, now.state, theta)[k])
    dynamics.release()
    return np.array(out)


def test_mass_is_symmetric_and_moves_as_a_whole() -> None:
    robot = neck("P2P1")
    twin, _ = twin_and_theta(robot)
    system: System = twin.system
    state = rest_state(system.layout)
    M = mass_tangent(system, robot_inertia(twin, robot), state)
    dense = full_matrix(system, M)
    np.testing.assert_array_equal(dense, dense.T)
    assert np.linalg.eigvalsh(dense).min() > -1e-12 * np.abs(dense).max()
    # A translation along x of all that is free: what is clamped stays, with its share of the mass.
    move = np.zeros(system.layout.n_unknowns)
    move[0 : system.layout.first_frame_unknown : 3] = 1.0
    move[system.layout.first_frame_unknown] = 1.0
    n = system.layout.n_points
    moves = (system.motion.matrix(state) @ move[: system.layout.first_effort_unknown])[: 3 * n : 3]
    inertia = robot_inertia(twin, robot)
    expected = moves @ inertia.matrix @ moves + inertia.carried.mass[0]
    assert move @ dense @ move == pytest.approx(expected, rel=1e-12)
    assert inertia.matrix.sum() + inertia.carried.mass.sum() == pytest.approx(0.03**2 * 0.1 * 1200.0 + 0.05, rel=1e-12)


def test_the_system_is_a_state_space_and_a_file(tmp_path) -> None:
    found = softcal.linearise(neck(), {"front": 3.0}, settings=softcal.TimeSettings(0.01, 1e-3, 0.1), modes=3)
    space = found.state_space
    assert space.A.shape == (10, 10)
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(space.A)), np.sort_complex(found.poles), rtol=1e-9)
    first = 2.0 * np.pi * found.frequencies[0]
    assert abs(found.poles[0]) == pytest.approx(first, rel=1e-2)
    assert -found.poles[0].real / abs(found.poles[0]) == pytest.approx(found.damping_ratios[0], rel=1e-2)
    np.testing.assert_allclose(space.D - space.C @ np.linalg.solve(space.A, space.B), found.static_gain, atol=1e-12)
    with np.load(found.save(tmp_path / "linear")) as file:
        np.testing.assert_array_equal(file["A"], space.A)
        assert file["inputs"].tolist() == ["front.tension", "left.tension"]
        assert file["channels"].tolist() == list(found.channels)


def test_rates_are_in_both_files(tmp_path: Path) -> None:
    project = write_project(tmp_path, ("      fixed: foot\n", "      fixed: foot\n      density: 1100 kg/m^3\n"))
    found = softcal.linearise(project, modes=2, parameters=["bar.youngs_modulus"], out=tmp_path / "out")
    assert found.pole_rates.shape[1] == 1
    stored = json.loads((tmp_path / "out" / "linear.json").read_text())["system"]["pole_rates"]
    np.testing.assert_array_equal(np.array(stored) @ [1.0, 1j], found.pole_rates)
    np.testing.assert_array_equal(np.load(tmp_path / "out" / "linear.npz")["pole_rates"], found.pole_rates)


def test_what_has_no_linear_form_is_refused() -> None:
    with pytest.raises(ParameterError, match="nothing that moves has mass"):
        softcal.linearise(column_robot())
    via = (softcal.ViaPoint(np.array([0.05, 0.0, 0.1]), "plate"), *(softcal.ViaPoint(np.array(at)) for at in GUIDE))
    bent = softcal.Cable("front", via, friction_coefficient=0.2)
    for tension in (0.0, 1.0):
        with pytest.raises(SimulationError, match="Friction along cables has no linear form"):
            softcal.linearise(replace(neck(), cables=(bent,)), {"front": tension})
        remembers = replace(bent, line=softcal.CableLine(friction_memory=True))
        with pytest.raises(SimulationError, match="It has a memory"):
            softcal.linearise(replace(neck(), cables=(remembers,)), {"front": tension})
    with pytest.raises(ParameterError, match="too many modes"):
        softcal.linearise(neck(), modes=150)
    with pytest.raises(InputError, match="modes"):
        softcal.linearise(neck(), modes=0)
    with pytest.raises(ParameterError, match="middle"):
        softcal.linearise(neck(), {"middle": 1.0})


def test_the_command_prints_frequencies_and_writes_the_system(tmp_path: Path, capsys) -> None:
    path = write_project(tmp_path, ("      fixed: foot\n", "      fixed: foot\n      density: 1100 kg/m^3\n"))
    code, told, _ = run(capsys, "linearise", path, "--at", "front=3N", "--modes", "3", "--out", tmp_path / "linear")
    assert code == 0
    found = softcal.linearise(path, {"front": 3.0}, modes=3)
    assert f"{found.frequencies[0]:.4g} Hz" in told
    assert "Inputs: front.tension." in told
    assert "The static gain is within" in told
    with np.load(tmp_path / "linear" / "linear.npz") as file:
        np.testing.assert_allclose(file["frequencies"], found.frequencies, rtol=1e-9)
    stored = json.loads((tmp_path / "linear" / "linear.json").read_text())
    np.testing.assert_allclose(stored["system"]["stiffness"], found.stiffness, rtol=1e-9, atol=1e-9)
    assert len((tmp_path / "linear" / "modes.csv").read_text().split()) > 3
    code, told, _ = run(capsys, "linearise", path, "--at", "front=3mm")
    assert code == 0
    assert "There is no input" in told
    code, _, told = run(capsys, "linearise", path, "--at", "front=3")
    assert code == 2
    assert "--at: this is not a pull" in told
