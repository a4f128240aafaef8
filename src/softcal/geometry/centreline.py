"""Centrelines of rods: nodes with the triads of their cross-sections, and arc lengths between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from numbers import Integral
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from softcal.arrays import Array, Series
from softcal.checks import Floats, frozen_floats
from softcal.declare import Checked, checked_arguments
from softcal.display import displayed
from softcal.errors import Fault, MeshError
from softcal.limits import LIMITS

SHORTER = 1e-2  # of the distance of two nodes: by so much an arc may be less, as that of an element that was halved


@displayed
@dataclass(frozen=True)
class Centreline(Checked):
    """nodes (m, 3) [m]; triads (m, 3, 3): columns d1, d2, d3 of each node's cross-section, d3 along the tangent;
    lengths (m - 1,): arc length from node to node [m].
    """

    nodes: Annotated[Floats, Array((None, 3))]
    triads: Annotated[Floats, Array((None, 3, 3))]
    lengths: Series

    def __post_init__(self) -> None:
        super().__post_init__()
        m = len(self.nodes)
        if (len(self.triads), len(self.lengths)) != (m, m - 1):
            got = f"{m} nodes, {len(self.triads)} triads, {len(self.lengths)} lengths"
            raise MeshError(Fault("a centreline has a triad for each node, and a length between two", "", got))
        if m < 2:
            raise MeshError(Fault("a centreline needs two nodes or more", got=str(m), allowed=">= 2"))
        if not self.lengths.min() > 0.0:
            at = int(np.argmin(self.lengths))
            raise MeshError(
                Fault(
                    "two nodes of a centreline coincide",
                    where=f"node {at + 1}",
                    got=f"an arc of {self.lengths[at]:.6g} m",
                    allowed="> 0",
                )
            )
        off = np.abs(np.swapaxes(self.triads, 1, 2) @ self.triads - np.eye(3)).max(axis=(1, 2))
        if off.max() > 1e-9 or np.linalg.det(self.triads).min() < 0.0:
            raise MeshError(Fault("a triad is no rotation", where=f"node {int(np.argmax(off))}"))
        chords = np.linalg.norm(np.diff(self.nodes, axis=0), axis=1)
        if (short := self.lengths < (1.0 - SHORTER) * chords).any():
            at = int(np.argmax(short))
            raise MeshError(
                Fault(
                    "an arc of a centreline is shorter than the straight line between its nodes",
                    where=f"nodes {at + 1} and {at + 2}",
                    got=f"{1e3 * self.lengths[at]:.6g} mm",
                    allowed=f"{1e3 * chords[at]:.6g} mm or more",
                )
            )

    @property
    def stations(self) -> Floats:
        """Arc length from the first node (m,) [m]."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)])


def spaced(stations: ArrayLike, longest: float) -> Floats:
    """Fractions from 0 to 1 that include all `stations` (also fractions), with a spacing of at most `longest`.

    For `straight` and `helix` with discs at given stations.

    Raises
    ------
    MeshError
        If a station is not between 0 and 1, or `longest` is not positive.
    """
    inner = np.asarray(stations, dtype=np.float64).ravel()
    if inner.size and not (inner.min() >= 0.0 and inner.max() <= 1.0):
        raise MeshError(Fault("a station is not on the rod", got=str(inner), allowed="fractions from 0 to 1"))
    if not longest > 0.0:
        raise MeshError(Fault("the longest element must have a length", got=f"{longest:.6g}", allowed="> 0"))
    ends = np.unique(np.concatenate([[0.0, 1.0], inner]))
    pieces = [np.linspace(a, b, math.ceil((b - a) / longest - 1e-9) + 1)[1:] for a, b in pairwise(ends)]
    return np.concatenate([[0.0], *pieces])


@checked_arguments
def straight(
    start: Sequence[float], end: Sequence[float], at: int | ArrayLike, *, first: Sequence[float] | None = None
) -> Centreline:
    """A straight rod.

    Parameters
    ----------
    start, end
        Its ends [m].
    at
        Number of elements of equal length, or the nodes as fractions ascending from 0 to 1.
    first
        A vector whose part normal to the rod becomes axis 1 of the sections; any if None.

    Raises
    ------
    MeshError
        Where the ends coincide, the fractions do not ascend, or `first` is along the rod.
    """
    a, b = _vector(start, "start"), _vector(end, "end")
    length = float(np.linalg.norm(b - a))
    if not length > 0.0:
        raise MeshError(Fault("a rod's ends coincide", got=str(a), allowed="two different points"))
    s = _fractions(at)
    triad = _triad((b - a) / length, first)
    return Centreline(a + s[:, None] * (b - a), np.repeat(triad[None], len(s), axis=0), length * np.diff(s))


