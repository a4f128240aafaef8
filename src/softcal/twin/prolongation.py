"""States of a twin as states of the same robot on a finer mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.state import State
from softcal.twin.build import Twin


@dataclass(frozen=True)
class InElements:
    """Places of the nodes (n,) of a finer mesh: numbers of the coarse tets (n,), barycentric coordinates (n, 4)."""

    tets: Ints
    barycentric: Floats


@dataclass(frozen=True)
class Prolongation:
    """From the states of a twin without rods to those of a finer one: displacements and pressures are interpolated.

    places: body -> where the nodes of its finer mesh lie.
    """

    coarse: Twin
    fine: Twin
    places: Mapping[str, InElements]

    def __call__(self, state: State) -> State:
        """The finer twin's state."""
        layout = self.fine.system.layout
        x = layout.X.copy()
        for body, at in self.places.items():
            mesh, first = self.coarse.meshes[body], self.coarse.first_point[body]
            moved = state.x[first : first + mesh.n_points] - mesh.points
            own = slice(self.fine.first_point[body], self.fine.first_point[body] + len(at.tets))
            x[own] += np.einsum("pn,pni->pi", mesh.cell.functions(at.barycentric), moved[mesh.tets[at.tets]])
        layout.links.place(x, state.position, state.rotation)
        # Pressures are linear in each tet; zero where the coarse elements have none.
        pressure = np.zeros(layout.n_pressures)
        for material, (first, body, nodes) in self.fine.pressure_nodes.items():
            if material not in self.coarse.pressure_nodes:
                continue
            first_coarse, _, own = self.coarse.pressure_nodes[material]
            mesh, at = self.coarse.meshes[body], self.places[body]
            nodal = np.zeros(mesh.n_points)
            nodal[own] = state.pressure[first_coarse : first_coarse + len(own)]
            corners = nodal[mesh.tets[at.tets[nodes], :4]]
            pressure[first : first + len(nodes)] = np.einsum("pk,pk->p", at.barycentric[nodes], corners)
        return State(x, state.position, state.rotation, pressure, state.effort)


def prolongation(coarse: Twin, fine: Twin, corners: Mapping[str, Floats]) -> Prolongation:
    """The prolongation from a twin to one on a refined mesh.

    Parameters
    ----------
    coarse, fine
        The twins.
    corners
        Body -> barycentric coordinates (n_tets, 4, 4) [-] of the corners of each of its finer tets in the coarse tet
        that it is a piece of; the pieces of each coarse tet follow those of the tet before.
    """
    places: dict[str, InElements] = {}
    for body, of_tets in corners.items():
        mesh = fine.meshes[body]
        pieces = mesh.n_tets // coarse.meshes[body].n_tets
        _, first = np.unique(mesh.tets, return_index=True)
        tets, nodes = np.divmod(first, mesh.cell.n_nodes)
        coordinates = np.einsum("pk,pkj->pj", mesh.cell.nodes[nodes], of_tets[tets])
        places[body] = InElements(tets // pieces, coordinates)
    return Prolongation(coarse, fine, places)
