"""Pairs of points and triangles that may touch, kept while no vertex has moved far (a Verlet list)."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.contact_kernels import NEAREST, Meeting, distances, near


class NearPairs:
    """Candidate pairs: all that touch at some positions of the vertices, or may meet between two positions. Which other
    pairs are among them depends on the positions of the last search, and has no effect.

    Pairs are searched for anew where a vertex is further than `slack` [m] from where it was. Within that, distances
    change by up to twice the slack, and pairs that are not kept

    - do not touch, since they were further apart than the reach (n_points,) [m] and twice the slack;
    - do not meet, nor come as near as to stop a step (`free_part`), since (d - 2 slack) > NEAREST (d + 2 slack).
    """

    def __init__(self, meeting: Meeting, reach: Floats, slack: float) -> None:
        self._meeting, self._reach, self._slack = meeting, reach, slack
        self._within = reach + 2.0 * slack * (1.0 + NEAREST) / (1.0 - NEAREST)
        nothing = np.zeros(0, dtype=np.int64)
        self._kept = np.full((len(meeting.group), 3), np.inf), nothing, nothing

    def around(self, V: Floats, room: float) -> tuple[Ints, Ints]:
        """Points (m,) and the triangles (m, 3) that are less than `room` [m] from touching with vertices at V."""
        within = self._reach + room
        points, triangles = near(V, V, self._meeting, within)
        corners = self._meeting.faces[triangles]
        close = distances(V, points, corners) < within[points]
        return points[close], corners[close]

    def at(self, V: Floats) -> tuple[Ints, Ints]:
        """Points (m,), ascending, and triangles (m,) that contain all that touch with vertices at V (n_vertices, 3)."""
        where, points, triangles = self._kept
        if not self._serves(where, V):
            points, triangles = near(V, V, self._meeting, self._within)
            close = distances(V, points, self._meeting.faces[triangles]) < self._within[points]
            points, triangles = points[close], triangles[close]
            order = np.lexsort((triangles, points))
            points, triangles = points[order], triangles[order]
            self._kept = V, points, triangles
        return points, triangles

    def between(self, V: Floats, to: Floats) -> tuple[Ints, Ints]:
        """Points (m,) and triangles (m,) that contain all that may meet on straight lines from V to `to`."""
        where, points, triangles = self._kept
        if self._serves(where, V) and self._serves(where, to):
            return points, triangles
        return near(V, to, self._meeting, np.zeros(len(self._within)))

    def _serves(self, where: Floats, V: Floats) -> bool:
        off = V - where
        return bool(np.einsum("vi,vi->v", off, off).max(initial=0.0) <= self._slack**2)
