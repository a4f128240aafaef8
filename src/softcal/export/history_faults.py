"""Faults of materials with a history, which softcal exports to no other program."""

from __future__ import annotations

from softcal.errors import Fault
from softcal.twin.robot import Robot


def history_faults(robot: Robot, program: str) -> list[Fault]:
    """Faults of materials that relax, soften or flow; program: such as "SOFA"."""
    return [
        Fault(
            f"the history of a material is not exported to {program}",
            f"{part.name}.history",
            ", ".join(part.history),
            "an elastic material",
            "a project without history, with the moduli after a long time",
        )
        for part in robot.deformable
        if part.history
    ]
