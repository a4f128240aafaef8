"""A bar with a square channel along it, made by leaving bricks out of a box, and the same bar without the channel."""

from __future__ import annotations

import numpy as np

from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.twin.robot import Body, Cable, Robot, ViaPoint

WIDE, LONG, BORE = 0.012, 0.060, 0.004
AT = 0.5 * BORE  # the channel runs along z through (AT, 0), from face to face


def channel(points: np.ndarray) -> np.ndarray:
    """Which points (n, 3) [m] lie in the channel."""
    return (points[:, 0] > 0.0) & (points[:, 0] < BORE) & (np.abs(points[:, 1]) < 0.5 * BORE)


def drilled_bar(layers: int = 10) -> TetMesh:
    """The bar with its channel; node sets z0 and z1."""
    whole = box_mesh([WIDE, WIDE, LONG], [6, 6, layers], origin=[-0.5 * WIDE, -0.5 * WIDE, 0.0])
    tets = whole.tets[~channel(whole.points[whole.tets].mean(axis=1))]
    used, numbered = np.unique(tets, return_inverse=True)
    points = whole.points[used]
    z = points[:, 2]
    sets = {"z0": np.flatnonzero(z < 1e-9), "z1": np.flatnonzero(z > LONG - 1e-9)}
    return TetMesh(points, numbered.reshape(-1, 4), sets)


def via_points(on: str, n: int = 5, offset: tuple[float, float] = (0.0, 0.0)) -> tuple[ViaPoint, ...]:
    """Along the channel, from the tip's face inwards, and the last one fixed in space below the foot."""
    x, y = AT + offset[0], offset[1]
    carried = [ViaPoint(np.array([x, y, z]), on) for z in np.linspace(LONG, 0.1 * LONG, n)]
    return (*carried, ViaPoint(np.array([x, y, -0.01])))


def drilled_robot(element: str = "P1", offset: tuple[float, float] = (0.0, 0.0)) -> Robot:
    mesh = drilled_bar()
    material = {"youngs_modulus": 1.0e6, "poissons_ratio": 0.4}
    body = Body("bar", mesh, mesh.node_sets["z0"], material, element=element)  # type: ignore[arg-type]
    return Robot((body,), cables=(Cable("front", via_points("bar", offset=offset)),))
