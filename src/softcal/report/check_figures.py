"""Pictures for the visual check of a project: mesh with regions, actuators, loads; curves of every experiment; states
before the fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats, Ints
from softcal.experiments.dataset import Dataset
from softcal.geometry.fine_surface import fine_surface
from softcal.geometry.pose import Pose
from softcal.geometry.ring import across
from softcal.report.figures.force_displacement import draw_record
from softcal.report.format import file_stem, number
from softcal.report.robot_view import (
    AROUND,
    LINE,
    ROUTE,
    WALL,
    Walls,
    actuator_legend,
    balls,
    has_materials,
    material_colours,
    material_faces,
    material_legend,
    name_of,
    on_walls,
    outlines,
    plate_parts,
    robot_points,
    rod_colours,
    rod_tube,
    routed,
    wall_labels,
)
from softcal.report.scene import (
    Arrow,
    Ball,
    Label,
    Part,
    Projection,
    Scene,
    Surface,
    Tube,
    Wire,
    alike,
    bending_camera,
    extent_points,
    length_scale,
    refined,
)
from softcal.report.scene_figure import draw_side_by_side
from softcal.report.scene_render import render_scenes
from softcal.report.scene_twin import bending_axes, displacements, route_radius, twin_parts
from softcal.report.style import BLUE, GREEN, INK, PURPLE, RED, SKY, as_png
from softcal.report.twin_view import TwinView
from softcal.report.write import write_files
from softcal.twin.facing import up_direction
from softcal.twin.loads import walls
from softcal.twin.response import Snapshot
from softcal.twin.robot import Body, Moment, PointLoad, Robot, SurfaceLoad

MOST = 4  # side by side

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_EDGES = 20000  # tets of a mesh whose edges can be told apart
_SEEN_THROUGH = 0.6  # opacity of what may have actuators or markers inside
BESIDE = 5e-3  # of the size of the robot: what is nearer to its axis is at it, but for the mesh


@dataclass(frozen=True)
class StartScenes:
    """Scenes in one projection; largest: the largest displacement [m], top of the colour scale."""

    scenes: tuple[Scene, ...]
    cameras: tuple[Projection, ...]
    largest: float


def start_scenes(
    robot: Robot, undeformed: Snapshot, shapes: Mapping[str, Snapshot], tets: Mapping[str, Ints]
) -> StartScenes | None:
    """The undeformed shape and the most displaced ones, coloured by displacement; None if nothing moved.

    Parameters
    ----------
    robot
        The robot.
    undeformed
        Its shape without loads.
    shapes
        Title -> shape.
    tets
        Body -> connectivity of `Snapshot.points` (n_tets, 4 or 10).
    """
    views = {name: TwinView(robot, undeformed, shape, tets) for name, shape in shapes.items()}
    moved = {name: displacements(view.rest, view.bent) for name, view in views.items()}
    furthest = {name: max(float(d.max()) for d in parts.values()) for name, parts in moved.items()}
    largest = max(furthest.values(), default=0.0)
    if largest <= 0.0:
        return None
    chosen = set(sorted(furthest, key=lambda name: -furthest[name])[: MOST - 1])
    far = views[max(furthest, key=lambda name: furthest[name])]
    scenes = [Scene("Undeformed", *twin_parts(far, undeformed, None, largest))]
    scenes += [
        Scene(name, *twin_parts(view, view.bent, moved[name], largest))
        for name, view in views.items()
        if name in chosen
    ]
    camera = bending_camera(extent_points(tuple(scenes)), *bending_axes(far))
    return StartScenes(tuple(scenes), (camera,) * len(scenes), largest)


@dataclass(frozen=True)
class CheckPaths:
    """Files: the robot, each dataset by name, the solved states; notes: why pictures are missing."""

    robot: Path
    datasets: Mapping[str, Path]
    states: Path | None = None
    notes: tuple[str, ...] = ()


def draw_check(
    robot: Robot, datasets: Mapping[str, Dataset], out_dir: str | Path, states: StartScenes | None = None
) -> CheckPaths:
    """Draw `robot.png`, `data-<name>.png` and, with states, `states.png`; older files are replaced.

    Parameters
    ----------
    robot
        The robot, drawn at rest.
    datasets
        Experiment -> its record.
    out_dir
        Folder of the pictures.
    states
        Scenes of solved states; None draws none.

    Raises
    ------
    StorageError
        Where the folder cannot be written.
    """
    folder = Path(out_dir)
    scenes, cameras = robot_scenes(robot)
    n = len(scenes)
    more = ((), ()) if states is None else (states.scenes, states.cameras)
    files: dict[Path, bytes] = {}

    def add(stem: str, figure: Figure) -> Path:
        path = folder / f"{stem}.png"
        files[path] = as_png(figure)
        return path

    with ThreadPoolExecutor(1) as renderer:  # its process works while the curves are drawn here
        # One call for all scenes: starting the renderer takes longer than rendering.
        rendering = renderer.submit(render_scenes, (*scenes, *more[0]), (*cameras, *more[1]))
        of_data = {name: add(f"data-{file_stem(name)}", draw_record(data)) for name, data in datasets.items()}
        rendered = rendering.result()
    own, others = (replace(rendered, pictures=part) for part in (rendered.pictures[:n], rendered.pictures[n:]))
    carriers = {_carrier_colour(robot, via.on) for part in robot.actuated for via in part.route}
    legend = material_legend(robot)
    if any(len(body.fixed) for body in robot.bodies) or any(plate.fixed for plate in robot.plates):
        legend["fixed"] = INK
    if any(not plate.fixed for plate in robot.plates):
        legend["plate (nodes, via points)" if robot.bodies else "plate"] = BLUE
    legend |= actuator_legend(robot)
    legend |= {
        name: colour
        for colour, name in ((GREEN, "via point in space"), (PURPLE, "via point on a body"))
        if colour in carriers
    }
    if robot.markers:
        legend["marker"] = SKY
    if robot.loads or np.any(robot.gravity):
        legend["load, gravity"] = RED
    drawn = draw_side_by_side(scenes, cameras, own, colours=legend)
    of_robot, of_states = add("robot", drawn.figure), None
    if states is not None:
        materials = material_legend(robot) if has_materials(robot) else None
        shown = draw_side_by_side(states.scenes, states.cameras, others, largest=states.largest, colours=materials)
        of_states = add("states", shown.figure)
    write_files(files)
    return CheckPaths(of_robot, of_data, of_states, (drawn.note,) if drawn.note else ())


def robot_scenes(robot: Robot) -> tuple[tuple[Scene, ...], tuple[Projection, ...]]:
    """Two views of the robot at rest: from the side, and turned by 90 degrees from a higher viewpoint."""
    points = robot_points(robot)
    size = length_scale(points)
    walled = walls(robot, {body.name: body.mesh for body in robot.bodies})
    parts: list[Part] = [surface for body in robot.bodies for surface in _surfaces(robot, body, walled)]
    fixed = [path for body in robot.bodies for path in outlines(body, body.fixed)]
    parts += [Wire(tuple(fixed), LINE * size, colour=INK)] if fixed else []
    carried = {part.on for part in (*(via for part in robot.actuated for via in part.route), *robot.markers)}
    for rod in robot.rods:
        opacity = _SEEN_THROUGH if rod.name in carried else 1.0
        colours = rod_colours(rod, material_colours(robot))
        parts.append(rod_tube(rod, rod.centreline.nodes, colours, opacity=opacity))
    others: list[Label] = []
    for plate in robot.plates:
        pose = Pose(np.eye(3), plate.reference)
        drawn, around = plate_parts(robot, plate, pose, INK if plate.fixed else BLUE, size)
        parts += drawn
        others.append(Label(plate.name, around))
    of_walls = wall_labels(walled, {body.name: body.mesh.points for body in robot.bodies})
    names, radius, routes = [*of_walls], route_radius(robot, size), list[Floats]()
    for part in routed(robot):
        path = np.stack([via.at for via in part.route])
        routes.append(path)
        parts.append(Tube(path, radius, colour=ROUTE))
        shown = [part.route[k] for k in balls(robot, part)]
        parts += [Ball(via.at, 2 * radius, colour=_carrier_colour(robot, via.on)) for via in shown]
        names.append(Label(name_of(robot, part), refined(path)))
    parts += [Ball(marker.place, 0.012 * size, colour=SKY) for marker in robot.markers]
    others += [Label(marker.name, marker.place[None]) for marker in robot.markers]
    up = up_direction(robot)
    towards = _first_actuator_side([*routes, *(one.at for one in of_walls)], points.mean(axis=0), up, size)
    # Arrows of equal length for all loads, so that small ones are visible; the label gives the magnitude.
    load_names: list[Label] = []
    for load in robot.loads:
        if isinstance(load, PointLoad):
            at, force, unit = load.at, load.force, "N"
        elif isinstance(load, Moment):
            at, force, unit = load.at, load.moment, "N m"
        else:
            body = next(body for body in robot.bodies if body.name == load.on)
            at, force, unit = body.mesh.points[np.unique(load.faces)].mean(axis=0), load.traction, "Pa"
        strength = float(np.linalg.norm(force))
        if strength > 0:
            tail = at - 0.3 * size * force / strength
            parts.append(Arrow(tail, at, 0.009 * size, colour=RED))
            load_names.append(Label(f"{load.name}: {number(strength)} {unit}", tail[None]))
    strength = float(np.linalg.norm(robot.gravity))
    if strength > 0:  # an arrow beside the robot, visible in both views
        side = np.cross(up, towards) - towards
        side = side / np.linalg.norm(side)
        middle = points.mean(axis=0)
        every = np.concatenate([points, *routes])
        tail = middle + (float(((every - middle) @ side).max()) + 0.22 * size) * side
        parts.append(Arrow(tail, tail + 0.2 * size * robot.gravity / strength, 0.009 * size, colour=RED))
        load_names.append(Label(f"gravity: {number(strength)} m/s²", tail[None]))
    names += load_names
    first, second = (others, names) if others else (names, others)
    scenes = (
        Scene("From the side", tuple(parts), tuple(first)),
        Scene("Turned by 90 deg", tuple(parts), tuple(second)),
    )
    extent = extent_points(scenes)
    return scenes, alike((bending_camera(extent, up, towards), bending_camera(extent, up, np.cross(up, towards))))


def region_colours(robot: Robot, body: Body, faces: Ints, colour: str) -> Floats:
    """RGB (n, 3) of each face of a body: loaded, else fixed if all its corners are, else tied if all belong to a plate.

    Parameters
    ----------
    robot
        Its plates and loads mark faces of the body.
    body
        The body of the faces.
    faces
        Nodes of each face, corners first (n, 3 or more).
    colour
        Colour of the other faces.
    """
    from matplotlib.colors import to_rgb

    corners = faces[:, :3]
    colours = np.tile(to_rgb(colour), (len(faces), 1))
    for plate in robot.plates:
        if body.name in plate.nodes:
            colours[np.isin(corners, plate.nodes[body.name]).all(axis=1)] = to_rgb(BLUE)
    colours[np.isin(corners, body.fixed).all(axis=1)] = to_rgb(INK)
    for load in robot.loads:
        if isinstance(load, SurfaceLoad) and load.on == body.name:
            colours[np.isin(corners, load.faces).all(axis=1)] = to_rgb(RED)
    return colours


def _surfaces(robot: Robot, body: Body, walled: Walls) -> list[Surface]:
    """The surface of each material, and the walls that actuators act on; one with actuators or other materials inside
    is seen through.
    """
    has_inside = any(via.on == body.name for part in robot.actuated for via in part.route)
    has_inside |= any(body.name in part.surfaces for part in robot.actuated)
    colours, surfaces = material_colours(robot), list[Surface]()
    for material, every in material_faces(body, body.mesh.tets).items():
        is_wall = on_walls(every, body.name, walled)
        if is_wall.any():
            wall = fine_surface(every[is_wall])
            surfaces.append(Surface(wall.at(body.mesh.points), wall.triangles, colour=WALL))
        faces = every[~is_wall]
        fine = fine_surface(faces)
        around = material == body.name and len(body.materials) > 1
        surfaces.append(
            Surface(
                fine.at(body.mesh.points),
                fine.triangles,
                colour=fine.by_triangle(region_colours(robot, body, faces, colours[material])),
                opacity=AROUND if around else _SEEN_THROUGH if has_inside else 1.0,
                edges=fine.edges if material == body.name and body.mesh.n_tets < _MOST_EDGES else None,
            )
        )
    return surfaces


def _carrier_colour(robot: Robot, carrier: str) -> str:
    if carrier in {plate.name for plate in robot.plates}:
        return BLUE
    return PURPLE if carrier else GREEN


def _first_actuator_side(actuators: Iterable[Floats], middle: Floats, up: Floats, size: float) -> Floats:
    """The direction across `up` from the middle of the robot (3,) to the first actuator that is not at its axis.

    actuators: points (n, 3) of each; any direction where there is none.
    """
    for points in actuators:
        offset = points.mean(axis=0) - middle
        aside = offset - (offset @ up) * up
        if np.linalg.norm(aside) > BESIDE * size:
            return aside
    return across(up)
