"""Rods with varied sections and materials, points on rods, and dead moments: closed forms and other models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.spatial.transform import Rotation

from softcal.errors import InputError, MeshError
from softcal.geometry.centreline import straight
from softcal.geometry.quality import check_quality
from softcal.geometry.section import RoundBar
from softcal.geometry.varied_section import VariedSection
from softcal.plugins.sofa.robot import scene_faults
from softcal.twin.barrier import Contact
from softcal.twin.material import Material
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Cable, Marker, Moment, Plate, PointLoad, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate
from softcal.twin.solid_rods import solid_body, with_solid_rods

E, NU, LENGTH, BASE, TIP = 1e6, 0.4, 0.3, 0.02, 0.008
TAPER = VariedSection((0.0, 1.0), (RoundBar(BASE), RoundBar(TIP)))


def rod(n: int, section: object = RoundBar(BASE), **given: object) -> Rod:
    line = straight((0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0), n, first=(0.0, 0.0, 1.0))
    parameters = {"youngs_modulus": E, "poissons_ratio": NU}
    return Rod("arm", line, section, parameters, fixed=np.array([0]), **given)


def tip_marker(**given: object) -> dict[str, object]:
    return {"markers": (Marker("tip", "arm", [LENGTH, 0.0, 0.0]),), **given}


def tip(robot: Robot, **given: object) -> np.ndarray:
    response = simulate(robot, Protocol({}), **given)
    assert response.succeeded, response.status
    return np.array([response.channels[f"tip.{axis}"][0] for axis in "xyz"])


def diameter(x: float) -> float:
    return BASE + (TIP - BASE) * x / LENGTH


@pytest.mark.parametrize("n", [1, 3])
def test_a_tapered_cantilever_under_a_small_force_is_exact_with_few_elements(n: int):
    force = 1e-6
    robot = Robot(
        rods=(rod(n, TAPER),), **tip_marker(), loads=(PointLoad("end", "arm", [LENGTH, 0, 0], [0, force, 0]),)
    )
    bending = quad(lambda x: (LENGTH - x) ** 2 / (E * np.pi * diameter(x) ** 4 / 64), 0, LENGTH, epsabs=0)[0]
    G, k = E / (2 * (1 + NU)), 6 * (1 + NU) / (7 + 6 * NU)
    shear = quad(lambda x: 1.0 / (k * G * np.pi * diameter(x) ** 2 / 4), 0, LENGTH, epsabs=0)[0]
    assert tip(robot)[1] == pytest.approx(force * (bending + shear), rel=1e-6)


def test_a_tapered_rod_weighs_what_its_cone_does_and_hangs_as_a_fine_one():
    cone = np.pi * LENGTH * (BASE**2 + BASE * TIP + TIP**2) / 12
    assert rod(5, TAPER).volumes.sum() == pytest.approx(cone, rel=1e-12)
    gravity = np.array([0.0, -9.81, 0.0])
    sags = [tip(Robot(rods=(rod(n, TAPER, density=200.0),), gravity=gravity, **tip_marker())) for n in (24, 96)]
    assert np.abs(sags[0] - sags[1]).max() < 2e-3 * np.abs(sags[1][1])


def test_a_rod_of_two_materials_bends_by_each_ones_stiffness():
    half = Material("soft", np.arange(2, 4), {"youngs_modulus": E / 4})
    robot = Robot(
        rods=(rod(4, inclusions=(half,)),), **tip_marker(), loads=(Moment("end", "arm", [0, 0, 1e-6], [LENGTH, 0, 0]),)
    )
    stiffness = E * np.pi * BASE**4 / 64
    turn = [1e-6 * 0.5 * LENGTH / stiffness, 4e-6 * 0.5 * LENGTH / stiffness]
    assert tip(robot)[1] == pytest.approx(turn[0] * 0.75 * LENGTH + turn[1] * 0.25 * LENGTH, rel=1e-6)
    found = simulate(robot, Protocol({}), sensitivities=("arm.soft.youngs_modulus",))
    step = 1e-4 * E
    at = [tip(robot, theta={"arm.soft.youngs_modulus": E / 4 + sign * step})[1] for sign in (1, -1)]
    assert found.sensitivities["tip.y"]["arm.soft.youngs_modulus"][0] == pytest.approx((at[0] - at[1]) / (2 * step))


@pytest.mark.parametrize("angle", [2.5, 2.0 * np.pi, 4.0 * np.pi])
def test_a_dead_moment_bends_a_rod_into_an_arc_a_circle_and_twice_round(angle: float):
    stiffness = E * np.pi * BASE**4 / 64
    moment = Moment("end", "arm", [0.0, 0.0, angle * stiffness / LENGTH], [LENGTH, 0.0, 0.0])
    radius = LENGTH / angle
    expected = [radius * np.sin(angle), radius * (1 - np.cos(angle)), 0.0]
    assert tip(Robot(rods=(rod(10),), **tip_marker(), loads=(moment,))) == pytest.approx(expected, abs=1e-9)


def test_a_dead_moment_about_an_oblique_axis_winds_a_rod_into_a_helix_of_two_turns():
    """The moment is constant along the rod, whose pose is an initial-value problem in arc length."""
    EI, GJ = E * np.pi * BASE**4 / 64, E / (2 * (1 + NU)) * np.pi * BASE**4 / 32
    moment = np.array([0.3, 0.4, 1.0]) * 4.0 * np.pi * EI / LENGTH / np.linalg.norm([0.3, 0.4, 1.0])
    straight_on = Rotation.from_matrix([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        section = Rotation.from_quat(y[3:])
        curvature = section.apply(section.inv().apply(moment) / [EI, EI, GJ])
        turning = np.append(y[6] * curvature + np.cross(curvature, y[3:6]), -(curvature @ y[3:6]))
        return np.append(section.apply([0.0, 0.0, 1.0]), 0.5 * turning)

    start = np.append(np.zeros(3), straight_on.as_quat())
    expected = solve_ivp(slope, (0.0, LENGTH), start, method="DOP853", rtol=1e-10, atol=1e-11).y[:3, -1]
    robot = Robot(rods=(rod(160),), **tip_marker(), loads=(Moment("end", "arm", moment, [LENGTH, 0.0, 0.0]),))
    assert np.linalg.norm(tip(robot) - expected) < 1e-4 * LENGTH


def spatial() -> Robot:
    """Moments about different axes with a force, by some radians."""
    size = E * np.pi * BASE**4 / 64 / LENGTH
    loads = (
        Moment("end", "arm", np.array([0.4, 0.6, 0.9]) * size, [LENGTH, 0.0, 0.0]),
        Moment("middle", "arm", np.array([-0.5, 0.8, -0.3]) * size, [0.45 * LENGTH, 0.0, 0.0]),
        PointLoad("force", "arm", [LENGTH, 0.0, 0.0], np.array([-0.5, 0.7, 0.8]) * size / LENGTH),
    )
    return Robot(rods=(rod(11),), **tip_marker(), loads=loads)


def test_the_tangent_of_dead_moments_is_exact_so_that_sensitivities_are():
    robot = spatial()
    names = ("end.moment", "middle.moment", "arm.youngs_modulus")
    found = simulate(robot, Protocol({}), sensitivities=names)
    for name in names:
        value = {"arm.youngs_modulus": E}.get(name) or float(
            np.linalg.norm(next(load.moment for load in robot.loads if f"{load.name}.moment" == name))
        )
        step = 1e-5 * value
        ends = [tip(robot, theta={name: value + sign * step}) for sign in (1, -1)]
        exact = [found.sensitivities[f"tip.{axis}"][name][0] for axis in "xyz"]
        slope = (ends[0] - ends[1]) / (2 * step)
        assert exact == pytest.approx(slope, abs=1e-6 * np.abs(slope).max())


def test_a_cable_on_a_rod_pulls_as_one_through_massless_plates_on_its_nodes():
    n, offset = 8, 0.006
    at = np.linspace(0.0, LENGTH, n + 1)
    on_rod = tuple(ViaPoint([x, offset, 0.0], "arm") for x in at)
    plates = tuple(Plate(f"p{i}", {}, [x, 0.0, 0.0]) for i, x in enumerate(at[1:], start=1))
    on_plates = (ViaPoint([0.0, offset, 0.0]), *(ViaPoint([x, offset, 0.0], f"p{i}") for i, x in enumerate(at) if i))
    pull = Protocol({"cable": Command("tension", np.array([0.3, 0.6]))})
    cable = Cable("cable", on_rod, pulled_end="first")
    one = Robot(rods=(rod(n),), cables=(cable,), **tip_marker())
    clamped = {f"p{i}": np.array([i]) for i in range(1, n + 1)}
    other = Robot(
        rods=(replace(rod(n), clamped=clamped),), plates=plates, cables=(replace(cable, via_points=on_plates),)
    )
    first = simulate(one, pull, curve_tolerance=0.0)
    second = simulate(other, pull, curve_tolerance=0.0)
    assert first.channels["cable.shortening"] == pytest.approx(second.channels["cable.shortening"], rel=1e-9)
    assert first.channels["tip.y"] == pytest.approx(second.channels[f"p{n}.y"], rel=1e-8)


def test_a_marker_between_two_nodes_errs_by_the_square_of_the_elements_length():
    where = [0.512 * LENGTH, 0.01, -0.004]
    errors: list[float] = []
    expected = None
    for n in (160, 10, 20):
        robot = replace(spatial(), rods=(rod(n),), markers=(Marker("tip", "arm", where),))
        found = tip(robot)
        expected = found if expected is None else expected
        errors.append(float(np.linalg.norm(found - expected)))
    assert errors[2] < 0.35 * errors[1] < 0.35 * 2e-3


def test_sofa_is_refused_a_rod_that_varies() -> None:
    told = {
        fault.what
        for fault in scene_faults(
            Robot(rods=(rod(6, TAPER, inclusions=(Material("soft", np.array([1]), {"youngs_modulus": 0.5 * E}),)),))
        )
    }
    assert any("whose section varies" in one for one in told)
    assert any("several materials" in one for one in told)
    assert not any("rod" in fault.what for fault in scene_faults(Robot(rods=(rod(6),))))


def test_a_taper_as_a_solid_has_its_cone_and_bends_as_it_does() -> None:
    held = rod(48, TAPER, clamped={"end": np.array([48])})
    robot = Robot(
        plates=(Plate("end", {}, np.array([LENGTH, 0.0, 0.0])),),
        rods=(held,),
        loads=(PointLoad("pull", "end", [LENGTH, 0.0, 0.0], [0.0, 1e-5, 0.0]),),
    )
    solid = with_solid_rods(robot)
    # One ring of tets leaves out 0.24 % of a circle.
    assert check_quality(solid.bodies[0].mesh).volume == pytest.approx(0.9976 * held.volumes.sum(), rel=1e-4)
    ends = [simulate(one, Protocol({})).channels["end.y"][0] for one in (robot, solid)]
    assert ends[1] == pytest.approx(ends[0], rel=0.01)


STEP = VariedSection((0.0, 0.5, 0.5, 1.0), (RoundBar(BASE), RoundBar(BASE), RoundBar(TIP), RoundBar(TIP)))
SOFT = (Material("soft", np.array([1]), {"youngs_modulus": 0.5 * E}),)


@pytest.mark.parametrize(
    ("made", "told"),
    [(rod(6, STEP), "a section with a step"), (rod(6, inclusions=SOFT), "several materials")],
)
def test_what_a_solid_cannot_have_is_refused(made: Rod, told: str) -> None:
    with pytest.raises(MeshError, match=told):
        solid_body(made)


def test_contact_is_refused_a_rod_that_varies() -> None:
    assert Robot(rods=(rod(6),), contact=Contact()).contact is not None
    with pytest.raises(InputError, match="a wire of one diameter"):
        Robot(rods=(rod(6, TAPER),), contact=Contact())
