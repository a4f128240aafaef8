"""The surfaces of the robot that can touch: the skins of its bodies, and the wires of its rods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.ring import across, ring_points
from softcal.geometry.surface import edges_of
from softcal.mechanics.contact import ContactTerm
from softcal.mechanics.contact_kernels import distances
from softcal.mechanics.contact_stiffness import ContactStiffness
from softcal.mechanics.layout import FIXED, Layout
from softcal.mechanics.wire_contact import WireContactTerm, passes_through
from softcal.twin.barrier import Contact, edge_lengths, wire_diameter
from softcal.twin.cores import CoredSkin, body_skin, columns, joined, numbers, pressing, rigid_skin
from softcal.twin.robot import Disc, Robot, Rod

NEIGHBOURS = 4.0  # wire diameters along a rod within which it does not touch itself
RIM = 32  # straight pieces of a disc's rim
DISC_POINTS = 2 + 2 * RIM  # of a disc's skin
SEAM = 2.0  # longest edges around a tied node within which the bodies it joins do not touch each other
FACING = 0.3  # least cosine between a normal and the other's opposite, of surfaces near at rest that may touch
WIRES = 1.0 / 80.0  # of the surfaces' stiffness: that of the barrier between wires
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
    robot: Robot, layout: Layout, meshes: dict[str, TetMesh], first: dict[str, int], drawn: Mapping[str, TetMesh]
) -> tuple[ContactTerm | WireContactTerm, ...]:
    """The contact of all bodies and discs with each other and themselves, of all rods of one diameter with each other
    and themselves, and of these with the discs.

    Parameters
    ----------
    robot
        The robot.
    layout
        Numbering of points, frames and unknowns.
    meshes
        Body -> the mesh of its elements [m].
    first
        The first point of each body, of each rod, and of the skin of each plate with a disc.
    drawn
        Body -> its mesh before shapes were changed [m].

    Raises
    ------
    MeshError
        Where surfaces pass through each other at rest.
    """
    if (contact := robot.fitted_contact) is None:
        return ()
    terms: list[ContactTerm | WireContactTerm] = []
    discs = [first[plate.name] + disc_skin(plate.disc)[1] for plate in robot.plates if plate.disc is not None]
    if meshes or discs:
        rigid = {plate.name: rigid_skin(*disc_skin(plate.disc)) for plate in robot.plates if plate.disc is not None}
        skins = {name: body_skin(mesh, drawn[name]) for name, mesh in meshes.items()} | rigid
        skin = joined(skins, first, len(layout.X))
        bonded = bonded_pairs(robot, numbers(skins), skin.X)
        surfaces = pressing_skins(skin, contact, contact.pressure(robot.bodies or robot.rods), layout, bonded)
        if passes_through(surfaces.X[len(surfaces.reach) :], skin.triangles, bonded):
            raise MeshError(Fault("surfaces pass through each other at rest", where="contact"))
        terms.append(surfaces)
    stiffness = contact.pressure(robot.rods)
    for diameter in sorted({wire_diameter(rod) for rod in robot.rods}):
        rods = [rod for rod in robot.rods if wire_diameter(rod) == diameter]
        wires = np.concatenate([first[r.name] + np.arange(len(r.centreline.nodes) - 1)[:, None] + [0, 1] for r in rods])
        # Nodes that are near each other along a rod, or near the plate that two rods are clamped to, never touch.
        near, apart = NEIGHBOURS * diameter, [NO_PAIRS]
        for rod in rods:
            s = rod.centreline.stations
            i, j = np.triu_indices(len(s), 1)
            is_near = s[j] - s[i] < near
            apart.append(first[rod.name] + np.stack([i[is_near], j[is_near]], axis=1))
        for a, b in combinations(rods, 2):
            for plate in a.clamped.keys() & b.clamped.keys():
                ends = [first[rod.name] + _around(rod, rod.clamped[plate], near) for rod in (a, b)]
                apart.append(_each_with_each(*ends))
        none = np.zeros((0, 3), dtype=np.int64)
        terms.append(_wires(contact, stiffness, layout, wires, none, diameter, np.concatenate(apart)))
        if discs:
            faces = np.concatenate(discs)
            apart = [NO_PAIRS]
            for rod in rods:
                for plate in robot.plates:
                    if plate.disc is not None and plate.name in rod.clamped:
                        nodes = first[rod.name] + _around(rod, rod.clamped[plate.name], near)
                        apart.append(_each_with_each(nodes, first[plate.name] + np.arange(DISC_POINTS)))
            edges = np.concatenate([wires, edges_of(faces)])
            term = _wires(contact, stiffness, layout, edges, faces, 0.5 * diameter, np.concatenate(apart))
            # Contact between discs, and between wires, is in other terms.
            terms.append(replace(term, patch=np.isin(term.points, faces).astype(np.int64)))
    return tuple(terms)


def pressing_skins(
    skin: CoredSkin, contact: Contact, stiffness: ContactStiffness, layout: Layout, bonded: Ints
) -> ContactTerm:
    """The contact of skins by the layout's points: every point on a surface presses, and has a core below it.

    bonded: pairs of the skin's points that do not touch (n, 2).

    Parameters
    ----------
    skin
        The skins.
    contact
        Settings of the contact.
    stiffness
        The contact's stiffness [Pa].
    layout
        Numbering of points, frames and unknowns.
    bonded
        Pairs of the skin's points that do not touch (n, 2).
    """
    import scipy.sparse as sp

    press = pressing(skin, contact.depth)
    n, faces = len(press.base), skin.triangles
    cores = skin.weights + contact.depth * skin.core
    points, weights = columns(sp.vstack([press.weights @ skin.weights, cores], format="csr"))
    # Pressing points, by the skin's point next to each, and vertices of cores never touch each other within a triangle,
    # nor where points of the skin are bonded, both ways.
    size = int(faces.max(initial=-1)) + 1
    edges = edges_of(faces)
    own = np.repeat(np.arange(size), 2).reshape(-1, 2)
    each = np.concatenate([own, edges, edges[:, ::-1], bonded, bonded[:, ::-1]])
    of_skin = sp.csr_matrix((np.ones(len(each)), (each[:, 0], each[:, 1])), shape=(size, size))
    of_points = of_skin[press.base].tocoo()
    term = ContactTerm(
        points=points,
        weights=weights,
        X=weights @ layout.X[points],
        area=press.area,
        faces=n + faces,
        reach=np.full(n, contact.depth),
        depth=contact.depth,
        stiffness=stiffness,
        apart=np.stack([of_points.row, of_points.col + n], axis=1),
        group=rigid_groups(weights, moving_together(layout, points)),
        friction_coefficient=contact.friction_coefficient,
        creep=contact.creep,
    )
    return _from_where_it_is(term, press.normals, skin.X)


def rigid_groups(weights: Any, group: Ints) -> Ints:
    """The group of each weighted sum of points of one group; -1 for a sum of several."""
    of = group[weights.indices]
    low, high = (pick.reduceat(of, weights.indptr[:-1]) for pick in (np.minimum, np.maximum))
    return np.where(low == high, low, -1)


def _from_where_it_is(term: ContactTerm, normals: Floats, skin: Floats) -> ContactTerm:
    """The term without contact at rest: where a core in front of a point is less than `depth` below its surface, as in
    the root of a groove, this distance replaces `depth`. A point never touches cores beside or behind it.

    normals: outward normals (n, 3) of the pressing points; skin: surface points (m, 3) [m] above the cores' vertices.
    """
    near = term.touching(term.X)
    flat = near.simplices[:, 2] >= 0
    points, faces = near.points[flat], near.simplices[flat]
    d = distances(term.X, points, faces)
    close = d < term.depth
    points, faces, d = points[close], faces[close], d[close]
    reach, surface = term.reach.copy(), np.concatenate([term.X[: len(term.reach)], skin])
    # Of the cores' triangles and of the surface's: the unit normals, and the heights of the points above the planes.
    a, b, c = (np.stack([term.X, surface])[:, faces[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    across /= np.linalg.norm(across, axis=2, keepdims=True)
    height, over = np.einsum("smi,smi->sm", across, term.X[points] - a)
    facing = np.einsum("mi,mi->m", across[0], normals[points]) < -FACING
    # How far the point is in front of the surface above the core. Where it is above the core's triangle, from the plane
    # of the surface's: at a sharp edge that is larger, and the point may be beside it.
    above = np.isclose(np.abs(height), d, rtol=1e-9, atol=0.0)
    before = np.where(above, over, distances(surface, points, faces))
    np.minimum.at(reach, points[facing], np.clip(d - before, 0.0, d)[facing])
    beside = np.column_stack([np.repeat(points[~facing], 3), faces[~facing].ravel()])
    return replace(term, reach=reach, apart=np.concatenate([term.apart, beside]))


def _wires(
    contact: Contact,
    stiffness: ContactStiffness,
    layout: Layout,
    edges: Ints,
    faces: Ints,
    thickness: float,
    apart: Ints,
) -> WireContactTerm:
    """The contact of rods with each other, or with discs; wires that are near at rest push from where they are."""
    points = np.unique(np.concatenate([edges.ravel(), faces.ravel()]))
    term = WireContactTerm(
        points=points,
        X=layout.X[points],
        edges=np.searchsorted(points, edges),
        faces=np.searchsorted(points, faces),
        gap=contact.gap,
        thickness=thickness,
        stiffness=replace(stiffness, factor=WIRES * stiffness.factor),
        apart=np.sort(np.searchsorted(points, apart), axis=1),
        patch=moving_together(layout, points),
        friction_coefficient=contact.friction_coefficient,
        creep=contact.creep,
    )
    distance = term.smallest_distance(layout.X)
    if distance <= 0.0:
        raise MeshError(
            Fault(
                "wires of rods pass through each other, or through a disc, at rest",
                where="contact",
                got=f"a distance of {1e3 * (distance + thickness):.4g} mm from their axes",
                allowed=f"more than {1e3 * thickness:.4g} mm",
            )
        )
    return replace(term, gap=min(term.gap, distance))


def moving_together(layout: Layout, points: Ints) -> Ints:
    """Patches of points without relative motion: the followers of a frame, or all that is fixed; else -1."""
    rider = layout.rider[points]
    return np.where(rider == FIXED, layout.n_frames, np.maximum(rider, -1))


def _around(rod: Rod, nodes: Ints, distance: float) -> Ints:
    """The nodes of a rod less than a distance [m] away, along it, from some of them."""
    s = rod.centreline.stations
    return np.flatnonzero(np.abs(s[:, None] - s[nodes]).min(axis=1) < distance)


def bonded_pairs(robot: Robot, on_skin: dict[str, Ints], X: Floats) -> Ints:
    """Pairs (n, 2) of points of skins that are bonded, and do not touch: of tied bodies close to their bond, and of a
    disc and the bodies that its plate is tied to.

    Parameters
    ----------
    robot
        The robot.
    on_skin
        Body or disc -> the numbers of its points.
    X
        Points of the skins (n, 3) [m].
    """
    from scipy.spatial import KDTree

    meshes = {body.name: body.mesh for body in robot.bodies}
    pairs = [NO_PAIRS]
    for tie in robot.ties:
        edge = max(float(edge_lengths(meshes[name]).max()) for name in (tie.body, tie.on))
        seam = KDTree(meshes[tie.body].points[tie.nodes])
        near = [on_skin[name][seam.query(X[on_skin[name]])[0] < SEAM * edge] for name in (tie.body, tie.on)]
        pairs.append(_each_with_each(*near))
    for plate in robot.plates:
        if plate.disc is not None and plate.name in on_skin:
            pairs += [_each_with_each(on_skin[plate.name], on_skin[body]) for body in plate.nodes]
    return np.concatenate(pairs)


def _each_with_each(a: Ints, b: Ints) -> Ints:
    """All pairs (n, 2) of one of `a` and one of `b`."""
    i, j = np.meshgrid(a, b)
    return np.stack([i.ravel(), j.ravel()], axis=1)
