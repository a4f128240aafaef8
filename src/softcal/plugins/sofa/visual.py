"""Visual model of the scene: surfaces of bodies, rods and discs as .obj files, and the camera.

`run.py` does not use it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from softcal.checks import Floats, Ints
from softcal.geometry.surface import boundary_triangles
from softcal.plugins.sofa.robot import LinearRobot
from softcal.plugins.sofa.rods import SEGMENTS, finer
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
    up = up_direction(linear.robot)
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
        "surfaces": {
            name: {"file": _file(name), "opacity": skin.opacity}
            | ({} if skin.nodes is None else {"nodes": skin.nodes.tolist()})
            for name, skin in there.items()
        },
        "camera": {
            "position": (centre + distance * back).tolist(),
            "orientation": turn.as_quat().tolist(),
            "distance": distance,
        },
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


SHARP = np.radians(40.0)  # angle between neighbouring triangles above which their edge is sharp


def split_at_edges(points: Floats, triangles: Ints) -> tuple[Ints, Ints]:
    """Duplicate points on sharp edges, once for each smooth part of the surface: viewers shade smoothly across points.

    Parameters
    ----------
    points
        (n, 3) [m].
    triangles
        (k, 3), consistently oriented.

    Returns
    -------
    source, triangles
        Original number of each new point (m,); triangles (k, 3) of new points.
    """
    k = len(triangles)
    corner = np.arange(3 * k).reshape(k, 3)
    begins, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    at_begin, at_end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    key = np.minimum(begins, ends) * len(points) + np.maximum(begins, ends)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    # A side of one triangle, or of three and more, is a sharp edge.
    one, two = order[first[count == 2]], order[first[count == 2] + 1]
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    smooth = (normal[one // 3] * normal[two // 3]).sum(axis=1) > np.cos(SHARP)
    one, two = one[smooth], two[smooth]
    rows, columns = np.concatenate([at_begin[one], at_end[one]]), np.concatenate([at_end[two], at_begin[two]])
    same = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(3 * k, 3 * k))
    label = np.asarray(connected_components(same, directed=False)[1], dtype=np.int64)
    _, where = np.unique(label, return_index=True)
    return begins[where], label.reshape(k, 3)


def wavefront(points: Floats, triangles: Ints, title: str) -> str:
    """Text of a .obj file, in full precision.

    Parameters
    ----------
    points
        Points (n, 3) [m].
    triangles
        Triangles (k, 3).
    title
        Comment in the first line.
    """
    lines = [f"# {title}"]
    lines += ["v " + " ".join(repr(float(value)) for value in at) for at in points]
    lines += ["f " + " ".join(str(n + 1) for n in corners) for corners in triangles.tolist()]
    return "\n".join(lines) + "\n"
