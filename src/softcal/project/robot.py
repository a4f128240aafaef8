"""From the project's `robot` section to a Robot: meshes read, regions selected, names resolved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Ints, frozen_floats
from softcal.geometry.locate import locate_points
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quality import MeshReport, require_sound
from softcal.geometry.regions import Box, Cylinder, Named, Plane, Region, Sphere, select_faces, select_nodes
from softcal.materials.catalogue import LAWS
from softcal.project.document import Findings, KeyPath
from softcal.project.mesh_schema import RegionSection
from softcal.project.robot_schema import BodySection, CableSection, LoadSection, PlateSection, RobotSection
from softcal.twin.robot import Body, Cable, Plate, PointLoad, Robot, SurfaceLoad, ViaPoint

# Makes the mesh of a body from its section; the project decides where files lie.
MeshMaker = Callable[[str, BodySection], TetMesh]


@dataclass(frozen=True)
class BuiltRobot:
    """A robot, what was found out about its meshes, and the named regions (nodes) of each body."""

    robot: Robot
    qualities: Mapping[str, MeshReport]
    regions: Mapping[str, Mapping[str, Ints]]


def build_robot(section: RobotSection, make_mesh: MeshMaker, findings: Findings) -> BuiltRobot | None:
    """The robot of a project, or None where something of it is wrong; every fault goes to `findings`."""
    n_faults = len(findings.faults)
    _check_names(section, findings)
    meshes: dict[str, TetMesh] = {}
    qualities: dict[str, MeshReport] = {}
    regions: dict[str, dict[str, Ints]] = {}
    bodies: list[Body] = []
    for name, body in section.bodies.items():
        path = ("robot", "bodies", name)
        with findings.at((*path, "mesh")):
            mesh = make_mesh(name, body)
            meshes[name] = mesh
            qualities[name] = require_sound(mesh)
        if body.law not in LAWS:
            findings.unknown((*path, "law"), "law", body.law, LAWS)
        if name in meshes:
            regions[name] = _regions(body, meshes[name], path, findings)
            fixed = _fixed(body, meshes[name], regions[name], path, findings)
            if name in qualities and (warning := _poor(qualities[name], meshes[name], fixed)):
                findings.warn((*path, "mesh"), warning)
            parameters = {"youngs_modulus": body.youngs_modulus, "poissons_ratio": body.poissons_ratio}
            bodies.append(Body(name, meshes[name], fixed, parameters, body.law, body.element, body.density))
    plates = [_plate(n, p, section, meshes, regions, findings) for n, p in section.plates.items()]
    cables = [_cable(n, c, section, meshes, findings) for n, c in section.cables.items()]
    loads = [_load(n, x, section, meshes, findings) for n, x in section.loads.items()]
    if len(findings.faults) > n_faults:
        return None
    with findings.at(("robot",)):
        robot = Robot(
            tuple(bodies),
            tuple(p for p in plates if p),
            tuple(c for c in cables if c),
            tuple(x for x in loads if x),
            frozen_floats(section.gravity, name="gravity"),
        )
        _check_held(robot, findings)
        if len(findings.faults) == n_faults:
            return BuiltRobot(robot, qualities, regions)
    return None


def region_of(section: RegionSection) -> Region:
    """The geometric region that a section describes.

    Raises
    ------
    MeshError
        For a shape that is none, such as a box turned inside out.
    """
    if section.plane:
        return Plane(section.plane.point, section.plane.normal, section.plane.tolerance, section.plane.side)
    if section.box:
        return Box(section.box.lower, section.box.upper)
    if section.cylinder:
        return Cylinder(section.cylinder.start, section.cylinder.end, section.cylinder.radius)
    if section.sphere:
        return Sphere(section.sphere.centre, section.sphere.radius)
    return Named(section.group or "")


def _check_names(section: RobotSection, findings: Findings) -> None:
    """Bodies, plates, cables and loads share one space of names: parameters and channels are called by them."""
    seen: dict[str, KeyPath] = {}
    for kind in ("bodies", "plates", "cables", "loads"):
        for name in getattr(section, kind):
            path = ("robot", kind, name)
            if not name.isidentifier():
                findings.add(path, "this cannot be a name", got=f"'{name}'", allowed="letters, digits and _")
            if name in seen:
                findings.add(path, "two parts of the robot share a name", got=f"'{name}', first as {seen[name][1]}")
            seen[name] = path


def _poor(quality: MeshReport, mesh: TetMesh, fixed: Ints) -> str:
    """What is poor about a mesh where it matters: a sliver that is fixed throughout is not computed with."""
    slivers = tuple(tet for tet in quality.slivers if not np.isin(mesh.tets[tet], fixed).all())
    return replace(quality, slivers=slivers).warning


def _regions(body: BodySection, mesh: TetMesh, path: KeyPath, findings: Findings) -> dict[str, Ints]:
    found: dict[str, Ints] = {}
    for name, region in body.regions.items():
        with findings.at((*path, "regions", name)):
            found[name] = select_nodes(mesh, region_of(region))
    return found


def _known_regions(body: BodySection, mesh: TetMesh) -> list[str]:
    return [*body.regions, *mesh.node_sets, *mesh.face_sets, *mesh.element_sets]


def _fixed(body: BodySection, mesh: TetMesh, regions: Mapping[str, Ints], path: KeyPath, findings: Findings) -> Ints:
    found = [_nodes(name, body, mesh, regions, (*path, "fixed"), findings) for name in body.fixed]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(nodes for nodes in found if nodes is not None)]))


def _nodes(
    name: str, body: BodySection, mesh: TetMesh, regions: Mapping[str, Ints], path: KeyPath, findings: Findings
) -> Ints | None:
    if name in regions:
        return regions[name]
    known = _known_regions(body, mesh)
    if name not in known:
        findings.unknown(path, "region", name, known)
    elif name not in body.regions:  # else its own fault is on record
        with findings.at(path):
            return select_nodes(mesh, Named(name))
    return None


def _plate(
    name: str,
    plate: PlateSection,
    section: RobotSection,
    meshes: Mapping[str, TetMesh],
    regions: Mapping[str, Mapping[str, Ints]],
    findings: Findings,
) -> Plate | None:
    path = ("robot", "plates", name)
    if plate.body not in section.bodies:
        findings.unknown((*path, "body"), "body", plate.body, section.bodies)
        return None
    if plate.body not in meshes:
        return None
    body, mesh = section.bodies[plate.body], meshes[plate.body]
    nodes = _nodes(plate.region, body, mesh, regions[plate.body], (*path, "region"), findings)
    if nodes is None:
        return None
    centre = None if plate.centre_of_mass is None else frozen_floats(plate.centre_of_mass, name=f"{name}.centre")
    return Plate(name, {plate.body: nodes}, frozen_floats(plate.reference, name=name), plate.mass, centre)


def _cable(
    name: str, cable: CableSection, section: RobotSection, meshes: Mapping[str, TetMesh], findings: Findings
) -> Cable | None:
    for i, via in enumerate(cable.via):
        _check_support(via.on, via.at, ("robot", "cables", name, "via", i), section, meshes, findings)
    if not any(via.on for via in cable.via):
        findings.add(
            ("robot", "cables", name, "via"),
            "the cable is fixed in space from end to end",
            got="no via point with `on`",
            allowed="at least one via point on a body or plate",
            attempt=f"on: {next(iter([*section.plates, *section.bodies]))}",
        )
    points = tuple(ViaPoint(frozen_floats(via.at, name=name), via.on) for via in cable.via)
    with findings.at(("robot", "cables", name)):
        return Cable(name, points, cable.friction_coefficient, cable.pulled_end)
    return None


def _check_support(
    on: str,
    at: tuple[float, float, float],
    path: KeyPath,
    section: RobotSection,
    meshes: Mapping[str, TetMesh],
    findings: Findings,
) -> None:
    if on and on not in section.bodies and on not in section.plates:
        findings.unknown((*path, "on"), "body or plate", on, [*section.bodies, *section.plates])
    elif on in meshes:
        with findings.at((*path, "at")):
            locate_points(meshes[on], np.array([at]))


def _load(
    name: str, load: LoadSection, section: RobotSection, meshes: Mapping[str, TetMesh], findings: Findings
) -> PointLoad | SurfaceLoad | None:
    path = ("robot", "loads", name)
    if load.at is not None and load.force is not None:
        _check_support(load.on, load.at, path, section, meshes, findings)
        return PointLoad(name, load.on, frozen_floats(load.at, name=name), frozen_floats(load.force, name=name))
    if load.region is None or load.traction is None:
        return None
    if load.on not in section.bodies:
        findings.unknown((*path, "on"), "body", load.on, section.bodies)
    elif load.on in meshes:
        body, mesh = section.bodies[load.on], meshes[load.on]
        if load.region not in _known_regions(body, mesh):
            findings.unknown((*path, "region"), "region", load.region, _known_regions(body, mesh))
            return None
        region = region_of(body.regions[load.region]) if load.region in body.regions else Named(load.region)
        with findings.at((*path, "region")):
            faces = select_faces(mesh, region)
            return SurfaceLoad(name, load.on, faces, frozen_floats(load.traction, name=name))
    return None


def _check_held(robot: Robot, findings: Findings) -> None:
    """Faults that only the whole robot shows: nothing fixed, or a node that is fixed and on a plate."""
    for body in robot.bodies:
        path = ("robot", "bodies", body.name)
        tied = [plate for plate in robot.plates if body.name in plate.nodes]
        if not len(body.fixed) and not tied:
            findings.add(
                (*path, "fixed"),
                "nothing holds the body",
                allowed="the name of a region that does not move",
                attempt="fixed: socket, with a region of that name",
            )
        for plate in tied:
            both = np.intersect1d(body.fixed, plate.nodes[body.name])
            if len(both):
                findings.add(
                    ("robot", "plates", plate.name, "region"),
                    f"{len(both)} nodes are both fixed and tied to the plate",
                    got=f"node {both[0]} of {body.name}",
                    allowed="regions that do not meet",
                )
    if not any(len(body.fixed) for body in robot.bodies):
        findings.add(("robot", "bodies"), "nothing holds the robot", allowed="at least one body with `fixed`")
