"""Contact: the barrier between surfaces, and how it is fitted to a robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.checks import Floats
from softcal.declare import Declared
from softcal.errors import Fault, InputError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.surface import boundary_faces, edges_of
from softcal.materials.catalogue import LAWS
from softcal.quantities import Friction, Modulus, Size, Speed

if TYPE_CHECKING:
    from softcal.twin.robot import Body, Rod

GAP = 0.02  # of a surface's mean edge, or of a wire's diameter
STIFFNESS = 0.05  # of the largest modulus
FITTED: Any = None  # a value that a robot chooses for its parts


@dataclass(frozen=True)
class Contact(Declared):
    """Contact between surfaces of bodies and wires of rods, which prevents interpenetration.

    gap and stiffness set the remaining distance of touching surfaces, not their contact force. Where omitted, a `Robot`
    chooses a gap small relative to its meshes and wires, and a stiffness proportional to its largest modulus.

    Attributes
    ----------
    gap : Distance [m] at which the barrier begins to act
    stiffness : Stiffness [Pa] of the barrier
    friction_coefficient : Coulomb's [-], in dynamics alone: equilibria with friction depend on the load path
    creep : Sliding speed [m/s] below which the friction is reduced
    """

    gap: Size = FITTED
    stiffness: Modulus = FITTED
    friction_coefficient: Friction = 0.0
    creep: Speed = 1e-3

    def fitted(self, bodies: Sequence[Body], rods: Sequence[Rod]) -> Contact:
        """With a gap and a stiffness, where they are omitted, for the parts of a robot.

        Raises
        ------
        InputError
            For a rod whose section varies: contact has one thickness for all of a wire.
        """
        what, allowed = "contact takes a rod for a wire of one diameter", "rods of one section"
        attempt = "no contact, or one rod of one section for each piece"
        if varied := [rod.name for rod in rods if not rod.section.is_uniform]:
            raise InputError([Fault(what, name, "a section that varies", allowed, attempt) for name in varied])
        gap, stiffness = self.gap, self.stiffness
        if gap is FITTED:
            gap = GAP * min([mean_edge(body.mesh) for body in bodies] + [wire_diameter(rod) for rod in rods])
        if stiffness is FITTED:
            moduli = [LAWS.named(body.law).youngs_modulus(body.parameters) for body in bodies]
            stiffness = STIFFNESS * max(moduli + [rod.parameters["youngs_modulus"] for rod in rods])
        return replace(self, gap=gap, stiffness=stiffness)


def wire_diameter(rod: Rod) -> float:
    """The diameter [m] of the round wire with the section's area."""
    return math.sqrt(4.0 * rod.section.constants.area / math.pi)


def mean_edge(mesh: TetMesh) -> float:
    """Of the surface's edges from corner to corner [m]."""
    return float(edge_lengths(mesh).mean())


def edge_lengths(mesh: TetMesh) -> Floats:
    """Of the surface's edges from corner to corner [m]."""
    edges = edges_of(boundary_faces(mesh)[:, :3])
    return np.linalg.norm(mesh.points[edges[:, 0]] - mesh.points[edges[:, 1]], axis=1)
