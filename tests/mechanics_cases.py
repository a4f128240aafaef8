"""Small robots and the few steps around the engine that the tests of the mechanics share."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quality import drop_unreferenced
from softcal.geometry.surface import boundary_faces
from softcal.materials.law import Law
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.loads import Loads
from softcal.mechanics.state import State, rest_state
from softcal.mechanics.system import Linearisation, System
from softcal.mechanics.term import Controls, Given
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.chamber import Chamber
from softcal.twin.build import Twin, build_twin
from softcal.twin.material import Winding
from softcal.twin.parameters import parameter_values, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint
from softcal.twin.simulate import simulate

NONE: dict[str, float] = {}
SHARED = Path(__file__).resolve().parents[1] / ".." / "shared"


def shared_json(name: str) -> dict:
    """A file of ../shared/data/sofa, or a skip that says that it is not there."""
    path = SHARED / "data" / "sofa" / name
    if not path.exists():
        pytest.skip(f"{path.name} is not here: ../shared is absent")
    return json.loads(path.read_text())


def irregular_box(
    lengths: Sequence[float], divisions: Sequence[int], element: str, *, shift: float = 0.2, seed: int = 0
) -> TetMesh:
    """A box whose inner corners are moved by up to `shift` times the brick's edges; sides as node and face sets."""
    mesh = box_mesh(lengths, divisions)
    edges = np.array(lengths) / np.array(divisions)
    inner = np.setdiff1d(np.arange(mesh.n_points), boundary_faces(mesh))
    points = mesh.points.copy()
    points[inner] += shift * edges * np.random.default_rng(seed).uniform(-1.0, 1.0, (len(inner), 3))
    mesh = TetMesh(points, mesh.tets, dict(mesh.node_sets), dict(mesh.face_sets))
    return ELEMENTS[element].mesh(mesh)


def elastic(E: float = 1.0e6, nu: float = 0.3) -> dict[str, float]:
    return {"youngs_modulus": E, "poissons_ratio": nu}


def constants(law: Law, E: float = 1.0e6, nu: float = 0.3) -> dict[str, float]:
    """The law's constants at which its moduli at small strain are these: its typical ones, scaled."""
    typical = {one.name: one.typical for one in law.parameters}
    factor = 0.5 * E / (1.0 + nu) / law.shear_modulus(typical)
    scaled = {one.name: one.typical * (factor if one.quantity.unit == "Pa" else 1.0) for one in law.parameters}
    if set(elastic()) <= set(law.names):
        return {**scaled, **elastic(E, nu)}
    return {**scaled, "bulk_modulus": E / (3.0 * (1.0 - 2.0 * nu))}


def solid_system(mesh: TetMesh, element: str, law: Law, fixed: np.ndarray, force: np.ndarray | None = None) -> System:
    """One body "body" without plates or cables, the nodes `fixed` prescribed, forces (n_points, 3) [N] on the rest.

    Fixed points stay where a state has them, so prescribing a displacement is moving them in the state.
    """
    parallel = Winding(0.0, (0.0, 0.0, 0.0), (0.0, 0.6, 0.8)) if law.n_directions > 1 else None
    body = Body("body", mesh, fixed=fixed, parameters=constants(law), law=law.name, element=element, winding=parallel)
    system = build_twin(Robot((body,))).system
    others = tuple(term for term in system.terms if term is not system.loads)
    return replace(system, terms=(*others, Loads(np.zeros((mesh.n_points, 3)) if force is None else force, {})))


def body_theta(parameters: Mapping[str, float]) -> dict[str, float]:
    return {f"body.{name}": value for name, value in parameters.items()}


def placed(system: System, x: np.ndarray) -> State:
    """The rest state with its points put elsewhere."""
    return replace(rest_state(system.layout), x=np.array(x))


def held(n_cables: int = 0, tension: float = 0.0) -> Controls:
    """Every cable's tension given."""
    return Controls(np.ones(n_cables, dtype=bool), np.full(n_cables, tension), np.zeros(n_cables))


def potential(system: System, state: State, controls: Controls, theta: Mapping[str, float]) -> float:
    """The total potential [J], whose gradient and tangent `System.linearise` gives."""
    return sum(term.energy(Given(state, controls, theta)) for term in system.terms)


