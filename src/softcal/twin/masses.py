"""Mass matrices of bodies, rods and plates."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault
from softcal.mechanics.inertia import (
    Inertia,
    build_inertia,
    element_masses,
    no_frame_masses,
    ride_along,
    second_moments,
)
from softcal.mechanics.layout import FREE, TIED
from softcal.twin.build import Twin
from softcal.twin.robot import Plate, Robot
from softcal.twin.time_settings import MassMatrix


def robot_inertia(twin: Twin, robot: Robot, masses: MassMatrix = "consistent") -> Inertia:
    """The inertia of a robot.

    A body's mass is consistent or lumped. A rod's is lumped at its nodes, with the rotary inertia of its section. A
    plate has its mass, its inertia tensor (see `Plate`) and the mass of whatever tets lie on it whole.

    Parameters
    ----------
    twin
        The twin of the robot, but for parameters.
    robot
        The robot.
    masses
        Whether masses of bodies are consistent or lumped.
    """
    layout = twin.system.layout
    carried = no_frame_masses(layout)
    elements: list[tuple[Ints, Floats]] = []
    for body in robot.bodies:
        mesh = twin.meshes[body.name]
        points = twin.first_point[body.name] + mesh.tets
        density = np.zeros(mesh.n_tets)
        for material in body.materials:
            density[material.elements] = material.density
        matrices = density[:, None, None] * element_masses(mesh, lumped=masses == "lumped")
        riders = layout.rider[points]
        as_one = (riders == riders[:, :1]).all(axis=1)
        on_frame = as_one & (riders[:, 0] >= 0)
        ride_along(carried, layout, points[on_frame], matrices[on_frame])
        bends = ~as_one | (riders[:, 0] == FREE) | (riders[:, 0] == TIED)
        elements.append((points[bends], matrices[bends]))
    for rod in robot.rods:
        frames = layout.rider[twin.first_point[rod.name] :][: len(rod.centreline.nodes)]
        stations, half = rod.centreline.stations / rod.centreline.stations[-1], 0.5 * rod.centreline.lengths
        density = np.zeros(len(half))
        for material in rod.materials:
            density[material.elements] = material.density
        volumes = density[:, None] * rod.volumes
        at_nodes = np.append(volumes[:, 0], 0.0) + np.insert(volumes[:, 1], 0, 0.0)
        line = np.append(density * half, 0.0) + np.insert(density * half, 0, 0.0)  # [kg/m^2]: times I is inertia
        sections = [rod.section.at(float(share)) for share in stations]
        # The second moment along axis 1 is I2, that about axis 2.
        along = np.array([[section.I2, section.I1, 0.0] for section in sections])
        triads = rod.centreline.triads
        tensors = line[:, None, None] * (triads * along[:, None, :]) @ np.swapaxes(triads, 1, 2)
        carried.add(frames, at_nodes, rod.centreline.nodes - layout.references[frames], tensors)
    for plate in robot.plates:
        frame = twin.frame[plate.name]
        arm = plate.centre_of_mass - layout.references[frame]
        carried.add(np.array([frame]), np.array([plate.mass]), arm[None], _plate_moments(plate)[None])
    return build_inertia(layout, twin.system.pattern, elements, carried)


def no_mass(robot: Robot) -> Fault:
    """The fault of a robot whose inertia is none."""
    parts = ", ".join(part.name for part in (*robot.bodies, *robot.rods, *robot.plates))
    return Fault("nothing that moves has mass", parts, attempt="a density, or a plate's mass")


def plate_inertia(plate: Plate) -> Floats:
    """The plate's inertia tensor about its centre of mass (3, 3) [kg m^2]; see `Plate`."""
    moments = _plate_moments(plate)
    return float(np.trace(moments)) * np.eye(3) - moments


def _plate_moments(plate: Plate) -> Floats:
    if plate.inertia is not None:
        return second_moments(plate.inertia)
    if plate.disc is None:
        return np.zeros((3, 3))
    axis = plate.disc.axis
    across, along = plate.mass * plate.disc.diameter**2 / 16.0, plate.mass * plate.disc.thickness**2 / 12.0
    return across * (np.eye(3) - np.outer(axis, axis)) + along * np.outer(axis, axis)
