"""Contact: what touches pushes with the right force, stays apart, and has exact derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from softcal.errors import MeshError, ParameterError
from softcal.geometry.centreline import helix, straight
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_quadratic
from softcal.geometry.section import RoundBar
from softcal.mechanics.contact import ONSET, ContactTerm
from softcal.mechanics.contact_kernels import push
from softcal.mechanics.state import moved
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls
from softcal.twin.barrier import Contact, wire_diameter
from softcal.twin.build import build_twin
from softcal.twin.contacts import disc_skin
from softcal.twin.in_time import simulate_in_time
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Snapshot
from softcal.twin.robot import Body, Cable, Disc, Marker, Plate, PointLoad, Robot, Rod, Tie, ViaPoint
from softcal.twin.schedule import Schedule
from softcal.twin.simulate import simulate
from softcal.twin.start import loaded
from softcal.twin.time_settings import TimeSettings

E, SIDE, APART = 1e6, 0.02, 1e-3
E_Z = np.array([0.0, 0.0, 1.0])
SOFT = {"youngs_modulus": E, "poissons_ratio": 0.0}


def two_blocks(element: str = "P2") -> Robot:
    """A block on a rigid plate that a cable lifts, along a guide, against a block that hangs from above."""
    low = box_mesh((SIDE, SIDE, SIDE), (3, 3, 3))
    high = box_mesh((SIDE, SIDE, SIDE), (4, 4, 4))
    high = TetMesh(high.points + [0.0, 0.0, SIDE + APART], high.tets)
    below = Body("below", low, [], SOFT, element=element)
    ceiling = np.flatnonzero(np.isclose(high.points[:, 2], 2 * SIDE + APART))
    above = Body("above", high, ceiling, SOFT, element=element)
    centre = np.array([SIDE / 2, SIDE / 2, 0.0])
    plate = Plate("lift", {"below": np.flatnonzero(low.points[:, 2] < 1e-9)}, centre)
    line = straight(tuple(centre - [0.0, 0.0, 0.1]), tuple(centre), 4)
    guide = Rod(
        "guide",
        line,
        RoundBar(0.02),
        {"youngs_modulus": 5e7, "poissons_ratio": 0.3},
        clamped={"lift": np.array([4])},
        fixed=np.array([0]),
    )
    pull = Cable("pull", (ViaPoint(centre + [0.0, 0.0, 0.1]), ViaPoint(centre, "lift")), pulled_end="first")
    return Robot((below, above), (plate,), (pull,), rods=(guide,), contact=Contact())


def lifted(*shortening: float) -> Protocol:
    return Protocol({"pull": Command("shortening", np.array(shortening))})


def spring(contact: bool, pitch: float = 0.008) -> Robot:
    """A helical spring of 6 mm wire that a cable beside its axis bends until its coils meet."""
    coil = helix((0, 0, 0), (0, 0, 1), diameter=0.03, pitch=pitch, turns=6, at=96, towards=(1, 0, 0))
    height = 6 * pitch
    rod = Rod(
        "spring",
        coil,
        RoundBar(0.006),
        {"youngs_modulus": 1e9, "poissons_ratio": 0.4},
        clamped={"top": np.array([96])},
        fixed=np.array([0]),
    )
    via = (ViaPoint(np.array([0.02, 0, 0])), ViaPoint(np.array([0.02, 0, height]), "top"))
    robot = Robot(
        plates=(Plate("top", {}, np.array([0, 0, height])),),
        rods=(rod,),
        cables=(Cable("pull", via, pulled_end="first"),),
    )
    return replace(robot, contact=Contact()) if contact else robot


@pytest.mark.slow
def test_two_blocks_press_with_the_exact_stress():
    """nu = 0: each is in uniaxial stress P = mu (stretch - 1/stretch), less what they overlap."""
    robot = two_blocks()
    d = np.array([0.0005, 0.002, 0.005])
    alone = simulate(replace(robot, contact=None), lifted(*d), curve_tolerance=0.0)
    response = simulate(robot, lifted(*d), curve_tolerance=0.0)
    assert response.succeeded, response.status
    force = response.channels["pull.tension"] - alone.channels["pull.tension"]
    assert abs(force[0]) < 1e-9  # not yet there
    stretch = 1.0 - (d[1:] - APART) / (2 * SIDE)
    exact = 0.5 * E * (1.0 / stretch - stretch) * SIDE**2
    np.testing.assert_allclose(force[1:], exact, rtol=1e-2)


@pytest.mark.parametrize("divisions", [2, 3])
def test_flush_blocks_that_touch_at_rest_press_as_blocks_beside_each_other(divisions: int):
    """With all points of one block moved rigidly into the other; at the edges, the core's triangles are smaller than
    the surface's.
    """
    forces = []
    for gap in (0.0, 1e-9, 1e-6):
        low, high = box_mesh((SIDE,) * 3, (2, 2, 2)), box_mesh((SIDE,) * 3, (divisions,) * 3, origin=(0, 0, SIDE + gap))
        bodies = [
            Body(name, mesh, mesh.node_sets["z0"], SOFT, element="P1") for name, mesh in (("low", low), ("high", high))
        ]
        twin = build_twin(Robot(tuple(bodies), contact=Contact(depth=4e-4, stiffness=E)))
        term = next(term for term in twin.system.terms if isinstance(term, ContactTerm))
        x, h = twin.system.layout.X.copy(), 1e-9
        assert term.stored(x, {}) == 0.0
        ends = []
        for overlap in (2e-4 + h, 2e-4 - h):
            moved_in = x.copy()
            moved_in[twin.first_point["high"] :] -= [0.0, 0.0, gap + overlap]
            ends.append(term.stored(moved_in, {}))
        forces.append((ends[0] - ends[1]) / (2.0 * h))
    np.testing.assert_allclose(forces, forces[-1], rtol=5e-3)
    np.testing.assert_allclose(
        forces, 2 * 0.5 * E * SIDE**2, rtol=0.05
    )  # the surfaces of both press, by half the depth


@pytest.mark.slow
def test_the_force_hardly_depends_on_the_depth():
    robot = two_blocks()
    errors = list[float]()
    exact_stretch = 1.0 - (0.004 - APART) / (2 * SIDE)
    exact = 0.5 * E * (1.0 / exact_stretch - exact_stretch) * SIDE**2
    alone = simulate(replace(robot, contact=None), lifted(0.004), curve_tolerance=0.0)
    contact = robot.fitted_contact
    assert contact is not None
    for factor in (1.0, 0.5):
        closer = replace(robot, contact=replace(contact, depth=factor * contact.depth))
        force = simulate(closer, lifted(0.004), curve_tolerance=0.0).channels["pull.tension"]
        errors.append(abs(float(force[0] - alone.channels["pull.tension"][0]) - exact) / exact)
    assert max(errors) < 1e-2
    assert errors[1] < errors[0]


@pytest.mark.slow
def test_coils_of_a_bent_spring_meet_and_stay_apart():
    d = np.linspace(0.0, 0.03, 4)
    free = simulate(spring(contact=False), lifted(*d), snapshots=True)
    robot = spring(contact=True)
    touching = simulate(robot, lifted(*d), snapshots=True)
    assert touching.succeeded, touching.status
    wire = wire_diameter(robot.rods[0])
    assert closest(robot, free.snapshots[-1].rods["spring"]) < 0.7 * wire
    assert min(closest(robot, shape.rods["spring"]) for shape in touching.snapshots) > wire
    # The same until they meet, and much stiffer after.
    np.testing.assert_allclose(touching.channels["pull.tension"][1], free.channels["pull.tension"][1], rtol=1e-4)
    assert touching.channels["pull.tension"][-1] > 3.0 * free.channels["pull.tension"][-1]


def closest(robot: Robot, axis: np.ndarray) -> float:
    """Smallest distance between points of the wire's axis at least three quarters of a turn apart."""
    from scipy.spatial.distance import cdist

    s = np.linspace(0, len(axis) - 1, 8 * len(axis))
    fine = np.stack([np.interp(s, np.arange(len(axis)), axis[:, i]) for i in range(3)], axis=1)
    along = np.interp(s, np.arange(len(axis)), robot.rods[0].centreline.stations)
    distance = cdist(fine, fine)
    return float(distance[np.abs(along[:, None] - along) > 0.07].min())


