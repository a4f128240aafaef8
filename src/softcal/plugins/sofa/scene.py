"""Writing a robot as a SOFA scene folder: source files, meshes, and parameters.json."""

from __future__ import annotations

import json
import keyword
import re
import unicodedata
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from softcal.csv_text import csv_text
from softcal.geometry.mesh import TetMesh
from softcal.geometry.surface import border
from softcal.mechanics.attachment import attach
from softcal.mechanics.elements import ELEMENTS
from softcal.plugins.sofa.robot import LinearRobot, material, scene_commands
from softcal.plugins.sofa.rods import SEGMENTS, finer, node_volumes, rod_parameters
from softcal.plugins.sofa.settings import SofaSettings
from softcal.sensing.channel import kinds
from softcal.twin.actuated import Actuator
from softcal.twin.loads import surface_forces
from softcal.twin.masses import plate_inertia
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Body, Cable, Control, PointLoad, Robot, Rod, SurfaceLoad
from softcal.twin.time_settings import TimeSettings

FORMAT = 1
SOURCE = Path(__file__).parent / "sofa_files"
ROBOT_PACKAGE = "ROBOT_PACKAGE"  # placeholder of the package's name in the sources
PACKAGE = "robot"  # default name of the package
PARAMETERS, SCHEDULE = "parameters.json", "schedule.csv"
# Names of the scene's files and of the modules they import.
TAKEN = frozenset({"", "scene", "run", "sofa", "sofaruntime", "numpy"})
# SOFA needs inertia: a massless body gets this density [kg/m^3], and a force that cancels its weight.
ASSUMED_DENSITY = 1000.0
RADIUS_OF_GYRATION = 1e-3  # [m], of a plate of unknown inertia, which SOFA inverts
PULL_SPEED = 2e-3  # [m/s], paper A's
PULL_TIME = 20.0  # [s], for the largest tension or pressure
KEY_STEP = 1e3  # [Pa], of a chamber that is not commanded
SCHEDULE_ROWS = 41


def scene_parameters(
    linear: LinearRobot,
    protocol: Protocol,
    motion: TimeSettings | None = None,
    settings: SofaSettings | None = None,
) -> dict[str, Any]:
    """Content of parameters.json: all numbers of the robot, in SI.

    Parameters
    ----------
    linear
        The robot with laws that SOFA has.
    protocol
        The cables pulled by tension or shortening, the chambers under pressure, and the drives turned by an angle; the
        others are slack, or open.
    motion
        Time step and damping of the scene; None for those of `TimeSettings()`.
    settings
        Those of run.py; None for the usual ones.
    """
    motion = motion or TimeSettings()
    robot = linear.robot.as_clamped
    protocol = scene_commands(robot, protocol)
    meshes = {body.name: body.mesh for body in robot.bodies}
    controls: dict[str, Control] = {name: command.control for name, command in protocol.commands.items()}
    largest = {name: float(np.abs(command.values).max(initial=0.0)) for name, command in protocol.commands.items()}
    plates: dict[str, Any] = {}
    for plate in robot.plates:
        per_mass = np.zeros((3, 3)) if plate.mass <= 0.0 else plate_inertia(plate) / plate.mass
        if np.linalg.eigvalsh(per_mass)[0] < RADIUS_OF_GYRATION**2:
            per_mass = per_mass + RADIUS_OF_GYRATION**2 * np.eye(3)
        plates[plate.name] = {
            "reference": plate.reference.tolist(),
            "centre_of_mass": plate.centre_of_mass.tolist(),
            "mass": plate.mass,
            "inertia_per_mass": per_mass.tolist(),
            "fixed": plate.fixed,
            "nodes": {name: nodes.tolist() for name, nodes in plate.nodes.items()},
        }
    cables: dict[str, Any] = {}
    for cable in robot.cables:
        control, most = controls.get(cable.name, "tension"), largest.get(cable.name, 0.0)
        via = cable.via_points if begins_first(cable) else cable.via_points[::-1]
        at = np.array([point.at for point in via])
        ends_in_space = via[0].on == ""
        cables[cable.name] = {
            "control": control,
            "pull_point": via[0].at.tolist() if ends_in_space else None,
            "points": [{"on": p.on, "at": p.at.tolist()} for p in (via[1:] if ends_in_space else via)],
            "length": float(np.linalg.norm(np.diff(at, axis=0), axis=1).sum()),
            "key_step": most / 50.0 if most > 0.0 else {"tension": 0.1, "shortening": 1e-3}[control],
        }
    markers: dict[str, Any] = {}
    for marker in robot.markers:
        on = "" if marker.on in linear.still else marker.on
        markers[marker.name] = {"on": on, "at": marker.place.tolist()}
        if marker.on in meshes:
            nodes, weights = attach(meshes[marker.on], marker.place[None], tolerance=np.inf, where=marker.name)
            markers[marker.name] |= {"nodes": nodes[0].tolist(), "weights": weights[0].tolist()}
    return {
        "format": FORMAT,
        "units": "m, kg, s, N, Pa, rad",
        "gravity": robot.gravity.tolist(),
        "time": {
            "dt": motion.time_step,
            "rayleigh_stiffness": motion.rayleigh_stiffness,
            "rayleigh_mass": motion.rayleigh_mass,
        },
        "constraint_solver": {"iterations": 500, "tolerance": 1e-9},
        "rest": (settings or SofaSettings()).rest,
        "bodies": {
            body.name: {
                "mesh": _mesh_file(body),
                **material(body.law, body.parameters),
                "density": density_in_motion(body),
                "fixed": body.fixed.tolist(),
            }
            for body in robot.bodies
        },
        "rods": {rod.name: rod_parameters(rod, density_in_motion(rod)) for rod in robot.rods},
        "plates": plates,
        "ties": {tie.name: {"body": tie.body, "on": tie.on, "nodes": tie.nodes.tolist()} for tie in robot.ties},
        "loads": _loads(robot, linear.still, meshes),
        "cables": cables,
        "chambers": {
            part.name: {**_chamber(part.actuator, meshes), "key_step": largest.get(part.name, 0.0) / 50.0 or KEY_STEP}
            for part in linear.chambers
        },
        "markers": markers,
    }


