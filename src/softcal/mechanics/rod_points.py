"""Points on rods: where they are along the axis, and the two nodes between which they follow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softcal.checks import Floats
from softcal.geometry.centreline import Centreline

AT_NODE = 1e-6  # of an element: a point as near as that to a node's section is on it


class RodPlace(NamedTuple):
    """A point on or beside a rod: its section is between nodes `node` and `node + 1`, at a share of the way."""

    node: int
    share: float

    @property
    def weights(self) -> tuple[tuple[int, float], ...]:
        """The nodes whose sections carry the point, with their weights: of one node, or of both ends of an element.

        A point that follows both rigidly, by shares, errs by the square of the element's length.
        """
        pairs = ((self.node, 1.0 - self.share), (self.node + 1, self.share))
        return tuple((node, weight) for node, weight in pairs if weight > 0.0)


def place_on_rod(centreline: Centreline, point: Floats) -> RodPlace:
    """The section of a rod at rest that is nearest to a point (3,) [m]."""
    nodes = centreline.nodes
    chords = np.diff(nodes, axis=0)
    along = ((point - nodes[:-1]) * chords).sum(axis=1) / (chords**2).sum(axis=1)
    along = np.clip(along, 0.0, 1.0)
    apart = np.linalg.norm(point - nodes[:-1] - along[:, None] * chords, axis=1)
    node = int(np.argmin(apart))
    share = float(along[node])
    share = round(share) if abs(share - round(share)) < AT_NODE else share
    return RodPlace(node, share)
