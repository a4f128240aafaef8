"""Drawing data of a robot: extent, rods, plates, and the colours of materials. Lengths in m."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.cell import all_faces, face_keys, outer_faces
from softcal.geometry.pose import Pose
from softcal.geometry.ring import across, ring_points
from softcal.geometry.surface import border, boundary
from softcal.report.scene import RIM, FlatDisc, Label, Part, Tube, Wire
from softcal.report.style import GREEN, ORANGE, PURPLE, RED, SKY
from softcal.twin.actuated import ActuatedPart
from softcal.twin.robot import Body, Disc, Plate, Robot, Rod

STEPS = 6  # between two nodes of a rod
MOST_BALLS = 8  # via points of a cable that have a ball each
OWN = "#d6d3cd"  # the colour of a part's own material
_TINTED = (GREEN, PURPLE, ORANGE, SKY, RED)  # for inclusions
LINE = 0.004  # radius of lines over the size of the robot
AROUND = 0.4  # opacity of a material that has others inside
ROUTE, WALL = ORANGE, PURPLE  # of actuators: of the line that they are, and of the surfaces that they act on


def robot_points(robot: Robot) -> Floats:
    """Points (n, 3) of all bodies, rods and plates at rest."""
    found = [body.mesh.points for body in robot.bodies] + [rod.centreline.nodes for rod in robot.rods]
    for plate in robot.plates:
        found.append(plate.reference[None])
        if plate.disc is not None:
            found.append(_rim(plate.disc))
    return np.concatenate(found)


def material_colours(robot: Robot) -> dict[str, str]:
    """Name of a material -> its colour: the part's own colour, and tints of the palette for inclusions."""
    from matplotlib.colors import to_hex, to_rgb

    own = {part.name: OWN for part in (*robot.bodies, *robot.rods)}
    others = [one.name for part in (*robot.bodies, *robot.rods) for one in part.materials[1:]]
    tints = [to_hex((0.5 + 0.5 * r, 0.5 + 0.5 * g, 0.5 + 0.5 * b)) for r, g, b in map(to_rgb, _TINTED)]
    return own | {name: tints[k % len(tints)] for k, name in enumerate(others)}


def has_materials(robot: Robot) -> bool:
    """Whether a part has several materials."""
    return any(len(part.materials) > 1 for part in (*robot.bodies, *robot.rods))


def material_legend(robot: Robot) -> dict[str, str]:
    """The meaning of each colour of a material; one for the own materials of all parts."""
    parts = (*robot.bodies, *robot.rods)
    kinds = " and ".join(kind for kind, some in (("body", robot.bodies), ("rod", robot.rods)) if some)
    own = parts[0].name if len(parts) == 1 and has_materials(robot) else kinds
    colours, names = material_colours(robot), {part.name for part in parts}
    return {own: OWN} | {name: colour for name, colour in colours.items() if name not in names}


