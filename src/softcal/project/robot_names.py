"""The names of a robot's parts: their rules, and that no two parts share one."""

from __future__ import annotations

from softcal.limits import LIMITS
from softcal.names import folded, part_name_fault
from softcal.project.document import Document, Findings
from softcal.project.robot_schema import RobotSection
from softcal.project.section import validated
from softcal.twin.manipulator import Manipulator

KINDS = ("bodies", "rods", "plates", "ties", "cables", "loads", "markers", "sensors")


def generated_names(section: RobotSection, kind: str) -> tuple[str, ...]:
    """The parts of a kind that a manipulator generates."""
    return section.manipulator.part_names(kind) if section.manipulator else ()


def part_names(document: Document) -> dict[str, list[str]] | None:
    """Names of the robot's parts by kind, even if the robot has other faults; None without a robot, or if its
    manipulator has faults.
    """
    robot = document.data.get("robot")
    if not isinstance(robot, dict):
        return None
    given: dict[str, object] = robot
    own: Manipulator | None = None
    if given.get("manipulator") is not None:
        own = validated(Manipulator, given["manipulator"], (), Findings(document))
        if own is None:
            return None
    found: dict[str, list[str]] = {}
    for kind in KINDS:
        written = given.get(kind)
        names = [str(name) for name in written] if isinstance(written, dict) else []
        found[kind] = list(dict.fromkeys([*(own.part_names(kind) if own else ()), *names]))
    return found


def check_part_names(section: RobotSection, findings: Findings) -> None:
    """Record part names that are not allowed or appear twice: parameters and channels are named after parts, so all
    share one namespace.
    """
    seen: dict[str, str] = {
        folded(name): "the manipulator's own" for kind in KINDS for name in generated_names(section, kind)
    }
    for kind in KINDS:
        for name in getattr(section, kind):
            path = ("robot", kind, name)
            if fault := part_name_fault(name):
                findings.add(path, fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
            if folded(name) in seen:
                got = f"'{name}', first as {seen[folded(name)]}"
                findings.add(path, "two parts of the robot share a name", got=got)
            seen.setdefault(folded(name), kind)
    if fault := LIMITS["parts of a robot"].fault(max(len(seen), 1)):
        findings.add(("robot",), fault.what, got=fault.got, allowed=fault.allowed)
