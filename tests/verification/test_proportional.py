"""Robots whose forces are those of their materials: one load path serves every modulus, and every set of samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from mechanics_cases import column_robot

from softcal.geometry.shape import DrawnShape
from softcal.materials.catalogue import LAWS
from softcal.materials.law import Law
from softcal.materials.neo_hooke import NEO_HOOKE
from softcal.mechanics import path
from softcal.mechanics.node import Node
from softcal.mechanics.path import Path
from softcal.mechanics.path_limits import PathLimits
from softcal.mechanics.statics import Statics
from softcal.project.project import load
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensor import NamedSensor, Posture, PostureRates, Sensor
from softcal.twin.barrier import Contact
from softcal.twin.build import build_twin, twin_of
from softcal.twin.equilibrium_path import EquilibriumPath
from softcal.twin.parameters import parameter_values
from softcal.twin.proportional import at_own_moduli
from softcal.twin.response import Response
from softcal.twin.robot import PointLoad, Robot
from softcal.twin.simulate import simulate
from tests.verification.test_closing_grooves import COARSE, EXAMPLES, grooved, pulled, touching

NAMES = ("block.youngs_modulus", "block.poissons_ratio")


def afresh(robot: Robot) -> Robot:
    """An equal robot, of which no twin was built."""
    return replace(robot)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [grooved(), touching(grooved(across=COARSE))], ids=["bends", "touches itself"])
def test_a_path_at_another_modulus_costs_nothing(robot: Robot, monkeypatch: pytest.MonkeyPatch):
    """And gives the same to the last digits, with its derivatives, as one that is followed there."""
    samples = np.linspace(0.5e-3, 4e-3, 40)
    simulate(robot, pulled(*samples), sensitivities=NAMES)
    solved = list[int]()
    solve = Statics.equilibrium
    monkeypatch.setattr(Statics, "equilibrium", lambda *args: (solved.append(1), solve(*args))[1])
    theta = {"block.youngs_modulus": 0.37e6}
    again = simulate(robot, pulled(*samples), theta, sensitivities=NAMES)
    assert not solved
    fresh = simulate(afresh(robot), pulled(*samples), theta, sensitivities=NAMES)
    assert solved
    for channel, values in fresh.channels.items():
        assert np.array_equal(again.channels[channel], values)
        assert np.array_equal(again.slopes[channel], fresh.slopes[channel])
        for name in NAMES:
            assert np.array_equal(again.sensitivities[channel][name], fresh.sensitivities[channel][name])
    assert again.status == fresh.status
    assert again.n_factorisations == fresh.n_factorisations


@pytest.mark.parametrize(
    ("name", "own"), [("gravity.gx", {"density": 900.0}), ("plate.mass", {"gravity": (3.0, 0.0, -9.0)})]
)
def test_a_weight_that_the_robot_has_not_bends_a_stiffer_one_less(name: str, own: dict[str, Any]):
    """The derivative by a weight that is zero, of a path that was followed at another modulus."""
    robot, samples, theta = column_robot(**own), (2e-3, 8e-3), {"neck.youngs_modulus": 0.4e6}
    found = simulate(robot, pulled(*samples), theta, sensitivities=(name,))
    h = 1e-3
    less, more = (simulate(robot, pulled(*samples), {**theta, name: h * sign}) for sign in (0.0, 1.0))
    for channel in ("front.tension", "plate.pitch"):
        slope = (more.channels[channel] - less.channels[channel]) / h
        assert np.abs(slope).max() > 0.0
        np.testing.assert_allclose(found.sensitivities[channel][name], slope, rtol=1e-2)


def test_shapes_at_another_modulus_have_the_forces_of_a_fresh_path():
    robot, samples, theta = (
        touching(grooved(element="P2P1", across=COARSE)),
        (1e-3, 3e-3),
        {"block.youngs_modulus": 0.37e6},
    )
    simulate(robot, pulled(*samples), snapshots=True)
    again, fresh = (simulate(one, pulled(*samples), theta, snapshots=True) for one in (robot, afresh(robot)))
    assert len(again.snapshots) == len(fresh.snapshots) > 2
    for one, other in zip(again.snapshots, fresh.snapshots, strict=True):
        assert one.efforts == other.efforts
        for values, others in ((one.pressures, other.pressures), (one.points, other.points)):
            for name in others:
                np.testing.assert_array_equal(values[name], others[name])
    here = simulate(robot, pulled(*samples), snapshots=True).snapshots[-1]
    assert fresh.snapshots[-1].efforts["front"] != pytest.approx(here.efforts["front"], rel=0.1)


@pytest.mark.long
def test_other_samples_are_those_of_a_fresh_path():
    """Of linear tets the walls of the groove rest at several places, and which depends on the nodes before."""
    robot, samples = touching(grooved(element="P2P1", across=(8, 1))), np.linspace(0.2e-3, 4e-3, 25)
    simulate(robot, pulled(*samples), sensitivities=NAMES)
    later = pulled(*(samples - 0.13e-3))
    again, fresh = (simulate(one, later, sensitivities=NAMES) for one in (robot, afresh(robot)))
    for channel, values in fresh.channels.items():
        assert np.array_equal(again.channels[channel], values)


def test_shared_paths_end_at_the_same_place(monkeypatch: pytest.MonkeyPatch):
    """A little beyond their samples: another slack needs no further equilibrium, and all samples are as close."""
    robot, samples = grooved(), np.linspace(0.2e-3, 3.9e-3, 60)
    simulate(robot, pulled(*samples), sensitivities=NAMES, shared=True)
    later = pulled(*(samples - 0.02e-3))
    solved = list[int]()
    solve = Statics.equilibrium
    monkeypatch.setattr(Statics, "equilibrium", lambda *args: (solved.append(1), solve(*args))[1])
    shared = simulate(robot, later, sensitivities=NAMES, shared=True)
    assert not solved
    exact = simulate(afresh(robot), later, curve_tolerance=0.0)
    for channel in ("front.tension", "top.pitch"):
        most = np.abs(exact.channels[channel]).max()
        np.testing.assert_allclose(shared.channels[channel], exact.channels[channel], rtol=0, atol=1e-4 * most)


SOFTER = {"block.poissons_ratio": 0.3}
AT_REST = 5e-3  # of the largest value: walls that have met rest at several places, by the path that leads there


def require_close(response: Response, other: Response, share: float) -> None:
    """Tension and pitch agree within a share of their largest values."""
    for channel in ("front.tension", "top.pitch"):
        values = other.channels[channel]
        np.testing.assert_allclose(response.channels[channel], values, rtol=0, atol=share * np.abs(values).max())


@pytest.mark.slow
def test_shared_paths_in_contact_have_the_same_nodes(monkeypatch: pytest.MonkeyPatch):
    """To whichever shortening, and at other parameters those of the robot's own, whatever was simulated before."""
    robot, samples = touching(grooved(across=COARSE)), np.linspace(0.2e-3, 4e-3, 20)
    shared = simulate(robot, pulled(*samples), SOFTER, sensitivities=NAMES, shared=True)
    require_close(shared, simulate(afresh(robot), pulled(*samples), SOFTER, curve_tolerance=0.0), AT_REST)
    other = afresh(robot)
    for ratio in (0.45, 0.4):
        simulate(other, pulled(*samples), {"block.poissons_ratio": ratio}, sensitivities=NAMES, shared=True)
    later = simulate(other, pulled(*samples), SOFTER, sensitivities=NAMES, shared=True)
    assert later.n_factorisations == shared.n_factorisations
    require_close(later, shared, 1e-8)
    solved = list[int]()
    solve = Statics.equilibrium
    monkeypatch.setattr(Statics, "equilibrium", lambda *args: (solved.append(1), solve(*args))[1])
    nearer = pulled(*(0.99 * samples))
    again = simulate(robot, nearer, SOFTER, sensitivities=NAMES, shared=True, curve_tolerance=0.1)
    assert not solved
    require_close(again, simulate(afresh(robot), nearer, SOFTER), 0.1)


