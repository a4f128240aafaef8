"""The surfaces of the robot that can touch: the skins of its bodies, and the wires of its rods."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.ring import across, ring_points
from softcal.geometry.surface import boundary_triangles, edges_of
from softcal.mechanics.contact import ContactTerm
from softcal.mechanics.layout import FIXED, Layout
from softcal.twin.barrier import Contact, edge_lengths, wire_diameter
from softcal.twin.robot import Disc, Plate, Robot, Rod

NEIGHBOURS = 4.0  # wire diameters along a rod within which it does not touch itself
RIM = 32  # straight pieces of a disc's rim
DISC_POINTS = 2 + 2 * RIM  # of a disc's skin
SEAM = 2.0  # longest edges around a tied node within which the bodies it joins do not touch each other
NO_PAIRS: Ints = np.zeros((0, 2), dtype=np.int64)


def disc_skin(disc: Disc) -> tuple[Floats, Ints]:
    """Points (n, 3) [m] and outward triangles of a disc's skin; its holes are filled, its rim has straight pieces."""
    rim = ring_points(np.zeros(3), disc.axis, across(disc.axis), 0.5 * disc.diameter, RIM)
    up = 0.5 * disc.thickness * disc.axis
    points = disc.centre + np.concatenate([[up, -up], rim + up, rim - up])
    i, j = np.arange(RIM), np.roll(np.arange(RIM), -1)
    top, bottom, zero = 2 + i, 2 + RIM + i, np.zeros(RIM, dtype=np.int64)
    faces = [(zero, top, 2 + j), (zero + 1, 2 + RIM + j, bottom), (bottom, 2 + RIM + j, top), (top, 2 + RIM + j, 2 + j)]
    return points, np.concatenate([np.stack(face, axis=1) for face in faces])


def build_contacts(
    robot: Robot, layout: Layout, meshes: dict[str, TetMesh], first: dict[str, int]
) -> tuple[ContactTerm, ...]:
    """The contact of all bodies and discs with each other, of all rods of one diameter with each other and themselves,
    and of these with the discs.

    first: the first point of each body, of each rod, and of the skin of each plate with a disc.

    Raises
    ------
    MeshError
        Where surfaces pass through each other at rest.
    """
    if robot.contact is None:
        return ()
    terms: list[ContactTerm] = []
    discs = [first[plate.name] + disc_skin(plate.disc)[1] for plate in robot.plates if plate.disc is not None]
    skins = {name: first[name] + boundary_triangles(mesh.tets) for name, mesh in meshes.items()}
    if skins or discs:
        faces = np.concatenate([*skins.values(), *discs])
        on_skin = {name: np.unique(triangles) for name, triangles in skins.items()}
        apart = [across_seams(robot, layout, meshes, on_skin)]
        apart += [_on_plate(plate, first, on_skin) for plate in robot.plates if plate.disc is not None]
        terms.append(_term(robot.contact, layout, edges_of(faces), faces, 0.0, np.concatenate(apart)))
    for diameter in sorted({wire_diameter(rod) for rod in robot.rods}):
        rods = [rod for rod in robot.rods if wire_diameter(rod) == diameter]
        wires = np.concatenate([first[r.name] + np.arange(len(r.centreline.nodes) - 1)[:, None] + [0, 1] for r in rods])
        apart = [first[r.name] + _neighbours(r, NEIGHBOURS * diameter) for r in rods]
        apart.append(_around_plates(rods, first, NEIGHBOURS * diameter))
        none = np.zeros((0, 3), dtype=np.int64)
        terms.append(_term(robot.contact, layout, wires, none, diameter, np.concatenate(apart)))
        if discs:
            faces = np.concatenate(discs)
            near = [_ends_on_disc(rod, plate, first, NEIGHBOURS * diameter) for rod in rods for plate in robot.plates]
            edges = np.concatenate([wires, edges_of(faces)])
            term = _term(robot.contact, layout, edges, faces, 0.5 * diameter, np.concatenate(near))
            # Contact between discs, and between wires, is in other terms.
            terms.append(replace(term, patch=np.isin(term.points, faces).astype(np.int64)))
    for term in terms:
        _check_apart(term, layout)
    return tuple(terms)


