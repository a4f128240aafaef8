"""Points bonded to a mesh: weighted sums of the nodes of the element around them, next to them, or of several around
them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.bore import wall_around
from softcal.geometry.locate import barycentric_in, locate_points, nearest_places, tets_holding
from softcal.geometry.mesh import TetMesh
from softcal.units import format_place

# Weights this small are rounding, of weights of about one.
NO_WEIGHT = 1e-14
STRAIGHT = 1e-6  # of an edge: tolerance of a point located in the straight-edged element
KNOT = 1e-3  # [m]: radius of what fixes a cable at a point in the material, where it is not stated
REACH = 1.25  # radius of the ball around a point in a bore, where it is not stated, over the bore's diameter
OCTANT_POINTS = 38  # that represent an eighth of a ball
GOLDEN = 0.5 * (1.0 + np.sqrt(5.0))


def attach(mesh: TetMesh, points: Floats, *, tolerance: float | None = None, where: str = "") -> tuple[Ints, Floats]:
    """Nodes (n, 4 or 10) and weights of the points (n, 3) [m], with sum of w = 1 and sum of w X = the point exactly.

    So a point follows rigid motions, and constant strain, without error. One outside the mesh, by `tolerance` [m] at
    most (see `locate_points`), is extrapolated from the nearest element along its deformation gradient.

    Parameters
    ----------
    mesh
        The mesh [m].
    points
        The points (n, 3) [m].
    tolerance
        Largest distance of a point from the mesh [m]; None: that of `locate_points`.
    where
        Place for error messages.

    Raises
    ------
    MeshError
        Where points lie further outside.
    """
    tets, barycentric = locate_points(mesh, points, tolerance=tolerance, where=where)
    return _in_elements(mesh, points, tets, barycentric)


class Attachment(NamedTuple):
    """A point as a weighted sum of nodes (k,), with sum of w = 1 and sum of w X = the point exactly.

    bore [m]: the diameter of the bore in whose wall the nodes are, where the point lies in one, else 0. radius [m]: of
    the ball over which a force is distributed; 0: it acts at the point, or on a ring of the bore's wall.
    """

    nodes: Ints
    weights: Floats
    bore: float = 0.0
    radius: float = 0.0


def attach_point(mesh: TetMesh, point: Floats, *, may_stand_off: bool = False, where: str = "") -> Attachment:
    """The nodes and weights of a point in or near the mesh as by `attach`; of one in a bore by the bore's wall all
    around it.

    In a bore it is the sum of points of the wall with the smallest weights that give it exactly. So it follows rigid
    motions and constant strain, and a force on it is passed on to the wall with no moment added.

    Parameters
    ----------
    mesh
        The mesh [m].
    point
        The point (3,) [m].
    may_stand_off
        Whether it may be at any distance, such as a marker on a stalk; it then is extrapolated from the nearest
        element.
    where
        Place for error messages.

    Raises
    ------
    MeshError
        Where the point lies too far outside the mesh, and no wall surrounds it.
    """
    outside = nearest_places(mesh, point[None, :]).distances[0] > 0.0
    wall = wall_around(mesh, point) if outside and not may_stand_off else None
    if wall is None:
        nodes, weights = attach(mesh, point[None, :], tolerance=np.inf if may_stand_off else None, where=where)
        return Attachment(nodes[0], weights[0])
    inside = np.array([barycentric_in(mesh, int(t), at) for t, at in zip(wall.tets, wall.points, strict=True)])
    attached = _in_elements(mesh, wall.points, wall.tets, inside)
    shares = _smallest_shares(np.vstack([np.ones(len(wall.points)), ((wall.points - point) / wall.diameter).T]))
    return Attachment(*_summed(shares, *attached), wall.diameter)


def attach_directions(mesh: TetMesh, point: Floats, *, where: str = "") -> tuple[Ints, Floats]:
    """Nodes (n,) of the element of a point, or of the nearest one, and the rates (n, 3) [1/m] of their weights as the
    point moves along x, y and z: times their positions, the deformation gradient there.

    Parameters
    ----------
    mesh
        The mesh [m].
    point
        The point (3,) [m].
    where
        Place for error messages.

    Raises
    ------
    MeshError
        Where no element is near.
    """
    nodes, rates = _directions(mesh, *locate_points(mesh, point[None, :], tolerance=np.inf, where=where))
    return nodes[0], rates[0]


def attach_rate(
    mesh: TetMesh, point: Floats, way: Floats, radius: float | None = 0.0, *, where: str = ""
) -> tuple[Ints, Floats]:
    """Nodes and rates [1/m] of the weights of a point inside the mesh that moves along a direction, with the ball
    around it.

    Parameters
    ----------
    mesh
        The mesh [m].
    point
        The point (3,) [m].
    way
        Its direction (3,) [-].
    radius
        Radius of the ball [m], as in `attach_ball`.
    where
        Place for error messages.

    Raises
    ------
    MeshError
        Where the point lies outside the material, such as in a bore, or in an element that is curved.
    """
    nodes, rates = _directions(mesh, *_located_inside(mesh, point[None, :], where))
    ball = _ball(mesh, point, radius, where=where)
    if ball is None:
        return nodes[0], rates[0] @ way
    nodes, rates = _directions(ball.mesh, *_located_inside(ball.mesh, ball.points, where))
    return _summed(ball.shares, nodes, rates @ way)


def attach_ball(mesh: TetMesh, centre: Floats, radius: float | None = None, *, where: str = "") -> Attachment:
    """A point (3,) [m] as a mean of the body around it, out to a radius [m]: a force on it is distributed over that
    ball. A force on one point alone gives a displacement that grows without bound as the mesh gets finer.

    Where the surface cuts the ball off, it is the sum with the smallest weights that gives the point exactly. Only
    material that is connected within the ball counts, and not what is beyond a groove.

    Parameters
    ----------
    radius
        Zero: the point alone. None: `REACH` times the diameter of the bore for a point in a bore, else `KNOT`.

    Raises
    ------
    MeshError
        Where the point lies too far outside the mesh, and no wall surrounds it.
    """
    ball = _ball(mesh, centre, radius, where=where)
    if ball is None:
        return attach_point(mesh, centre, where=where)
    tets, barycentric = locate_points(ball.mesh, ball.points, where=where)
    attached = _summed(ball.shares, *_in_elements(ball.mesh, ball.points, tets, barycentric))
    return Attachment(*attached, ball.bore, ball.radius)


class _Ball(NamedTuple):
    """Points (n, 3) [m] of the material within a radius [m] of a point, and their shares (n,) in a sum that is the
    point; mesh: the tets around it; bore [m]: as of `Attachment`.
    """

    points: Floats
    shares: Floats
    mesh: TetMesh
    bore: float
    radius: float


def _ball(mesh: TetMesh, centre: Floats, radius: float | None, *, where: str) -> _Ball | None:
    """The ball around a point; None for a point alone, or too little material for a ball."""
    if radius == 0.0:
        return None
    seed = attach_point(mesh, centre, where=where)
    if radius is None:
        radius = REACH * seed.bore or KNOT
    points = centre + radius * _ball_points()
    near = _connected(mesh, centre, radius, seed.nodes)
    points = points[tets_holding(near, points) >= 0]
    conditions = np.vstack([np.ones(len(points)), ((points - centre) / radius).T])
    if np.linalg.matrix_rank(conditions, tol=1e-6 * np.sqrt(8 * OCTANT_POINTS)) < 4:
        return None
    return _Ball(points, _smallest_shares(conditions), near, seed.bore, radius)


def _ball_points() -> Floats:
    """Points (n, 3) that fill the ball of radius 1 evenly, and are their own mirror images in x, y and z."""
    k = np.arange(OCTANT_POINTS) + 0.5
    height = k / OCTANT_POINTS
    across = np.sqrt(1.0 - height**2)
    # No sum of multiples of the two steps is whole, so that radii and directions are ordered independently.
    angle = 0.5 * np.pi * ((k * GOLDEN) % 1.0)
    far = ((k * np.sqrt(2.0)) % 1.0) ** (1.0 / 3.0)
    octant = far[:, None] * np.column_stack([across * np.cos(angle), across * np.sin(angle), height])
    signs = np.array(np.meshgrid([1.0, -1.0], [1.0, -1.0], [1.0, -1.0])).reshape(3, -1).T
    return (signs[:, None] * octant).reshape(-1, 3)


def _connected(mesh: TetMesh, centre: Floats, radius: float, seed: Ints) -> TetMesh:
    """The tets within a radius [m] of a point (3,) [m] that are connected there, by common nodes, with nodes `seed`."""
    corners = mesh.points[mesh.tets[:, :4]]
    beyond = np.maximum(0.0, np.maximum(corners.min(axis=1) - centre, centre - corners.max(axis=1)))
    has_seed = np.isin(mesh.tets, seed).any(axis=1)
    tets = mesh.tets[has_seed | (np.linalg.norm(beyond, axis=1) <= radius)]
    reached = np.isin(np.arange(mesh.n_points), seed)
    while True:
        joins = reached[tets].any(axis=1)
        before = int(reached.sum())
        reached[tets[joins]] = True
        if int(reached.sum()) == before:
            return TetMesh(mesh.points, tets[joins])


def _located_inside(mesh: TetMesh, points: Floats, where: str) -> tuple[Ints, Floats]:
    """The tets of points (n, 3) [m] and their barycentric coordinates; refuses a point outside the material, or in an
    element that is curved.
    """
    tets, barycentric = locate_points(mesh, points, tolerance=np.inf, where=where)
    X = mesh.points[mesh.tets[tets]]
    edges = np.linalg.norm(X[:, 1] - X[:, 0], axis=1)
    off = np.linalg.norm(np.einsum("na,nai->ni", mesh.cell.functions(barycentric), X) - points, axis=1)
    outside = (barycentric.min(axis=1) < -STRAIGHT) | (off > STRAIGHT * edges)
    if outside.any():
        raise MeshError(
            Fault(
                "a via point that an offset moves must lie inside its body, in an element that is not curved",
                where=where,
                got=format_place(points[outside.argmax()]),
                allowed="a point in the material; one in a bore goes with the bore",
            )
        )
    return tets, barycentric


def _directions(mesh: TetMesh, tets: Ints, barycentric: Floats) -> tuple[Ints, Floats]:
    """Nodes (n, k) of the elements of points, and the rates (n, k, 3) [1/m] of `attach_directions`."""
    nodes = mesh.tets[tets]
    gradients = mesh.cell.gradients(_within(barycentric))
    local = gradients[:, :, 1:] - gradients[:, :, :1]
    return nodes, local @ np.linalg.inv(mesh.points[nodes].transpose(0, 2, 1) @ local)


def _smallest_shares(conditions: Floats) -> Floats:
    """The smallest shares s (n,) of points in a sum with C s = (1, 0, 0, 0): the sum of the shares is one, and that of
    the points, counted from the point that it is to be, is zero.
    """
    shares, *_ = np.linalg.lstsq(conditions, np.array([1.0, 0.0, 0.0, 0.0]), rcond=1e-9)
    return np.asarray(shares, dtype=np.float64)


def _summed(shares: Floats, nodes: Ints, weights: Floats) -> tuple[Ints, Floats]:
    """The nodes and weights of a sum, with shares (n,), of points by nodes and weights (n, k)."""
    unique, place = np.unique(nodes, return_inverse=True)
    summed: Floats = np.zeros(len(unique))
    np.add.at(summed, place.ravel(), (shares[:, None] * weights).ravel())
    kept = np.abs(summed) > NO_WEIGHT
    return unique[kept], summed[kept]


def _in_elements(mesh: TetMesh, points: Floats, tets: Ints, barycentric: Floats) -> tuple[Ints, Floats]:
    """Nodes and weights of points in elements or beside them, by barycentric coordinates between the corners."""
    inside = _within(barycentric)
    nodes = mesh.tets[tets]
    X = mesh.points[nodes]
    N = mesh.cell.functions(inside)
    dN = mesh.cell.gradients(inside)
    dN = dN[:, :, 1:] - dN[:, :, :1]
    left = points - np.einsum("na,nai->ni", N, X)  # to points outside the range of the element's map
    local = np.linalg.solve(np.einsum("nai,nak->nik", X, dN), left[:, :, None])[:, :, 0]
    return nodes, N + np.einsum("nak,nk->na", dN, local)


def _within(barycentric: Floats) -> Floats:
    """Barycentric coordinates (n, 4) of points in the elements that are near those given."""
    inside = np.clip(barycentric, 0.0, None)
    return inside / inside.sum(axis=1, keepdims=True)
