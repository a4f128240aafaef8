"""A chamber: a cavity of the robot that is filled with gas or liquid, driven by its pressure or by the pump's volume.

The volume of a cavity whose wall is S, and whose openings are closed by flat caps, is on the deformed surface

    V(x) = 1/3 oint x . n dA = 1/3 sum over faces of int x . (x_u cross x_v) du dv + 1/3 sum over caps of c . A

A face is a flat triangle or a curved one of six nodes; u, v are its coordinates, and the quadrature is exact. A cap is
the cone from the mean c of its rim's nodes to the rim, with the vector area A = 1/2 oint x cross dx of the rim. All of
it is a cubic polynomial of the nodes: its gradient is the follower force of a unit pressure, its Hessian the stiffness
of that force, symmetric since the surface is closed. Each of its blocks is the matrix of a cross product.

The pump displaces the volume

    v = V(x) - V0 + g(p),    g(p) = C p + n (V0 + Vd) (1 - (p_atm / (p_atm + p))^(1 / gamma))

with the pressure p above the atmosphere's, the compliance C of hoses, and for a gas (n = 1) the dead volume Vd of
hoses, fittings and the pump itself, at p = 0. For a liquid n = 0. A closed amount of gas is a pump that stands still:
with C = 0, v = 0 says (p + p_atm) (V + Vd)^gamma = const. So the pump's volume is the coordinate of the shape and a
*transmission* g, as the shortening of a cable is that of its via points and the stretch of its line.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import SimulationError
from softcal.kernel import kernel
from softcal.mechanics.actuator import ActuatorLimits, ActuatorTerm, Drives
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.term import Connectivity, Given, Sum

ATMOSPHERE = 101325.0  # [Pa]
# Of the faces: six points and their weights over the unit triangle, exact to the fourth degree of x . (x_u cross x_v).
_A, _B = 0.445948490915965, 0.091576213509771
_POINTS = np.array([(a, b) for a, b in ((_A, _A), (1 - 2 * _A, _A), (_A, 1 - 2 * _A))]
                   + [(a, b) for a, b in ((_B, _B), (1 - 2 * _B, _B), (_B, 1 - 2 * _B))])  # fmt: skip
_WEIGHTS = 0.5 * np.array([0.223381589678011] * 3 + [0.109951743655322] * 3)
# int N_i dN_j/ds ds on an edge of two nodes, and of three in their order along it, antisymmetric part.
_EDGE = np.array([[0.0, 0.5], [-0.5, 0.0]])
_CURVED_EDGE = np.array([[0.0, 2.0 / 3.0, -1.0 / 6.0], [-2.0 / 3.0, 0.0, 2.0 / 3.0], [1.0 / 6.0, -2.0 / 3.0, 0.0]])


class ChamberWall(NamedTuple):
    """A part of a chamber's wall: faces (n, 3 or 6) of one kind, from outside of the material, and the closed rims (m,)
    of their openings, the middle nodes of quadratic edges between their ends.
    """

    faces: Ints
    rims: Sequence[Ints]


class Filling(NamedTuple):
    """The content of a chamber, a gas or a liquid, at the values of its parameters.

    Attributes
    ----------
    compliance
        Compliance of the hoses [m^3/Pa].
    gas
        Volume of gas at p = 0 [m^3]; zero of a liquid.
    exponent
        gamma, of its compression [-].
    """

    compliance: float
    gas: float
    exponent: float

    def swallowed(self, p: float) -> float:
        """g(p) [m^3]."""
        return self.compliance * p + self.gas * (1.0 - self._expansion(p))

    def slope(self, p: float) -> float:
        """g'(p) [m^3/Pa]."""
        return self.compliance + self.gas * self._expansion(p) / (self.exponent * (ATMOSPHERE + p))

    def energy(self, p: float) -> float:
        """int g dp from 0 [J]."""
        k = 1.0 - 1.0 / self.exponent
        ratio = np.log1p(p / ATMOSPHERE)
        power = ratio if k < 1e-6 else np.expm1(k * ratio) / k
        return 0.5 * self.compliance * p**2 + self.gas * float(p - ATMOSPHERE * power)

    def rates(self, p: float) -> dict[str, float]:
        """Derivatives of g by the parameters, by the last parts of their names."""
        expansion = self._expansion(p)
        return {
            "hose_compliance": p,
            "dead_volume": 1.0 - expansion,
            "polytropic_exponent": -self.gas * expansion * np.log1p(p / ATMOSPHERE) / self.exponent**2,
        }

    def _expansion(self, p: float) -> float:
        """(p_atm / (p_atm + p))^(1 / gamma)."""
        return float(np.exp(-np.log1p(p / ATMOSPHERE) / self.exponent))


