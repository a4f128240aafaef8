"""Rods as solids: the same parts with meshes of tets in the place of their rods, to verify or replace rods."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from softcal.checks import Ints
from softcal.errors import Fault, MeshError, unknown
from softcal.geometry.section import RoundBar, SectionConstants
from softcal.geometry.varied_section import VariedSection
from softcal.geometry.wire import wire_mesh
from softcal.mechanics.elements import DEFAULT
from softcal.twin.robot import Body, Plate, Robot, Rod

# Sections whose constants agree to this relative tolerance are the same.
SAME_SECTION = 1e-6


def with_solid_rods(
    robot: Robot, names: Collection[str] | None = None, *, rings: int = 1, element: str = DEFAULT.name
) -> Robot:
    """The robot with bodies of the same names in the place of some of its rods, or of all.

    A rod's material, with its history, and density go to its body, one layer of tets for two elements of its
    centreline, with the rod's section at each node; plates that hold its ends hold all nodes of the body's end faces,
    which can then not warp.

    Parameters
    ----------
    robot
        The robot.
    names
        Names of the rods to replace; all if None.
    rings
        Number of tets from the axis to the surface.

    Raises
    ------
    MeshError
        For a rod that is not round, whose section has a step, of several materials, with an odd number of elements, or
        held elsewhere than at its ends; for a name
        that is no rod.
    """
    rods = {rod.name: rod for rod in robot.rods}
    chosen = tuple(rods) if names is None else tuple(names)
    if faults := [unknown("there is no such rod", "robot", name, rods) for name in chosen if name not in rods]:
        raise MeshError(faults)
    bodies = {name: solid_body(rods[name], rings=rings, element=element) for name in chosen}
    plates: list[Plate] = []
    for plate in robot.plates:
        nodes = dict(plate.nodes)
        for name in chosen:
            if plate.name in rods[name].clamped:
                sets = bodies[name].mesh.node_sets
                nodes[name] = _end_nodes(rods[name], rods[name].clamped[plate.name], sets["start"], sets["end"])
        plates.append(replace(plate, nodes=nodes))
    return replace(
        robot,
        bodies=(*robot.bodies, *bodies.values()),
        rods=tuple(rod for rod in robot.rods if rod.name not in bodies),
        plates=tuple(plates),
    )


def solid_body(rod: Rod, *, rings: int = 1, element: str = DEFAULT.name) -> Body:
    """A rod as a body, its fixed end faces among the fixed nodes; see `with_solid_rods`.

    Parameters
    ----------
    rod
        The rod.
    rings
        Number of tets from the axis to the surface.
    element
        Name of the element.

    Raises
    ------
    MeshError
        For a rod that is not round, whose section has a step, of several materials, with an odd number of elements, or
        held elsewhere than at its ends.
    """
    shares = rod.centreline.stations / rod.centreline.stations[-1]
    found = [_diameter(rod.section.at(float(share))) for share in shares]
    diameters = [diameter for diameter in found if diameter is not None]
    faults: list[Fault] = []
    if len(diameters) < len(found):
        faults.append(
            Fault("only a round rod can be made solid", rod.name, "a section that is no circle", "a circular section")
        )
    if isinstance(rod.section, VariedSection) and len(set(rod.section.stations)) < len(rod.section.stations):
        faults.append(Fault("a section with a step cannot be made solid", rod.name, attempt="a short taper"))
    if rod.inclusions:
        several = ", ".join(part.name for part in rod.inclusions)
        faults.append(
            Fault("a rod of several materials cannot be made solid", rod.name, several, attempt="one rod for each")
        )
    last = len(rod.centreline.nodes) - 1
    held = np.concatenate([rod.fixed, *rod.clamped.values()])
    inner = sorted(set(held.tolist()) - {0, last})
    if inner:
        faults.append(
            Fault(
                "a solid rod can be fixed or clamped at its ends only",
                rod.name,
                "node " + ", ".join(str(node) for node in inner),
                f"0 and {last}",
                "one rod for each piece between plates",
            )
        )
    if faults:
        raise MeshError(faults)
    mesh = wire_mesh(rod.centreline, np.array(diameters), rings=rings, order=2, where=rod.name)
    fixed = _end_nodes(rod, rod.fixed, mesh.node_sets["start"], mesh.node_sets["end"])
    return Body(rod.name, mesh, fixed, rod.parameters, element=element, density=rod.density, history=rod.history)


def _end_nodes(rod: Rod, held: Ints, start: Ints, end: Ints) -> Ints:
    last = len(rod.centreline.nodes) - 1
    none = np.zeros(0, dtype=np.int64)
    return np.concatenate([none, *(nodes for node, nodes in ((0, start), (last, end)) if node in held)])


def _diameter(section: SectionConstants) -> float | None:
    """Diameter [m] of the section if it is a full circle, else None."""
    diameter = math.sqrt(4.0 * section.area / math.pi)
    round_bar = RoundBar(diameter).constants
    pairs = [(getattr(section, key), getattr(round_bar, key)) for key in ("I1", "I2", "J")]
    return diameter if all(abs(a - b) <= SAME_SECTION * b for a, b in pairs) else None