@checked_arguments
def helix(
    base: Sequence[float],
    axis: Sequence[float],
    *,
    diameter: float,
    pitch: float,
    turns: float,
    at: int | ArrayLike,
    towards: Sequence[float] | None = None,
    left_handed: bool = False,
) -> Centreline:
    """The wire of a helical spring. Axis 1 of its sections points to the coil's axis (Frenet's triad).

    Parameters
    ----------
    base
        Point on the coil's axis at the height of the wire's first node [m].
    axis
        Direction of the coil's axis.
    diameter
        Diameter of the coil, from wire centre to wire centre [m].
    pitch
        Rise per turn [m]; 0 for a ring.
    turns
        Number of turns, not necessarily whole.
    at
        Number of elements of equal length, or the nodes as fractions ascending from 0 to 1.
    towards
        Direction from the axis to the first node; any if None.
    left_handed
        True if the wire rises clockwise, viewed against `axis`.

    Raises
    ------
    MeshError
        Where a measure is out of range, a turn has fewer than four elements, or `towards` is along the axis.
    """
    faults = [
        Fault(f"a helix's {name} must be positive", name, got=f"{value:.6g}", allowed="> 0")
        for name, value in {"diameter": diameter, "turns": turns}.items()
        if not value > 0.0
    ]
    if not pitch >= 0.0:
        faults.append(Fault("a helix's pitch must not be negative", "pitch", got=f"{pitch:.6g} m", allowed=">= 0"))
    if faults:
        raise MeshError(faults)
    origin = _vector(base, "base")
    e1, e2, e3 = _triad(_direction(axis, "axis"), towards).T
    if left_handed:
        e2 = -e2
    radius, climb = diameter / 2.0, pitch / (2.0 * math.pi)
    angle = 2.0 * math.pi * turns * _fractions(at)
    if (widest := float(np.diff(angle).max())) > 0.5 * math.pi * (1.0 + 1e-9):
        got, allowed = f"{2.0 * math.pi / widest:.3g} elements in a turn", "4 or more"
        raise MeshError(Fault("a helix is too coarse for its turns", "at", got, allowed))
    per_angle = math.hypot(radius, climb)
    outwards = np.cos(angle)[:, None] * e1 + np.sin(angle)[:, None] * e2
    around = np.cos(angle)[:, None] * e2 - np.sin(angle)[:, None] * e1
    nodes = origin + radius * outwards + climb * angle[:, None] * e3
    d3 = (radius * around + climb * e3) / per_angle
    d1 = -outwards
    triads = np.stack([d1, np.cross(d3, d1), d3], axis=2)
    return Centreline(nodes, triads, per_angle * np.diff(angle))


def polyline(points: ArrayLike, *, first: Sequence[float] | None = None) -> Centreline:
    """A smooth curve through points: tangents by circles through three points, lengths by arcs between them.

    The sections have no twist from node to node (double reflection; Wang, Juettler, Zheng and Liu, 2008). Axis 1 of the
    first one is the part of `first` normal to the curve.

    Raises
    ------
    MeshError
        If points coincide, or the curve turns by a right angle or more at one of them.
    """
    nodes = frozen_floats(points, name="points", shape=(None, 3))
    chords = np.diff(nodes, axis=0)
    h = np.linalg.norm(chords, axis=1)
    if len(nodes) < 2 or not h.min() > 0.0:
        raise MeshError(Fault("a polyline needs two points or more, all different", got=f"{len(nodes)} points"))
    u = chords / h[:, None]
    turning = (u[1:] * u[:-1]).sum(axis=1)
    sharp = np.flatnonzero(turning <= 0.0)
    if sharp.size:
        at = int(sharp[0])
        raise MeshError(
            Fault(
                "a polyline is too coarse for a smooth curve",
                where=f"point {at + 1}",
                got=f"a turn of {math.degrees(math.acos(max(-1.0, turning[at]))):.0f} deg",
                allowed="less than 90 deg",
                attempt="more points along the curve",
            )
        )
    tangents = np.empty_like(nodes)
    tangents[1:-1] = h[1:, None] * u[:-1] + h[:-1, None] * u[1:]
    tangents[1:-1] /= np.linalg.norm(tangents[1:-1], axis=1)[:, None]
    tangents[0] = 2.0 * (u[0] @ tangents[1]) * u[0] - tangents[1] if len(nodes) > 2 else u[0]
    tangents[-1] = 2.0 * (u[-1] @ tangents[-2]) * u[-1] - tangents[-2] if len(nodes) > 2 else u[0]
    half = 0.5 * np.linalg.norm(np.diff(tangents, axis=0), axis=1)  # sine of half the angle of an arc
    lengths = h * np.where(half > 1e-8, np.arcsin(np.minimum(half, 1.0)) / np.maximum(half, 1e-300), 1.0)
    triads = [_triad(tangents[0], first)]
    for i in range(len(nodes) - 1):
        v = nodes[i + 1] - nodes[i]
        d1 = _reflected(triads[-1][:, 0], v)
        w = tangents[i + 1] - _reflected(tangents[i], v)
        if w @ w > 1e-30:
            d1 = _reflected(d1, w)
        triads.append(_triad(tangents[i + 1], d1))
    return Centreline(nodes, np.array(triads), lengths)


