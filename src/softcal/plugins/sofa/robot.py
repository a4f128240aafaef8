"""Conversion of a robot for SOFA: linear tetrahedra, SOFA's laws, only supported features."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softcal.checks import Ints
from softcal.errors import Fault, ParameterError
from softcal.export.engine import actuator_faults, cable_faults, contact_faults, history_faults
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import linear_numbers
from softcal.geometry.regions import Named, select_faces
from softcal.geometry.varied_section import VariedSection
from softcal.materials.catalogue import LAWS
from softcal.mechanics.elements import P1
from softcal.plugins.sofa.rods import linear_rod
from softcal.sensing.sensors.actuators import ANGLE, PRESSURE, SHORTENING, TORQUE, VOLUME
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.chamber import Chamber
from softcal.twin.actuators.drive import Drive
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Moment, Robot, SurfaceLoad
from softcal.twin.routing import bores

ITS_ELEMENT = P1.name
STAND_IN = "neo-hooke"  # its law for those by E and nu that it does not have


def scene_faults(robot: Robot) -> list[Fault]:
    """Faults of features that SOFA with SoftRobots does not support."""
    faults = actuator_faults(robot, "SOFA", Chamber.name, Drive.name) + cable_faults(robot, "SOFA")
    faults += [
        Fault(
            "a drive in SOFA takes up r a of each cable, without springs and backlash between",
            where=part.name,
            got=", ".join(f"{key} {getattr(part.actuator, key):g}" for key in between),
            allowed="radius, gear_ratio and zero",
            attempt="a drive without them, or CalculiX, which gets the tensions",
        )
        for part in robot.actuators
        if isinstance(part.actuator, Drive)
        and (between := [key for key in ("spring_rate", "gear_backlash") if getattr(part.actuator, key)])
    ]
    faults += [
        Fault(
            "in SOFA a via point is attached to one element, not to the wall of a bore",
            where=cable,
            got=f"via points {', '.join(str(i + 1) for i in held)} in bores",
            attempt="a model with the bores closed",
        )
        for cable, held in bores(robot).items()
    ]
    faults += [
        Fault(
            "a body or rod of several materials cannot be exported to SOFA",
            where=whole.name,
            got=", ".join(part.name for part in whole.inclusions),
            attempt="one of one material, or two bodies tied together",
        )
        for whole in (*robot.bodies, *robot.rods)
        if whole.inclusions
    ]
    faults += [
        Fault("a rod whose section varies cannot be exported to SOFA", rod.name, attempt="a rod of one section")
        for rod in robot.rods
        if isinstance(rod.section, VariedSection)
    ]
    faults += point_faults(robot, "SOFA")
    return [*faults, *contact_faults(robot, "SOFA"), *history_faults(robot, "SOFA"), *law_faults(robot)]


def command_faults_of_sofa(protocol: Protocol) -> list[Fault]:
    """Faults of commands that SOFA's components do not follow."""
    instead = {
        VOLUME.name: ("a chamber in SOFA is driven by pressure", PRESSURE.name, "--pull NAME=20kPa"),
        TORQUE.name: ("a drive in SOFA is driven by its angle", ANGLE.name, "--pull NAME=30deg"),
    }
    return [
        Fault(instead[command.control][0], name, command.control, *instead[command.control][1:])
        for name, command in protocol.commands.items()
        if command.control in instead
    ]


def scene_commands(robot: Robot, protocol: Protocol) -> Protocol:
    """The commands of the scene's cables and chambers, with the angles of drives as shortenings of their cables."""
    drives = {part.name: part.actuator for part in robot.actuators if isinstance(part.actuator, Drive)}
    commands: dict[str, Command] = {}
    for name, command in protocol.commands.items():
        if name in drives:
            ways = drives[name].shortenings(command.values)
            commands |= {cable: Command(SHORTENING.name, way) for cable, way in ways.items()}
        else:
            commands[name] = command
    return replace(protocol, commands=commands)


def point_faults(robot: Robot, program: str) -> list[Fault]:
    """Faults of moments, and of points that rods carry without a plate, which exports do not represent."""
    rods = {rod.name for rod in robot.rods}
    points = {via.on: cable.name for cable in robot.cables for via in cable.via_points}
    points |= {part.on: part.name for part in (*robot.loads, *robot.markers)}
    faults = [
        Fault(f"a point on a rod cannot be exported to {program}", points[name], name, attempt="a plate clamped to it")
        for name in sorted(rods & points.keys())
    ]
    return faults + [
        Fault(f"a moment cannot be exported to {program}", load.name, attempt="two forces")
        for load in robot.loads
        if isinstance(load, Moment)
    ]


def law_faults(robot: Robot) -> list[Fault]:
    """Faults of bodies whose law SOFA does not have with linear tets, and whose constants are not E and nu, so that
    they cannot be identified anew.
    """
    by = " and ".join(LAWS.named(STAND_IN).names)
    return [
        Fault(
            "SOFA does not support this law" if body.law not in MATERIALS else "SOFA has this law in linear tets only",
            where=f"{body.name}.law",
            got=f"{body.law}, {body.element}",
            allowed=f"{', '.join(MATERIALS)} with element {ITS_ELEMENT}, or a law by {by}",
            attempt="a twin with one of these, calibrated on the same experiments",
        )
        for body in robot.bodies
        if not _has_stand_in(body.law) and not is_its_own(body)
    ]


def _has_stand_in(law: str) -> bool:
    return set(LAWS.named(law).names) == set(LAWS.named(STAND_IN).names)


