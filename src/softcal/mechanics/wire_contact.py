"""Contact of round wires with each other, and with discs: the barrier of IPC Toolkit.

    Pi = sum over contacts of area * kappa * b(d - thickness),   b = 0 beyond `gap`, infinite at touch

with areas of the undeformed surface, so that kappa [Pa] means the same on every mesh (Li et al., 2020, Incremental
potential contact; 2023, Convergent incremental potential contact). Equilibrium determines the force; kappa and `gap`
only determine the remaining distance: between zero and `gap`. Each of several neighbouring pairs counts: taking the
nearest alone instead, as the convergent formulation does, has kinks at which Newton's method stops.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.surface import edges_of
from softcal.mechanics.contact_stiffness import ContactStiffness
from softcal.mechanics.damping import TimeStep
from softcal.mechanics.term import Given, Sum, Term
from softcal.units import format_quantity

CLEARANCE = 0.8  # of the distance to touch, at most, in one step
CCD_ITERATIONS = 1000  # of the search for the time of touch, which is conservative


@dataclass(frozen=True)
class WireContactTerm(Term):
    """Wires, by their axes, and discs that may touch.

    Attributes
    ----------
    points
        The layout's points that are the vertices (n,).
    X
        Vertices at rest (n, 3) [m].
    edges, faces
        Their vertices (m, 2) and (k, 3); the faces' edges are among the edges.
    gap
        Distance at which contact begins to push [m].
    thickness
        What lies between touching vertices, edges and faces [m]: of wires the diameter.
    stiffness
        The barrier's kappa.
    apart
        Pairs of vertices (n_pairs, 2), i < j, that never touch, such as neighbours along a rod.
    patch
        Vertices of one patch never touch each other (n,); -1: of none.
    friction_coefficient
        Coulomb's [-]; without effect outside a time step. The normal forces are those at the step's start.
    creep
        Speed of sliding below which friction decreases to zero [m/s], which makes it smooth.
    before, pressure_before, step
        Vertices (n, 3) [m], None outside a time step, and the stiffness [Pa] at the step's start, and its length [s].
    """

    points: Ints
    X: Floats
    edges: Ints
    faces: Ints
    gap: float
    thickness: float
    stiffness: ContactStiffness
    apart: Ints
    patch: Ints
    friction_coefficient: float = 0.0
    creep: float = 1e-3
    before: Floats | None = None
    pressure_before: float = 0.0
    step: float = 0.0

    @property
    def parameters(self) -> tuple[str, ...]:
        return self.stiffness.parameters

    def add(self, into: Sum, given: Given) -> None:
        """The pairs in contact change from state to state, so the tangent is outside the pattern."""
        import scipy.sparse as sp

        for potential, contacts, at in self._pushing(given):
            into.points[self.points] += potential.gradient(contacts, self._mesh, at).reshape(-1, 3)
            if into.data is not None:
                H: Any = sp.bsr_array(potential.hessian(contacts, self._mesh, at), blocksize=(3, 3))
                rows = np.repeat(np.arange(len(self.points)), np.diff(H.indptr))
                upper = rows <= H.indices
                into.outside.append((H.data[upper], self.points[rows[upper]], self.points[H.indices[upper]]))

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        V = self._vertices(given.state.x)
        for name, rate in self.stiffness.rates(given.theta).items():
            if name in into:
                gradient = self._barrier(1.0).gradient(self._collisions(V), self._mesh, V)
                into[name].points[self.points] += rate * gradient.reshape(-1, 3)

    def energy(self, given: Given) -> float:
        return float(sum(potential(contacts, self._mesh, at) for potential, contacts, at in self._pushing(given)))

    def in_step(self, before: Given, step: TimeStep) -> Sequence[Term]:
        """The term with friction, where there is any."""
        rubs = self.friction_coefficient > 0.0
        if not rubs:
            return (self,)
        pressure = self.stiffness.at(before.theta)
        return (replace(self, before=self._vertices(before.state.x), pressure_before=pressure, step=step.length),)

    def free_way(self, x: Floats, to: Floats) -> float:
        """Fraction of the straight line from x to `to` that is free of contact (one: all of it)."""
        import ipctk

        before, after = self._vertices(x), self._vertices(to)
        narrow = ipctk.AdditiveCCD(max_iterations=CCD_ITERATIONS)
        free = ipctk.compute_collision_free_stepsize(self._mesh, before, after, self.thickness, narrow_phase_ccd=narrow)
        return float(free)

    def in_words(self) -> str:
        """Text on the distance from which on wires push, for a table."""
        other = "discs" if len(self.faces) else "each other"
        return f"wires push {other} from {format_quantity(self.gap, 'm', digits=2)} on"

    def smallest_distance(self, x: Floats) -> float:
        """The smallest distance [m], less the thickness; infinite if none is below `gap`."""
        V = self._vertices(x)
        collisions = self._collisions(V)
        if len(collisions) == 0:
            return np.inf
        return float(np.sqrt(collisions.compute_minimum_distance(self._mesh, V))) - self.thickness

    def _collisions(self, V: Floats) -> Any:
        import ipctk

        collisions = ipctk.NormalCollisions()
        collisions.use_area_weighting = True
        collisions.build(self._mesh, V, self.gap, self.thickness)
        return collisions

    @cached_property
    def _rubbing(self) -> Any:
        """The contacts at the step's start, with the normal forces for friction, or None."""
        import ipctk

        if self.before is None:
            return None
        collisions = self._collisions(self.before)
        if len(collisions) == 0:
            return None
        rubbing = ipctk.TangentialCollisions()
        barrier = self._barrier(self.pressure_before)
        rubbing.build(self._mesh, self.before, collisions, barrier, self.friction_coefficient)
        return rubbing

    def _pushing(self, given: Given) -> list[tuple[Any, Any, Floats]]:
        """The active potentials at a state, each with its contacts, and the positions or slips of its evaluation."""
        import ipctk

        V = self._vertices(given.state.x)
        collisions = self._collisions(V)
        pushing = [(self._barrier(self.stiffness.at(given.theta)), collisions, V)] if len(collisions) else []
        if self.before is not None and self._rubbing is not None:
            slip = np.asfortranarray(V - self.before)
            pushing.append((ipctk.FrictionPotential(self.creep * self.step), self._rubbing, slip))
        return pushing

    def _vertices(self, x: Floats) -> Floats:
        return np.asfortranarray(x[self.points])

    @cached_property
    def _mesh(self) -> Any:
        return collision_mesh(self.X, self.edges, self.faces, self.patch, self.apart)

    def _barrier(self, pressure: float) -> Any:
        """The barrier between wires of a stiffness [Pa]."""
        import ipctk

        # An edge's "area" is its length: wires meet in a strip, about as wide as the gap.
        stiffness = pressure if len(self.faces) else pressure * self.gap
        return ipctk.BarrierPotential(self.gap, stiffness, use_physical_barrier=True)


