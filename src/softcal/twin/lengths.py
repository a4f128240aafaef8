"""A robot whose bodies have other lengths: their meshes, and what is attached to them, moved at rest.

Points on a body keep their place in its mesh. A plate moves, without a turn, as the nodes that are tied to it do next
to its reference point, and takes along what is on it. Sizes of plates, and all that is stated in space, stay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault, MeshError
from softcal.geometry.quality import inverted_tets
from softcal.geometry.shape import LENGTHS
from softcal.mechanics.attachment import attach_point
from softcal.twin.robot import Body, Plate, PointLoad, Robot
from softcal.units import format_quantity


def with_lengths(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with those of the values [SI] that are lengths of bodies; the same object where none differs.

    Raises
    ------
    MeshError
        Where they would turn tets inside out, or a part that cannot move along is attached to the body.
    """
    for body in robot.bodies:
        if body.shape is None:
            continue
        old = body.shape.values
        stated = {key: values.get(f"{body.name}.{key}", value) for key, value in old.items()}
        if new := {key: value for key, value in stated.items() if value != old[key]}:
            still = [plate.nodes[body.name] for plate in robot.plates if plate.fixed and body.name in plate.nodes]
            points, shape = body.shape.moved(body.mesh, np.concatenate([body.fixed, *still]), new)
            mesh = replace(body.mesh, points=points)
            if len(inverted := inverted_tets(mesh)):
                raise MeshError(
                    Fault(
                        f"{len(inverted)} of {mesh.n_tets} tets are turned inside out",
                        body.name,
                        got=", ".join(f"{key} {format_quantity(v, LENGTHS[key].unit)}" for key, v in new.items()),
                        allowed="lengths nearer to those of the mesh",
                        attempt="narrower bounds, or a mesh of that shape",
                    )
                )
            robot = _with_body(robot, body, replace(body, mesh=mesh, shape=shape))
    return robot


def _with_body(robot: Robot, old: Body, new: Body) -> Robot:
    """The robot with a body replaced by one that has the same nodes at other positions."""
    shifts: dict[str, Floats] = {}
    for plate in robot.plates:
        # The affine motion of the plate's nodes, where their box is nearest to its reference.
        shifts[plate.name] = np.zeros(3)
        if not plate.fixed and old.name in plate.nodes:
            before, after = (points[plate.nodes[old.name]] for points in (old.mesh.points, new.mesh.points))
            at = np.clip(plate.reference, before.min(axis=0), before.max(axis=0))
            motion, *_ = np.linalg.lstsq(np.column_stack([np.ones(len(before)), before - at]), after - before)
            shifts[plate.name] = motion[0]
    moving = [plate for plate in robot.plates if shifts[plate.name].any()]
    parts = [f"tie {tie.name}" for tie in robot.ties if old.name in (tie.body, tie.on)]
    parts += [f"body {name} on {plate.name}" for plate in moving for name in plate.nodes if name != old.name]
    parts += [f"rod {rod.name} on {plate.name}" for plate in moving for rod in robot.rods if plate.name in rod.clamped]
    # Where the route of an actuator but a cable is stated, only its class knows.
    moved = {old.name, *(plate.name for plate in moving)}
    parts += [f"actuator {part.name}" for part in robot.actuators if any(via.on in moved for via in part.route)]
    if parts:
        raise MeshError(
            Fault(
                "the lengths of a body cannot vary where other parts would have to move along",
                old.name,
                got=", ".join(parts),
                allowed="a body that is attached to plates of its own",
            )
        )

    def place(at: Floats, on: str, *, beside: bool = False) -> Floats:
        """The new place of a point (3,) [m] on a part; beside: it may be outside the material."""
        if on != old.name:
            return at + shifts.get(on, 0.0)
        attached = attach_point(old.mesh, at, may_stand_off=beside, where=old.name)
        return attached.weights @ new.mesh.points[attached.nodes]

    plates: list[Plate] = []
    for plate in robot.plates:
        shift, disc = shifts[plate.name], plate.disc
        plates.append(
            replace(
                plate,
                reference=plate.reference + shift,
                centre_of_mass=plate.centre_of_mass + shift,
                holes={name: at + shift for name, at in plate.holes.items()},
                disc=None if disc is None else replace(disc, centre=disc.centre + shift),
            )
        )
    return replace(
        robot,
        bodies=tuple(new if body is old else body for body in robot.bodies),
        plates=tuple(plates),
        cables=tuple(
            replace(
                cable,
                via_points=tuple(replace(via, at=place(via.at, via.on)) for via in cable.via_points),
            )
            for cable in robot.cables
        ),
        loads=tuple(
            replace(load, at=place(load.at, load.on)) if isinstance(load, PointLoad) else load for load in robot.loads
        ),
        markers=tuple(replace(marker, at=place(marker.at, marker.on, beside=True)) for marker in robot.markers),
    )
