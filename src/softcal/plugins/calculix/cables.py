"""Cables in a CalculiX deck: constant-force springs from via point to via point.

The force rotates with the robot, as in softcal, and contributes to CalculiX's tangent. It is controlled by CalculiX's
temperature, on which nothing else depends: at temperature k it is the tension of the k-th shape, at zero it vanishes.

A via point inside an element is a node constrained to the element's nodes. CalculiX has an error of about one per cent
if some of these belong to a rigid body. Cable segments that end in such a point are dead forces instead, updated at
each shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.cable import cables_of
from softcal.plugins.calculix.format import MICRONEWTON, number, place, set_name, weighted_sum
from softcal.plugins.calculix.load_path import positions
from softcal.twin.build import Twin
from softcal.twin.loads import Weights
from softcal.twin.response import Snapshot

FAR = 1e3  # [mm], largest elongation in the table of forces; its last value is extrapolated


@dataclass(frozen=True)
class CableLines:
    """Lines of the deck: nodes of via points inside elements, springs, and constraint equations of those nodes."""

    nodes: tuple[str, ...]
    springs: tuple[str, ...]
    equations: tuple[str, ...]


def cable_lines(twin: Twin, shapes: Sequence[Snapshot], node: int, element: int) -> CableLines:
    """Lines of all cables that are taut in any of the shapes.

    Parameters
    ----------
    twin
        The robot as a system.
    shapes
        Its shapes with the tensions [N] of its cables.
    node, element
        The last numbers in use.
    """
    nodes: list[str] = []
    springs: list[str] = []
    equations: list[str] = []
    for cable in twin.robot.cables:
        name, via = cable.name, twin.routes[cable.name]
        tensions = [shape.efforts.get(name, 0.0) for shape in shapes]
        segments = [(i, i + 1) for i, pair in enumerate(pairwise(via)) if _is_spring(twin, pair)]
        if not any(tensions) or not segments:
            continue
        ends: dict[int, int] = {}
        for i in sorted({i for segment in segments for i in segment}):
            if len(via[i]) == 1:
                ends[i] = via[i][0][0] + 1
                continue
            node += 1
            ends[i] = node
            at = np.sum([weight * twin.system.layout.X[point] for point, weight in via[i]], axis=0)
            nodes.append(f"{node}, {place(at)}")
            equations += weighted_sum(node, [(point + 1, weight) for point, weight in via[i] if weight != 0.0])
        springs.append(f"*ELEMENT, TYPE=SPRINGA, ELSET=CABLE_{set_name(name)}")
        for a, b in segments:
            element += 1
            springs.append(f"{element}, {ends[a]}, {ends[b]}")
        springs.append(f"*SPRING, ELSET=CABLE_{set_name(name)}, NONLINEAR")
        for k, tension in enumerate([0.0, *tensions]):
            pull = number(tension / MICRONEWTON)
            springs += [f"{pull}, {number(stretch)}, {number(k)}" for stretch in (-FAR, FAR)]
    return CableLines(tuple(nodes), tuple(springs), tuple(equations))


def dead_pulls(twin: Twin, shape: Snapshot) -> Floats:
    """Forces at a shape (n_points, 3) [N] of the segments that are not springs."""
    cables, n_points = cables_of(twin.system), twin.system.layout.n_points
    pulls = [
        0.0 if _is_spring(twin, pair) else shape.efforts.get(cable.name, 0.0)
        for cable in twin.robot.cables
        for pair in pairwise(twin.routes[cable.name])
    ]
    if not any(pulls):
        return np.zeros((n_points, 3))
    segments = cables.segments
    gradient = segments.gradient(segments.shape(positions(twin, shape)), np.array(pulls), 3 * n_points)
    return -gradient.reshape(-1, 3)


def _is_spring(twin: Twin, segment: tuple[Weights, Weights]) -> bool:
    """Whether both ends can be nodes: points of the deck, or combinations of nodes of no rigid body."""
    layout = twin.system.layout
    for end in segment:
        riders = layout.rider[[point for point, weight in end if weight != 0.0]]
        if len(end) > 1 and np.any((riders >= 0) & (riders < layout.n_moving_frames)):
            return False
    return True
