"""Chambers in a CalculiX deck: a pressure on the faces of the wall, which follows them.

CalculiX has no faces over an opening, so that a flat cap hands no pressure to its rim, and three points on a curved
face, where the pressure on it needs six. What is left out are forces on nodes, dead ones, updated at each shape.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.cell import TET_FACES, face_keys
from softcal.mechanics.chamber import ChamberTerm, face_shapes
from softcal.plugins.calculix.format import number
from softcal.plugins.calculix.load_path import positions
from softcal.twin.build import Twin
from softcal.twin.response import Snapshot

_POINTS = np.array([(1.0, 1.0), (4.0, 1.0), (1.0, 4.0)]) / 6.0  # of CalculiX on a face, each of a third of its area


def wall_pressures(twin: Twin, shape: Snapshot, corners: Ints) -> Iterator[str]:
    """Lines of *DLOAD of all walls at a shape.

    Parameters
    ----------
    twin
        The robot as a system.
    shape
        Its shape with the pressures [Pa] of its chambers.
    corners
        Points at the corners of the deck's elements (n_elements, 4), in their order.
    """
    n_points = twin.system.layout.n_points
    keys = face_keys(corners[:, TET_FACES].reshape(-1, 3), n_points)
    order = np.argsort(keys)
    for term in twin.system.of(ChamberTerm):
        for wall in term.walls:
            elements, sides = np.divmod(order[np.searchsorted(keys, face_keys(wall.faces, n_points), sorter=order)], 4)
            for element, side in zip(elements + 1, sides + 1, strict=True):  # CalculiX's faces are in our order
                yield f"{element}, P{side}, {number(shape.efforts[term.name])}"


def forces_left_out(twin: Twin, shape: Snapshot) -> Floats:
    """Forces at a shape (n_points, 3) [N] of the chambers' pressures, less those of CalculiX on their walls."""
    x = positions(twin, shape)
    forces = np.zeros_like(x)
    for term in twin.system.of(ChamberTerm):
        pressure = shape.efforts[term.name]
        forces += pressure * term.shape_gradient(x, 0, x.size).reshape(-1, 3)
        for wall in term.walls:
            N, N_u, N_v = face_shapes(wall.faces.shape[1], _POINTS)
            area = np.cross(*(np.einsum("qk,nki->nqi", by, x[wall.faces]) for by in (N_u, N_v)))
            np.add.at(forces, wall.faces, pressure / 6.0 * np.einsum("qk,nqi->nki", N, area))
    return forces