def collision_mesh(X: Floats, edges: Ints, faces: Ints, patch: Ints, apart: Ints) -> Any:
    """The surfaces as a mesh of IPC Toolkit; see `WireContactTerm` for the pairs excluded from contact.

    Parameters
    ----------
    X
        Vertices at rest (n, 3) [m].
    edges, faces
        Their vertices (m, 2), (k, 3).
    patch, apart
        See `WireContactTerm`.
    """
    import ipctk

    edges_and_faces = (np.asfortranarray(part.astype(np.int32)) for part in (edges, faces))
    mesh = ipctk.CollisionMesh(np.asfortranarray(X), *edges_and_faces)
    alone = np.arange(len(X)) + patch.max(initial=0) + 1
    patches = np.where(patch >= 0, patch, alone).astype(np.int32)
    never = {(int(i), int(j)): False for i, j in apart}
    mesh.can_collide = ipctk.make_vertex_patches_filter(patches) & ipctk.make_sparse_filter(never, True)
    return mesh


def passes_through(X: Floats, faces: Ints, apart: Ints) -> bool:
    """Whether triangles pass through each other.

    Parameters
    ----------
    X
        Points (n, 3) [m].
    faces
        The triangles (k, 3).
    apart
        Pairs of points of which no triangles count (n_pairs, 2).
    """
    import ipctk

    mesh = collision_mesh(X, edges_of(faces), faces, np.full(len(X), -1), np.sort(apart, axis=1))
    return bool(ipctk.has_intersections(mesh, np.asfortranarray(X), ipctk.LBVH()))
