"""Supports of via points by a robot's bodies: in a bore, by its wall all around; and their extent."""

from __future__ import annotations

from softcal.mechanics.attachment import Attachment, attach_ball
from softcal.twin.robot import Robot


def supports(robot: Robot) -> dict[str, dict[int, Attachment]]:
    """Cable -> the numbers of its via points on bodies, from 0, with their attachment; only cables with such points."""
    meshes = {body.name: body.mesh for body in robot.bodies}
    attachments: dict[str, dict[int, Attachment]] = {}
    for cable in robot.cables:
        for i, via in enumerate(cable.via_points):
            if via.on in meshes:
                where = f"{cable.name}, via point {i + 1}"
                attachments.setdefault(cable.name, {})[i] = attach_ball(meshes[via.on], via.at, via.radius, where=where)
    return attachments


def bores(robot: Robot) -> dict[str, dict[int, float]]:
    """Cable -> the numbers of its via points in bores, from 0, with the bores' diameters [m]; only cables with such
    points.
    """
    wide = {
        cable: {i: held.bore for i, held in points.items() if held.bore > 0.0}
        for cable, points in supports(robot).items()
    }
    return {cable: points for cable, points in wide.items() if points}