def _check_apart(term: ContactTerm, layout: Layout) -> None:
    if len(term.faces) and term.crosses(layout.X):
        raise MeshError(Fault("surfaces pass through each other at rest", where="contact"))
    distance = term.smallest_distance(layout.X)
    if distance <= 0.0:
        raise MeshError(
            Fault(
                "wires of rods pass through each other, or through a disc, at rest",
                where="contact",
                got=f"a distance of {1e3 * (distance + term.thickness):.4g} mm from their axes",
                allowed=f"more than {1e3 * term.thickness:.4g} mm",
            )
        )


def _term(contact: Contact, layout: Layout, edges: Ints, faces: Ints, thickness: float, apart: Ints) -> ContactTerm:
    points = np.unique(np.concatenate([edges.ravel(), faces.ravel()]))
    return ContactTerm(
        points=points,
        X=layout.X[points],
        edges=np.searchsorted(points, edges),
        faces=np.searchsorted(points, faces),
        gap=contact.gap,
        thickness=thickness,
        stiffness=contact.stiffness,
        apart=np.sort(np.searchsorted(points, apart), axis=1),
        patch=moving_together(layout, points),
        friction_coefficient=contact.friction_coefficient,
        creep=contact.creep,
    )


def moving_together(layout: Layout, points: Ints) -> Ints:
    """Patches of points without relative motion: the followers of a frame, or all that is fixed; else -1."""
    rider = layout.rider[points]
    return np.where(rider == FIXED, layout.n_frames, np.maximum(rider, -1))


def _neighbours(rod: Rod, distance: float) -> Ints:
    """Pairs of nodes of a rod less than a distance apart along it."""
    s = rod.centreline.stations
    i, j = np.triu_indices(len(s), 1)
    near = s[j] - s[i] < distance
    return np.stack([i[near], j[near]], axis=1)


def _around_plates(rods: list[Rod], first: dict[str, int], distance: float) -> Ints:
    """Pairs of nodes of two rods that are clamped to one plate, both near it along their rods."""
    pairs = [NO_PAIRS]
    for a, b in combinations(rods, 2):
        for plate in a.clamped.keys() & b.clamped.keys():
            near = [first[rod.name] + _around(rod, rod.clamped[plate], distance) for rod in (a, b)]
            pairs.append(_each_with_each(*near))
    return np.concatenate(pairs)


def _on_plate(plate: Plate, first: dict[str, int], on_skin: dict[str, Ints]) -> Ints:
    """Pairs of a disc's points and those of the bodies that its plate is tied to: they are bonded."""
    disc = first[plate.name] + np.arange(DISC_POINTS)
    return np.concatenate([NO_PAIRS, *(_each_with_each(disc, on_skin[body]) for body in plate.nodes)])


def _ends_on_disc(rod: Rod, plate: Plate, first: dict[str, int], distance: float) -> Ints:
    """Pairs of a disc's points and the nodes near those that a rod is clamped with to its plate."""
    if plate.disc is None or plate.name not in rod.clamped:
        return NO_PAIRS
    nodes = first[rod.name] + _around(rod, rod.clamped[plate.name], distance)
    return _each_with_each(nodes, first[plate.name] + np.arange(DISC_POINTS))


def _around(rod: Rod, nodes: Ints, distance: float) -> Ints:
    """The nodes of a rod less than a distance away from given ones along it."""
    s = rod.centreline.stations
    return np.flatnonzero(np.abs(s[:, None] - s[nodes]).min(axis=1) < distance)


def across_seams(robot: Robot, layout: Layout, meshes: dict[str, TetMesh], on_skin: dict[str, Ints]) -> Ints:
    """Pairs of points of tied bodies close to their bond: bonded parts do not touch."""
    from scipy.spatial import KDTree

    given = {body.name: body.mesh for body in robot.bodies}  # the ties number these
    pairs = [NO_PAIRS]
    for tie in robot.ties:
        sides = [on_skin[name] for name in (tie.body, tie.on)]
        edge = max(float(edge_lengths(meshes[name]).max()) for name in (tie.body, tie.on))
        seam = KDTree(given[tie.body].points[tie.nodes])
        near = [side[seam.query(layout.X[side])[0] < SEAM * edge] for side in sides]
        pairs.append(_each_with_each(*near))
    return np.concatenate(pairs)


def _each_with_each(a: Ints, b: Ints) -> Ints:
    """All pairs (n, 2) of one of `a` and one of `b`."""
    i, j = np.meshgrid(a, b)
    return np.stack([i.ravel(), j.ravel()], axis=1)
