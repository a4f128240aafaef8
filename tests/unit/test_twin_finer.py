"""The robot on finer discretisations: held, tied, loaded and run through in the same places."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, irregular_box, pulled, side_cable
from sweep_case import robot as manipulator_robot

from softcal.errors import MeshError
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quality import check_quality
from softcal.geometry.surface import boundary_faces
from softcal.twin.build import build_twin
from softcal.twin.finer import elevated, halved, size
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Marker, Plate, PointLoad, Robot, SurfaceLoad, Tie
from softcal.twin.simulate import simulate

E = 1.0e6


def stretched_box(element: str, order: int) -> Robot:
    """A bar on a foot, pulled by a traction on its top: with next to no Poisson's ratio it stretches evenly."""
    mesh = irregular_box((0.02, 0.02, 0.05), (2, 2, 3), "P1" if order == 1 else "P2")
    body = Body("bar", mesh, mesh.node_sets["z0"], {"youngs_modulus": E, "poissons_ratio": 1e-5}, element=element)
    load = SurfaceLoad("pull", "bar", mesh.face_sets["z1"], np.array([0.0, 0.0, 5e4]))
    return Robot((body,), loads=(load,), markers=(Marker("top", "bar", np.array([0.012, 0.007, 0.05])),))


@pytest.mark.parametrize(("element", "order"), [("P1", 1), ("P1", 2), ("P2", 2), ("P2P1", 1), ("P2P1", 2)])
def test_uniform_stretch_is_exact_on_every_mesh(element: str, order: int):
    robot = stretched_box(element, order)
    again = [halved(halved(robot))] if order == 1 and element == "P1" else []
    found = [simulate(r, Protocol({})) for r in (robot, halved(robot), *again)]
    assert all(one.succeeded for one in found)
    places = [one.channels["top.z"][0] for one in found]
    assert places[0] > 0.052
    assert places[1:] == pytest.approx([places[0]] * len(places[1:]), rel=1e-7)


def test_what_is_held_tied_and_loaded_is_refined():
    robot = tied_bars()
    fine = halved(robot)
    for body in fine.bodies:
        z = body.mesh.points[:, 2]
        foot = np.flatnonzero(np.abs(z) < 1e-12)
        assert np.array_equal(np.sort(body.fixed), foot if body.name == "lower" else [])
        assert set(body.mesh.node_sets) == {"x0", "x1", "y0", "y1", "z0", "z1"}
    upper = fine.bodies[1].mesh
    top, seam = (np.flatnonzero(np.abs(upper.points[:, 2] - z) < 1e-12) for z in (0.08, 0.04))
    assert np.array_equal(np.sort(fine.plates[0].nodes["upper"]), top)
    assert np.array_equal(np.sort(fine.ties[0].nodes), seam)
    assert len(fine.loads[1].faces) == 4 * len(robot.loads[1].faces)
    sides = {tuple(sorted(face)) for face in boundary_faces(upper)[:, :3].tolist()}
    assert {tuple(sorted(face)) for face in fine.loads[1].faces[:, :3].tolist()} <= sides
    assert simulate(fine, pulled(0.001, 0.004)).succeeded


def tied_bars() -> Robot:
    """Two bars whose meshes do not match, the upper a tenth of a millimetre off the lower."""
    lower = box_mesh((0.02, 0.02, 0.04), (2, 2, 3), origin=(-0.01, -0.01, 0.0))
    upper = box_mesh((0.018, 0.018, 0.04), (3, 3, 3), origin=(-0.009, -0.009, 0.04))
    elastic = {"youngs_modulus": 1e6, "poissons_ratio": 0.4}
    bodies = (
        Body("lower", lower, lower.node_sets["z0"], elastic, element="P1"),
        Body("upper", upper, np.zeros(0, dtype=int), elastic, element="P1"),
    )
    plate = Plate("plate", {"upper": upper.node_sets["z1"]}, np.array([0.0, 0.0, 0.08]))
    loads = (
        PointLoad("weight", "plate", np.array([0.0, 0.0, 0.08]), np.array([0.0, 0.0, -0.01])),
        SurfaceLoad("wind", "upper", upper.face_sets["x0"], np.array([10.0, 0.0, 0.0])),
    )
    tie = Tie("seam", "upper", upper.node_sets["z0"], "lower")
    return Robot(bodies, (plate,), (side_cable("front", (0.03, 0.0), 0.08),), loads, ties=(tie,))


def test_a_tie_across_a_gap_still_holds_on_the_finer_mesh():
    robot = tied_bars()
    upper = robot.bodies[1].mesh
    # Within a quarter of the coarse edge, 3.8 mm, and beyond that of the fine one.
    moved = replace(robot.bodies[1], mesh=replace(upper, points=upper.points + [0.0, 0.0, 0.003]))
    robot = replace(robot, bodies=(robot.bodies[0], moved))
    build_twin(robot)
    build_twin(halved(halved(robot)))
    with pytest.raises(MeshError, match="the tie touches nothing"):
        build_twin(replace(halved(robot), ties=(replace(halved(robot).ties[0], tolerance=None),)))


@pytest.mark.parametrize("element", ["P1", "P2", "P2P1"])
def test_the_size_is_known_before_anything_is_made(element: str):
    robot = column_robot(element)
    twin = build_twin(robot)
    assert size(robot).unknowns == 3 * twin.meshes["neck"].n_points + twin.system.layout.n_pressures
    assert size(robot).unknowns > twin.system.layout.n_unknowns  # those that are held are none
    assert size(robot, 1) == size(halved(robot))
    assert size(robot, 2) == size(halved(halved(robot)))


def test_a_column_gets_softer_with_every_halving_and_with_higher_elements():
    def tension(robot: Robot) -> float:
        return float(simulate(robot, pulled(0.005)).channels["front.tension"][-1])

    robot = column_robot("P1")
    once, twice = halved(robot), halved(halved(robot))
    coarse, fine, finest, raised = (tension(one) for one in (robot, once, twice, elevated(robot, "P2P1")))
    assert coarse > fine > finest > 0.95 * raised
    assert raised < 0.8 * coarse


def test_only_lower_elements_are_raised():
    robot = tied_bars()
    mixed = replace(robot, bodies=(replace(robot.bodies[0], element="P2P1"), robot.bodies[1]))
    assert [body.element for body in elevated(mixed, "P2").bodies] == ["P2P1", "P2"]


def test_halved_rods_are_those_made_with_twice_the_elements():
    def tip(one: Robot) -> list[float]:
        response = simulate(one, Protocol({"cable1": Command("tension", np.array([6.0]))}))
        return [response.channels[f"marker2.{axis}"][0] for axis in "xyz"]

    robot, fine = manipulator_robot(), manipulator_robot(elements_per_turn=12)
    assert size(halved(robot)) == size(robot, 1) == size(fine)
    assert size(fine).rod_elements == 48
    assert tip(halved(robot)) == pytest.approx(tip(fine), abs=1e-9)
    assert tip(robot) != pytest.approx(tip(fine), abs=1e-5)


def test_the_refined_body_fills_the_same():
    robot = column_robot("P2P1")
    before, after = (check_quality(r.bodies[0].mesh) for r in (robot, halved(robot)))
    assert after.volume == pytest.approx(before.volume, rel=1e-12)