@pytest.mark.long
def test_rims_of_discs_meet_and_stay_apart():
    """A cable outside bends a backbone until the upper disc's rim meets the wider one below; then it pulls harder."""
    height, across, thick = 0.03, 0.05, 0.004
    line = straight((0, 0, 0), (0, 0, height), 12)
    material = {"youngs_modulus": 5e8, "poissons_ratio": 0.4}
    rod = Rod("back", line, RoundBar(0.003), material, clamped={"low": np.array([0]), "high": np.array([12])})
    plates = tuple(
        Plate(name, {}, np.array([0, 0, z]), fixed=name == "low", disc=Disc(wide, thick, E_Z))
        for name, z, wide in (("low", 0.0, 1.3 * across), ("high", height, across))
    )
    via = (ViaPoint(np.array([0.02, 0, -0.05])), ViaPoint(np.array([0.02, 0, 0]), "low"))
    via = (*via, ViaPoint(np.array([0.02, 0, height]), "high"))
    robot = Robot(plates=plates, rods=(rod,), cables=(Cable("pull", via, pulled_end="first"),))
    touching = replace(robot, contact=Contact())
    d = np.linspace(0.0, 0.024, 5)
    tension, rims = [], []
    for case in (robot, touching):
        response = simulate(case, lifted(*d), snapshots=True)
        assert response.succeeded, response.status
        tension.append(response.channels["pull.tension"][-1])
        rims.append(lowest_rim(response.snapshots[-1], plates[1]) - 0.5 * thick)
    assert rims[0] < -1e-3
    assert touching.fitted_contact is not None
    assert -touching.fitted_contact.depth < rims[1] < 0.0
    assert tension[1] > 1.5 * tension[0]


