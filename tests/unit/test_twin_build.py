"""From a robot to its system: loads that keep their sum, points on bodies and plates, what is refused, what is kept."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled

from softcal.errors import InputError, MeshError
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_quadratic
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.state import moved, rest_state
from softcal.twin.build import build_twin, twin_of
from softcal.twin.cables import RoutingAxis
from softcal.twin.parameters import parameter_values, with_parameters
from softcal.twin.robot import Body, Cable, PointLoad, Robot, SurfaceLoad, ViaPoint
from softcal.twin.simulate import simulate


def block(element="P1", **options):
    mesh = box_mesh((2.0, 3.0, 4.0), (1, 2, 2), order=options.pop("order", 1))
    return Body("block", mesh, fixed=mesh.node_sets["x0"], parameters=elastic(), element=element, **options)


@pytest.mark.parametrize("element", ELEMENTS)
def test_traction_adds_up_to_its_force_and_moment(element):
    body = block(element)
    load = SurfaceLoad("push", "block", body.mesh.face_sets["x1"], np.array([3.0, -1.0, 2.0]))
    robot = Robot((body,), loads=(load,))
    layout, loads = (system := build_twin(robot).system).layout, system.loads
    force = loads.total(parameter_values(robot))
    np.testing.assert_allclose(force.sum(axis=0), 12.0 * load.traction)
    centre = np.array([2.0, 1.5, 2.0])
    np.testing.assert_allclose(np.cross(layout.X, force).sum(axis=0), np.cross(centre, 12.0 * load.traction))


@pytest.mark.parametrize("element", ELEMENTS)
def test_weight_adds_up_to_its_mass_at_the_centroid(element):
    robot = Robot((block(element),), gravity=np.array([1.0, 2.0, -9.81]))
    layout, loads = (system := build_twin(robot).system).layout, system.loads
    weight = loads.total(parameter_values(robot, {"block.density": 1100.0}))
    np.testing.assert_allclose(weight.sum(axis=0), 1100.0 * 24.0 * robot.gravity)
    moment = np.cross([1.0, 1.5, 2.0], 1100.0 * 24.0 * robot.gravity)
    np.testing.assert_allclose(np.cross(layout.X, weight).sum(axis=0), moment)


@pytest.mark.parametrize("element", ELEMENTS)
def test_point_load_inside_a_body_keeps_force_and_moment(element):
    load = PointLoad("pin", "block", np.array([1.3, 0.7, 2.9]), np.array([1.0, -2.0, 0.5]))
    robot = Robot((block(element),), loads=(load,))
    system = build_twin(robot).system
    force = system.loads.total(parameter_values(robot))
    np.testing.assert_allclose(force.sum(axis=0), load.force)
    np.testing.assert_allclose(np.cross(system.layout.X, force).sum(axis=0), np.cross(load.at, load.force))


@pytest.mark.parametrize("element", ELEMENTS)
def test_via_point_on_a_body_moves_with_it(element):
    """Under an affine motion of the nodes it goes where the motion takes it."""
    at = np.array([0.003, -0.008, 0.041])
    cable = Cable("front", (ViaPoint(np.array([0.0, 0.0, 0.1]), "plate"), ViaPoint(at, "neck")))
    twin = build_twin(column_robot(element, divisions=(2, 2, 3), cables=(cable,)))
    A = np.array([[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.3, 0.0, 1.2]])
    x = twin.system.layout.X @ A.T
    found = sum(w * x[p] for p, w in twin.routes["front"][1])
    np.testing.assert_allclose(found, A @ at, atol=1e-14)


def test_points_on_the_plate_ride_on_it():
    twin = build_twin(column_robot("P1"))
    layout = twin.system.layout
    dz = np.zeros(layout.n_unknowns)
    dz[layout.first_frame_unknown : layout.first_frame_unknown + 6] = [0, 0, 0, 0, np.pi / 2, 0]
    state = moved(layout, rest_state(layout), dz)
    ((point, weight),) = twin.routes["front"][0]
    assert weight == 1.0
    np.testing.assert_allclose(state.x[point], [0.0, 0.0, 0.05], atol=1e-15)  # (50, 0, 0) mm turned about y


def test_linear_mesh_serves_quadratic_elements_and_the_other_way_round():
    linear = column_robot("P2", divisions=(1, 1, 3))
    (body,) = linear.bodies
    quadratic_mesh = to_quadratic(body.mesh)
    plate = replace(linear.plates[0], nodes={"neck": quadratic_mesh.node_sets["z1"]})
    for element in ("P1", "P2", "P2P1"):
        given = replace(linear, bodies=(replace(body, element=element),))
        other_body = replace(body, element=element, mesh=quadratic_mesh, fixed=quadratic_mesh.node_sets["z0"])
        other = replace(linear, bodies=(other_body,), plates=(plate,))
        one, two = (simulate(robot, pulled(0.02)).channels for robot in (given, other))
        for name, values in one.items():
            np.testing.assert_allclose(two[name], values, rtol=1e-7, atol=1e-11, err_msg=f"{element} {name}")


def test_socket_of_clamped_tets_costs_nothing_and_changes_nothing():
    """Tets whose nodes are all fixed cannot deform: leaving them out gives the same answer."""
    robot = column_robot("P2P1", divisions=(1, 1, 5))
    (body,) = robot.bodies
    deep = np.flatnonzero(body.mesh.points[:, 2] <= 0.02 + 1e-12)
    clamped = replace(robot, bodies=(replace(body, fixed=deep),))
    mesh = box_mesh((0.03, 0.03, 0.08), (1, 1, 4), origin=(-0.015, -0.015, 0.02))
    short_body = replace(body, mesh=mesh, fixed=mesh.node_sets["z0"])
    short = replace(
        robot, bodies=(short_body,), plates=(replace(robot.plates[0], nodes={"neck": mesh.node_sets["z1"]}),)
    )
    one, two = (simulate(r, pulled(0.03)).channels for r in (clamped, short))
    for name, values in one.items():
        np.testing.assert_allclose(two[name], values, rtol=1e-7, atol=1e-11, err_msg=name)
    assert build_twin(clamped).system.layout.n_pressures == build_twin(short).system.layout.n_pressures


def test_what_cannot_be_built_is_refused_by_name():
    robot = column_robot("P1")
    (body,), (plate,) = robot.bodies, robot.plates
    with pytest.raises(InputError, match=r"neck\.law: there is no such law; got 'ogden'; .* Try: 'ogden-"):
        build_twin(replace(robot, bodies=(replace(body, law="ogden"),)))
    with pytest.raises(InputError, match=r"neck\.element: there is no such element"):
        build_twin(replace(robot, bodies=(replace(body, element="Q1"),)))
    with pytest.raises(MeshError, match=r"neck: 9 node\(s\) are both fixed and tied to a plate"):
        build_twin(replace(robot, plates=(replace(plate, nodes={"neck": body.fixed}),)))
    with pytest.raises(MeshError, match="tied to two plates"):
        build_twin(replace(robot, plates=(plate, replace(plate, name="second"))))
    with pytest.raises(MeshError, match="the body is not attached"):
        build_twin(Robot((replace(body, fixed=np.zeros(0, dtype=int)),)))
    with pytest.raises(MeshError, match="front, via point 1: there is no such body, rod or plate; got 'lid'"):
        build_twin(replace(robot, cables=(Cable("front", (ViaPoint(np.zeros(3), "lid"), ViaPoint(np.ones(3)))),)))
    with pytest.raises(MeshError, match="front, via point 1"):
        build_twin(replace(robot, cables=(Cable("front", (ViaPoint(np.ones(3), "neck"), ViaPoint(2 * np.ones(3)))),)))
    with pytest.raises(MeshError, match="push: there is no such body"):
        build_twin(replace(robot, loads=(SurfaceLoad("push", "lid", np.array([[0, 1, 2]]), np.ones(3)),)))


def test_twin_is_kept_for_a_robot_and_made_anew_for_another_shape():
    robot = column_robot("P1", mass=0.1, density=1000.0, gravity=(0, 0, -9.81))
    kept = twin_of(robot)
    assert twin_of(robot, {"neck.youngs_modulus": 1e6, "front.friction_coefficient": 0.2}) is kept
    assert (
        twin_of(with_parameters(robot, {"neck.youngs_modulus": robot.bodies[0].parameters["youngs_modulus"]})) is kept
    )
    assert twin_of(replace(robot, gravity=np.array([0.0, 0.0, 9.81]))) is not kept
    cable = replace(robot.cables[0], routing_axis=RoutingAxis())
    routed = replace(robot, cables=(cable,))
    offset = f"{cable.name}.routing_offset"
    own, moved = twin_of(routed), twin_of(routed, {offset: 0.001})
    assert twin_of(routed, {offset: 0.0}) is own
    assert twin_of(routed, {offset: 0.001, "neck.density": 1.0}) is moved
    assert moved is not own
    assert moved.robot.cables[0].routing_offset == 0.001


def test_robots_that_are_gone_are_not_mistaken_for_new_ones():
    """A new robot may get the identity of one that was let go: the twins kept must keep their robots."""
    heights = np.linspace(0.05, 0.15, 40)
    for z in heights:
        robot = column_robot("P1")
        robot = replace(robot, plates=(replace(robot.plates[0], reference=np.array([0.0, 0.0, z])),))
        assert twin_of(robot).robot.plates[0].reference[2] == z