@dataclass(frozen=True)
class ChamberTerm(ActuatorTerm):
    """One chamber.

    Attributes
    ----------
    name
        First part of its parameters' names.
    walls
        The parts of its wall, which its caps close.
    rest_volume
        V0, on the undeformed robot [m^3].
    stated
        Its parameters that are there, by the last parts of their names.
    is_gas
        Whether it is filled with gas, else with a liquid.
    places
        Pairs of nodes and their blocks in the tangent, once planned.
    """

    name: str
    walls: tuple[ChamberWall, ...]
    rest_volume: float
    stated: tuple[str, ...] = ()
    is_gas: bool = False
    places: _NodePairs | None = None

    @cached_property
    def parameters(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        return tuple(f"{self.name}.{key}" for key in self.stated)

    @property
    def actuators(self) -> Sequence[ActuatorLimits]:
        return (ActuatorLimits(self.name, "volume", "pressure", -ATMOSPHERE),)

    def connectivity(self, layout: Layout) -> Connectivity:
        return Connectivity([np.sort(group, axis=1) for group in self._groups])

    def plan(self, layout: Layout, pattern: Pattern) -> ChamberTerm:
        ends = [np.triu_indices(group.shape[1], 1) for group in self._groups]
        pairs = [(group[:, i].ravel(), group[:, j].ravel()) for group, (i, j) in zip(self._groups, ends, strict=True)]
        low = np.concatenate([np.minimum(i, j) for i, j in pairs])
        high = np.concatenate([np.maximum(i, j) for i, j in pairs])
        sign = np.concatenate([np.where(i < j, 1.0, -1.0) for i, j in pairs])
        return replace(self, places=_NodePairs(pattern.pair(low, high), sign))

    @cached_property
    def _groups(self) -> tuple[Ints, ...]:
        """The nodes of each face, and of each rim as one group."""
        faces = [wall.faces for wall in self.walls if len(wall.faces)]
        return (*faces, *(rim[None, :-1] for wall in self.walls for rim in wall.rims))

    @cached_property
    def _rims(self) -> tuple[tuple[Ints, Floats], ...]:
        """The nodes (m,) of each rim, and the antisymmetric W (m, m) of A = 1/2 sum W_ij x_i cross x_j. A rim runs as
        the faces do, so that its cap, seen from inside the chamber, has the other sense.
        """
        found = []
        for wall in self.walls:
            order = 2 if wall.faces.shape[1] > 3 else 1
            edge = _CURVED_EDGE if order > 1 else _EDGE
            for rim in wall.rims:
                m = len(rim) - 1
                W = np.zeros((m, m))
                for k in range(0, m, order):
                    nodes = np.arange(k, k + order + 1) % m
                    W[np.ix_(nodes, nodes)] -= edge
                found.append((rim[:-1], W))
        return tuple(found)

    def volume(self, x: Floats) -> float:
        """V [m^3] at positions of the points (n_points, 3) [m]."""
        total = 0.0
        for wall in self.walls:
            at, a, b = _on_faces(wall.faces, x)
            total += float(np.einsum("q,nqi,nqi->", _WEIGHTS, at, np.cross(a, b)))
        for nodes, W in self._rims:
            total += float(x[nodes].mean(axis=0) @ _vector_area(x[nodes], W))
        return -total / 3.0  # the faces are seen from outside of the material, which is inside of the chamber

    def shape_coordinates(self, x: Floats) -> Floats:
        return np.array([self.volume(x) - self.rest_volume])

    def shape_gradient(self, x: Floats, i: int, size: int) -> Floats:
        out = np.zeros(size)
        points = out[: x.size].reshape(-1, 3)
        for wall in self.walls:
            (N, N_u, N_v), (at, a, b) = _shapes(wall.faces.shape[1]), _on_faces(wall.faces, x)
            forces = (
                np.einsum("q,qk,nqi->nki", _WEIGHTS, N, np.cross(a, b))
                + np.einsum("q,qk,nqi->nki", _WEIGHTS, N_u, np.cross(b, at))
                + np.einsum("q,qk,nqi->nki", _WEIGHTS, N_v, np.cross(at, a))
            )
            np.add.at(points, wall.faces, -forces / 3.0)
        for nodes, W in self._rims:
            own = x[nodes]
            c, beside = own.mean(axis=0), W @ own
            np.add.at(points, nodes, -(_vector_area(own, W) / len(nodes) + np.cross(beside, c)) / 3.0)
        return out

    def _spins(self, x: Floats) -> Floats:
        """The vectors a (n_pairs, 3) of the blocks d2V/dx_i dx_j = [a]x, pair by pair in the order of the plan."""
        found = [np.zeros((0, 3))]
        for wall in self.walls:
            (N, N_u, N_v), (at, a, b) = _shapes(wall.faces.shape[1]), _on_faces(wall.faces, x)
            i, j = np.triu_indices(wall.faces.shape[1], 1)
            of_b = N_u[:, i] * N[:, j] - N[:, i] * N_u[:, j]
            of_a = N[:, i] * N_v[:, j] - N_v[:, i] * N[:, j]
            of_x = N_v[:, i] * N_u[:, j] - N_u[:, i] * N_v[:, j]
            each = (np.einsum("q,qp,nqi->npi", _WEIGHTS, by, of) for by, of in ((of_b, b), (of_a, a), (of_x, at)))
            found.append(-sum(each, start=np.zeros(3)).reshape(-1, 3) / 3.0)
        for nodes, W in self._rims:
            own = x[nodes]
            c, beside = own.mean(axis=0), W @ own
            i, j = np.triu_indices(len(nodes), 1)
            found.append(-((beside[i] - beside[j]) / len(nodes) - W[i, j, None] * c) / 3.0)
        return np.concatenate(found)

    def add_forces(self, given: Given, effort: Floats, into: Sum, transmission: Any) -> None:
        """Add the pressure on the wall, and its stiffness.

        Raises
        ------
        SimulationError
            Where the pressure is that of a vacuum or below.
        """
        p, x = float(effort[0]), given.state.x
        if not p > -ATMOSPHERE:
            raise SimulationError(f"the pressure of {self.name} would be below that of a vacuum")
        if p == 0.0:
            return
        into.full -= p * self.shape_gradient(x, 0, len(into.full))
        if into.data is not None and self.places is not None:
            spins = (-p * self.places.sign)[:, None] * self._spins(x)
            _add_spins(self.places.start, spins, into.data)

    def drives(self, given: Given, which: Ints, size: int, transmission: Any) -> Drives:
        columns = super().drives(given, which, size, transmission).columns
        slope = self.filling(given.theta).slope(self._pressure(given))
        return Drives(columns, columns, np.full(len(which), -slope))

    def coordinates(self, given: Given, transmission: Any) -> Floats:
        return self.shape_coordinates(given.state.x) + self.filling(given.theta).swallowed(self._pressure(given))

    def filling(self, theta: Mapping[str, float]) -> Filling:
        """The content of the chamber at values of the parameters [SI]."""
        values = {key: theta[f"{self.name}.{key}"] for key in self.stated}
        gas = self.rest_volume + values.get("dead_volume", 0.0) if self.is_gas else 0.0
        return Filling(values.get("hose_compliance", 0.0), gas, values.get("polytropic_exponent", 1.0))

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        own = self.own
        if bool(given.controls.is_held[own][0]):
            return
        for key, rate in self.filling(given.theta).rates(self._pressure(given)).items():
            if (one := into.get(f"{self.name}.{key}")) is not None:
                one.efforts[own] -= rate

    def _pressure(self, given: Given) -> float:
        return float(given.state.effort[self.own][0])

    def coordinate_scales(self, extent: float) -> Floats:
        return np.array([abs(self.rest_volume)])

    def coordinate_spans(self, extent: float, theta: Mapping[str, float], effort: Floats) -> Floats:
        return self.coordinate_scales(extent) + abs(self.filling(theta).swallowed(float(effort[0])))

    def energy(self, given: Given) -> float:
        return super().energy(given) - (
            0.0 if given.controls.is_held[self.own][0] else self.filling(given.theta).energy(self._pressure(given))
        )


class _NodePairs(NamedTuple):
    """The pairs of nodes of the tangent: where their blocks begin (n_pairs, 3), and 1 or -1 where i > j (n_pairs,)."""

    start: Ints
    sign: Floats


def _vector_area(x: Floats, W: Floats) -> Floats:
    return 0.5 * np.cross(x, W @ x).sum(axis=0)


@cache
def _shapes(k: int) -> tuple[Floats, Floats, Floats]:
    """Shape functions of a face of k nodes and their derivatives, at the quadrature points (6, k)."""
    return face_shapes(k, _POINTS)


def face_shapes(k: int, points: Floats) -> tuple[Floats, Floats, Floats]:
    """Shape functions of a face of k nodes, and their derivatives by u and v, at points u, v (n, 2); each (n, k)."""
    u, v = points.T
    w, one, none = 1.0 - u - v, np.ones_like(u), np.zeros_like(u)
    if k == 3:
        shapes = ((w, u, v), (-one, one, none), (-one, none, one))
    else:
        shapes = (
            (w * (2 * w - 1), u * (2 * u - 1), v * (2 * v - 1), 4 * w * u, 4 * u * v, 4 * v * w),
            (1 - 4 * w, 4 * u - 1, none, 4 * (w - u), 4 * v, -4 * v),
            (1 - 4 * w, none, 4 * v - 1, -4 * u, 4 * u, 4 * (w - v)),
        )
    N, N_u, N_v = (np.stack(each, axis=1) for each in shapes)
    return N, N_u, N_v


def _on_faces(faces: Ints, x: Floats) -> tuple[Floats, ...]:
    """x, x_u, x_v (n, 6, 3) at the points of quadrature."""
    nodes = x[faces]
    return tuple(np.einsum("qk,nki->nqi", by, nodes) for by in _shapes(faces.shape[1]))


@kernel()
def _add_spins(start: Ints, spins: Floats, data: Floats) -> None:
    """Add the matrices [a]x to blocks that begin at start (n, 3); spins: a (n, 3)."""
    for k in range(len(spins)):
        a, b, c = spins[k]
        data[start[k, 0] + 1] -= c
        data[start[k, 0] + 2] += b
        data[start[k, 1]] += c
        data[start[k, 1] + 2] -= a
        data[start[k, 2]] -= b
        data[start[k, 2] + 1] += a
