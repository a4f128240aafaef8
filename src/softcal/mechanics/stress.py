"""Stress and strain in a solid, as means over its elements."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from softcal.checks import Floats
from softcal.geometry.mesh import TetMesh
from softcal.materials.components import NO_DIRECTIONS, full
from softcal.materials.law import Law, compile_law, stacked
from softcal.materials.stress_at import Deformation, Volumetric, points, whole_stress
from softcal.mechanics.element import Element


def deformation_gradients(element: Element, mesh: TetMesh, x: Floats) -> tuple[Floats, Floats]:
    """F (n_tets, n_q, 3, 3) at the quadrature points, and their weights (n_tets, n_q) [m^3].

    Parameters
    ----------
    element
        The element.
    mesh
        The undeformed mesh [m].
    x
        Positions of its nodes (n_points, 3) [m].
    """
    dN, w = element.gradients(mesh.points, mesh.tets)
    return np.einsum("eai,eqak->eqik", x[mesh.tets], dN), w


def cauchy_stress(
    element: Element,
    mesh: TetMesh,
    law: Law,
    theta: Mapping[str, float],
    x: Floats,
    pressure: Floats | None = None,
    directions: Floats = NO_DIRECTIONS,
) -> Floats:
    """The mean Cauchy stress of each tet (n_tets, 3, 3) [Pa].

    Parameters
    ----------
    mesh
        The element's own.
    theta
        The law's own parameters [SI].
    x
        Positions of the nodes (n_points, 3) [m].
    pressure
        For mixed elements, the multiplier p of g(J) at the nodes (n_points,) [Pa], where only those of the element's
        pressure count; for others None.
    directions
        Directions of a law in I4 and I6, as `Points` has them, at the quadrature points of the tets.
    """
    F, w = deformation_gradients(element, mesh, x)
    at = points(F.reshape(-1, 3, 3), directions)
    compiled = compile_law(law)
    values = tuple(theta[name] for name in compiled.parameters)
    if pressure is None:
        stress = whole_stress(compiled, at, values, tangent=False)
    else:
        p = (pressure[element.pressure_nodes(mesh.tets)] @ element.pressure_functions().T).ravel()
        _, dg, ddg = stacked(compiled.strain(at.J), at.J.size)
        stress = Deformation(compiled, at).stress(values, Volumetric(p * dg, p * ddg), tangent=False)
    S = full(stress.S).reshape(F.shape)
    sigma = F @ S @ np.swapaxes(F, 2, 3) / at.J.reshape(w.shape)[..., None, None]
    return np.einsum("eq,eqij->eij", w, sigma) / w.sum(axis=1)[:, None, None]


def green_lagrange_strain(element: Element, mesh: TetMesh, x: Floats) -> Floats:
    """The mean Green-Lagrange strain of each tet (n_tets, 3, 3).

    Parameters
    ----------
    element
        The element.
    mesh
        The undeformed mesh [m].
    x
        Positions of its nodes (n_points, 3) [m].
    """
    F, w = deformation_gradients(element, mesh, x)
    E = 0.5 * (np.einsum("eqki,eqkj->eqij", F, F) - np.eye(3))
    return np.einsum("eq,eqij->eij", w, E) / w.sum(axis=1)[:, None, None]


def von_mises(stress: Floats) -> Floats:
    """The equivalent stress (n,) of stresses (n, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    return np.sqrt(1.5 * np.einsum("eij,eij->e", deviator, deviator))