def lowest_rim(shape: Snapshot, plate: Plate) -> float:
    """Height of the lowest point of a disc's skin."""
    position, rotation = shape.plates[plate.name]
    assert plate.disc is not None
    skin, _ = disc_skin(plate.disc)
    return float((position + (skin - plate.reference) @ rotation.T)[:, 2].min())


def test_tangent_is_the_gradients_derivative_while_touching():
    robot = spring(contact=True)
    twin = build_twin(robot)
    theta = parameter_values(robot)
    statics = Statics(twin.system, theta)
    none = np.zeros(1)
    pressed = Controls(np.array([True]), none + 9.0, none)
    state = loaded(twin, statics).state
    for tension in np.linspace(0.5, 9.0, 18):
        solved = statics.equilibrium(state, Controls(np.array([True]), none + tension, none))
        assert solved.converged, solved.status
        state = solved.state
    at = twin.system.linearise(state, pressed, theta)
    assert at.touch is not None
    pattern, n = twin.system.pattern, len(twin.system.pattern.indptr) - 1
    upper = sp.csr_matrix((at.data, pattern.indices, pattern.indptr), shape=(n, n)) + at.touch
    K = upper + sp.triu(upper, 1).T
    d = np.append(np.random.default_rng(3).uniform(-1, 1, n) * 1e-6, 0.0)
    errors = []
    for h in (1.0, 0.5):
        ahead = twin.system.linearise(moved(twin.system.layout, state, h * d), pressed, theta, tangent=False)
        errors.append(np.linalg.norm((ahead.reduced - at.reduced)[:n] - h * (K @ d[:n])))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)
    statics.release()


def test_sensitivities_through_contact_are_exact():
    """Of the pose by a second spring's modulus: how far the coils that meet are pressed."""
    robot = two_springs()
    name = "upper.youngs_modulus"
    exact = simulate(robot, lifted(0.02), sensitivities=(name,), curve_tolerance=0.0)
    assert exact.succeeded, exact.status
    step = 2e5
    ends = [simulate(robot, lifted(0.02), {name: 1e9 + s * step}, curve_tolerance=0.0).channels for s in (1, -1)]
    for channel in ("pull.tension", "top.pitch", "top.z"):
        difference = (ends[0][channel] - ends[1][channel]) / (2 * step)
        np.testing.assert_allclose(exact.sensitivities[channel][name], difference, rtol=2e-5)


