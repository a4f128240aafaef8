"""Contact: the barrier between surfaces, and how it is fitted to a robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.checks import Floats
from softcal.declare import Declared
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.surface import boundary_faces, edges_of
from softcal.quantities import Friction, Modulus, Size, Speed

if TYPE_CHECKING:
    from softcal.mechanics.contact_stiffness import ContactStiffness
    from softcal.twin.robot import Body, Plate, Rod

DEPTH = 0.04  # of a surface's mean edge or a disc's thickness
STIFF = 4.0  # of the mean modulus: the neck's tension is then within 1 % of the limit of small overlaps
GAP = 0.02  # of a wire's diameter
FITTED: Any = None  # a value that a robot chooses for its parts


@displayed
@dataclass(frozen=True)
class Contact(Declared):
    """Contact between surfaces of bodies, discs and wires of rods, which prevents interpenetration.

    depth, stiffness and gap set how far touching surfaces overlap, or wires stay apart, not their contact force. Where
    omitted, a `Robot` chooses lengths small relative to its meshes and wires; the stiffness is then four times the
    mean modulus of the bodies, or of the rods for their contact, at every value of their parameters.

    Attributes
    ----------
    gap : Distance [m] at which wires of rods begin to push each other, or discs; surfaces need none
    stiffness : Pressure [Pa] of each of two surfaces that overlap by the depth; of the barrier of wires, 80 times that
    friction_coefficient : Coulomb's [-], in dynamics alone: equilibria with friction depend on the load path
    creep : Sliding speed [m/s] below which the friction is reduced
    depth : Overlap [m] of surfaces at which their pressure is the stiffness
    """

    gap: Size = FITTED
    stiffness: Modulus = FITTED
    friction_coefficient: Friction = 0.0
    creep: Speed = 1e-3
    depth: Size = FITTED

    def fitted(self, bodies: Sequence[Body], rods: Sequence[Rod], plates: Sequence[Plate]) -> Contact:
        """The contact with the lengths that are omitted, chosen for the parts of a robot.

        Parameters
        ----------
        bodies, rods, plates
            The parts.
        """
        depth, gap = self.depth, self.gap
        if depth is FITTED:
            thick = [plate.disc.thickness for plate in plates if plate.disc is not None]
            edges = [float(edge_lengths(body.mesh).mean()) for body in bodies]
            depth = DEPTH * min(edges + thick, default=1.0)
        if gap is FITTED:
            gap = GAP * min([wire_diameter(rod) for rod in rods], default=1.0)
        return replace(self, gap=gap, depth=depth)

    @property
    def follows_moduli(self) -> bool:
        """Whether the surfaces' pressure is in proportion to the moduli."""
        return self.stiffness is FITTED

    def pressure(self, parts: Sequence[Body | Rod]) -> ContactStiffness:
        """The stiffness; where it is omitted, that for parts that touch."""
        from softcal.mechanics.contact_stiffness import ContactStiffness

        if not self.follows_moduli:
            return ContactStiffness(self.stiffness)
        return ContactStiffness(STIFF, {part.name: part.elasticity for part in parts})


def require_wires(rods: Sequence[Rod]) -> None:
    """Refuse rods that are no wires of one diameter.

    Raises
    ------
    InputError
        For a rod whose section varies: contact has one thickness for all of a wire.
    """
    what, allowed = "contact takes a rod for a wire of one diameter", "rods of one section"
    attempt = "no contact, or one rod of one section for each piece"
    if varied := [rod.name for rod in rods if not rod.section.is_uniform]:
        raise InputError([Fault(what, name, "a section that varies", allowed, attempt) for name in varied])


def wire_diameter(rod: Rod) -> float:
    """The diameter [m] of the round wire with the section's area."""
    return math.sqrt(4.0 * rod.section.constants.area / math.pi)


def edge_lengths(mesh: TetMesh) -> Floats:
    """Lengths of the surface's edges from corner to corner [m]."""
    edges = edges_of(boundary_faces(mesh)[:, :3])
    return np.linalg.norm(mesh.points[edges[:, 0]] - mesh.points[edges[:, 1]], axis=1)
