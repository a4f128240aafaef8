"""Shapes for PyVista; and for ParaView: one .vtu file per solved shape, and a .pvd file that lists them in order.

ParaView's time is the drive in its display unit, such as the pulled cable's shortening [mm] or a chamber's pressure
[kPa], or the time [s]. It is the number of the shape if several actuators are driven or the drive does not ascend,
since shapes of equal time would be drawn together.

Points carry `displacement` [m] from the robot without loads; tets `stress` (Cauchy) and `von_mises` [Pa], and `strain`
(Green-Lagrange), each the element's mean; rods and the routes of actuators are lines, discs their skins, chambers their
walls. `part` numbers the parts as in `parts`, which is field data, as the parameters, efforts and coordinates are, and
in `parts.txt`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from softcal.checks import Floats, Ints
from softcal.declare import checked_arguments
from softcal.errors import Fault, ParameterError
from softcal.extras import require_extra
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.stress import cauchy_stress, green_lagrange_strain, von_mises
from softcal.twin.contacts import disc_skin
from softcal.twin.loads import walls
from softcal.twin.parameters import robot_parameters
from softcal.twin.response import Response, Snapshot
from softcal.twin.robot import Robot
from softcal.units import readable_unit, unit_factor

VTK_LINE, VTK_TRIANGLE = 3, 5


def write_vtk(robot: Robot, response: Response, folder: Path) -> list[Path]:
    """Write every shape of a response into an existing folder; returns the .pvd and the .vtu files.

    Parameters
    ----------
    robot
        The robot.
    response
        A response with snapshots.
    folder
        An existing folder.

    Raises
    ------
    ParameterError
        If the response has no shapes: simulate with `snapshots=True`.
    """
    if not response.snapshots:
        raise ParameterError(Fault("the response has no shapes", attempt="simulate with snapshots=True"))
    written: list[Path] = []
    for i, shape in enumerate(response.snapshots):
        path = folder / f"shape-{i:03d}.vtu"
        shape_grid(robot, shape).save(str(path))
        written.append(path)
    unit, drive = response.snapshots[0].drive_unit, np.array([shape.drive for shape in response.snapshots])
    if unit:
        drive = drive / unit_factor(readable_unit(float(np.abs(drive).max()), unit), unit)
    times = drive if (np.diff(drive) > 0.0).all() else np.arange(1.0, len(drive) + 1.0)
    entries = "".join(
        f'    <DataSet timestep="{time:.10g}" group="" part="0" name={quoteattr(shape.label)} file="{path.name}"/>\n'
        for time, shape, path in zip(times, response.snapshots, written, strict=True)
    )
    series = folder / "shapes.pvd"
    series.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        f"{entries}  </Collection>\n</VTKFile>\n",
        encoding="utf-8",
    )
    (folder / "parts.txt").write_text(
        "".join(f"{i} {name}\n" for i, name in enumerate(_parts(robot))), encoding="utf-8"
    )
    return [series, *written]


class _Cells:
    """Points and cells of all parts, concatenated."""

    def __init__(self) -> None:
        self.points: list[Floats] = []
        self.rest: list[Floats] = []
        self.cells: list[Ints] = []
        self.kinds: list[int] = []
        self.part: list[int] = []
        self.stress: list[Floats] = []
        self.strain: list[Floats] = []
        self._n = 0

    def add(self, part: int, x: Floats, rest: Floats, cells: Ints, kind: int) -> None:
        """Add a part with its cells, with zero stress by default."""
        self.points.append(x)
        self.rest.append(rest)
        self.cells.append(np.insert(self._n + cells, 0, cells.shape[1], axis=1).ravel())
        self.kinds += [kind] * len(cells)
        self.part += [part] * len(cells)
        self._n += len(x)
        self.stress.append(np.zeros((len(cells), 3, 3)))
        self.strain.append(np.zeros((len(cells), 3, 3)))


def _parts(robot: Robot) -> list[str]:
    """The names of what is drawn, in the order of their numbers."""
    discs = [plate for plate in robot.plates if plate.disc is not None]
    lines = [part for part in robot.actuated if part.route]
    walled = [part for part in robot.actuated if part.surfaces]
    return [part.name for part in (*robot.bodies, *robot.rods, *lines, *discs, *walled)]


@checked_arguments
def shape_grid(robot: Robot, shape: Snapshot) -> Any:
    """A solved shape of a robot as a grid of PyVista, whose filters take it and whose `plot` draws it.

    Points carry `displacement` [m] from the robot without loads; tets `stress` (Cauchy, 9 columns) and `von_mises` [Pa]
    and `strain` (Green-Lagrange), each the element's mean, zero in all else (`cell_data_to_point_data()` gives means at
    the points). Rods and the routes of actuators are lines, discs their skins, chambers their walls. Every cell has a
    `part`, its number in `field_data["parts"]`, where the parameters, efforts and coordinates are too.

    Parameters
    ----------
    robot
        The robot, with the parameters of the shape.
    shape
        One of `Response.snapshots`, which `simulate(…, snapshots=True)` keeps, or the `shape` of a `LiveState`.

    Returns
    -------
    pyvista.UnstructuredGrid
        One of all parts, where they are in the shape [m].

    Raises
    ------
    InputError
        Where PyVista is not installed.
    ParameterError
        Where the shape is not one of the robot.
    """
    require_extra("pictures", "pyvista", where="shape_grid")
    import pyvista

    names = _parts(robot)
    meshes = {body.name: body.clamped(ELEMENTS[body.element].mesh(body.mesh)) for body in robot.bodies}
    sizes = {name: mesh.n_points for name, mesh in meshes.items()}
    sizes |= {rod.name: len(rod.centreline.nodes) for rod in robot.rods}
    sizes |= {part.name: len(part.route) for part in robot.actuated if part.route}
    if sizes != {name: len(x) for name, x in (*shape.points.items(), *shape.rods.items(), *shape.routes.items())}:
        raise ParameterError(Fault("the shape is of another robot", "shape", shape.label, "one of this robot"))
    cells = _Cells()
    for body in robot.bodies:
        element, mesh, x = ELEMENTS[body.element], meshes[body.name], shape.points[body.name]
        tets = mesh.tets
        cells.add(names.index(body.name), x, mesh.points, tets, element.cell.vtk)
        places, n_q = element.places(mesh.points, tets), len(element.quadrature.points)
        for part in body.materials:
            own, pressure = TetMesh(mesh.points, tets[part.elements]), shape.pressures.get(part.name)
            directions = body.directions(places.reshape(-1, n_q, 3)[part.elements].reshape(-1, 3))
            cells.stress[-1][part.elements] = cauchy_stress(
                element, own, body.elasticity, part.parameters, x, pressure, directions
            )
        cells.strain[-1] = green_lagrange_strain(element, mesh, x)
    lines = {rod.name: (rod.centreline.nodes, shape.rods[rod.name]) for rod in robot.rods}
    for part in robot.actuated:
        if part.route:
            lines[part.name] = np.array([point.at for point in part.route]), shape.routes[part.name]
    for name, (at_rest, x) in lines.items():
        segments = np.arange(len(x) - 1)[:, None] + [0, 1]
        cells.add(names.index(name), x, at_rest, segments, VTK_LINE)
    for plate in robot.plates:
        if plate.disc is not None:
            skin, faces = disc_skin(plate.disc)
            position, rotation = shape.plates[plate.name]
            x = position + (skin - plate.reference) @ rotation.T
            cells.add(names.index(plate.name), x, skin, faces, VTK_TRIANGLE)
    for name, by_body in walls(robot, meshes).items():
        for body, faces in by_body.items():
            nodes, corners = np.unique(faces[:, :3], return_inverse=True)
            x, at_rest = shape.points[body][nodes], meshes[body].points[nodes]
            cells.add(names.index(name), x, at_rest, corners.reshape(-1, 3), VTK_TRIANGLE)
    points = np.concatenate(cells.points)
    grid = pyvista.UnstructuredGrid(np.concatenate(cells.cells), np.array(cells.kinds, dtype=np.uint8), points)
    grid.point_data["displacement"] = points - np.concatenate(cells.rest)
    stress = np.concatenate(cells.stress)
    grid.cell_data["stress"] = stress.reshape(-1, 9)
    grid.cell_data["von_mises"] = von_mises(stress)
    grid.cell_data["strain"] = np.concatenate(cells.strain).reshape(-1, 9)
    grid.cell_data["part"] = np.array(cells.part)
    # VTK has texts of ASCII alone: another letter is written as in Python's strings, \xfc.
    grid.field_data["parts"] = [name.encode("ascii", "backslashreplace").decode() for name in names]
    for name, info in robot_parameters(robot).items():
        grid.field_data[f"{name} [{info.unit}]"] = [info.value]
    for part in robot.actuated:
        for kind, values in zip(part.channels, (shape.coordinates, shape.efforts), strict=True):
            if part.name in values:
                grid.field_data[f"{part.name}.{kind.name} [{kind.unit}]"] = [values[part.name]]
    return grid