@pytest.mark.long
def test_a_shared_path_in_contact_takes_fewer_factorisations():
    """At another ratio of the shipped neck, beside the path at its own."""
    robot = load(EXAMPLES / "neck" / "project.yaml").robot
    softer, rough = {"neck.poissons_ratio": 0.48}, {"curve_tolerance": 0.1}
    by_itself = simulate(afresh(robot), pulled(0.05), softer, **rough)
    shared = simulate(robot, pulled(0.05), softer, shared=True, **rough)
    assert shared.n_factorisations < 0.7 * by_itself.n_factorisations
    for channel in ("front.tension", "plate.pitch"):
        np.testing.assert_allclose(shared.channels[channel], by_itself.channels[channel], rtol=5e-3)


def test_a_path_of_another_shape_is_followed_by_itself():
    """Beside states of the own shape, its surfaces might have passed through each other."""
    robot = grooved(across=COARSE)
    (body,) = robot.bodies
    robot = touching(replace(robot, bodies=(replace(body, shape=DrawnShape()),)))
    samples, wider = np.linspace(0.2e-3, 4e-3, 20), {"block.scale": 1.02}
    shared, alone = (simulate(afresh(robot), pulled(*samples), wider, shared=shared) for shared in (True, False))
    require_close(shared, alone, AT_REST)