def full_matrix(system: System, at: Linearisation) -> np.ndarray:
    """The tangent on all unknowns as a dense matrix: symmetric but for the cables' friction."""
    import scipy.sparse as sp

    layout, border = system.layout, at.border
    n = layout.first_effort_unknown
    upper = sp.csr_matrix((at.data, system.pattern.indices, system.pattern.indptr), shape=(n, n)).toarray()
    K = np.zeros((layout.n_unknowns, layout.n_unknowns))
    K[:n, :n] = upper + np.triu(upper, 1).T
    n_taut = len(border.driven)
    if len(border.corner):
        K[:n, n + border.driven] = border.columns[:, :n_taut]
        K[n + border.driven, :n] = border.rows[:, :n_taut].T
        K[np.ix_(n + border.driven, n + border.driven)] = border.corner[:n_taut, :n_taut]
        K[:n, :n] += border.columns[:, n_taut:] @ border.rows[:, n_taut:].T
    return K


def blown_box(element: str, *, is_open: bool, medium: str) -> Robot:
    """A thick box with a cavity, which is a chamber."""
    mesh = box_mesh((0.04,) * 3, (3, 3, 3 + is_open), origin=(-0.02,) * 3)
    middle = mesh.points[mesh.tets].mean(axis=1)
    inside = (np.abs(middle[:, :2]) < 0.02 / 3).all(axis=1) & (middle[:, 2] > -0.01)
    inside &= is_open | (middle[:, 2] < 0.02 / 3)
    mesh = drop_unreferenced(TetMesh(mesh.points, mesh.tets[~inside], {"foot": mesh.node_sets["z0"]}))
    faces = boundary_faces(mesh)
    wall = faces[(np.abs(mesh.points[faces].mean(axis=1)) < [0.007, 0.007, 0.0199]).all(axis=1)]
    body = Body("box", mesh, mesh.node_sets["foot"], elastic(1e6, 0.4), element=element, density=1e3)
    own = {"dead_volume": 3e-6, "polytropic_exponent": 1.3} if medium == "gas" else {}
    chamber = Chamber({"box": wall}, medium=medium, hose_compliance=2e-11, **own)
    return Robot((body,), actuators=(NamedActuator("main", chamber),))


def bent_box(element: str) -> Robot:
    """A hanging box of gas, with a heavy plate on a part of one side, which turns as it is blown up."""
    robot = replace(blown_box(element, is_open=True, medium="gas"), gravity=np.array([0.0, 0.0, 9.81]))
    x, _, z = robot.bodies[0].mesh.points.T
    nodes = np.flatnonzero((x > 0.0199) & (z > 0.0))
    return replace(robot, plates=(Plate("plate", {"box": nodes}, np.array([0.02, 0.0, 0.02]), mass=0.1),))


def hanging_finger(element: str, *, is_open: bool) -> Robot:
    """A square bar that hangs from its foot, with a chamber on one side, which bends it."""
    size, divisions = np.array((0.016, 0.016, 0.06)), (4, 4, 8)
    mesh = box_mesh(size, divisions)
    cell = mesh.points[mesh.tets].mean(axis=1) / (size / divisions)
    inside = (cell[:, 0] > 1) & (cell[:, 0] < 2) & (cell[:, 1] > 1) & (cell[:, 1] < 3) & (cell[:, 2] < 7)
    mesh = drop_unreferenced(TetMesh(mesh.points, mesh.tets[~inside | (cell[:, 2] < 1 - is_open)]))
    faces = boundary_faces(mesh)
    middle = mesh.points[faces].mean(axis=1)
    wall = faces[((middle > 1e-9) & (middle < size - 1e-9)).all(axis=1)]
    foot = np.flatnonzero(mesh.points[:, 2] < 1e-9)
    body = Body("finger", mesh, foot, elastic(3e5, 0.45), element=element, density=1e3)
    main = NamedActuator("main", Chamber({"finger": wall}, dead_volume=3e-6))
    return Robot((body,), actuators=(main,), gravity=np.array([0.0, 0.0, 9.81]))


def column_robot(
    element: str = "P1",
    *,
    parameters: Mapping[str, float] | None = None,
    divisions: Sequence[int] = (2, 2, 6),
    gravity: Sequence[float] = (0.0, 0.0, 0.0),
    density: float = 0.0,
    mass: float = 0.0,
    cables: Sequence[Cable] | None = None,
    law: str = "neo-hooke",
    mesh: TetMesh | None = None,
) -> Robot:
    """A square column, 30 x 30 x 100 mm, clamped at its foot, a plate on top, a cable 50 mm off its axis in front."""
    if mesh is None:
        mesh = box_mesh((0.03, 0.03, 0.1), divisions, origin=(-0.015, -0.015, 0.0))
    body = Body(
        "neck",
        mesh,
        fixed=mesh.node_sets["z0"],
        parameters=dict(parameters or elastic(2.3e6, 0.43)),
        law=law,
        element=element,
        density=density,
    )
    plate = Plate(
        "plate",
        {"neck": mesh.node_sets["z1"]},
        reference=np.array([0.0, 0.0, 0.1]),
        mass=mass,
        centre_of_mass=np.array([0.0, 0.0, 0.12]),
    )
    if cables is None:
        cables = (side_cable("front", (0.05, 0.0)),)
    return Robot((body,), (plate,), tuple(cables), gravity=np.array(gravity, dtype=float))