def two_springs() -> Robot:
    """The spring whose coils meet, and a longer one on top of it that the same cable bends."""
    lower = spring(contact=True)
    coil = helix((0, 0, 0.048), (0, 0, 1), diameter=0.03, pitch=0.014, turns=3, at=48, towards=(1, 0, 0))
    upper = Rod(
        "upper",
        coil,
        RoundBar(0.006),
        {"youngs_modulus": 1e9, "poissons_ratio": 0.4},
        clamped={"middle": np.array([0]), "top": np.array([48])},
    )
    rod = replace(lower.rods[0], clamped={"middle": np.array([96])})
    via = (*(ViaPoint(np.array([0.02, 0, z]), on) for z, on in ((0.0, ""), (0.048, "middle"), (0.09, "top"))),)
    return replace(
        lower,
        rods=(rod, upper),
        plates=tuple(Plate(name, {}, np.array([0, 0, z])) for name, z in (("middle", 0.048), ("top", 0.09))),
        cables=(Cable("pull", via, pulled_end="first"),),
    )


def test_what_overlaps_at_rest_is_refused():
    robot = two_blocks()
    high = robot.bodies[1]
    into = replace(high, mesh=TetMesh(high.mesh.points - [0.0, 0.0, 3 * APART], high.mesh.tets))
    with pytest.raises(MeshError, match="pass through each other at rest"):
        build_twin(replace(robot, bodies=(robot.bodies[0], into)))
    with pytest.raises(MeshError, match="allowed: more than 6 mm"):
        build_twin(spring(contact=True, pitch=0.005))


def test_tied_bodies_do_not_touch_at_their_seam_whatever_their_meshes_have():
    """Linear elements on meshes with middle nodes: the tie's nodes are the mesh's, the surfaces' the elements'."""
    low = to_quadratic(box_mesh((SIDE, SIDE, SIDE), (2, 2, 2)))
    high = to_quadratic(box_mesh((SIDE, SIDE, SIDE), (3, 3, 3), origin=(0.0, 0.0, SIDE)))
    seam = Tie("seam", "high", np.flatnonzero(np.isclose(high.points[:, 2], SIDE)), "low")
    below = Body("low", low, np.flatnonzero(low.points[:, 2] < 1e-9), SOFT, element="P1")
    robot = Robot(bodies=(below, Body("high", high, [], SOFT, element="P1")), ties=(seam,))
    twin = build_twin(replace(robot, contact=Contact()))
    system = twin.system
    (term,) = system.contacts
    pairs = replace(term, reach=np.full(len(term.reach), 2.0 * SIDE)).touching(term.X)
    nodes = term.points[term.weights.indices[term.weights.indptr[:-1]]]
    upper = nodes >= twin.first_point["high"]
    at_seam = np.abs(term.X[pairs.points, 2] - SIDE) < 1e-9
    assert upper.any()
    assert not np.any(at_seam & (upper[pairs.points] != upper[pairs.simplices[:, 0]]))
    assert term.overlap(system.layout.X) == 0.0


@pytest.mark.parametrize(("pull", "slides"), [(0.3, False), (0.8, True)])
def test_a_block_sticks_or_slides_on_a_floor_as_coulomb_says(pull, slides):
    """Weight W, friction coefficient 0.5: a pull of 0.3 W does not move it, one of 0.8 W does with 0.3 g."""
    density, g = 1000.0, 9.81
    floor = box_mesh((0.06, 0.04, 0.01), (3, 2, 1))
    block = box_mesh((0.02, 0.02, 0.01), (2, 2, 1))
    block = TetMesh(block.points + [0.01, 0.01, 0.01], block.tets)
    stiff = {"youngs_modulus": 1e7, "poissons_ratio": 0.3}
    weight = density * 4e-6 * g
    start = np.array([0.02, 0.02, 0.012])
    robot = Robot(
        bodies=(
            Body("floor", floor, np.arange(floor.n_points)[floor.points[:, 2] < 1e-9], stiff, element="P1"),
            Body("block", block, [], stiff, element="P1", density=density),
        ),
        loads=(PointLoad("tug", "block", start, np.array([pull * weight, 0.0, 0.0])),),
        markers=(Marker("middle", "block", start),),
        gravity=np.array([0.0, 0.0, -g]),
        contact=Contact(depth=2e-4, stiffness=2e5, friction_coefficient=0.5),
    )
    time = 0.04
    settings = TimeSettings(time_step=5e-4, rayleigh_stiffness=1e-3, start="undeformed")  # the first step rubs not yet
    response = simulate_in_time(robot, Schedule(np.array([0.0, time]), {}), settings)
    assert response.succeeded, response.status
    moved_by = response.channels["middle.x"][-1] - start[0]
    if slides:
        assert moved_by == pytest.approx(0.5 * 0.3 * g * time**2, rel=0.1)
    else:
        assert 0.0 <= moved_by < 1.1 * 1e-3 * time  # creep


