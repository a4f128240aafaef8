"""The term of a solid from its mesh, its element and its law."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.materials.law import Law, compile_law
from softcal.mechanics.element import Element
from softcal.mechanics.solid import SolidTerm


def build_solid(
    name: str,
    law: Law,
    element: Element,
    points: Floats,
    tets: Ints,
    *,
    first_point: int,
    first_pressure: int = 0,
) -> tuple[SolidTerm, Ints]:
    """The term of some tets of a body, and the nodes that have its pressures, in the order of their numbers.

    Parameters
    ----------
    name
        First part of its parameters' names.
    law
        The law.
    element
        The element.
    points
        Nodes of the body (n_points, 3) [m].
    tets
        Its tets, by the body's nodes (n_tets, n_a).
    first_point, first_pressure
        Numbers of the body's first point, and of the first pressure.

    Raises
    ------
    MeshError
        Where an element is inverted.
    """
    dN, w = element.gradients(points, tets, where=name)
    order = np.argsort(tets, axis=1)
    conn = np.take_along_axis(tets, order, axis=1) + first_point
    dN = np.take_along_axis(dN, order[:, None, :, None], axis=2)
    own = element.pressure_nodes(tets)
    nodes, number = np.unique(own, return_inverse=True)
    number = number.reshape(own.shape)
    order = np.argsort(number, axis=1)
    term = SolidTerm(
        name=name,
        law=law,
        compiled=compile_law(law),
        conn=conn,
        dN=np.ascontiguousarray(dN),
        w=w,
        pressure_conn=np.take_along_axis(number, order, axis=1) + first_pressure,
        N_p=np.ascontiguousarray(np.swapaxes(element.pressure_functions().T[order], 1, 2)),
    )
    return term, nodes