def write_scene(linear: LinearRobot, parameters: Mapping[str, Any], folder: Path, package: str = PACKAGE) -> list[Path]:
    """Write the scene's files into a folder, and the robot's sources, meshes and parameters into a package in it.

    Parameters
    ----------
    linear
        The robot with laws that SOFA has.
    parameters
        Those of `scene_parameters`.
    folder
        Existing one to write into.
    package
        Name of the package.
    """
    written = write_sources(folder, package)
    for body in linear.robot.as_clamped.bodies:
        path = folder / package / _mesh_file(body)
        path.write_text(legacy_vtk(body.mesh, body.name), encoding="utf-8")
        written.append(path)
    path = folder / package / PARAMETERS
    path.write_text(json.dumps(parameters, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return [*written, path]


def write_sources(folder: Path, package: str = PACKAGE) -> list[Path]:
    """Write the Python sources: `scene.py`, `run.py`, and the package of the robot."""
    (folder / package).mkdir()
    written: list[Path] = []
    for source in sorted(SOURCE.rglob("*.py")):
        inside = source.relative_to(SOURCE)
        path = folder / (inside if inside.parent == Path() else package / Path(inside.name))
        path.write_text(source.read_text(encoding="utf-8").replace(ROBOT_PACKAGE, package), encoding="utf-8")
        written.append(path)
    return written


def package_name(name: str) -> str:
    """A valid Python package name from a robot's name: "Soft neck, 2" becomes `soft_neck_2`."""
    ascii_only = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    found = re.sub(r"\W+", "_", ascii_only).strip("_").lower()[:40].rstrip("_")
    return found if found.isidentifier() and not keyword.iskeyword(found) and found not in TAKEN else f"robot_{found}"


def legacy_vtk(mesh: TetMesh, title: str) -> str:
    """Linear tets as legacy VTK text for SOFA's MeshVTKLoader, in full precision."""
    lines = ["# vtk DataFile Version 3.0", title, "ASCII", "DATASET UNSTRUCTURED_GRID"]
    lines.append(f"POINTS {mesh.n_points} double")
    lines += [" ".join(repr(float(value)) for value in at) for at in mesh.points]
    lines.append(f"CELLS {mesh.n_tets} {5 * mesh.n_tets}")
    lines += ["4 " + " ".join(str(n) for n in tet) for tet in mesh.tets]
    lines.append(f"CELL_TYPES {mesh.n_tets}")
    lines += ["10"] * mesh.n_tets
    return "\n".join(lines) + "\n"


def schedule_csv(protocol: Protocol) -> str:
    """The protocol over time: from zero to at most 41 of its samples, at paper A's 2 mm/s, or 20 s in total."""
    commands = protocol.thinned(SCHEDULE_ROWS).commands
    table = np.column_stack([np.append(0.0, command.values) for command in commands.values()])
    rates = np.array(
        [
            PULL_SPEED if c.control == "shortening" else max(float(np.abs(v).max(initial=0.0)), 1e-12) / PULL_TIME
            for c, v in zip(commands.values(), table.T, strict=True)
        ]
    )
    steps = np.abs(np.diff(table, axis=0)) / rates
    times = np.append(0.0, np.cumsum(np.maximum(steps.max(axis=1, initial=0.0), 1e-2)))
    headers = [f"{name}.{command.control} [{kinds()[command.control].unit}]" for name, command in commands.items()]
    rows = [[f"{t:.6g}", *(f"{v:.12g}" for v in row)] for t, row in zip(times, table, strict=True)]
    return csv_text(["time [s]", *headers], rows)


def _mesh_file(body: Body) -> str:
    return f"{body.name}.vtk"


def density_in_motion(part: Body | Rod) -> float:
    """Density [kg/m^3] of a part in the scene."""
    return part.density if part.density > 0.0 else ASSUMED_DENSITY


def begins_first(cable: Cable) -> bool:
    """Whether the scene's cable starts at the first via point: an end fixed in space, or the pulled one of two."""
    in_space = cable.via_points[0].on == "", cable.via_points[-1].on == ""
    return in_space[0] if in_space[0] != in_space[1] else cable.pulled_end == "first"


def _chamber(actuator: Actuator, meshes: Mapping[str, TetMesh]) -> dict[str, Any]:
    """The closed surface of a chamber: points of bodies, and triangles of them whose normals point out of the chamber.

    An opening is closed by triangles from one node of its rim, with the area, and so the force, of a flat cap.
    """
    points: list[tuple[str, int]] = []
    triangles: list[list[int]] = []
    for body, faces in actuator.surfaces.items():
        first = len(points)
        used, numbers = np.unique(np.asarray(faces), return_inverse=True)
        points += [(body, int(node)) for node in used]
        wall = first + numbers.reshape(-1, 3)
        triangles += wall[:, ::-1].tolist()
        triangles += [[rim[0], a, b] for rim in map(np.ndarray.tolist, border(wall)) for a, b in pairwise(rim[1:-1])]
    return {
        "bodies": [body for body, _ in points],
        "nodes": [node for _, node in points],
        "positions": [meshes[body].points[node].tolist() for body, node in points],
        "triangles": triangles,
    }


def _loads(robot: Robot, still: tuple[str, ...], meshes: Mapping[str, TetMesh]) -> dict[str, Any]:
    loads: dict[str, Any] = {}
    for body in robot.bodies:
        if body.density <= 0.0 and robot.gravity.any():
            volumes = ELEMENTS[body.element].nodal_volumes(body.mesh.points, body.mesh.tets)
            forces = -ASSUMED_DENSITY * volumes[:, None] * robot.gravity
            loads[f"{body.name}_weightless"] = {
                "on": body.name, "nodes": list(range(len(volumes))), "forces": forces.tolist(),
            }  # fmt: skip
    for rod in robot.rods:
        if rod.density <= 0.0 and robot.gravity.any():
            volumes = node_volumes(finer(rod, SEGMENTS))
            forces = np.zeros((len(volumes), 6))
            forces[:, :3] = -ASSUMED_DENSITY * volumes[:, None] * robot.gravity
            loads[f"{rod.name}_weightless"] = {
                "on": rod.name, "nodes": list(range(len(forces))), "forces": forces.tolist(),
            }  # fmt: skip
    for load in robot.loads:
        if load.on in still:
            continue
        if isinstance(load, PointLoad):
            loads[load.name] = {"on": load.on, "at": load.at.tolist(), "force": load.force.tolist()}
        if not isinstance(load, SurfaceLoad):
            continue
        total = np.zeros((meshes[load.on].n_points, 3))
        for _, weights, force in surface_forces(load, dict(meshes), dict(meshes), {load.on: 0}):
            for node, weight in weights:
                total[node] += weight * force
        nodes = np.flatnonzero(total.any(axis=1))
        loads[load.name] = {"on": load.on, "nodes": nodes.tolist(), "forces": total[nodes].tolist()}
    return loads
