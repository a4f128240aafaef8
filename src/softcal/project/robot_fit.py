"""Checks of the whole robot: parts without support, nodes fixed twice, parts that overlap at rest, walls of
chambers that enclose nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import permutations

import numpy as np

from softcal.checks import Floats
from softcal.errors import MeshError
from softcal.geometry.locate import depths_inside
from softcal.geometry.ring import across, ring_points
from softcal.project.document import Findings
from softcal.twin.build import twin_of
from softcal.twin.joints import GROUND, hinges
from softcal.twin.robot import Disc, Robot
from softcal.units import format_quantity

# Discs may touch: an overlap below this part of the thickness is rounding error.
TOUCHING = 1e-6


def check_whole(robot: Robot, findings: Findings, *, generated: Iterable[str] = ()) -> None:
    """Record the faults of the robot as a whole.

    Parameters
    ----------
    robot
        The robot.
    findings
        Collects the faults and warnings.
    generated
        Names of parts without a section of their own in the file.
    """
    where = _Where(robot, set(generated))
    n_faults = len(findings.faults)
    _check_attached(robot, where, findings)
    _check_fixed_once(robot, findings)
    if len(findings.faults) == n_faults:
        _check_overlaps(robot, where, findings)
        _check_hinges(robot, findings)
        # Surfaces that actuators act on, such as walls that enclose no volume.
        try:
            if any(part.actuator.surfaces for part in robot.actuators):
                twin_of(robot)
        except MeshError as error:
            for part in robot.actuators:
                own = [fault for fault in error.faults if fault.where.startswith(f"{part.name}.")]
                findings.take(("robot", "actuators", part.name, *part.actuator.region_key), own)


class _Where:
    """The key path of a part in the file."""

    def __init__(self, robot: Robot, generated: set[str]) -> None:
        kinds = {"bodies": robot.bodies, "rods": robot.rods, "plates": robot.plates}
        self._paths = {part.name: ("robot", kind, part.name) for kind, parts in kinds.items() for part in parts}
        self._paths |= {name: ("robot", "manipulator") for name in generated}

    def __call__(self, name: str) -> tuple[str, ...]:
        return self._paths[name]


def _check_attached(robot: Robot, where: _Where, findings: Findings) -> None:
    """Record bodies, rods and plates without a connection to a fixed part."""
    links: dict[str, set[str]] = {part.name: set() for part in (*robot.bodies, *robot.rods, *robot.plates)}
    links[GROUND] = set()

    def join(one: str, other: str) -> None:
        links[one].add(other)
        links[other].add(one)

    for body in robot.bodies:
        if len(body.fixed):
            join(body.name, GROUND)
    for rod in robot.rods:
        if len(rod.fixed):
            join(rod.name, GROUND)
        for plate in rod.clamped:
            join(rod.name, plate)
    for plate in robot.plates:
        if plate.fixed:
            join(plate.name, GROUND)
        for body in plate.nodes:
            join(plate.name, body)
    for tie in robot.ties:
        join(tie.body, tie.on)
    held, new = {GROUND}, {GROUND}
    while new:
        new = set[str]().union(*(links[name] for name in new)) - held
        held |= new
    loose = [name for name in links if name not in held]
    if len(held) == 1:
        findings.add(
            ("robot",),
            "the robot is not fixed",
            allowed="a body, rod or plate with `fixed`",
            attempt="fixed: REGION in a body, or fixed: true in a plate",
        )
        return
    kinds = {body.name: "body" for body in robot.bodies} | {rod.name: "rod" for rod in robot.rods}
    for name in loose:
        kind = kinds.get(name, "plate")
        alone = "tied or clamped to nothing" if not links[name] else "on " + ", ".join(sorted(links[name]))
        findings.add(
            (*where(name), "fixed") if kind == "body" else where(name),
            f"the {kind} is not attached",
            got=alone,
            allowed="a connection to a fixed part: fixed, a plate, a tie",
            attempt="fixed: socket, with a region of that name" if kind == "body" else "",
        )


def _check_hinges(robot: Robot, findings: Findings) -> None:
    """Warn of what is joined at one point or line, about which it can turn; contact may prevent it."""
    keys = {part.name: ("bodies", part.name, "fixed") for part in robot.bodies}
    keys |= {part.name: ("plates", part.name, "region") for part in robot.plates}
    keys |= {part.name: ("ties", part.name, "region") for part in robot.ties}
    for name, turns in hinges(robot) if robot.contact is None else []:
        findings.warn(
            ("robot", *keys[name]),
            f"the nodes are at one point or on one line, about which nothing but cables and weight holds {turns}",
            attempt="a region that spans a surface",
        )


def _check_fixed_once(robot: Robot, findings: Findings) -> None:
    for body in robot.bodies:
        held = [("fixed", "fixed", body.fixed)]
        held += [(f"on {p.name}", p.name, p.nodes[body.name]) for p in robot.plates if body.name in p.nodes]
        held += [(f"tied by {tie.name}", tie.name, tie.nodes) for tie in robot.ties if tie.body == body.name]
        plates = {plate.name for plate in robot.plates}
        for k, (how, name, nodes) in enumerate(held):
            for other, _, others in held[:k]:
                both = np.intersect1d(nodes, others)
                if not len(both):
                    continue
                what = f"{len(both)} nodes are both {other} and {how}"
                if name in plates:
                    what = f"{len(both)} nodes are both {other} and tied to the plate"
                findings.add(
                    ("robot", "plates" if name in plates else "ties", name, "region"),
                    what,
                    got=f"node {both[0]} of {body.name}",
                    allowed="regions that do not overlap",
                )


def _check_overlaps(robot: Robot, where: _Where, findings: Findings) -> None:
    """Overlapping bodies and discs are faults; a rod through a part that does not clamp it is a warning."""
    deepest: dict[tuple[str, str], tuple[float, int]] = {}

    def note(one: str, other: str, depth: Floats, allowed: Floats | float) -> None:
        too_deep = depth > allowed
        if too_deep.any():
            key = (one, other) if one <= other else (other, one)
            was, n = deepest.get(key, (0.0, 0))
            deepest[key] = max(was, float(depth.max())), n + int(too_deep.sum())

    for one, other in permutations(robot.bodies, 2):
        note(one.name, other.name, *depths_inside(other.mesh, one.mesh.points))
    for plate in robot.plates:
        if plate.disc is None:
            continue
        for body in robot.bodies:
            if body.name not in plate.nodes:
                depth = _depths_in_disc(plate.disc, body.mesh.points)
                note(body.name, plate.name, depth, TOUCHING * plate.disc.thickness)
                note(plate.name, body.name, *depths_inside(body.mesh, _samples(plate.disc)))
        for other in robot.plates:
            if other.disc is not None and other.name != plate.name:
                depth = _depths_in_disc(other.disc, _samples(plate.disc))
                note(plate.name, other.name, depth, TOUCHING * other.disc.thickness)
    for (one, other), (depth, n) in deepest.items():
        findings.add(
            where(one),
            f"{one} and {other} overlap at rest",
            got=f"{n} points up to {format_quantity(depth, 'm')} deep",
            allowed="parts that touch at most",
            attempt="another placement; the unit of the meshes",
        )
    for rod in robot.rods:
        nodes = rod.centreline.nodes
        depths: dict[str, float] = {}
        for plate in robot.plates:
            if plate.disc is not None and plate.name not in rod.clamped:
                depth = float(_depths_in_disc(plate.disc, nodes).max())
                depths[plate.name] = depth if depth > TOUCHING * plate.disc.thickness else 0.0
        for body in robot.bodies:
            depth, allowed = depths_inside(body.mesh, nodes)
            depths[body.name] = float(np.where(depth > allowed, depth, 0.0).max(initial=0.0))
        for name, depth in depths.items():
            if depth > 0.0:
                findings.warn(
                    where(rod.name),
                    f"the rod runs through {name} and is not attached to it",
                    got=f"{format_quantity(depth, 'm')} deep",
                    attempt=f"clamped: {{{name}: station}}, where {name} is a plate",
                )


def _depths_in_disc(disc: Disc, points: Floats) -> Floats:
    """Depths (n,) [m] of points (n, 3) in a disc, 0 outside; its holes count as filled."""
    offset = points - disc.centre
    along = offset @ disc.axis
    across = np.linalg.norm(offset - np.outer(along, disc.axis), axis=1)
    depth = np.minimum(0.5 * disc.diameter - across, 0.5 * disc.thickness - np.abs(along))
    return np.maximum(depth, 0.0)


def _samples(disc: Disc) -> Floats:
    """Points of a disc: its middle plane and both faces, on three circles and in the centre."""
    ring = ring_points(np.zeros(3), disc.axis, across(disc.axis), 1.0, 24)
    flat = np.concatenate([np.zeros((1, 3)), *(0.5 * disc.diameter * share * ring for share in (1 / 3, 2 / 3, 1.0))])
    levels = (-0.5 * disc.thickness, 0.0, 0.5 * disc.thickness)
    return np.concatenate([disc.centre + flat + level * disc.axis for level in levels])
