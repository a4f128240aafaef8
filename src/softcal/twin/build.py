"""From a robot to the system of equations that its statics solves."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError, ParameterError
from softcal.geometry.locate import locate_points
from softcal.geometry.mesh import TET_EDGES, TetMesh
from softcal.geometry.quadratic import to_linear, to_quadratic
from softcal.materials.catalogue import LAWS
from softcal.mechanics.cable import build_cables
from softcal.mechanics.element import nodal_volumes, shape_functions
from softcal.mechanics.layout import FIXED, FREE, Layout
from softcal.mechanics.solid import SolidTerm, build_solid
from softcal.mechanics.system import Loads, System, build_system
from softcal.twin.robot import Body, Plate, PointLoad, Robot, SurfaceLoad

Weights = list[tuple[int, float]]


@dataclass(frozen=True)
class Twin:
    """A robot's system, and where its parts stand in it.

    first_point: body -> its first point; meshes: body -> the mesh of its element; via: cable -> its via points as
    weighted points.
    """

    robot: Robot
    system: System
    first_point: dict[str, int]
    meshes: dict[str, TetMesh]
    via: dict[str, list[Weights]]


def build_twin(robot: Robot) -> Twin:
    """Number the unknowns, place the extra points, build the terms.

    Raises
    ------
    MeshError
        For a node that is both fixed and on a plate, a plate without nodes, a via point outside its body.
    ParameterError
        For an unknown law or element.
    """
    builder = _Points()
    meshes: dict[str, TetMesh] = {}
    solids: list[SolidTerm] = []
    n_pressures = 0
    number = {plate.name: i for i, plate in enumerate(robot.plates)}
    for body in robot.bodies:
        mesh = _element_mesh(body)
        meshes[body.name] = mesh
        rider = _riders(body, mesh, robot.plates, number)
        first = builder.add(mesh.points, rider)
        builder.first[body.name] = first
        if body.law not in LAWS:
            raise ParameterError(
                Fault("there is no such law", where=f"{body.name}.law", got=body.law, allowed=", ".join(LAWS))
            )
        pressure = n_pressures if body.element == "P2P1" else None
        solid, count = build_solid(
            body.name,
            LAWS[body.law],
            mesh.points,
            _deformable(body, mesh, rider),
            first_point=first,
            first_pressure=pressure,
        )
        solids.append(solid)
        n_pressures += count

    def support(at: Floats, on: str, where: str) -> Weights:
        if on == "":
            return [(builder.add(at[None, :], np.array([FIXED])), 1.0)]
        if on in number:
            return [(builder.add(at[None, :], np.array([number[on]])), 1.0)]
        if on not in meshes:
            known = ", ".join([*meshes, *number])
            raise MeshError(Fault("there is no such body or plate", where=where, got=on, allowed=known))
        return _inside(meshes[on], at, builder.first[on], where)

    via = {
        cable.name: [support(p.at, p.on, f"{cable.name}, via point {i + 1}") for i, p in enumerate(cable.via_points)]
        for cable in robot.cables
    }
    forces: list[tuple[str | None, Weights, Floats]] = []
    for plate in robot.plates:
        assert plate.centre_of_mass is not None  # noqa: S101
        forces.append((f"{plate.name}.mass", support(plate.centre_of_mass, plate.name, plate.name), robot.gravity))
    for load in robot.loads:
        if isinstance(load, PointLoad):
            forces.append((None, support(load.at, load.on, load.name), load.force))
        else:
            forces.extend(_surface_forces(load, meshes, builder.first))

    layout = Layout(
        X=np.concatenate(builder.X),
        rider=np.concatenate(builder.rider),
        references=np.array([p.reference for p in robot.plates]).reshape(-1, 3),
        n_pressures=n_pressures,
        n_cables=len(robot.cables),
    )
    pulled_last = np.array([cable.pulled_end == "last" for cable in robot.cables], dtype=bool)
    loads = _loads(robot, meshes, builder.first, forces, layout.n_points)
    system = build_system(layout, tuple(solids), build_cables(layout.X, via, pulled_last), loads)
    return Twin(robot, system, builder.first, meshes, via)


def cached_twin(robot: Robot) -> Twin:
    """`build_twin`, remembered for robots that differ only in parameters: what is built depends on none."""
    key = _key(robot)
    if key in _CACHE:
        _CACHE.move_to_end(key)
        return _CACHE[key]
    twin = build_twin(robot)
    _CACHE[key] = twin
    while len(_CACHE) > CACHE_SIZE:
        _CACHE.popitem(last=False)
    return twin


CACHE_SIZE = 8
_CACHE: OrderedDict[Hashable, Twin] = OrderedDict()


def _key(robot: Robot) -> Hashable:
    # Meshes by identity: a cached twin keeps its robot, and so its meshes, alive.
    bodies = tuple((b.name, id(b.mesh), b.fixed.tobytes(), b.law, b.element) for b in robot.bodies)
    plates = tuple(
        (
            p.name,
            tuple((body, nodes.tobytes()) for body, nodes in p.nodes.items()),
            p.reference.tobytes(),
            np.asarray(p.centre_of_mass).tobytes(),
        )
        for p in robot.plates
    )
    cables = tuple((c.name, tuple((v.on, v.at.tobytes()) for v in c.via_points), c.pulled_end) for c in robot.cables)
    loads = tuple(
        (x.name, x.on, x.at.tobytes(), x.force.tobytes())
        if isinstance(x, PointLoad)
        else (x.name, x.on, x.faces.tobytes(), x.traction.tobytes())
        for x in robot.loads
    )
    return bodies, plates, cables, loads, robot.gravity.tobytes()


class _Points:
    """Points in the order they are added."""

    def __init__(self) -> None:
        self.X: list[Floats] = []
        self.rider: list[Ints] = []
        self.first: dict[str, int] = {}
        self._n = 0

    def add(self, X: Floats, rider: Ints) -> int:
        """Append points and return the number of the first."""
        first = self._n
        self.X.append(np.asarray(X, dtype=np.float64))
        self.rider.append(rider)
        self._n += len(X)
        return first


def _element_mesh(body: Body) -> TetMesh:
    if body.element == "P1":
        return to_linear(body.mesh)
    if body.element in ("P2", "P2P1"):
        return body.mesh if body.mesh.order == 2 else to_quadratic(body.mesh)
    raise ParameterError(
        Fault("there is no such element", where=f"{body.name}.element", got=body.element, allowed="P1, P2, P2P1")
    )


def _riders(body: Body, mesh: TetMesh, plates: tuple[Plate, ...], number: dict[str, int]) -> Ints:
    rider = np.full(mesh.n_points, FREE, dtype=np.int64)
    for plate in plates:
        if body.name not in plate.nodes:
            continue
        nodes = _extended(body.mesh, mesh, plate.nodes[body.name])
        taken = nodes[rider[nodes] != FREE]
        if len(taken):
            raise MeshError(Fault(f"{len(taken)} node(s) are tied to two plates", where=f"{plate.name} on {body.name}"))
        rider[nodes] = number[plate.name]
    fixed = _extended(body.mesh, mesh, body.fixed)
    both = fixed[rider[fixed] != FREE]
    if len(both):
        raise MeshError(
            Fault(f"{len(both)} node(s) are both fixed and tied to a plate", where=body.name, got=f"node {both[0]}")
        )
    rider[fixed] = FIXED
    if np.all(rider == FREE):
        raise MeshError(Fault("nothing holds the body: no node is fixed or tied to a plate", where=body.name))
    return rider


def _extended(given: TetMesh, used: TetMesh, nodes: Ints) -> Ints:
    """Node numbers of the mesh in use for node numbers of the mesh as given (middle nodes gained or lost)."""
    if given.order == used.order:
        return nodes
    chosen = np.zeros(max(given.n_points, used.n_points), dtype=bool)
    chosen[nodes] = True
    if used.order == 1:
        old = given.corners
        return np.flatnonzero(chosen[old])
    for i, (a, b) in enumerate(TET_EDGES):
        chosen[used.tets[:, 4 + i]] |= chosen[used.tets[:, a]] & chosen[used.tets[:, b]]
    return np.flatnonzero(chosen)


def _deformable(body: Body, mesh: TetMesh, rider: Ints) -> Ints:
    """The tets that can deform: one whose nodes are all fixed, or all on one plate, stays as it is, free of stress."""
    riders = rider[mesh.tets]
    stiff = (riders == riders[:, :1]).all(axis=1) & (riders[:, 0] != FREE)
    if stiff.all():
        raise MeshError(
            Fault("no tet of the body can deform: its nodes are all fixed or on one plate", where=body.name)
        )
    return mesh.tets[~stiff]


def _inside(mesh: TetMesh, at: Floats, first: int, where: str) -> Weights:
    tets, barycentric = locate_points(mesh, at[None, :], where=where)
    N = shape_functions(barycentric, mesh.order)[0]
    return [(first + int(node), float(weight)) for node, weight in zip(mesh.tets[tets[0]], N, strict=True)]


def _surface_forces(
    load: SurfaceLoad, meshes: dict[str, TetMesh], first: dict[str, int]
) -> list[tuple[str | None, Weights, Floats]]:
    """Consistent nodal forces of a constant traction; quadratic straight faces load their middle nodes alone."""
    if load.on not in meshes:
        raise MeshError(Fault("there is no such body", where=load.name, got=load.on, allowed=", ".join(meshes)))
    mesh = meshes[load.on]
    faces = load.faces[:, :3]
    X = mesh.points
    area = 0.5 * np.linalg.norm(np.cross(X[faces[:, 1]] - X[faces[:, 0]], X[faces[:, 2]] - X[faces[:, 0]]), axis=1)
    if mesh.order == 1:
        return [
            (None, [(first[load.on] + int(n), 1.0)], a / 3.0 * load.traction)
            for f, a in zip(faces, area, strict=True)
            for n in f
        ]
    middle: dict[tuple[int, int], int] = {}
    for i, (a, b) in enumerate(TET_EDGES):
        low, high = np.sort(mesh.tets[:, [a, b]], axis=1).T
        middle.update(zip(zip(low.tolist(), high.tolist(), strict=True), mesh.tets[:, 4 + i].tolist(), strict=True))
    forces: list[tuple[str | None, Weights, Floats]] = []
    for f, a in zip(faces.tolist(), area, strict=True):
        for i, j in ((0, 1), (1, 2), (2, 0)):
            node = middle[min(f[i], f[j]), max(f[i], f[j])]
            forces.append((None, [(first[load.on] + node, 1.0)], a / 3.0 * load.traction))
    return forces


def _loads(
    robot: Robot,
    meshes: dict[str, TetMesh],
    first: dict[str, int],
    forces: list[tuple[str | None, Weights, Floats]],
    n_points: int,
) -> Loads:
    constant = np.zeros((n_points, 3))
    per_unit: dict[str, Floats] = {}
    for name, weights, force in forces:
        target = constant if name is None else per_unit.setdefault(name, np.zeros((n_points, 3)))
        for point, weight in weights:
            target[point] += weight * force
    for name, mesh in meshes.items():
        unit = per_unit[f"{name}.density"] = np.zeros((n_points, 3))
        unit[first[name] : first[name] + mesh.n_points] = nodal_volumes(mesh.points, mesh.tets)[:, None] * robot.gravity
    return Loads(constant, per_unit)
