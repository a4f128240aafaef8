"""Point-mesh distances, outside and inside, for checking ties and initial overlap."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.geometry.locate import OUTSIDE, mean_edges, nearest_tets, tets_holding
from softcal.geometry.mesh import TetMesh


def distances_outside(mesh: TetMesh, points: Floats) -> tuple[Floats, Floats]:
    """Distances of points (n, 3) outside a mesh, 0 for points inside, and the default tolerances there [m]."""
    outside = tets_holding(mesh, points) < 0
    distance, allowed = np.zeros(len(points)), np.zeros(len(points))
    if outside.any():
        tets, distance[outside] = nearest_tets(mesh, points[outside])
        allowed[outside] = OUTSIDE * mean_edges(mesh, tets)
    return distance, allowed


def depths_inside(mesh: TetMesh, points: Floats) -> tuple[Floats, Floats]:
    """Depths of points (n, 3) in a mesh, 0 for points outside, and the element sizes there [m]."""
    depth, allowed = np.zeros(len(points)), np.zeros(len(points))
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    near = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
    inside = near[tets_holding(mesh, points[near]) >= 0]
    if len(inside):
        tets, depth[inside] = nearest_tets(mesh, points[inside])
        allowed[inside] = OUTSIDE * mean_edges(mesh, tets)
    return depth, allowed
