"""Visual model of the scene: surfaces of bodies, rods and discs as .obj files, and the camera.

`run.py` does not use it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from softcal.checks import Floats, Ints
from softcal.geometry.surface import boundary_triangles
from softcal.plugins.sofa.robot import LinearRobot
from softcal.plugins.sofa.rods import SEGMENTS, finer
from softcal.plugins.sofa.wavefront import split_at_edges, wavefront
from softcal.twin.contacts import disc_skin
from softcal.twin.facing import plate_normal, plate_radius, up_direction
from softcal.twin.robot import Disc, Plate, Robot, Rod

SIDES = 12  # of a rod
FIELD_OF_VIEW = 45.0  # [degrees], of SOFA's cameras
VIEW = (0.45, -0.8, 0.35)  # direction to the camera: along x (or y, if x is up), across both, and up
ROOM = 1.2  # margin for bending, relative to the robot's size
MARKER = 0.02  # a marker's radius, relative to half the robot's size
FLAT = 0.05  # thickness of a plate of unknown shape, relative to its radius
SEE_THROUGH = 0.35  # its opacity


@dataclass(frozen=True)
class Skin:
    """Surface of a part: points (n, 3) [m], outward triangles (k, 3); nodes (n,): the rod's node of each point."""

    points: Floats
    triangles: Ints
    nodes: Ints | None = None
    opacity: float = 1.0


def skins(linear: LinearRobot) -> dict[str, Skin]:
    """Surfaces of all bodies, rods and plates, except plates of unknown shape without attached parts."""
    robot = linear.robot
    found = {body.name: Skin(body.mesh.points, boundary_triangles(body.mesh.tets)) for body in robot.bodies}
    found |= {rod.name: rod_skin(finer(rod, SEGMENTS)) for rod in robot.rods}
    plates = ((plate.name, plate_skin(robot, plate)) for plate in robot.plates)
    found |= {name: skin for name, skin in plates if skin is not None}
    for name, skin in found.items():
        source, triangles = split_at_edges(skin.points, skin.triangles)
        nodes = None if skin.nodes is None else skin.nodes[source]
        found[name] = replace(skin, points=skin.points[source], triangles=triangles, nodes=nodes)
    return found


def plate_skin(robot: Robot, plate: Plate) -> Skin | None:
    """Surface of a plate's disc, or of a thin one that covers its attached points; None if there are none."""
    if plate.disc is not None:
        return Skin(*disc_skin(plate.disc))
    radius = plate_radius(robot, plate)
    if not radius > 0.0:
        return None
    flat = Disc(2.0 * radius, FLAT * radius, plate_normal(robot, plate), plate.reference)
    return Skin(*disc_skin(flat), opacity=SEE_THROUGH)


def rod_skin(rod: Rod) -> Skin:
    """A round wire of the section's outer diameter, closed at its ends."""
    line, n = rod.centreline, len(rod.centreline.nodes)
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    ring = 0.5 * rod.section.constants.outer_diameter * np.column_stack([np.cos(angle), np.sin(angle)])
    walls = line.nodes[:, None] + np.einsum("nij,sj->nsi", line.triads[:, :, :2], ring)
    one = SIDES * np.arange(n - 1)[:, None] + np.arange(SIDES)
    two = SIDES * np.arange(n - 1)[:, None] + np.roll(np.arange(SIDES), -1)
    begin, end = np.full(SIDES, SIDES * n), np.full(SIDES, SIDES * n + 1)
    last = SIDES * (n - 1)
    faces = [
        (one.ravel(), two.ravel(), two.ravel() + SIDES), (one.ravel(), two.ravel() + SIDES, one.ravel() + SIDES),
        (two[0], one[0], begin), (last + one[0], last + two[0], end),
    ]  # fmt: skip
    return Skin(
        np.concatenate([walls.reshape(-1, 3), line.nodes[[0, -1]]]),
        np.concatenate([np.stack(face, axis=1) for face in faces]),
        np.append(np.repeat(np.arange(n), SIDES), [0, n - 1]),
    )


def visual_parameters(linear: LinearRobot) -> dict[str, Any]:
    """Visual entries of parameters.json: surfaces, a camera that shows the whole robot, a marker's size."""
    there = skins(linear)
    points = np.concatenate(
        [
            *(skin.points for skin in there.values()),
            *(point.at[None] for cable in linear.robot.cables for point in cable.via_points),
        ]
    )
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    size = float(np.linalg.norm(points - centre, axis=1).max())
    return {
        "surfaces": {
            name: {"file": _file(name), "opacity": skin.opacity}
            | ({} if skin.nodes is None else {"nodes": skin.nodes.tolist()})
            for name, skin in there.items()
        },
        "camera": _camera(centre, size, up_direction(linear.robot)),
        "marker_radius": MARKER * size,
    }


def write_surfaces(linear: LinearRobot, folder: Path) -> list[Path]:
    """Write the surfaces listed by `visual_parameters` into an existing folder."""
    written: list[Path] = []
    for name, skin in skins(linear).items():
        path = folder / _file(name)
        path.write_text(wavefront(skin.points, skin.triangles, f"{name} [m]"), encoding="utf-8")
        written.append(path)
    return written


def _file(name: str) -> str:
    return f"{name}.obj"


def _camera(centre: Floats, size: float, up: Floats) -> dict[str, Any]:
    """Position, orientation (x, y, z, w) and distance to the target."""
    along = np.eye(3)[0 if abs(up[0]) < 0.9 else 1]
    along = along - (along @ up) * up
    along /= np.linalg.norm(along)
    back = np.array(VIEW) @ np.array([along, np.cross(up, along), up])
    back /= np.linalg.norm(back)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    turn = Rotation.from_matrix(np.column_stack([right, np.cross(back, right), back]))
    distance = ROOM * size / float(np.sin(np.radians(0.5 * FIELD_OF_VIEW)))
    return {
        "position": (centre + distance * back).tolist(),
        "orientation": turn.as_quat().tolist(),
        "distance": distance,
    }