def test_a_shared_path_goes_on_by_itself_where_that_at_the_own_parameters_is_no_guide(monkeypatch: pytest.MonkeyPatch):
    robot, samples = touching(grooved(across=COARSE)), np.linspace(0.2e-3, 4e-3, 20)
    guided = list[Node]()
    monkeypatch.setattr(path._Continuation, "_beside", lambda self, there: guided.append(there))
    shared, again = (simulate(robot, pulled(*samples), SOFTER, shared=True) for _ in range(2))
    assert len(guided) == 1
    assert again.n_factorisations == shared.n_factorisations
    require_close(shared, simulate(afresh(robot), pulled(*samples), SOFTER), AT_REST)


def test_a_shared_path_in_contact_ends_at_its_samples_where_the_robot_gets_no_further(monkeypatch: pytest.MonkeyPatch):
    """And does not go beyond again for later samples."""
    robot, samples = touching(grooved(across=COARSE)), np.linspace(0.2e-3, 4e-3, 20)
    own = simulate(afresh(robot), pulled(*samples))
    beyond = list[float]()
    follow = EquilibriumPath.follow

    def no_further(self: EquilibriumPath, start: Node, end: float, **options: Any) -> Path:
        way = follow(self, start, end, **options)
        if "past" not in options:
            return way
        beyond.append(options["past"])
        return replace(way, nodes=way.nodes[:-1], reached=False, status="a limit")

    monkeypatch.setattr(EquilibriumPath, "follow", no_further)
    for _ in range(2):
        shared = simulate(robot, pulled(*samples), shared=True)
        assert shared.succeeded
        require_close(shared, own, AT_REST)
    assert beyond == [samples.max()]


def test_a_shared_path_ends_at_its_samples_where_the_robot_gets_no_further():
    """One that would pass a limit of its work beyond them."""
    robot, samples = grooved(), np.linspace(0.2e-3, 4e-3, 20)
    whole = simulate(robot, pulled(*samples), shared=True)
    n = simulate(afresh(robot), pulled(*samples)).n_factorisations
    limited = replace(robot, limits=PathLimits(factorisations=1))
    assert whole.succeeded
    assert n > 1
    failed = simulate(limited, pulled(*samples), shared=True)
    assert not failed.succeeded
    assert failed.status == simulate(afresh(limited), pulled(*samples)).status


def test_derivatives_at_another_modulus_are_those_of_finite_differences():
    robot, protocol, E = touching(grooved(element="P2P1", across=COARSE)), pulled(1e-3, 3e-3), 3.1e6
    at = {"block.youngs_modulus": E}
    exact = simulate(robot, protocol, at, sensitivities=NAMES)
    for name, value in zip(NAMES, (E, 0.4), strict=True):
        h = 2e-4 * value
        # Every sample solved: between nodes that differ from one value to the other, curves differ by their own error.
        changed = ({**at, name: value + s * h} for s in (1, -1))
        ahead, behind = (simulate(robot, protocol, theta, curve_tolerance=0.0) for theta in changed)
        for channel in ("front.tension", "top.pitch"):
            difference = (ahead.channels[channel] - behind.channels[channel]) / (2 * h)
            rounding = 1e-8 * abs(ahead.channels[channel]).max() / value
            np.testing.assert_allclose(exact.sensitivities[channel][name], difference, rtol=2e-3, atol=rounding)


def factor(robot: Robot) -> float:
    """Of the moduli, at twice the robot's own."""
    theta = parameter_values(robot)
    twice = {name: 2.0 * value if name.endswith("youngs_modulus") else value for name, value in theta.items()}
    return at_own_moduli(build_twin(robot), twice)[1]


