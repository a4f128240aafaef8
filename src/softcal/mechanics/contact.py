"""Contact of surfaces: points of one press on the core of another.

    Pi = sum over points of area * stiffness * sum over simplices near of share * phi(reach - d),   phi'(o) = o / depth

The core of a surface lies `depth` below it, so that a point that just touches the surface is `depth` from the core: no
gap, no sign, and nothing acts before surfaces meet. A point that is nearer than that to a core at rest has a shorter
reach: nothing acts at rest. Triangles count once, the edges between them less once, the vertices once more: on flat and
convex surfaces the nearest point alone counts, and the sum is smooth throughout (inclusion and exclusion, as in Li et
al., 2023, Convergent incremental potential contact). At an overlap of `depth` each surface presses with the
stiffness, about the material's modulus: with a depth of a small part of an element, the overlap changes forces less
than the mesh does.

At each state:

1. *Pairs near* (`near_pairs.py`). Trees of boxes give the points and triangles that may touch; they are kept until a
   vertex has moved by `SLACK` of the depth. A point never touches triangles that it is a corner of or bonded to
   (`apart`), nor what moves rigidly with it (`group`).
2. *Touching* (`contact_kernels.touching`). Of each point p the triangles nearer than its reach, each with the share +1,
   their edges with 1 - (number of these triangles at it), their vertices with what is left to 1; shares of zero are
   dropped.
3. *Push* (`contact_kernels.push`). With d the distance to the simplex, w the weights of its nearest point and
   n = (p - sum w_i a_i) / d, the force of area * stiffness * share * phi'(reach - d) acts on p along n, and its
   reactions on the corners, by w. phi' is linear, but for a parabola over the first `ONSET` of the depth, which
   Newton's method needs. The tangent is exact, and outside the planned pattern, since what touches changes.
4. *Ridges* (`make_convex`). Between two triangles a point on a ridge has a negative stiffness across; where that is
   asked for, its negative eigenvalues are taken out, as if the ridge were flat. Equilibria stay the same.
5. *Step*. `free_way` is the part of a step from x to `to` on which no point passes a core, by advances of the distance
   over the largest relative speed; Newton's method takes no more of the step (`Statics.reachable`).

In a time step rough surfaces rub (`_friction`). With N the normal forces at the step's start and u the motion since
then in the plane of a pair, the potential is N mu f(|u|), its force mu N f' against the motion, where f' = 1 beyond
u_c = creep * step, and (2 - |u| / u_c) |u| / u_c below: sticking is slow creep, and the tangent stays symmetric.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.contact_kernels import Meeting, distances, free_part, law, make_convex, nearest, push, touching
from softcal.mechanics.contact_stiffness import ContactStiffness
from softcal.mechanics.damping import TimeStep
from softcal.mechanics.moving_boxes import order_of
from softcal.mechanics.near_pairs import NearPairs
from softcal.mechanics.term import Given, Sum, Term, Theta
from softcal.mechanics.weighted_blocks import blocks_on_points
from softcal.units import format_quantity

SLACK = 0.1  # of the depth: motion for which pairs near are kept
ROOM = 0.5  # of the depth: how far points are from touching whose entries a tangent's pattern has beforehand
ONSET = 0.02  # of the depth: overlap over which the pressure's slope rises, for Newton's method


class Pairs(NamedTuple):
    """Points (m,), and the simplices that they touch: vertices (m, 3), -1 beyond the last, and shares (m,)."""

    points: Ints
    simplices: Ints
    shares: Floats


class Rubbing(NamedTuple):
    """Contacts of the pairs of `points` (m,) and `simplices` (m, 3): weights (m, 3) of the corners, normals (m, 3), and
    normal forces (m,) [N].
    """

    points: Ints
    simplices: Ints
    weights: Floats
    normals: Floats
    force: Floats


@dataclass(frozen=True)
class ContactTerm(Term):
    """Surfaces that may touch each other and themselves.

    Vertices are weighted sums of points: first the `n_points` that press, which are points, then the cores'.

    Attributes
    ----------
    points
        The layout's points of which the vertices are sums (n_points, ...) (n,).
    weights
        Of the vertices by the points: sparse (n_vertices, n), the first n_pressing rows of one entry.
    X
        Vertices at rest (n_vertices, 3) [m].
    area
        Area of each pressing point's part of the surface at rest (n_pressing,) [m^2].
    faces
        The cores' triangles by vertices (k, 3).
    reach
        Distance from a core from which on a point is pressed (n_pressing,) [m]: `depth`, or less where it is near at
        rest.
    depth
        Depth of the cores below their surfaces [m].
    stiffness
        Pressure at an overlap of `depth`.
    apart
        Pairs of a pressing point and a core's vertex that never touch (n_pairs, 2).
    group
        Vertices of one group never move relative to each other (n_vertices,); -1: of none.
    friction_coefficient
        Coulomb's [-]; without effect outside a time step. The normal forces are those at the step's start.
    creep
        Speed of sliding below which friction decreases to zero [m/s], which makes it smooth.
    before, pressure_before, step
        Vertices (n_vertices, 3) [m], None outside a time step, and the stiffness [Pa] at the step's start, and its
        length [s].
    """

    points: Ints
    weights: Any
    X: Floats
    area: Floats
    faces: Ints
    reach: Floats
    depth: float
    stiffness: ContactStiffness
    apart: Ints
    group: Ints
    friction_coefficient: float = 0.0
    creep: float = 1e-3
    before: Floats | None = None
    pressure_before: float = 0.0
    step: float = 0.0

    @property
    def parameters(self) -> tuple[str, ...]:
        return self.stiffness.parameters

    def add(self, into: Sum, given: Given) -> None:
        """The touching points change from state to state, so the tangent is outside the pattern."""
        V = self.vertices(given.state.x)
        stiffness = self.stiffness.at(given.theta)
        pairs, _, gradient, pressed, blocks = self._push(
            V, stiffness, tangent=into.data is not None, convex=into.convex
        )
        parts = [(pairs.points[pressed], pairs.simplices[pressed], blocks)]
        if self.before is not None and len(self._rubbing.force):
            _, rubbed, blocks = self._friction(V)
            gradient = gradient + rubbed
            parts.append((self._rubbing.points, self._rubbing.simplices, blocks))
        into.points[self.points] += self.weights.T @ gradient
        if into.data is not None:
            into.outside += [self._on_points(*part) for part in parts if len(part[-1])]
            into.near.append(lambda: self._on_points(*self._near.around(V, ROOM * self.depth)))

    def _on_points(self, points: Ints, simplices: Ints, blocks: Floats | None = None) -> tuple[Floats, Ints, Ints]:
        """Blocks, rows and columns of the layout's points by the tangents (m, 12, 12) of pairs; without, of zeros."""
        blocks = np.zeros((len(points), 12, 12)) if blocks is None else blocks
        vertices = np.column_stack([points, simplices])
        rows, columns, sums = blocks_on_points(vertices, blocks, *self._sums, len(self.points))
        return sums, self.points[rows], self.points[columns]

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        rates = {name: rate for name, rate in self.stiffness.rates(given.theta).items() if name in into}
        if rates:
            gradient = self.weights.T @ self._push(self.vertices(given.state.x), 1.0, tangent=False)[2]
            for name, rate in rates.items():
                into[name].points[self.points] += rate * gradient

    def energy(self, given: Given) -> float:
        energy = self.stored(given.state.x, given.theta)
        return energy if self.before is None else energy + self._friction(self.vertices(given.state.x))[0]

    def stored(self, x: Floats, theta: Theta) -> float:
        """The energy [J] of the pressure at positions x (n_points, 3) and parameter values theta [SI]."""
        return self._push(self.vertices(x), self.stiffness.at(theta), tangent=False)[1]

    def in_step(self, before: Given, step: TimeStep) -> Sequence[Term]:
        """The term with friction, where there is any."""
        rubs = self.friction_coefficient > 0.0
        if not rubs:
            return (self,)
        pressure = self.stiffness.at(before.theta)
        return (replace(self, before=self.vertices(before.state.x), pressure_before=pressure, step=step.length),)

    def free_way(self, x: Floats, to: Floats) -> float:
        """Fraction of the straight line from x to `to` on which no point passes through a core (one: all of it)."""
        before, after = self.vertices(x), self.vertices(to)
        return free_part(before, after, self.faces, *self._near.between(before, after))

    def overlap(self, x: Floats) -> float:
        """The largest overlap [m] of a point at positions x (n_points, 3); zero where nothing touches."""
        return float(self.overlaps(x)[2].max(initial=0.0))

    def overlaps(self, x: Floats) -> tuple[Ints, Ints, Floats]:
        """The points (m,) and simplices (m, 3) that touch at positions x (n_points, 3), and their overlaps (m,) [m]."""
        V = self.vertices(x)
        points, simplices, _ = self.touching(V)
        return points, simplices, self.reach[points] - distances(V, points, simplices)

    def in_words(self) -> str:
        """Text for a table on the pressing surfaces, and the number of points with a shorter reach than the others."""
        n, near = len(self.reach), int(np.count_nonzero(self.reach < self.depth))
        pressure, depth = self.stiffness.in_words(), format_quantity(self.depth, "m", digits=2)
        return f"{n:,} points, {near:,} of them near a surface at rest; {pressure} at an overlap of {depth}"

    def vertices(self, x: Floats) -> Floats:
        """The vertices (n_vertices, 3) [m] at positions x (n_points, 3) of the layout's points."""
        return np.ascontiguousarray(self.weights @ x[self.points])

    def touching(self, V: Floats) -> Pairs:
        """The points and simplices that touch with vertices at V (n_vertices, 3)."""
        return Pairs(*touching(V, self.faces, self.reach, *self._near.at(V)))

    @cached_property
    def _near(self) -> NearPairs:
        apart = self.apart[np.lexsort((self.apart[:, 1], self.apart[:, 0]))]
        begin = np.searchsorted(apart[:, 0], np.arange(len(self.reach) + 1))
        of_points, of_faces = order_of(self.X[: len(self.reach)]), order_of(self.X[self.faces].mean(axis=1))
        meeting = Meeting(self.faces, of_points, of_faces, begin, apart[:, 1].astype(np.int64), self.group)
        return NearPairs(meeting, self.reach, SLACK * self.depth)

    def _push(
        self, V: Floats, stiffness: float, *, tangent: bool, convex: bool = False
    ) -> tuple[Pairs, float, Floats, Ints, Floats]:
        """The pairs near, the energy [J], the gradient (n_vertices, 3) [N], which pairs touch, and their tangents, at a
        stiffness [Pa].
        """
        near = self.touching(V)
        scale = stiffness * self.area[near.points] * near.shares
        reach, onset = self.reach[near.points], ONSET * self.depth
        pushed = push(V, near.points, near.simplices, scale, reach, self.depth, onset, tangent)
        if tangent and convex:
            make_convex(V, near.points, near.simplices, *pushed[2:])
        return near, *pushed

    @cached_property
    def _sums(self) -> tuple[Ints, Ints, Floats]:
        """The vertices' weights, in compressed rows."""
        return self.weights.indptr.astype(np.int64), self.weights.indices.astype(np.int64), self.weights.data

    @property
    def _before(self) -> Floats:
        return self.X if self.before is None else self.before

    @cached_property
    def _rubbing(self) -> Rubbing:
        """The contacts at the step's start, with the normal forces for friction."""
        V = self._before
        near = self.touching(V)
        n, w = (np.empty((len(near.points), 3)) for _ in range(2))
        force = np.empty(len(near.points))
        for k, (point, corners) in enumerate(zip(near.points, near.simplices, strict=True)):
            d = nearest(V, int(point), corners, w[k], n[k])
            pressure = law(float(self.reach[point] - d), self.depth, ONSET * self.depth)[1]
            force[k] = self.pressure_before * self.area[point] * near.shares[k] * pressure
        touch = force != 0.0
        return Rubbing(near.points[touch], near.simplices[touch], w[touch], n[touch], force[touch])

    def _friction(self, V: Floats) -> tuple[float, Floats, Floats]:
        """Friction's potential [J], gradient (n_vertices, 3) [N] and tangents (m, 12, 12): Coulomb's force, less below
        the creep.
        """
        rub = self._rubbing
        B = np.concatenate([np.ones((len(rub.force), 1)), -rub.weights], axis=1)
        across = np.eye(3) - rub.normals[:, :, None] * rub.normals[:, None, :]
        moved = (V - self._before)[np.column_stack([rub.points, rub.simplices])]
        slip = np.einsum("mij,mk,mkj->mi", across, B, moved)
        size, creep = np.linalg.norm(slip, axis=1), self.creep * self.step
        slides = size >= creep
        far = np.where(slides, size, creep)
        over = np.where(slides, 1.0 / far, (2.0 - size / creep) / creep)  # of the force and the slip
        slope = np.where(slides, -1.0 / far**3, -1.0 / (creep**2 * np.maximum(size, 1e-3 * creep)))
        most = self.friction_coefficient * rub.force
        below = creep / 3.0 + size**2 / creep - size**3 / (3.0 * creep**2)
        energy = float(most @ np.where(slides, size, below))
        force = (most * over)[:, None] * slip
        gradient = np.zeros_like(V)
        for k in range(4):
            present = B[:, k] != 0.0
            vertex = rub.points if k == 0 else rub.simplices[:, k - 1]
            np.add.at(gradient, vertex[present], B[present, k, None] * force[present])
        h = most[:, None, None] * (
            over[:, None, None] * across + slope[:, None, None] * slip[:, :, None] * slip[:, None, :]
        )
        blocks = np.einsum("ma,mb,mij->maibj", B, B, h).reshape(-1, 12, 12)
        return energy, gradient, blocks
