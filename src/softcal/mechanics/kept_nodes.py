"""Nodes of load paths, kept for further simulations at the same parameters.

A search, a grid or a second test comes back to the same parameters with other samples. A node depends on the nodes
before it and not on the samples, so that with kept nodes a path is the same to the last digit. Their factorisations
count again, as part of the path's work.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from softcal.mechanics.node import Node

ROOM = 256e6  # [bytes] of all nodes of one twin


class KeptNode(NamedTuple):
    """A node, the length of the step that follows it, and the number of factorisations that it took."""

    node: Node
    next_step: float
    n_factorisations: int

    @property
    def size(self) -> int:
        """The size of its arrays [bytes]."""
        node, state = self.node, self.node.state
        arrays = (state.x, state.pressure, node.slope, node.by_parameter, node.mixed, node.free)
        return sum(array.nbytes for array in arrays)


class KeptNodes:
    """The nodes at one theta, by what each depends on and the parameters of its derivatives.

    in_vain: keys of attempts that failed, with their numbers of factorisations; shared_end: c where a path that was to
    serve others too ended early; none is followed beyond for their sake.
    """

    def __init__(self) -> None:
        self._kept: dict[Hashable, dict[tuple[str, ...], KeptNode]] = {}
        self.size = 0
        self.in_vain: dict[Hashable, int] = {}
        self.shared_end = math.inf

    def get(self, key: Hashable, names: tuple[str, ...]) -> KeptNode | None:
        """A node by its key, with derivatives by the parameters `names` (k,)."""
        each = self._kept.get(key, {})
        if names in each:
            return each[names]
        own = next((own for own in each if set(names) <= set(own)), None)
        return None if own is None else each[own]._replace(node=each[own].node.by([own.index(name) for name in names]))

    def keep(self, key: Hashable, names: tuple[str, ...], kept: KeptNode) -> None:
        """Keep a node by its key.

        Parameters
        ----------
        key
            What the node depends on.
        names
            Parameters (k,) by dotted name.
        kept
            The node.
        """
        self._kept.setdefault(key, {})[names] = kept
        self.size += kept.size


class KeptPaths:
    """The kept nodes of a twin at each theta, the least recent of which are dropped where they need too much room."""

    def __init__(self, room: float = ROOM) -> None:
        self.room = room
        self._at: dict[Hashable, KeptNodes] = {}

    def at(self, theta: Mapping[str, float]) -> KeptNodes:
        """The nodes at theta."""
        key = tuple(sorted(theta.items()))
        nodes = self._at.pop(key, None) or KeptNodes()
        while self._at and nodes.size + sum(other.size for other in self._at.values()) > self.room:
            self._at.pop(next(iter(self._at)), None)
        self._at[key] = nodes
        return nodes