def test_friction_without_time_is_refused():
    robot = spring(contact=True)
    assert robot.contact is not None
    with pytest.raises(ParameterError, match="depends on the load path"):
        simulate(replace(robot, contact=replace(robot.contact, friction_coefficient=0.2)), lifted(0.0))


def ridge(n: int) -> TetMesh:
    """A block whose upper side is a cylinder's, about y through x = 0: elements are the smaller the nearer to there."""
    mesh = to_quadratic(box_mesh((2.0, 1.0, 1.0), (n, 1, n // 3), origin=(-1.0, 0.0, 0.0)))
    x, y, z = mesh.points.T
    x, z = np.sign(x) * np.abs(x) ** 1.7, 1.0 - (1.0 - z) ** 1.6
    sagged = z - 0.5 * WIDE / ROUND * x**2 * z
    return TetMesh(np.column_stack([WIDE * x, WIDE * y, WIDE * sagged]), mesh.tets)


WIDE, ROUND = 0.01, 0.02  # half of the block's width, and the cylinder's radius [m]


def pressed_ridges(n: int) -> tuple[float, float]:
    """Half of the width of the contact of two cylinders [m], and Hertz's at the same force."""
    low = ridge(n)
    other = ridge(n + 4)
    high = TetMesh(other.points * [-1.0, 1.0, -1.0] + [0.0, 0.0, 2 * WIDE + 1e-5], other.tets)
    below = Body("below", low, [], SOFT, element="P2")
    above = Body("above", high, np.flatnonzero(high.points[:, 2] > 2 * WIDE + 0.9e-5), SOFT, element="P2")
    centre = np.array([0.0, 0.5 * WIDE, 0.0])
    plate = Plate("lift", {"below": np.flatnonzero(low.points[:, 2] < 1e-9)}, centre)
    line = straight(tuple(centre - [0.0, 0.0, 0.1]), tuple(centre), 4)
    material = {"youngs_modulus": 5e7, "poissons_ratio": 0.3}
    guide = Rod("guide", line, RoundBar(0.02), material, clamped={"lift": np.array([4])}, fixed=np.array([0]))
    pull = Cable("pull", (ViaPoint(centre + [0.0, 0.0, 0.1]), ViaPoint(centre, "lift")), pulled_end="first")
    robot = Robot((below, above), (plate,), (pull,), rods=(guide,), contact=Contact(depth=1.2e-4 / n, stiffness=8 * E))
    response = simulate(robot, lifted(1e-4), curve_tolerance=0.0, snapshots=True)
    assert response.succeeded, response.status
    twin = build_twin(robot)
    (term,) = twin.system.of(ContactTerm)
    x = twin.system.layout.X.copy()
    for name, points in response.snapshots[-1].points.items():
        x[twin.first_point[name] + np.arange(len(points))] = points
    V = term.vertices(x)
    force = np.abs(push_of(term, V)[: len(term.reach), 2])  # of the points of either, on the other's core
    width = 2.0 * np.sqrt(float(force @ V[: len(term.reach), 0] ** 2) / force.sum())
    load = force.sum() / WIDE
    return float(width), float(np.sqrt(4.0 * load * 0.5 * ROUND / (np.pi * 0.5 * E)))


def push_of(term: ContactTerm, V: np.ndarray) -> np.ndarray:
    """The gradient of the contact's energy by its vertices (n, 3) [N], of a stiffness without laws."""
    near = term.touching(V)
    scale = term.stiffness.factor * term.area[near.points] * near.shares
    return push(V, near.points, near.simplices, scale, term.reach[near.points], term.depth, ONSET * term.depth, False)[
        1
    ]


@pytest.mark.slow
def test_cylinders_press_as_hertz_says():
    """The width, by the second moment of the pressure, b^2 / 4, in plane strain at nu = 0; the meshes do not match."""
    errors = [abs(width / hertz - 1.0) for width, hertz in map(pressed_ridges, (12, 24))]
    assert errors[1] < 0.02
    assert errors[1] < 0.5 * errors[0]
