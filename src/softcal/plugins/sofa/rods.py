"""Rods in SOFA's scene: Rigid3 nodes, and two-node beams with softcal's stiffness matrices.

SOFA's BeamFEMForceField has straight beams of round section, without shear. Its stiffness matrices can be replaced, and
its formulation suits any element: the displacement of one end relative to the other, times the matrix. The scene sets
the matrices of softcal's elements at rest: pre-curved, of any section, with shear. Each element is in the scene twice,
in the frame of either end and with half its stiffness: the errors of the two frames, of first order in the element's
rotation, cancel.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from softcal.checks import Floats, Ints
from softcal.geometry.centreline import Centreline
from softcal.mechanics.rod import RodTerm, build_rod
from softcal.twin.robot import Rod

SEGMENTS = 3  # beams of the scene for each of softcal's elements
SAME_MASS = 1e-9  # relative difference up to which nodes share a mass component
SAME_KIND = 1e-10  # of the largest entry: difference up to which elements share a flexibility
FLEXIBILITY_OF = (0.0, 1.0)  # two values of Poisson's ratio: the flexibility is linear in it


def linear_rod(rod: Rod, still: Collection[str]) -> Rod:
    """The rod with its nodes on fixed plates fixed in space."""
    on_still = [nodes for plate, nodes in rod.clamped.items() if plate in still]
    return replace(
        rod,
        clamped={plate: nodes for plate, nodes in rod.clamped.items() if plate not in still},
        fixed=np.sort(np.concatenate([rod.fixed, *on_still])),
    )


def rod_parameters(rod: Rod, density: float) -> dict[str, Any]:
    """Entries of parameters.json for a refined rod: nodes, their attachments, and flexibilities of its elements.

    flexibilities: of every kind of element by_bending and by_shear (6, 6); (by_bending + (1 + nu) by_shear) / E is the
    displacement and rotation of the later end relative to the earlier one per force and moment at the later one, in the
    axes of the section at the earlier end. kinds: the kind of every element; axes: those axes at rest, as quaternions.
    """
    rod = finer(rod, SEGMENTS)
    # Flexibility of every kind of element, and the kind of each element; all elements of a helix are of one kind.
    nodes, term = np.array(rod.centreline.nodes), _on_own_nodes(rod)
    axes = np.tile(np.eye(3), (len(nodes), 1, 1))
    found: list[Floats] = []
    for ratio in FLEXIBILITY_OF:
        tangent = term.assemble(nodes, axes, {"youngs_modulus": 1.0, "poissons_ratio": ratio}).tangent
        found.append(np.asarray(np.linalg.inv(tangent[:, 6:, 6:]), dtype=np.float64))
    turn = np.kron(np.eye(2), rod.centreline.triads[:-1])
    shear = np.swapaxes(turn, 1, 2) @ (found[1] - found[0]) @ turn
    bending = np.swapaxes(turn, 1, 2) @ found[0] @ turn - shear
    length = np.repeat([1.0, float(rod.centreline.lengths.mean())], 3)  # scales moments and rotations
    values = np.stack([bending, shear], axis=1) * length[:, None] * length
    apart = SAME_KIND * float(np.abs(values).max())
    firsts: list[int] = []
    kinds: list[int] = []
    for one in values:
        kind = next((k for k, i in enumerate(firsts) if np.abs(values[i] - one).max() <= apart), len(firsts))
        if kind == len(firsts):
            firsts.append(len(kinds))
        kinds.append(kind)
    flexibilities = [{"by_bending": bending[i].tolist(), "by_shear": shear[i].tolist()} for i in firsts]
    masses = density * node_volumes(rod)
    section = rod.section.constants
    inertia = (section.I1 + section.I2) / section.area
    groups: list[dict[str, Any]] = []
    for node in np.argsort(-masses, kind="stable").tolist():
        mass = float(masses[node])
        if not groups or mass < (1.0 - SAME_MASS) * groups[-1]["mass"]:
            groups.append({"mass": mass, "inertia_per_mass": inertia, "nodes": []})
        groups[-1]["nodes"].append(node)
    return {
        "segments": SEGMENTS,
        "nodes": rod.centreline.nodes.tolist(),
        "youngs_modulus": rod.parameters["youngs_modulus"],
        "poissons_ratio": rod.parameters["poissons_ratio"],
        "radius": 0.5 * rod.section.constants.outer_diameter,
        "flexibilities": flexibilities,
        "kinds": kinds,
        "axes": Rotation.from_matrix(rod.centreline.triads[:-1]).as_quat().tolist(),
        "fixed": rod.fixed.tolist(),
        "plates": {name: nodes.tolist() for name, nodes in rod.clamped.items()},
        "masses": groups,
    }


def finer(rod: Rod, segments: int) -> Rod:
    """The rod with every element divided equally along the screw motion of softcal's element at rest."""
    line = rod.centreline
    xi = _on_own_nodes(rod).xi_rest
    pieces: list[tuple[Floats, Floats]] = []
    for k in range(segments):
        part = k / segments
        # The translation (n, 3) by that part of each screw, in its initial axes.
        out = np.zeros_like(xi[:, :3])
        for i, (rho, theta) in enumerate(zip(xi[:, :3], xi[:, 3:], strict=True)):
            twist = np.zeros((4, 4))
            twist[:3, :3] = np.cross(np.eye(3), theta)
            twist[:3, 3] = rho
            out[i] = expm(part * twist)[:3, 3]
        nodes = line.nodes[:-1] + np.einsum("nij,nj->ni", line.triads[:-1], out)
        pieces.append((nodes, line.triads[:-1] @ Rotation.from_rotvec(part * xi[:, 3:]).as_matrix()))
    nodes = np.stack([nodes for nodes, _ in pieces], axis=1).reshape(-1, 3)
    triads = np.stack([triads for _, triads in pieces], axis=1).reshape(-1, 3, 3)
    cut = Centreline(
        np.vstack([nodes, line.nodes[-1:]]),
        np.concatenate([triads, line.triads[-1:]]),
        np.repeat(line.lengths / segments, segments),
    )
    clamped = {plate: _with_between(nodes, segments) for plate, nodes in rod.clamped.items()}
    return replace(rod, centreline=cut, clamped=clamped, fixed=_with_between(rod.fixed, segments))


def _with_between(nodes: Ints, segments: int) -> Ints:
    """Node numbers in the refined rod, including nodes between two neighbours of the list."""
    held = segments * np.sort(nodes)
    between = [at + np.arange(1, segments) for at in held if at + segments in held]
    return np.sort(np.concatenate([held, *between]))


def node_volumes(rod: Rod) -> Floats:
    """Volume of the rod per node (m,) [m^3]: half of the adjacent elements."""
    half = 0.5 * rod.section.constants.area * rod.centreline.lengths
    return np.append(half, 0.0) + np.insert(half, 0, 0.0)


def _on_own_nodes(rod: Rod) -> RodTerm:
    nodes = rod.centreline.nodes
    return build_rod(rod.name, rod.section, rod.centreline, np.arange(len(nodes)), nodes)
