"""Places in the gradient and in the tangent of the blocks of terms that connect frames with each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern


@dataclass(frozen=True)
class FrameBlocks:
    """Places of the blocks of n elements between frames.

    Attributes
    ----------
    unknown
        The unknowns of each element's frames (n, k), -1 where a frame is fixed.
    place
        Places of the entries of its block's upper triangle in the tangent's long array (n, k, k).
    """

    unknown: Ints
    place: Ints

    def add_gradient(self, reduced: Floats, gradient: Floats) -> None:
        """Add element gradients (n, k) to the gradient on the unknowns."""
        moves = self.unknown >= 0
        np.add.at(reduced, self.unknown[moves], gradient[moves])

    def add_tangent(self, data: Floats, tangent: Floats) -> None:
        """Add element tangents (n, k, k), symmetric, to the tangent's triangle."""
        _add(data, self.place, tangent)


UNPLANNED = FrameBlocks(np.zeros((0, 0), dtype=np.int64), np.zeros((0, 0, 0), dtype=np.int64))


def frame_unknowns(layout: Layout, frames: Ints) -> Ints:
    """The unknowns (n, 6 m) of frames (n, m), -1 where one is fixed."""
    unknown = layout.first_frame_unknown + 6 * frames[:, :, None] + np.arange(6)
    unknown[frames >= layout.n_moving_frames] = -1
    return unknown.reshape(len(frames), 6 * frames.shape[1])


def moving_pairs(layout: Layout, frames: Ints) -> Ints:
    """The pairs (n, 2) of ends that both move."""
    return frames[(frames < layout.n_moving_frames).all(axis=1)]


def frame_blocks(layout: Layout, pattern: Pattern, frames: Ints) -> FrameBlocks:
    """The places of the blocks of elements between frames, looked up once.

    Parameters
    ----------
    layout
        Numbering of points, frames and unknowns.
    pattern
        Sparsity of the tangent.
    frames
        Frames of each element (n, m).
    """
    unknown = frame_unknowns(layout, frames)
    i, j = np.triu_indices(unknown.shape[1])
    low, high = np.minimum(unknown[:, i], unknown[:, j]), np.maximum(unknown[:, i], unknown[:, j])
    place = np.full((len(frames), unknown.shape[1], unknown.shape[1]), -1, dtype=np.int64)
    of_pairs, move = np.full_like(low, -1), low >= 0
    of_pairs[move] = pattern.entry(low[move], high[move])
    place[:, i, j] = of_pairs
    return FrameBlocks(unknown, place)


@kernel(error_model="numpy")
def _add(data: Floats, place: Ints, tangent: Floats) -> None:
    k = place.shape[1]
    for n in range(len(place)):
        for i in range(k):
            for j in range(i, k):
                if place[n, i, j] >= 0:
                    data[place[n, i, j]] += tangent[n, i, j]
