"""Contact, which softcal exports to no other program: parts may pass through each other there."""

from __future__ import annotations

from softcal.errors import Fault
from softcal.twin.robot import Robot

_INSTEAD = "parts may pass through each other. Compare small bending only, or set contact: false."


def not_exported(robot: Robot, place: str) -> tuple[str, ...]:
    """The sentence on contact that an export leaves out; none for a robot without. place: such as "the scene"."""
    return () if robot.contact is None else (f"Contact is not exported: in {place} {_INSTEAD}",)


def left_out_by(program: str) -> str:
    """The sentence on contact that another program leaves out where it takes softcal's place."""
    return f"Contact is left out by {program}: {_INSTEAD}"


def contact_faults(robot: Robot, program: str) -> list[Fault]:
    """Faults of bodies that lie loose without contact; program: such as "SOFA"."""
    if robot.contact is None:
        return []
    attached = {body.name for body in robot.bodies if len(body.fixed)}
    attached |= {name for plate in robot.plates for name in plate.nodes}
    attached |= {name for tie in robot.ties for name in (tie.body, tie.on)}
    return [
        Fault(
            f"contact is not exported to {program}, and the body is not attached otherwise",
            where=body.name,
            attempt="a body that is fixed, or tied to a plate or another body",
        )
        for body in robot.bodies
        if body.name not in attached
    ]