def curve_through(
    points: ArrayLike, stations: ArrayLike, longest: float, *, first: Sequence[float] | None = None
) -> Centreline:
    """`polyline` with additional nodes: at arc lengths `stations` [m], with a spacing of at most `longest` [m].

    Parameters
    ----------
    points
        Points of the curve (n, 3) [m].
    stations
        Arc lengths (k,) [m] that get a node.
    longest
        Largest spacing of nodes [m].
    first
        First axis (3,) of the section at the start; chosen by default.

    Raises
    ------
    MeshError
        As `polyline`; or if a station is off the curve.
    """
    from scipy.interpolate import CubicHermiteSpline

    coarse = polyline(points, first=first)
    known, total = coarse.stations, float(coarse.stations[-1])
    wanted = np.concatenate([known, np.asarray(stations, dtype=np.float64).ravel()])
    same = 1e-9 * total
    wanted[np.abs(wanted - total) < same] = total
    s = total * spaced(wanted / total, longest / total)
    s = s[np.append(True, np.diff(s) > same)]  # a station at one of the points
    curve = CubicHermiteSpline(known, coarse.nodes, coarse.triads[:, :, 2])
    return polyline(curve(s), first=first)


def _reflected(vector: Floats, normal: Floats) -> Floats:
    return vector - 2.0 * (normal @ vector) / (normal @ normal) * normal


def _triad(d3: Floats, first: ArrayLike | None) -> Floats:
    """Columns d1, d2, d3 with d1 the part of `first` normal to the unit vector d3."""
    if first is None:
        wanted = np.eye(3)[np.argmin(np.abs(d3))]
    else:
        wanted = _direction(first, "first")
    d1 = wanted - (wanted @ d3) * d3
    norm = float(np.linalg.norm(d1))
    if norm < 1e-9:
        raise MeshError(Fault("a section's first axis is along the tangent", got=str(first), allowed="any other"))
    d1 /= norm
    return np.stack([d1, np.cross(d3, d1), d3], axis=1)


def _vector(values: ArrayLike, name: str) -> Floats:
    return frozen_floats(values, name=name, shape=(3,))


def _direction(values: ArrayLike, name: str) -> Floats:
    vector = _vector(values, name)
    norm = float(np.linalg.norm(vector))
    if not norm > 0.0:
        raise MeshError(Fault(f"{name} has no direction", got=str(vector), allowed="a vector that is not zero"))
    return vector / norm


def _fractions(at: int | ArrayLike) -> Floats:
    if isinstance(at, Integral):
        return np.linspace(0.0, 1.0, LIMITS["elements of a rod"].checked(at, where="at") + 1)
    s = frozen_floats(at, name="at", shape=(None,))
    if len(s) < 2 or s[0] != 0.0 or s[-1] != 1.0 or not np.diff(s).min() > 0.0:
        allowed = "fractions ascending from 0 to 1"
        raise MeshError(Fault("a rod's nodes are not in order", "at", str(s), allowed))
    return s


AT_NODE = 1e-6  # of an element: a point as near as that to a node's section is on it


class RodPlace(NamedTuple):
    """A point on or beside a rod: its section is between nodes `node` and `node + 1`, at a share of the way."""

    node: int
    share: float

    @property
    def weights(self) -> tuple[tuple[int, float], ...]:
        """The nodes whose sections carry the point, with their weights: of one node, or of both ends of an element.

        A point that follows both rigidly, by shares, errs by the square of the element's length.
        """
        pairs = ((self.node, 1.0 - self.share), (self.node + 1, self.share))
        return tuple((node, weight) for node, weight in pairs if weight > 0.0)


def place_on_rod(centreline: Centreline, point: Floats) -> RodPlace:
    """The section of a rod at rest that is nearest to a point (3,) [m]."""
    nodes = centreline.nodes
    chords = np.diff(nodes, axis=0)
    along = ((point - nodes[:-1]) * chords).sum(axis=1) / (chords**2).sum(axis=1)
    along = np.clip(along, 0.0, 1.0)
    apart = np.linalg.norm(point - nodes[:-1] - along[:, None] * chords, axis=1)
    node = int(np.argmin(apart))
    share = float(along[node])
    share = round(share) if abs(share - round(share)) < AT_NODE else share
    return RodPlace(node, share)