def test_the_derivative_by_the_only_modulus_follows_from_the_forces(monkeypatch: pytest.MonkeyPatch):
    """In the order of the names; no equilibrium is differentiated by it."""
    by = list[tuple[str, ...]]()
    kept = Statics.kept_node
    monkeypatch.setattr(Statics, "kept_node", lambda one, key, names: (by.append(names), kept(one, key, names))[1])
    modulus, ratio = NAMES
    response = simulate(grooved(), pulled(1e-3, 2e-3), {modulus: 0.5e6}, sensitivities=(ratio, modulus))
    assert set(by) == {(ratio,)}
    assert list(response.sensitivities["front.tension"]) == [ratio, modulus]
    tension, pitch = response.channels["front.tension"], response.sensitivities["top.pitch"]
    np.testing.assert_allclose(response.sensitivities["front.tension"][modulus], tension / 0.5e6, rtol=1e-14)
    assert not pitch[modulus].any()


def test_only_what_is_proportional_is_scaled():
    robot = grooved()
    (body,), (cable,) = robot.bodies, robot.cables
    heavy = replace(robot, bodies=(replace(body, density=1000.0),))
    down = np.array([0.0, 0.0, -9.81])
    assert factor(robot) == factor(replace(robot, gravity=down)) == factor(heavy) == factor(touching(robot)) == 2.0
    force = PointLoad("push", "block", body.mesh.points[-1], np.array([0.1, 0.0, 0.0]))
    stretches = replace(cable, line=replace(cable.line, stiffness=1e4))
    for other in (
        replace(heavy, gravity=down),
        replace(robot, loads=(force,)),
        replace(robot, cables=(stretches,)),
        replace(robot, contact=Contact(stiffness=1e6)),
    ):
        assert factor(other) == 1.0


@dataclass(frozen=True)
class Share(Sensor):
    """A channel in a unit that no part of softcal has."""

    name = "share"
    kinds = (ChannelKind("share", "N/m"),)
    cable: str = "front"

    def sense(self, robot: Posture) -> list[float]:
        return [robot.effort(self.cable)]

    def rates(self, robot: Posture, moving: PostureRates) -> list[np.ndarray]:
        return [moving.effort(self.cable)]


def test_sensors_of_other_makers_read_what_is_solved():
    robot = replace(grooved(), sensors=(NamedSensor("own", Share()),))
    response = simulate(robot, pulled(1e-3), {"block.youngs_modulus": 2e6})
    np.testing.assert_array_equal(response.channels["own.share"], response.channels["front.tension"])
    assert factor(robot) == 1.0


def test_a_law_with_a_force_of_its_own_is_not_proportional():
    theta = {"youngs_modulus": 1e6, "poissons_ratio": 0.4}
    own = replace(NEO_HOOKE, name="own", distortional=f"({NEO_HOOKE.distortional}) + 1e4*(I1 - 3)")
    assert NEO_HOOKE.is_proportional(theta)
    assert not own.is_proportional(theta)
    assert not replace(NEO_HOOKE, name="own", bulk=f"({NEO_HOOKE.bulk}) + 1e4").is_proportional(theta)


@pytest.mark.parametrize("name", list(LAWS))
def test_every_law_of_the_catalogue_is_proportional(name: str):
    law: Law = LAWS.named(name)
    theta = {p.name: 1e6 * (1 + k) if p.quantity.unit == "Pa" else 0.3 + 0.01 * k for k, p in enumerate(law.parameters)}
    theta |= {p.name: 3.0 for p in law.parameters if p.quantity.upper > 10.0 and p.quantity.unit == "1"}
    assert law.is_proportional(theta)


def test_nodes_are_kept_within_their_room():
    twin = twin_of(grooved())
    for k in range(4):
        simulate(twin.robot, pulled(1e-3), {"block.poissons_ratio": 0.3 + 0.02 * k})
    sizes = [nodes.size for nodes in twin.kept._at.values()]
    assert len(sizes) == 4
    twin.kept.room = 2.5 * max(sizes)
    simulate(twin.robot, pulled(1e-3), {"block.poissons_ratio": 0.45})
    assert 1 <= len(twin.kept._at) <= 3