def is_its_own(body: Body) -> bool:
    """Whether SOFA has the body's element and law."""
    return body.element == ITS_ELEMENT and body.law in MATERIALS


def element_faults(robot: Robot) -> list[Fault]:
    """Faults of bodies with an element or a law that SOFA lacks."""
    return [
        Fault(
            "SOFA does not have this element or law",
            where=body.name,
            got=f"{body.element}, {body.law}",
            allowed=f"{ITS_ELEMENT}, {', '.join(MATERIALS)}",
            attempt=f"element: {ITS_ELEMENT}, law: {STAND_IN} in the project: what is found then holds for its mesh",
        )
        for body in robot.bodies
        if not is_its_own(body) and _has_stand_in(body.law)
    ]


@dataclass(frozen=True)
class LinearRobot:
    """A robot of linear tets in laws that SOFA has, without unused nodes, fixed plates and contact.

    still: names of the fixed plates; their nodes and points are fixed in space.
    """

    robot: Robot
    still: tuple[str, ...]

    @property
    def chambers(self) -> tuple[NamedActuator, ...]:
        """The actuators with components of their own in the scene, the chambers; drives act by their cables."""
        return tuple(part for part in self.robot.actuators if isinstance(part.actuator, Chamber))


def linear_robot(robot: Robot) -> LinearRobot:
    """The robot with only the corner nodes of its meshes, renumbered, without contact; its parameters are unchanged.

    Raises
    ------
    ParameterError
        For unsupported features.
    """
    if faults := scene_faults(robot):
        raise ParameterError(faults)
    still = tuple(plate.name for plate in robot.plates if plate.fixed)
    old = {body.name: body for body in robot.bodies}
    meshes = {
        body.name: TetMesh(body.mesh.points[body.mesh.corners], _renumbered(body.mesh, body.mesh.tets[:, :4]))
        for body in robot.bodies
    }

    def numbers(body: str, nodes: Ints) -> Ints:
        return _renumbered(old[body].mesh, nodes)

    def fixed(body: str) -> Ints:
        on_still = [numbers(body, plate.nodes[body]) for plate in robot.plates if plate.fixed and body in plate.nodes]
        return np.unique(np.concatenate([numbers(body, old[body].fixed), *on_still]))

    bodies = tuple(
        replace(
            body,
            mesh=meshes[body.name],
            element=ITS_ELEMENT,
            law=body.law if body.law in MATERIALS else STAND_IN,
            fixed=fixed(body.name),
        )
        for body in robot.bodies
    )
    plates = tuple(
        replace(plate, nodes={} if plate.fixed else {name: numbers(name, nodes) for name, nodes in plate.nodes.items()})
        for plate in robot.plates
    )
    ties = tuple(replace(tie, nodes=numbers(tie.body, tie.nodes)) for tie in robot.ties)
    loads = tuple(
        replace(load, faces=_renumbered(old[load.on].mesh, load.faces[:, :3]))
        if isinstance(load, SurfaceLoad)
        else load
        for load in robot.loads
    )
    # SOFA's forces act at points.
    cables = tuple(
        replace(
            cable, via_points=tuple(replace(v, on="" if v.on in still else v.on, radius=0.0) for v in cable.via_points)
        )
        for cable in robot.cables
    )
    rods = tuple(linear_rod(rod, still) for rod in robot.rods)

    def wall(body: str, faces: Ints | str) -> Ints:
        mesh = old[body].mesh
        own = select_faces(mesh, Named(faces), where=body) if isinstance(faces, str) else faces
        return _renumbered(mesh, own[:, :3])

    actuators = tuple(
        replace(part, actuator=part.actuator.on_surfaces({b: wall(b, f) for b, f in part.actuator.surfaces.items()}))
        for part in robot.actuators
    )
    return LinearRobot(
        replace(
            robot,
            bodies=bodies,
            rods=rods,
            plates=plates,
            ties=ties,
            loads=loads,
            cables=cables,
            actuators=actuators,
            contact=None,
        ),
        still,
    )


def _renumbered(mesh: TetMesh, nodes: Ints) -> Ints:
    """New numbers of corner nodes; nodes of a list that are no corners are omitted."""
    found = linear_numbers(mesh)[nodes]
    return found[found >= 0] if found.ndim == 1 else found


MATERIALS: Mapping[str, str] = {
    "neo-hooke": "NeoHookean",
    "stable-neo-hooke": "StableNeoHookean",
    "stvenant-kirchhoff": "StVenantKirchhoff",
    "sofa-mooney-rivlin": "MooneyRivlin",
    "sofa-ogden": "Ogden",
    "sofa-arruda-boyce": "ArrudaBoyce",
}


def material(law: str, theta: Mapping[str, float]) -> dict[str, Any]:
    """A body's law in the scene's parameters, at softcal's constants theta [SI]; law: one of `MATERIALS`.

    The constants are E and nu, of which the scene makes mu and Lame's lambda, or those of SOFA's ParameterSet.
    """
    name = MATERIALS[law]
    if name == "Ogden":
        own = [theta["mu1"] * theta["alpha1"], theta["alpha1"], theta["bulk_modulus"]]
    elif name == "MooneyRivlin":
        own = [theta["C10"], theta["C01"], theta["bulk_modulus"]]
    elif name == "ArrudaBoyce":
        own = [theta["chain_modulus"], theta["bulk_modulus"]]
    else:
        return {"material": name, **{key: theta[key] for key in ("youngs_modulus", "poissons_ratio")}}
    return {"material": name, "constants": own}
