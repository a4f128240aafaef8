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

# Weights this small are rounding, of weights of about one.
NO_WEIGHT = 1e-14
STRAIGHT = 1e-6  # of an edge: tolerance of a point located in the straight-edged element
BALL_POINTS = 300  # that represent a ball
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def attach(mesh: TetMesh, points: Floats, *, tolerance: float | None = None, where: str = "") -> tuple[Ints, Floats]:
    """Nodes (n, 4 or 10) and weights of the points (n, 3) [m], with sum of w = 1 and sum of w X = the point exactly.

    So a point follows rigid motions, and constant strain, without error. One outside the mesh, by `tolerance` [m] at
    most (see `locate_points`), is extrapolated from the nearest element along its deformation gradient.

    Raises
    ------
    MeshError
        Where points lie further outside.
    """
    tets, barycentric = locate_points(mesh, points, tolerance=tolerance, where=where)
    return _in_elements(mesh, points, tets, barycentric)


class Attachment(NamedTuple):
    """A point as a weighted sum of nodes (k,), with sum of w = 1 and sum of w X = the point exactly.

    bore [m]: the diameter of the bore whose wall the nodes are, where the point lies in one, else 0.
    """

    nodes: Ints
    weights: Floats
    bore: float = 0.0


def attach_point(mesh: TetMesh, point: Floats, *, may_stand_off: bool = False, where: str = "") -> Attachment:
    """A point (3,) [m] in or near the mesh as by `attach`; one in a bore by the bore's wall all around it.

    may_stand_off: for a point such as a marker on a stalk, extrapolated from the nearest element at any distance.

    In a bore it is the sum of points of the wall with the smallest weights that give it exactly. So it follows rigid
    motions and constant strain, and a force on it is passed on to the wall with no moment added.

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
    return _smallest_sum(_conditions(wall.points, point, wall.diameter), *attached, wall.diameter)


def attach_directions(mesh: TetMesh, point: Floats, *, where: str = "") -> tuple[Ints, Floats]:
    """Nodes (n,) of the element of a point (3,) [m], or of the nearest one, and the rates (n, 3) [1/m] of their weights
    as the point moves along x, y and z: times their positions, the deformation gradient there.

    Raises
    ------
    MeshError
        Where no element is near.
    """
    tets, barycentric = locate_points(mesh, point[None, :], tolerance=np.inf, where=where)
    nodes = mesh.tets[tets[0]]
    gradients = mesh.cell.gradients(_within(barycentric))[0]
    local = gradients[:, 1:] - gradients[:, :1]
    return nodes, local @ np.linalg.inv(mesh.points[nodes].T @ local)


def attach_rate(mesh: TetMesh, point: Floats, way: Floats, *, where: str = "") -> tuple[Ints, Floats]:
    """Nodes and rates [1/m] of the weights of a point (3,) [m] inside the mesh that moves along a direction (3,).

    Raises
    ------
    MeshError
        Where the point lies outside the material, such as in a bore, or in an element that is curved.
    """
    tets, barycentric = locate_points(mesh, point[None, :], tolerance=np.inf, where=where)
    nodes = mesh.tets[tets[0]]
    X = mesh.points[nodes]
    edge = float(np.linalg.norm(X[1] - X[0]))
    off = float(np.linalg.norm(mesh.cell.functions(barycentric)[0] @ X - point))
    if barycentric.min() < -STRAIGHT or off > STRAIGHT * edge:
        raise MeshError(
            Fault(
                "a via point that an offset moves must lie inside its body, in an element that is not curved",
                where=where,
                got="(" + ", ".join(f"{1e3 * x:.6g}" for x in point) + ") mm",
                allowed="a point in the material; one in a bore goes with the bore",
            )
        )
    nodes, rates = attach_directions(mesh, point, where=where)
    return nodes, rates @ way


def attach_ball(mesh: TetMesh, centre: Floats, radius: float, *, where: str = "") -> Attachment:
    """A point (3,) [m] as the mean of the body around it, out to a radius [m]: a force on it is spread over that ball.

    Where the surface cuts the ball off, it is the sum with the smallest weights that gives the point exactly. A force
    on one point alone gives a displacement that grows without bound as the mesh gets finer.

    Raises
    ------
    MeshError
        Where the point lies too far outside the mesh, and no wall surrounds it.
    """
    k = np.arange(BALL_POINTS) + 0.5
    height, turn = 1.0 - 2.0 * k / BALL_POINTS, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - height**2)
    # Radii and directions are ordered independently, so that the ball is filled evenly.
    far = radius * ((k * GOLDEN) % 1.0) ** (1.0 / 3.0)
    ball = centre + far[:, None] * np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    ball = ball[tets_holding(mesh, ball) >= 0]
    conditions = _conditions(ball, centre, radius)
    if np.linalg.matrix_rank(conditions, tol=1e-6 * np.sqrt(BALL_POINTS)) < 4:
        return attach_point(mesh, centre, where=where)
    return _smallest_sum(conditions, *attach(mesh, ball, where=where))


def _conditions(points: Floats, at: Floats, size: float) -> Floats:
    """Conditions C (4, n) on shares s of points (n, 3) in a sum that gives the point `at`: C s = (1, 0, 0, 0)."""
    return np.vstack([np.ones(len(points)), ((points - at) / size).T])


def _smallest_sum(conditions: Floats, nodes: Ints, weights: Floats, bore: float = 0.0) -> Attachment:
    """The sum with the smallest shares that meets the conditions (4, n), of points by nodes and weights (n, k)."""
    shares = np.linalg.lstsq(conditions, np.array([1.0, 0.0, 0.0, 0.0]), rcond=1e-9)[0]
    unique, place = np.unique(nodes, return_inverse=True)
    summed: Floats = np.zeros(len(unique))
    np.add.at(summed, place.ravel(), (shares[:, None] * weights).ravel())
    kept = np.abs(summed) > NO_WEIGHT
    return Attachment(unique[kept], summed[kept], bore)


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