def material_faces(body: Body, tets: Ints) -> dict[str, Ints]:
    """Material -> faces (k, 3 or 6): of the body's own those on its surface, of an inclusion all around it."""
    rows, own = outer_faces(tets), body.materials[0]
    found = {own.name: all_faces(tets)[rows[np.isin(rows // 4, own.elements)]]}
    for one in body.materials[1:]:
        found[one.name] = boundary(tets[one.elements])
    return {name: faces for name, faces in found.items() if len(faces)}


Walls = Mapping[str, Mapping[str, Ints]]
"""Actuator -> body -> faces (n, 3 or 6) that it acts on; see `softcal.twin.loads.walls`."""


def on_walls(faces: Ints, body: str, walls: Walls) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Mask (k,) of the faces that actuators act on.

    Parameters
    ----------
    faces
        The faces (k, 3 or 6).
    body
        Their body.
    walls
        Where the actuators act.
    """
    n, corners = 1 + int(faces.max(initial=0)), [of[body][:, :3] for of in walls.values() if body in of]
    return np.isin(face_keys(faces, n), face_keys(np.concatenate([faces[:0, :3], *corners]), n))


def wall_labels(walls: Walls, points: Mapping[str, Floats]) -> list[Label]:
    """The names of actuators at the surfaces that they act on; points: body -> positions (n, 3) [m]."""
    of = {name: [points[body][np.unique(faces)] for body, faces in by.items()] for name, by in walls.items()}
    return [Label(name, np.concatenate(parts)) for name, parts in of.items()]


def routed(robot: Robot) -> list[ActuatedPart]:
    """The actuators of the robot that have a route."""
    return [part for part in robot.actuated if part.route]


def name_of(robot: Robot, part: ActuatedPart) -> str:
    """The name of an actuator in pictures: of a cable with that of the drive that pulls it."""
    return f"{part.name} ({robot.led[part.name]})" if part.name in robot.led else part.name


def actuator_legend(robot: Robot) -> dict[str, str]:
    """The meaning of the colours of actuators: of their routes, and of the surfaces that they act on."""
    kinds = {ROUTE: [part.kind for part in routed(robot)]}
    kinds[WALL] = [part.kind for part in robot.actuated if part.surfaces]
    return {" and ".join(dict.fromkeys(names)): colour for colour, names in kinds.items() if names}


def rod_colours(rod: Rod, colours: Mapping[str, str]) -> str | Floats:
    """The colour of a rod's material, or RGB of each element (n_elements, 3) where it has several."""
    from matplotlib.colors import to_rgb

    if len(rod.materials) == 1:
        return colours[rod.name]
    found = np.zeros((len(rod.centreline.lengths), 3))
    for one in rod.materials:
        found[one.elements] = to_rgb(colours[one.name])
    return found


def rod_tube(rod: Rod, nodes: Floats, colour: str | Floats, *, opacity: float = 1.0) -> Tube:
    """A rod with current node positions, as thick as its section.

    Parameters
    ----------
    rod
        The rod, with its section.
    nodes
        Current positions (n, 3) [m].
    colour
        A name, or RGB of each node (n, 3) or of each element (n - 1, 3).
    opacity
        From 0 to 1.
    """
    from scipy.interpolate import CubicSpline

    stations = rod.centreline.stations
    fine = np.unique(np.concatenate([np.linspace(a, b, STEPS + 1) for a, b in pairwise(stations)]))
    path = CubicSpline(stations, nodes)(fine) if len(nodes) > 2 else _between(stations, nodes, fine)
    shades = colour
    if not isinstance(colour, str) and len(colour) == len(nodes):
        shades = _between(stations, colour, fine)
    elif not isinstance(colour, str):
        shades = colour[np.clip(np.searchsorted(stations, fine, side="right") - 1, 0, len(colour) - 1)]
    at = (fine / stations[-1]).tolist()
    radius = 0.5 * np.array(
        [rod.section.at(share).outer_diameter for share in (at[:1] if rod.section.is_uniform else at)]
    )
    return Tube(
        path, float(radius[0]) if rod.section.is_uniform else radius, colour=shades, opacity=opacity, bulky=True
    )


def _between(stations: Floats, values: Floats, at: Floats) -> Floats:
    return np.stack([np.interp(at, stations, column) for column in values.T], axis=1)


def balls(robot: Robot, part: ActuatedPart) -> list[int]:
    """Numbers of an actuator's via points that are drawn as balls: those in no disc; of many, which hide it, the
    ends.
    """
    shaped = {plate.name for plate in robot.plates if plate.disc is not None}
    found = [k for k, via in enumerate(part.route) if via.on not in shaped]
    return found if len(found) <= MOST_BALLS else [found[0], found[-1]]


def plate_parts(
    robot: Robot, plate: Plate, pose: Pose, colour: str, size: float, *, opacity: float = 1.0
) -> tuple[list[Part], Floats]:
    """A plate at a pose of its reference point, and points (n, 3) [m] of it for the line from its name.

    It is drawn in its own shape with open guide holes; one of no stated shape as the outline of what it is bonded to,
    with straight lines to the actuators, holes and markers that it carries.

    Parameters
    ----------
    robot
        What the plate is bonded to, with its actuators and markers.
    plate
        The plate.
    pose
        Pose of the plate's reference point [m].
    colour
        Colour of its parts.
    size
        Size of the robot [m].
    opacity
        From 0 to 1.
    """
    if plate.disc is not None:
        holes = np.array([*plate.holes.values()] if plate.disc.hole_diameter > 0.0 else []).reshape(-1, 3)
        disc = FlatDisc(
            pose.apply(plate.disc.centre - plate.reference),
            pose.rotation @ plate.disc.axis,
            0.5 * plate.disc.diameter,
            plate.disc.thickness,
            holes=pose.apply(holes - plate.reference),
            hole_radius=0.5 * plate.disc.hole_diameter,
            colour=colour,
            opacity=opacity,
        )
        return [disc], pose.apply(0.97 * (_rim(plate.disc) - plate.disc.centre) + plate.disc.centre - plate.reference)
    # Around the regions of bodies, and the sections of rods, that the plate holds, at rest.
    held = [path for body in robot.bodies for path in outlines(body, plate.nodes.get(body.name, ()))]
    for rod, node in ((one, node) for one in robot.rods for node in one.clamped.get(plate.name, ())):
        at, along = rod.centreline.nodes[node], rod.centreline.triads[node, :, 2]
        share = float(rod.centreline.stations[node] / rod.centreline.stations[-1])
        ring = ring_points(at, along, across(along), 0.55 * rod.section.at(share).outer_diameter, RIM)
        held.append(np.concatenate([ring, ring[:1]]))
    bonded = [pose.apply(path - plate.reference) for path in held]
    carried = [via.at for part in robot.actuated for via in part.route if via.on == plate.name]
    carried += [*plate.holes.values(), *(marker.place for marker in robot.markers if marker.on == plate.name)]
    arms = [pose.apply(np.stack([plate.reference, at]) - plate.reference) for at in carried]
    paths = [path for path in (*bonded, *arms) if np.ptp(path, axis=0).max() > 1e-6 * size]
    wire: list[Part] = [Wire(tuple(paths), LINE * size, colour=colour)] if paths else []
    return wire, np.concatenate(bonded or paths or [pose.position[None]])


def outlines(body: Body, nodes: Ints | Sequence[int]) -> list[Floats]:
    """Closed polylines (k, 3) at rest around the faces of a body whose corners are all among some nodes."""
    faces = boundary(body.mesh.tets)
    return [body.mesh.points[loop] for loop in border(faces[np.isin(faces[:, :3], nodes).all(axis=1)])]


def _rim(shape: Disc) -> Floats:
    return ring_points(shape.centre, shape.axis, across(shape.axis), 0.5 * shape.diameter, RIM)
