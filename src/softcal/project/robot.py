"""From the project's `robot` section to a Robot: every part built, names resolved, the whole checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from softcal.checks import Ints
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quality import MeshReport, check_quality
from softcal.project.document import Findings
from softcal.project.robot_bodies import MeshMaker, build_bodies
from softcal.project.robot_fit import check_whole
from softcal.project.robot_parts import (
    Carriers,
    build_actuator,
    build_cable,
    build_limits,
    build_load,
    build_marker,
    build_plate,
    build_tie,
)
from softcal.project.robot_rods import build_rod
from softcal.project.robot_schema import KINDS, RobotSection, generated_names
from softcal.project.sensor_schema import built_sensors
from softcal.twin.manipulator import manipulator
from softcal.twin.robot import Robot, Rod


@dataclass(frozen=True)
class BuiltRobot:
    """A robot, the reports on its meshes, and the named regions (nodes) of each body.

    made: body -> its mesh before its placement.
    """

    robot: Robot
    qualities: Mapping[str, MeshReport]
    regions: Mapping[str, Mapping[str, Ints]]
    made: Mapping[str, TetMesh]


def build_robot(section: RobotSection, make_mesh: MeshMaker, findings: Findings) -> BuiltRobot | None:
    """The robot of a project; None with a fault, which goes to `findings`.

    Parameters
    ----------
    section
        Section `robot` of the file.
    make_mesh
        Makes the mesh [m] of a body by its name and section.
    findings
        Collects the faults and warnings.
    """
    n_faults = len(findings.faults)
    gravity = section.gravity
    given: Robot | None = None
    if section.manipulator is not None:
        with findings.at(("robot", "manipulator", "springs")):
            given = manipulator(section.manipulator, gravity=gravity.tolist())
    built = build_bodies(section.bodies, make_mesh, findings)
    via = (point for cable in section.cables.values() for point in cable.via)
    points = (*via, *section.markers.values(), *section.loads.values())
    rods: list[Rod | None] = []
    for name, rod in section.rods.items():
        carried = [point.at for point in points if point.on == name and point.at is not None]
        rods.append(build_rod(name, rod, section.names("plates"), carried, findings))
    plates = [build_plate(name, plate, built, findings) for name, plate in section.plates.items()]
    own = [f"h{k + 1}" for k in range(len(generated_names(section, "cables")))]
    holes = dict.fromkeys(generated_names(section, "plates"), own)
    holes |= {name: plate.holes.names for name, plate in section.plates.items()}
    whole_plates = (*(given.plates if given else ()), *(plate for plate in plates if plate))
    own_rods = dict(zip(section.rods, rods, strict=True)) | {rod.name: rod for rod in (given.rods if given else ())}
    carriers = Carriers(built, {plate.name: plate for plate in whole_plates}, holes, own_rods, findings)
    ties = [build_tie(name, tie, built, findings) for name, tie in section.ties.items()]
    cables = [build_cable(name, cable, carriers) for name, cable in section.cables.items()]
    actuators = [build_actuator(name, actuator, carriers) for name, actuator in section.actuators.items()]
    loads = [build_load(name, load, gravity, carriers) for name, load in section.loads.items()]
    markers = [build_marker(name, marker, carriers) for name, marker in section.markers.items()]
    if len(findings.faults) > n_faults:
        return None
    with findings.at(("robot",)):
        robot = Robot(
            bodies=(*(given.bodies if given else ()), *built.bodies),
            plates=whole_plates,
            cables=(*(given.cables if given else ()), *(cable for cable in cables if cable)),
            loads=tuple(load for load in loads if load),
            gravity=gravity,
            contact=section.contact,
            limits=section.limits,
            actuators=tuple(part for part in actuators if part),
            rods=(*(given.rods if given else ()), *(rod for rod in rods if rod)),
            ties=tuple(tie for tie in ties if tie),
            markers=(*(given.markers if given else ()), *(marker for marker in markers if marker)),
        )
        robot = replace(robot, sensors=built_sensors(section.sensors, robot, findings))
        robot = replace(robot, actuator_limits=build_limits(section.actuator_limits, robot.actuated, findings))
        check_whole(robot, findings, generated=[name for kind in KINDS for name in generated_names(section, kind)])
        if len(findings.faults) == n_faults:
            own_bodies = {body.name: body.mesh for body in given.bodies} if given else {}
            return BuiltRobot(
                robot,
                {**{name: check_quality(mesh) for name, mesh in own_bodies.items()}, **built.qualities},
                {**{name: mesh.node_sets for name, mesh in own_bodies.items()}, **built.regions},
                built.made,
            )
    return None