def mirrored_box(lengths: Sequence[float], divisions: Sequence[int]) -> TetMesh:
    """A box about the z axis whose mesh is its own mirror image in x; `divisions` are those of the half x >= 0."""
    half = box_mesh((lengths[0] / 2, lengths[1], lengths[2]), divisions, origin=(0.0, -lengths[1] / 2, 0.0))
    image = half.points * [-1.0, 1.0, 1.0]
    points, number = np.unique(np.round(np.vstack([half.points, image]), 12), axis=0, return_inverse=True)
    number = number.ravel()
    other = number[half.n_points + half.tets][:, [1, 0, 2, 3]]
    z = points[:, 2]
    ends = {"z0": np.flatnonzero(z == z.min()), "z1": np.flatnonzero(z == z.max())}
    return TetMesh(points, np.vstack([number[half.tets], other]), ends)


def side_cable(name: str, at: Sequence[float], height: float = 0.1) -> Cable:
    """A cable from the plate of `column_robot` straight down to the ground."""
    return Cable(
        name,
        (ViaPoint(np.array([*at, height]), "plate"), ViaPoint(np.array([*at, 0.0]))),
    )


def pulled(*values: float, cable: str = "front") -> Protocol:
    """Shortening [m]."""
    return Protocol({cable: Command("shortening", np.array(values, dtype=float))})


def tensed(*values: float, cable: str = "front") -> Protocol:
    """Tension [N]."""
    return Protocol({cable: Command("tension", np.array(values, dtype=float))})


def twin_and_theta(robot: Robot) -> tuple[Twin, dict[str, float]]:
    return build_twin(robot), parameter_values(robot)


def require_derivatives(
    robot: Robot,
    protocol: Protocol,
    steps: Mapping[str, float],
    monkeypatch: pytest.MonkeyPatch,
    *,
    error: float = 1e-6,
    at: Mapping[str, float] = NONE,
    moved: str = "plate.z",
) -> None:
    """All channels' derivatives by parameters agree with central differences of whole simulations, but for these'
    rounding. steps: of the differences; at: values of parameters, by default the robot's own; moved: a channel that
    each of the parameters changes.
    """
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    values = parameter_values(with_parameters(robot, at))
    options = {"curve_tolerance": 0.0, "crossings": False}
    response = simulate(robot, protocol, at, sensitivities=tuple(steps), **options)
    assert response.succeeded, response.status
    for name, h in steps.items():
        ends = [simulate(robot, protocol, {**at, name: values[name] + s * h}, **options).channels for s in (1.0, -1.0)]
        want = {channel: (ends[0][channel] - ends[1][channel]) / (2.0 * h) for channel in ends[0]}
        for unit in sorted(set(response.units.values())):
            of_unit = [channel for channel in want if response.units[channel] == unit]
            scale = max(np.abs(want[channel]).max() for channel in of_unit)
            largest = max(np.abs(ends[0][channel]).max() for channel in of_unit)
            rounding = 4e-16 * (1.0 if unit == "rad" else largest) / h  # an angle is that of a rotation's entries
            for channel in of_unit:
                got, said = response.sensitivities[channel][name], f"{channel} by {name}"
                np.testing.assert_allclose(got, want[channel], error, error * scale + rounding, err_msg=said)
        assert np.all(want[moved] != 0.0), name


def moved_points(robot: Robot, turn: Callable[[np.ndarray], np.ndarray], rotation: np.ndarray) -> Robot:
    """The same robot elsewhere: every point by `turn`, every direction by `rotation`."""
    bodies = tuple(
        replace(b, mesh=TetMesh(turn(b.mesh.points), b.mesh.tets, dict(b.mesh.node_sets), dict(b.mesh.face_sets)))
        for b in robot.bodies
    )
    plates = tuple(
        replace(p, reference=turn(p.reference), centre_of_mass=turn(np.asarray(p.centre_of_mass))) for p in robot.plates
    )
    cables = tuple(replace(c, via_points=tuple(replace(v, at=turn(v.at)) for v in c.via_points)) for c in robot.cables)
    return replace(robot, bodies=bodies, plates=plates, cables=cables, gravity=rotation @ robot.gravity)
