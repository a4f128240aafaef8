"""Faults of cables with friction or stretch, which other programs replace by lines without either."""

from __future__ import annotations

from softcal.errors import Fault
from softcal.twin.robot import Robot


def cable_faults(robot: Robot, program: str) -> list[Fault]:
    """Faults of friction along cables, and of their stretch and pretension; program: such as "SOFA".

    Without a friction coefficient the preload and the speed of friction have no effect, and are no fault.
    """
    faults: list[Fault] = []
    for cable in robot.cables:
        if (mu := cable.friction_coefficient) > 0.0:
            parts = [name for name in ("friction_preload", "friction_speed") if getattr(cable.line, name) is not None]
            faults.append(
                Fault(f"a cable in {program} has no friction", cable.name, ", ".join([f"{mu:g}", *parts]), "0")
            )
        if cable.line.friction_memory:
            where, got, allowed = f"{cable.name}.line", "friction_memory: true", "friction_memory: false"
            faults.append(Fault(f"friction of a cable in {program} has no memory", where, got, allowed))
        elastic = [name for name in cable.properties if name not in ("presliding", "friction_preload")]
        if elastic:
            got, allowed = ", ".join(elastic), "a cable without stretch"
            faults.append(Fault(f"a cable in {program} does not stretch", f"{cable.name}.line", got, allowed))
    return faults
