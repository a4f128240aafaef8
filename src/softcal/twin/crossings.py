"""Sentences on bodies of the robot that pass through themselves or each other along the load path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.crossing import Skins
from softcal.mechanics.layout import Layout
from softcal.mechanics.node import Node
from softcal.mechanics.path import interpolated
from softcal.mechanics.term import Theta
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensors.actuators import SHORTENING
from softcal.twin.barrier import Contact
from softcal.twin.contacts import bonded_pairs, moving_together, pressing_skins, rigid_groups
from softcal.twin.cores import body_skin, columns, joined, numbers
from softcal.twin.robot import Robot
from softcal.units import format_quantity, readable_unit, unit_factor

INSET = 0.02  # of the cores' depth: touching skins do not count as crossing
BISECTIONS = 6
REMEDY = ": set contact: true"
SLIGHT = 1e-3  # of the actuator's work: a contact that changes it by less is no reason to doubt the shapes

Pair = tuple[str, str]


def build_skins(robot: Robot, layout: Layout, meshes: dict[str, TetMesh], first: dict[str, int]) -> Skins | None:
    """The skins that are checked for crossings; None where there is no body, or contact prevents crossings.

    Parameters
    ----------
    robot
        The robot.
    layout
        Numbering of points, frames and unknowns.
    meshes
        Body -> the mesh of its elements [m].
    first
        Part -> the number of its first point.
    """
    if robot.contact is not None or not meshes:
        return None
    contact = Contact().fitted(robot.bodies, (), ())
    skins = {name: body_skin(mesh) for name, mesh in meshes.items()}
    skin = joined(skins, first, len(layout.X))
    points, weights = columns(skin.weights)
    bonded = bonded_pairs(robot, numbers(skins), skin.X)
    touch = pressing_skins(skin, contact, contact.pressure(robot.bodies), layout, bonded)
    begin = np.array([first[name] for name in skins])
    order = np.argsort(begin)

    def owner(points: Ints, weights: Any) -> Ints:
        """The number of the body of each weighted sum of points."""
        own = points[weights.indices[weights.indptr[:-1]]]
        return order[np.searchsorted(begin[order], own, side="right") - 1]

    return Skins(
        points=points,
        weights=weights,
        X=skin.X,
        faces=skin.triangles,
        owner=owner(points, weights),
        names=tuple(skins),
        inset=INSET * contact.depth,
        apart=np.sort(bonded, axis=1),
        patch=rigid_groups(weights, moving_together(layout, points)),
        touch=touch,
        touch_owner=owner(touch.points, touch.weights),
    )


def crossed_on_path(
    skins: Skins | None,
    layout: Layout,
    nodes: Sequence[Node],
    end: float,
    driven: tuple[str, ChannelKind],
    work: Floats,
    theta: Theta,
) -> tuple[str, str]:
    """The sentences on crossings along a path of one actuator's coordinate: on those that are a reason to doubt the
    shapes, and on slight ones.

    Parameters
    ----------
    skins
        The skins; None: nothing is checked.
    layout
        Numbering of points, frames and unknowns.
    nodes
        The nodes of the path.
    end
        Coordinate up to which crossings count [SI].
    driven
        Name of the actuator, and the kind of its coordinate.
    work
        Work of the actuator up to each node (n,) [J].
    theta
        Parameter values by dotted name [SI].
    """
    if skins is None:
        return "", ""
    crossing = [skins.pairs(node.state.x) for node in nodes]
    doubts: list[str] = []
    slight: list[str] = []
    for pair in sorted({pair for one in crossing for pair in one}):

        def crosses(a: Node, b: Node, c: float, pair: Pair = pair) -> bool:
            return pair in skins.pairs(interpolated(layout, a, b, c).x)

        spans = [
            span_in_words(begin if begin > nodes[0].c else None, stop, *driven)
            for begin, stop in _spans(nodes, [pair in one for one in crossing], crosses)
            if begin <= end
        ]
        if len(nodes) == 1 and spans:
            spans = ["under the loads"]
        if spans:
            at = [i for i, one in enumerate(crossing) if pair in one]
            i = at[-1]
            beyond = nodes[i].c > end and i > 0
            shape = interpolated(layout, nodes[i - 1], nodes[i], end) if beyond else nodes[i].state
            where, depth = " and ".join(spans), skins.crossings(shape.x).get(pair, 0.0)
            # At its coordinate, contact raises the robot's least energy by at most what it stores in this shape. Parts
            # deep inside each other, or between the points that press, store less than they should.
            presses = all(0.0 < skins.overlaps(nodes[k].state.x).get(pair, 0.0) < skins.touch.depth for k in at)
            if presses and all(skins.touch.stored(nodes[k].state.x, theta) < SLIGHT * work[k] for k in at):
                changes = f", where contact would change the work of {driven[0]} by less than {100 * SLIGHT:g} %"
                slight.append(_sentence(pair, where, depth, changes))
            else:
                doubts.append(_sentence(pair, where, depth))
    return "".join(doubts), "".join(slight)


def span_in_words(begin: float | None, stop: float | None, name: str, kind: ChannelKind = SHORTENING) -> str:
    """The range of a driven coordinate with a crossing, in words.

    Parameters
    ----------
    begin, stop
        Its ends [SI]; None: from the start, and to the end.
    name, kind
        Of the actuator, and of its coordinate.
    """
    unit = path_unit(kind, stop or begin or 0.0)
    factor, of = unit_factor(unit, kind.unit), f" {unit} of {kind.name} of {name}"
    if begin is None:
        return "from the start on" if stop is None else f"from the start to {stop / factor:.3g}{of}"
    return f"from {begin / factor:.3g}" + (f"{of} on" if stop is None else f" to {stop / factor:.3g}{of}")


def path_unit(kind: ChannelKind, value: float) -> str:
    """The unit in which a place on a load path is stated: millimetres of a length, else what suits the value [SI]."""
    return "mm" if kind.unit == "m" else readable_unit(value, kind.unit)


def _spans(
    nodes: Sequence[Node], crosses: Sequence[bool], between: Callable[[Node, Node, float], bool]
) -> list[tuple[float, float | None]]:
    """Ranges of the control with the crossing (end None: to the end), their ends located between two nodes."""
    spans: list[tuple[float, float | None]] = []
    begin = nodes[0].c
    for i, node in enumerate(nodes):
        before = crosses[i - 1] if i else False
        if crosses[i] and not before:
            begin = _change(nodes[i - 1], node, between, crosses[i]) if i else node.c
        if before and not crosses[i]:
            spans.append((begin, _change(nodes[i - 1], node, between, crosses[i])))
    return [*spans, (begin, None)] if crosses[-1] else spans


def _change(a: Node, b: Node, crosses: Callable[[Node, Node, float], bool], at_b: bool) -> float:
    """The control between two nodes at which the crossing begins or ends; at a snap-through, that of the node
    after it.
    """
    low, high = a.c, b.c
    for _ in range(0 if b.is_snapped else BISECTIONS):
        middle = 0.5 * (low + high)
        if crosses(a, b, middle) == at_b:
            high = middle
        else:
            low = middle
    return high if at_b else low


def crossed_at(found: Sequence[tuple[str, dict[Pair, float]]]) -> str:
    """The sentences on intersecting pairs of parts, with the labels of their states."""
    sentences: list[str] = []
    for pair in sorted({pair for _, one in found for pair in one}):
        labels = [label for label, one in found if pair in one]
        later = f" and {len(labels) - 1} more" if len(labels) > 1 else ""
        sentences.append(_sentence(pair, f"at {labels[0]}{later}", max(one.get(pair, 0.0) for _, one in found)))
    return "".join(sentences)


def _sentence(pair: Pair, where: str, depth: float, end: str = REMEDY) -> str:
    what = f"{pair[0]} intersects itself" if pair[0] == pair[1] else f"{pair[0]} and {pair[1]} intersect"
    how_deep = f", by about {format_quantity(depth, 'm', digits=2)}" if depth > 0.0 else ""
    return f" {what} {where}{how_deep}{end}."
